"""Dropped curbs: at crossings the sidewalk slopes down nearly to the carriageway."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads import RoadNetwork
from urbantwin.roads.model import CURB_HEIGHT_M

__all__ = ["LIP_M", "DroppedCurbs"]

#: Remaining height: detectable by a cane, low enough for wheels (DIN 32984: 3 cm).
LIP_M = 0.03
#: Distance over which the sidewalk rises from the crossing to its own height, metres: 8 %, the
#: maximum of ADA 405.2 (1:12) and the UK's Inclusive Mobility 3.13 (8 %).
RAMP_M = 1.5
#: Distance beyond the crossing's marks over which the curb is low, metres.
BESIDE_M = 0.2


class DroppedCurbs:
    """Share of a curb's height that remains at a point.

    Args:
        crossings: areas of pedestrian crossings, site frame.
    """

    def __init__(self, crossings: Iterable[shapely.Geometry] = ()) -> None:
        grown = [shapely.buffer(area, BESIDE_M, join_style="mitre") for area in crossings]
        self._mouths = [area for area in grown if not area.is_empty]
        self._tree = shapely.STRtree(self._mouths)

    @classmethod
    def of_network(cls, network: RoadNetwork, level: int) -> DroppedCurbs:
        """Return the dropped curbs of one level."""
        return cls(
            lane.polygon
            for lane in network.lanes
            if lane.kind == "crossing" and lane.level == level
        )

    def share(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share (N,) of the curb's height that remains at points (N, 2): 1 far away."""
        share = np.ones(len(xy))
        if not self._mouths:
            return share
        points = shapely.points(xy)
        near, mouth = self._tree.query(points, predicate="dwithin", distance=RAMP_M)
        distance = shapely.distance(points[near], np.array(self._mouths, object)[mouth])
        lowest = LIP_M / CURB_HEIGHT_M
        np.minimum.at(share, near, lowest + (1 - lowest) * np.minimum(distance / RAMP_M, 1.0))
        return share

    def lines(self) -> list[shapely.Geometry]:
        """Return the lines where the slope of sidewalks changes; triangles do not cross them."""
        if not self._mouths:
            return []
        mouths = area_union(self._mouths)
        tops = shapely.buffer(mouths, RAMP_M, quad_segs=2)
        return [
            part
            for area in (mouths, tops)
            for part in shapely.get_parts(shapely.boundary(area))
            if part.geom_type == "LineString"
        ]
