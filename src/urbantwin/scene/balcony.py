"""Balconies that are mapped, as slabs with parapets on every storey that has one."""

from __future__ import annotations

from collections.abc import Mapping

import shapely
from shapely import Geometry, Polygon

from urbantwin.scene.building_height import LEVEL_M, MOST_LEVELS, building_materials
from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Solid
from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["BALCONY", "balcony_parts"]

#: The value of ``building:part`` (OSM wiki, "Tag:building:part=balcony").
BALCONY = "balcony"
#: A slab's thickness, how high and thick its parapet is, metres.
SLAB_M, PARAPET_M, THICK_M = 0.2, 1.0, 0.08
#: No parapet stands nearer to the building than this, metres.
WALL_M = 0.15


def balcony_parts(
    tags: Mapping[str, str],
    plan: Polygon,
    building: Geometry,
    storey_m: float = LEVEL_M,
    levels: float = 1.0,
) -> list[tuple[Solid, str]]:
    """Return slabs and parapets with their materials, heights above the building's ground.

    Args:
        tags: of the balcony: its levels or heights, and its material.
        plan: its area, site frame.
        building: the walls that it hangs on, in plan.
        storey_m: height of the building's storeys.
        levels: storeys of the building, where the balcony's are not mapped.
    """
    low = length_m_of(tags.get("min_height"))
    first = count_of(tags.get("building:min_level")) or 0.0
    low = first * storey_m if low is None else low
    high = length_m_of(tags.get("height"))
    top = (count_of(tags.get("building:levels")) or levels) * storey_m if high is None else high
    floors = int(min(max((top - low) / storey_m + 0.5, 1.0), MOST_LEVELS))
    material = "metal-painted"
    if "building:material" in tags:
        material = building_materials({"building:material": tags["building:material"]}, {})[0]
    open_sides = plan.boundary.difference(building.buffer(WALL_M))
    rail = shapely.intersection(open_sides.buffer(THICK_M, cap_style="flat"), plan)
    found = []
    for number in range(floors):
        floor = max(low + number * storey_m, SLAB_M)
        found += [(slab(one, floor - SLAB_M, floor), "concrete") for one in plain_polygons(plan)]
        sides = plain_polygons(rail, smallest_m2=0.01)
        found += [(slab(one, floor, floor + PARAPET_M), material) for one in sides]
    return found
