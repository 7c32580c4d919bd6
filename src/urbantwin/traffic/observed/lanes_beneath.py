"""The lanes below points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads import RoadNetwork
from urbantwin.roads.network import Lane

__all__ = ["LanesBeneath"]

#: Margin along the edge of the carriageway without waiting vehicles, where posts stand, metres.
EDGE_M = 0.3
#: Maximum difference of a heading from its lane's, radians.
SAME = np.radians(35.0)


class LanesBeneath:
    """The lanes of vehicles, with their directions.

    Args:
        network: the lanes.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._lanes: list[Lane] = [
            lane for lane in network.lanes if lane.kind in ("driving", "connection")
        ]
        self._tree = shapely.STRtree([lane.polygon for lane in self._lanes])

    @cached_property
    def _area(self) -> shapely.Geometry:
        area = shapely.union_all([lane.polygon for lane in self._lanes]).buffer(-EDGE_M)
        shapely.prepare(area)
        return area

    def cover(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 2 or 3) are over lanes."""
        return np.asarray(shapely.contains_xy(self._area, points[:, 0], points[:, 1]))

    def headings(self, place: NDArray[np.float64], kinds: Sequence[str]) -> list[float]:
        """Return the driving directions at a point (2,), radians."""
        yaws = []
        for number in sorted(self._tree.query(shapely.Point(place), predicate="intersects")):
            lane = self._lanes[number]
            if lane.kind in kinds:
                k = int(np.linalg.norm(lane.centre[:, :2] - place, axis=1).argmin())
                k = min(max(k, 1), len(lane.centre) - 1)
                ahead = lane.centre[k, :2] - lane.centre[k - 1, :2]
                yaws.append(float(np.arctan2(ahead[1], ahead[0])))
        return yaws

    def lane_heading(self, place: NDArray[np.float64], yaw: float) -> float | None:
        """Return the driving direction at a point, if known, nearest to ``yaw``."""
        streets = self.headings(place, ("driving",))
        yaws = streets or self.headings(place, ("connection",))
        if not yaws:
            return None
        # Fitted sides have no front: headings are compared modulo half a turn.
        gap = [abs(float(wrapped(2 * (lane_yaw - yaw))) / 2) for lane_yaw in yaws]
        best = int(np.argmin(gap))
        return yaws[best] if streets or gap[best] < SAME else None
