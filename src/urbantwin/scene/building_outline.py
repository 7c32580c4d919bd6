"""Outlines of mapped buildings, their parts, and entrances and other marks on their walls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import shapely
from shapely import Geometry, MultiPolygon, Polygon

from urbantwin.scene.building_height import ROOF_TYPES, building_type
from urbantwin.scene.extrusion import clean_polygons
from urbantwin.site.extract import OsmFeature

__all__ = ["MappedBuilding", "building_footprints", "mapped_buildings"]

#: Maximum distance of a balcony from its building, metres.
BESIDE_M = 0.5


@dataclass
class MappedBuilding:
    """An outline with the building parts in it.

    Attributes:
        id: id of its feature in the map.
        tags: tags of the outline.
        footprints: the outline's polygons, site frame.
        parts: tags and polygon of every part.
        balconies: polygons of mapped balconies: not part of the plan, and not drawn.
    """

    id: int
    tags: dict[str, str]
    footprints: list[Polygon]
    parts: list[tuple[dict[str, str], Polygon]] = field(default_factory=list)
    balconies: list[Polygon] = field(default_factory=list)

    def plan(self) -> Geometry:
        """Return the whole footprint."""
        return shapely.union_all([*self.footprints, *(polygon for _, polygon in self.parts)])


def building_footprints(features: Iterable[OsmFeature]) -> list[Polygon]:
    """Return the footprints of buildings on the ground, which other objects must avoid."""
    return [
        polygon
        for feature in features
        if _is_drawn(feature.tags, "building") and building_type(feature.tags) not in ROOF_TYPES
        for polygon in clean_polygons(feature.geometry)
    ]


def mapped_buildings(
    features: Sequence[OsmFeature],
    region: Polygon,
    without: Geometry | None,
    notes: Counter[str],
) -> list[MappedBuilding]:
    """Collect outlines and assign every part to its outline.

    Args:
        features: the map's features, site frame.
        region: buildings that do not touch it are left out.
        without: buildings with more than half of their area in it are left out.
        notes: counter of buildings left out, by reason.
    """
    outlines = _outlines(features, notes)
    kept = []
    for building in outlines:
        plans = [*building.footprints, *(polygon for _, polygon in building.parts)]
        if not any(region.intersects(polygon) for polygon in plans):
            continue
        if without is not None and without.intersects(building.plan()):
            plan = building.plan()
            if plan.intersection(without).area > 0.5 * plan.area:
                notes["buildings left to imported geometry"] += 1
                continue
        kept.append(building)
    return kept


def _is_drawn(tags: dict[str, str], key: str) -> bool:
    """Return whether a feature is a building (or a part) above the ground."""
    if tags.get(key, "no") == "no":
        return False
    if tags.get("location") == "underground" or tags.get("building") == "underground":
        return False
    return not tags.get("layer", "0").strip().startswith("-")


def _outlines(features: Sequence[OsmFeature], notes: Counter[str]) -> list[MappedBuilding]:
    outlines: list[MappedBuilding] = []
    parts: list[tuple[int, dict[str, str], Polygon]] = []
    for feature in features:
        key = "building:part" if "building:part" in feature.tags else "building"
        if "building" in feature.tags and feature.tags["building"] != "no":
            key = "building"
        if key not in feature.tags:
            continue
        if not _is_drawn(feature.tags, key):
            notes["not drawn (underground or mapped as no building)"] += 1
            continue
        if not isinstance(feature.geometry, Polygon | MultiPolygon):
            continue  # entrances and similar features, mapped as nodes
        polygons = clean_polygons(feature.geometry)
        if not polygons:
            notes["footprints without area, dropped"] += 1
        elif key == "building":
            outlines.append(MappedBuilding(feature.id, feature.tags, polygons))
        else:
            parts += [(feature.id, feature.tags, polygon) for polygon in polygons]
    return _with_parts(_without_twins(outlines, notes), parts, notes)


def _with_parts(
    outlines: list[MappedBuilding],
    parts: Sequence[tuple[int, dict[str, str], Polygon]],
    notes: Counter[str],
) -> list[MappedBuilding]:
    """Assign parts and balconies to their outlines."""
    tree = shapely.STRtree([MultiPolygon(outline.footprints) for outline in outlines])
    for identity, tags, polygon in parts:
        if tags["building:part"] == "balcony":
            beside = tree.query_nearest(polygon, max_distance=BESIDE_M, all_matches=False)
            notes["balconies, not drawn"] += 1
            for number in beside.tolist():
                outlines[number].balconies.append(polygon)
            continue
        owner, most = None, 0.5 * polygon.area
        for k in sorted(tree.query(polygon).tolist()):
            shared = polygon.intersection(tree.geometries[k]).area
            if shared > most:
                owner, most = outlines[k], shared
        if owner is None:
            notes["parts without a building around them"] += 1
            owner = MappedBuilding(identity, tags, [])
            outlines.append(owner)
        owner.parts.append((tags, polygon))
    return outlines


def _without_twins(outlines: list[MappedBuilding], notes: Counter[str]) -> list[MappedBuilding]:
    """Drop outlines mapped twice: as a relation and again as its outer way."""
    if not outlines:
        return []
    filled = [
        shapely.union_all([Polygon(p.exterior) for p in outline.footprints]) for outline in outlines
    ]
    tree = shapely.STRtree(filled)
    dropped: set[int] = set()
    for first, second in sorted(map(tuple, tree.query(filled, predicate="intersects").T.tolist())):
        if first >= second or first in dropped or second in dropped:
            continue
        shared = filled[first].intersection(filled[second]).area
        if shared > 0.97 * max(filled[first].area, filled[second].area):
            # The outline with courtyards is preferred; otherwise the later, as relations come last.
            holes = [sum(len(p.interiors) for p in outlines[k].footprints) for k in (first, second)]
            dropped.add(second if holes[0] > holes[1] else first)
            notes["outlines mapped twice, dropped"] += 1
    return [outline for k, outline in enumerate(outlines) if k not in dropped]
