"""Water levels: level, below the land around."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.water.plan import WaterBody

__all__ = ["water_level", "with_water"]

#: Points this near to a body's border are on it: the ground's vertices are snapped, metres.
SNAP_M = 0.03
#: An elevation model shows water that lies this far below its shore, metres.
SHOWN_M = 0.3


def water_level(body: WaterBody, region: Polygon, terrain_height: GroundHeight) -> float:
    """Return the height of a body's surface, metres.

    Where the elevation model has the water below its shore: its median on the water. Else below
    the lower parts of the shore by what is usual.
    """
    near = shapely.intersection(body.area, region.buffer(25.0))
    near = body.area if near.is_empty else near
    shore = _sampled(body.area.boundary, region)
    land = np.percentile(terrain_height(shore), 20) if len(shore) else 0.0
    west, south, east, north = near.bounds
    x, y = np.meshgrid(np.linspace(west, east, 24)[1:-1], np.linspace(south, north, 24)[1:-1])
    spots = np.column_stack([x.ravel(), y.ravel()])
    spots = spots[shapely.contains_xy(near.buffer(-1.0), spots[:, 0], spots[:, 1])]
    if len(spots):
        seen = float(np.median(terrain_height(spots)))
        if land - seen > SHOWN_M:
            return seen
    return float(land) - body.below


def _sampled(line: Geometry, region: Polygon) -> NDArray[np.float64]:
    """Return points (N, 2) every 5 m of a shore in and about a region."""
    part = shapely.intersection(line, region.buffer(25.0))
    part = line if part.is_empty else part
    return np.asarray(shapely.get_coordinates(shapely.segmentize(part, 5.0)), np.float64)


def with_water(
    terrain_height: GroundHeight, bodies: Sequence[WaterBody], region: Polygon
) -> GroundHeight:
    """Return heights of the bare earth with water lying level in it.

    Args:
        terrain_height: heights of the bare earth at (N, 2) points.
        bodies: the waters.
        region: where the shore counts.
    """
    if not bodies:
        return terrain_height
    areas = [body.area.buffer(SNAP_M) for body in bodies]
    for area in areas:
        shapely.prepare(area)
    levels = [water_level(body, region, terrain_height) for body in bodies]

    def height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        z = np.array(terrain_height(xy), np.float64)
        for body, area, level in zip(bodies, areas, levels, strict=True):
            within = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
            z[within] = z[within] - body.below if body.follows else level
        return z

    return height
