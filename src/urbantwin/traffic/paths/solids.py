"""Solids: what stands in people's way, joined and as wide as keeps their middles off it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.paths.box_plan import PlanBoxes, rows_near

__all__ = ["Solids"]

#: Room that people keep from what stands in their way, metres, from their middle.
_ROOM_M = 0.4
#: Of what is so near to people's ways the outlines are joined, metres.
_NEAR_M = 12.0
#: Ways are looked at so coarsely for that, metres.
_COARSE_M = 4.0
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
            cells = np.unique(np.round(points / _COARSE_M), axis=0) * _COARSE_M
            tree = shapely.STRtree(shapely.points(cells))
            near = tree.query(shapes, predicate="dwithin", distance=_NEAR_M)[0]
            wide = shapely.buffer(shapes[np.unique(near)], _ROOM_M, quad_segs=2)
            found = [_filled(one, footway) for one in shapely.get_parts(shapely.union_all(wide))]
        self.shapes: NDArray[np.object_] = np.array(found, object)
        shapely.prepare(self.shapes)
        self.tree = shapely.STRtree(self.shapes)
        self._borders = shapely.boundary(self.shapes)

    def way_out(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return which points (N, 2) are in a solid (R,), the way out (R, 2), and how far (R,).

        The ways out are unit vectors, how far is in metres.
        """
        near = rows_near(self.tree, points, np.zeros(len(points)))
        places = shapely.points(points[near])
        row, which = self.tree.query(places, predicate="within")
        line = shapely.shortest_line(places[row], self._borders[which])
        row = near[row]
        way = np.diff(shapely.get_coordinates(line).reshape(-1, 2, 2), axis=1)[:, 0]
        far = np.hypot(*way.T)
        deep = far > 1e-6
        return row[deep], way[deep] / far[deep, None], far[deep]


def _filled(part: shapely.Polygon, footway: shapely.Geometry) -> shapely.Polygon:
    """Return an outline without the courts that nobody walks in."""
    courts = [shapely.Polygon(ring) for ring in part.interiors]
    kept = [
        court.exterior
        for court in courts
        if shapely.intersection(court, footway).area > _COURT * court.area
    ]
    return shapely.Polygon(part.exterior, kept)
