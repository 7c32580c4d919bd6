"""Solids: what stands in people's way, joined and as wide as keeps their middles off it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.paths.box_plan import PlanBoxes

__all__ = ["ROOM_M", "Solids"]

#: Room that people keep from what stands in their way, metres, from their middle.
ROOM_M = 0.4
#: Of what is so near to people's ways the outlines are joined, metres.
_NEAR_M = 12.0
#: Ways are looked at so coarsely for that, metres.
_COARSE_M = 4.0
#: So many points are looked at together.
_POINTS = 1 << 17
#: A court is solid that has less footway than this share.
_COURT = 0.2


class Solids:
    """The outlines of walls, posts and furniture near people's ways, with the room they leave.

    A scene's walls are plates, of which each has two sides: one who has come into a house would be
    led on into it. Joined, they have one outside.

    Args:
        blocks: what stands in the way, in plan.
        points: (N, 2) where people walk, site frame.
        footway: where there is footway, there is no solid house.
    """

    def __init__(
        self, blocks: PlanBoxes, points: NDArray[np.float64], footway: shapely.Geometry
    ) -> None:
        found = []
        if len(blocks.yaw) and len(points):
            shapes = blocks.polygons
            # Of all points of an hour at once that would take a hundred megabytes.
            some = [points[k : k + _POINTS] for k in range(0, len(points), _POINTS)]
            every = [np.unique(np.round(one / _COARSE_M), axis=0) for one in some]
            cells = np.unique(np.concatenate(every), axis=0) * _COARSE_M
            tree = shapely.STRtree(shapely.points(cells))
            near = tree.query(shapes, predicate="dwithin", distance=_NEAR_M)[0]
            wide = shapely.buffer(shapes[np.unique(near)], ROOM_M, quad_segs=2)
            found = [_filled(one, footway) for one in shapely.get_parts(shapely.union_all(wide))]
        self.shapes: NDArray[np.object_] = np.array(found, object)
        shapely.prepare(self.shapes)
        self.tree = shapely.STRtree(self.shapes)


def _filled(part: shapely.Polygon, footway: shapely.Geometry) -> shapely.Polygon:
    """Return an outline without the courts that nobody walks in."""
    courts = [shapely.Polygon(ring) for ring in part.interiors]
    kept = [
        court.exterior
        for court in courts
        if shapely.intersection(court, footway).area > _COURT * court.area
    ]
    return shapely.Polygon(part.exterior, kept)
