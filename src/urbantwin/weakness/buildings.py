"""Findings about buildings: those without a height, and a region without any."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import shapely

from urbantwin.scene.building_height import building_rise
from urbantwin.scene.building_outline import MappedBuilding, mapped_buildings
from urbantwin.weakness.finding import Finding, finding
from urbantwin.weakness.mapped_site import MappedSite, nearness
from urbantwin.weakness.place_in_editor import spot

__all__ = ["building_findings"]

#: What a guess of a building's height is counted as.
_ASSUMED = "height assumed from building type"


def building_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield what is weak about the buildings of the region, as the scene would build them."""
    buildings = mapped_buildings(place.features, place.region, None, Counter())
    # Imported geometry takes the place of the map's buildings, nobody knows yet of how many.
    share = 0.5 if place.site.geometry else 1.0
    if not buildings:
        yield finding("buildings-missing", "no building is mapped in the region", share=share)
        return
    elements = {
        (item.id, item.tags.get("building"), item.tags.get("building:part")): item.kind
        for item in place.features
        if "building" in item.tags or "building:part" in item.tags
    }
    spots, weak, all_of = [], 0.0, 0.0
    for building in buildings:
        plan = building.plan()
        # What a wall hides and shows grows with the side of a house, not with its area.
        weight = plan.area**0.5 * nearness(plan)
        all_of += weight
        if _has_height(building):
            continue
        weak += weight
        tags = building.tags
        kind = elements.get((building.id, tags.get("building"), tags.get("building:part")), "way")
        name = tags.get("name") or " ".join(
            tags[key] for key in ("addr:street", "addr:housenumber") if key in tags
        )
        kinds = tags.get("building", "yes")
        word = "building" if kinds == "yes" else kinds.replace("_", " ")
        shape = max(shapely.get_parts(plan), key=lambda one: one.area)
        element = "" if building.id in place.added else f"{kind}/{building.id}"
        spots.append(spot(place.frame, shape, element=element, name=name or word))
    if spots:
        yield finding(
            "building-heights",
            f"{len(spots)} of {len(buildings)} buildings have neither a height nor storeys",
            share=share * weak / all_of,
            count=len(spots),
            of=len(buildings),
            spots=spots,
        )


def _has_height(building: MappedBuilding) -> bool:
    """Return whether the map tells how high a building or a part of it is."""
    tags = [part for part, _ in building.parts] or [building.tags]
    for one in tags:
        notes: Counter[str] = Counter()
        building_rise(one, building.tags, 100.0, notes)
        if not notes[_ASSUMED]:
            return True
    return False
