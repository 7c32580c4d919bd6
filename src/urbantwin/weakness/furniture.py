"""Findings about what stands beside streets: lamps, poles and trees."""

from __future__ import annotations

from collections.abc import Iterator

import shapely

from urbantwin.site.corrections import AddPole, AddTree
from urbantwin.weakness.finding import Finding, finding
from urbantwin.weakness.mapped_site import MappedSite
from urbantwin.weakness.place_in_editor import spot

__all__ = ["furniture_findings"]

#: Kinds of poles of corrections that are lamps or carry wires.
_POLES = ("lamp", "utility")
_TREES = ("tree", "tree_row", "tree_group", "wood", "scrub")


def furniture_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield kinds of things of which none is mapped in the region, or added by a correction."""
    added = [one.asked for one in place.corrections]
    here = [spot(place.frame, shapely.Point(0.0, 0.0), name="the anchor")]
    tags = [item.tags for item in place.features]
    if not any(isinstance(one, AddTree) for one in added) and not any(
        one.get("natural") in _TREES or one.get("landuse") == "forest" for one in tags
    ):
        yield finding("trees-missing", "no tree is mapped in the region", spots=here)
    if not any(isinstance(one, AddPole) and one.kind in _POLES for one in added) and not any(
        one.get("highway") == "street_lamp"
        or one.get("power") in ("pole", "tower", "catenary_mast")
        or one.get("man_made") in ("street_lamp", "utility_pole")
        for one in tags
    ):
        lit = [street for street in place.streets if street.way.tags.get("lit") == "no"]
        share = 1.0 - len(lit) / max(len(place.streets), 1)
        if share > 0:
            problem = "neither street lamps nor poles are mapped in the region"
            yield finding("lamps-missing", problem, share=share, spots=here)
