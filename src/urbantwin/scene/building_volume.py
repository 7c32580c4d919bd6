"""Volumes of a mapped building: outline and parts with their heights and roofs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon

from urbantwin.scene.building_height import (
    ROOF_TYPES,
    Rise,
    building_materials,
    building_rise,
    building_type,
)
from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.extrusion import Body, clean_polygons
from urbantwin.scene.roof import RoofTags, roof_facets, roof_span, roof_tags
from urbantwin.scene.tag_values import count_of

__all__ = ["Volume", "building_volumes"]

#: A roof without walls is a slab of this thickness, metres.
SLAB_M = 0.3
#: Minimum height of walls under a roof of assumed height, metres.
WALL_M = 2.2
#: Maximum share of its building's height of a roof of assumed height.
ROOF_SHARE = 0.45
#: Height of each mapped storey under a roof of assumed height, if at least the second height is
#: left for the roof, metres.
LOW_STOREY_M, LOWEST_ROOF_M = 2.5, 0.8
#: Storeys are between these heights, metres.
LOWEST_STOREY_M, HIGHEST_STOREY_M = 2.2, 6.0


@dataclass(frozen=True)
class Volume:
    """A body in heights above the building's lowest ground, with its materials.

    Attributes:
        body: the body.
        tags: tags of the outline or the part.
        materials: names of the materials of walls and roof.
        is_roof: whether it is a roof without walls, on posts.
        storey_m: height of a storey.
        eaves_m: height of the top of its walls.
    """

    body: Body
    tags: Mapping[str, str]
    materials: tuple[str, str]
    is_roof: bool
    storey_m: float
    eaves_m: float


def building_volumes(building: MappedBuilding, notes: Counter[str]) -> list[Volume]:
    """Return the bodies of a building.

    Parts and balconies replace the outline where they are. The rest of the outline is built from
    the outline's own tags, with a level top if it is less than two thirds of the outline.
    """
    volumes = []
    area = sum(p.area for p in building.footprints)
    top = 0.0
    own_notes = notes if not building.parts else Counter[str]()
    if building.footprints:
        rise = building_rise(building.tags, {}, area, own_notes)
        top = rise.high_m
    replaced = list(building.balconies)
    for tags, polygon in building.parts:
        part_rise = building_rise(tags, building.tags, polygon.area, notes)
        volumes.append(_volume(polygon, tags, building.tags, part_rise, notes))
        if part_rise.low_m < top - 0.5:  # otherwise it is on the roof of its building
            replaced.append(polygon)
    if building.footprints and volumes and replaced:
        rise = _rise_of_rest(rise, volumes, notes)
    for polygon in building.footprints:
        rest = [polygon]
        if replaced:
            # Opened by 15 cm: slits between parts that are drawn a little apart are dropped.
            left = shapely.difference(polygon, shapely.union_all(replaced))
            left = left.buffer(-0.15, join_style="mitre").buffer(0.15, join_style="mitre")
            rest = clean_polygons(left, smallest_m2=2.0, thinnest_m=0.5)
        for piece in rest:
            whole = piece.area > 2 / 3 * polygon.area
            own = building.tags if whole else _without_roof(building.tags)
            volumes.append(_volume(piece, own, {}, rise, own_notes))
    return volumes


def _rise_of_rest(rise: Rise, parts: Sequence[Volume], notes: Counter[str]) -> Rise:
    """Return the rise of the part of an outline without building parts.

    If a part has the height of the outline's tags, that height is the whole building's. The rest of
    the outline then has the height of most of the parts.
    """
    tops = np.array([part.body.high for part in parts])
    if tops.max() < rise.high_m - 0.5:
        return rise
    area = np.array([part.body.footprint.area for part in parts])
    order = np.argsort(tops, kind="stable")
    middle = int(np.searchsorted(np.cumsum(area[order]), area.sum() / 2))
    usual = float(tops[order[middle]])
    if usual >= rise.high_m - 0.5 or usual <= rise.low_m + WALL_M:
        return rise
    notes["outlines built as high as most of their parts"] += 1
    return replace(rise, high_m=usual, eaves_m=None)


def _volume(
    polygon: Polygon,
    tags: Mapping[str, str],
    outline_tags: Mapping[str, str],
    rise: Rise,
    notes: Counter[str],
) -> Volume:
    is_roof = building_type(tags) in ROOF_TYPES
    roof = roof_tags(tags, notes)
    footprint = _snapped(polygon) if roof.shape != "flat" else polygon
    low, high, eaves = rise.low_m, rise.high_m, rise.high_m
    facets = []
    if roof.shape != "flat":
        levels = count_of(tags.get("building:levels")) or 0.0
        height = _roof_height(roof, roof_span(roof.shape, footprint, tags), rise, levels, notes)
        facets = roof_facets(roof.shape, footprint, tags, height, notes)
        if facets:
            notes[f"{roof.shape} roofs"] += 1
            high = (rise.eaves_m if rise.eaves_m is not None else high - height) + height
            eaves = high - height
    if is_roof and low == 0.0:
        low = max(eaves - SLAB_M, 0.5 * eaves)
    body = Body(
        footprint, low, high, tuple(facet.placed(1.0, eaves) for facet in facets), eaves=eaves
    )
    materials = building_materials(tags, outline_tags)
    return Volume(body, tags, materials, is_roof, _storey(tags, rise, eaves), eaves)


def _storey(tags: Mapping[str, str], rise: Rise, eaves_m: float) -> float:
    """Return the height of the storeys under a roof."""
    levels = count_of(tags.get("building:levels"))
    if levels and LOWEST_STOREY_M <= eaves_m / levels <= HIGHEST_STOREY_M:
        return eaves_m / levels
    return rise.storey_m


def _roof_height(
    roof: RoofTags, span_m: float, rise: Rise, levels: float, notes: Counter[str]
) -> float:
    """Return the height of a sloped roof, limited to the available height."""
    height = roof.rise_m(span_m)
    said = roof.height_m is not None or roof.pitch_deg is not None
    if not said:
        notes["height of a roof assumed"] += 1
    if rise.eaves_m is not None:
        return height
    room = rise.high_m - rise.low_m
    if not said and room > WALL_M + 0.5:
        storeys = min(levels * LOW_STOREY_M, room - LOWEST_ROOF_M)
        room = min(room - max(WALL_M, storeys), ROOF_SHARE * room)
    if height > room and said:
        notes["roofs lowered: higher than their building"] += 1
    return min(height, room)


def _snapped(polygon: Polygon) -> Polygon:
    """Snap a footprint to a grid of a centimetre, so that its roof's creases fit it."""
    snapped = shapely.set_precision(shapely.set_precision(polygon, 0.01), 0)
    return snapped if isinstance(snapped, Polygon) and not snapped.is_empty else polygon


def _without_roof(tags: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in tags.items() if not key.startswith("roof:")} | {
        key: tags[key] for key in ("roof:material",) if key in tags
    }
