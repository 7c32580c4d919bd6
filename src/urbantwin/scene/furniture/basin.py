"""Fountains that are mapped as areas: a rim around a level sheet of water."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Assembly, GroundHeight

__all__ = ["add_basin"]

RIM_M, RIM_HIGH_M, WATER_BELOW_M, BURIED_M = 0.3, 0.45, 0.12, 0.3


def add_basin(assembly: Assembly, area: Polygon, ground_height: GroundHeight) -> bool:
    """Add a basin: a rim 0.3 m thick, water 0.12 m below its top; return whether it has one."""
    outer = plain_polygons(area.simplify(0.05), smallest_m2=0.5)
    if not outer:
        return False
    ground = ground_height(shapely.get_coordinates(outer))
    ground = ground[np.isfinite(ground)]
    level = float(ground.max()) if len(ground) else 0.0
    low = (float(ground.min()) if len(ground) else 0.0) - BURIED_M
    part = assembly.new_part()
    for shape in outer:
        pools = plain_polygons(shape.buffer(-RIM_M, join_style="mitre"), smallest_m2=0.2)
        rims = plain_polygons(shapely.difference(shape, shapely.union_all(pools)))
        for rim in rims:
            solid = slab(rim, low, level + RIM_HIGH_M)
            assembly.add(solid, "other-structure", "stone", part)
        for pool in pools:
            sheet = slab(pool, low, level + RIM_HIGH_M - WATER_BELOW_M)
            assembly.add(sheet, "other-ground", "water", part)
    return True
