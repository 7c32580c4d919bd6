"""The lane of an actor, from its position, heading and class."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import Lane, RoadNetwork
from urbantwin.taxonomy import road_user

__all__ = ["LanesBelow"]

#: Cost of a lane that the actor may not use, relative to radians of turn and metres off its middle.
_FORBIDDEN_COST = 4.0
_OFF_MIDDLE_PER_M = 0.3
_LEVEL_PER_M = 1.0
_PEDESTRIAN_LANE_KINDS = ("sidewalk", "crossing", "walkingarea")
_UNUSED_KINDS = ("curb", "median", "island")


@dataclass(frozen=True, eq=False)
class LanesBelow:
    """The lanes of a network, queried by position."""

    roads: RoadNetwork
    _lanes: list[Lane] = field(init=False)
    _tree: shapely.STRtree = field(init=False)

    def __post_init__(self) -> None:
        lanes = [lane for lane in self.roads.lanes if lane.kind not in _UNUSED_KINDS]
        object.__setattr__(self, "_lanes", lanes)
        object.__setattr__(self, "_tree", shapely.STRtree([lane.polygon for lane in lanes]))

    def at(
        self,
        xy: NDArray[np.float64],
        yaw: NDArray[np.float64],
        actor_class: str,
        z: NDArray[np.float64] | None = None,
    ) -> NDArray[np.object_]:
        """Return the id of the lane (N,) below each pose of an actor; empty beside all lanes.

        Of several lanes, it prefers one that the actor may use, in its direction, near its middle
        and at its height.

        Args:
            xy: (N, 2) positions, site frame, metres.
            yaw: (N,) headings, rad; ignored for pedestrians.
            actor_class: class of the actor.
            z: (N,) heights, if known, metres.
        """
        lane_ids = np.full(len(xy), "", object)
        point, number = self._tree.query(shapely.points(xy), predicate="intersects")
        if not len(point):
            return lane_ids
        cost = np.empty(len(point))
        walks = actor_class == "pedestrian"
        user = road_user(actor_class)
        for lane_number in np.unique(number):
            candidates = np.flatnonzero(number == lane_number)
            lane = self._lanes[lane_number]
            pose = point[candidates]
            # Walking areas have no line of their own: they are used if there is no other lane.
            allowed = user in lane.allowed and (lane.kind in _PEDESTRIAN_LANE_KINDS) == walks
            cost[candidates] = 0.0 if allowed else _FORBIDDEN_COST
            if lane.kind != "walkingarea" and len(lane.centre) > 1:
                away, turned = _distances_from(lane.centre[:, :2], xy[pose], yaw[pose])
                cost[candidates] += _OFF_MIDDLE_PER_M * away + (0.0 if walks else turned)
            else:
                cost[candidates] += 1.0
            if z is not None:
                cost[candidates] += _LEVEL_PER_M * np.abs(
                    self.roads.height(lane.id, xy[pose]) - z[pose]
                )
        order = np.lexsort([number, cost, point])
        first = order[np.concatenate([[True], np.diff(point[order]) != 0])]
        names = np.array([lane.id for lane in self._lanes], object)
        lane_ids[point[first]] = names[number[first]]
        return lane_ids


def _distances_from(
    line: NDArray[np.float64], xy: NDArray[np.float64], yaw: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distances of points from a line, metres, and heading differences from it."""
    string, points = shapely.LineString(line), shapely.points(xy)
    along = np.asarray(shapely.line_locate_point(string, points))
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    segment = np.searchsorted(np.cumsum(step), along, side="right").clip(0, len(step) - 1)
    direction = np.diff(line, axis=0)[segment]
    turned = np.angle(np.exp(1j * (yaw - np.arctan2(direction[:, 1], direction[:, 0]))))
    return np.asarray(shapely.distance(string, points)), np.abs(turned)
