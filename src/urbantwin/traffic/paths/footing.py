"""Positions of pedestrians on footways, off the carriageway and out of buildings.

SUMO's pedestrians cross the walking areas of corners in straight lines and wait anywhere on them.
These areas reach into curves that vehicles cut, and ignore adjacent walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["Footways", "on_footways"]

#: Half width of a pedestrian, metres (Highway Capacity Manual 2010, chapter 4: a body of 0.60 m by
#: 0.50 m).
BODY_M = 0.3
#: Maximum correction, metres. Farther off, either no footway was found or a crossing begins that
#: does not reach one, and pedestrians would slide.
FARTHEST_M = 1.2
#: Number of rows processed together.
_ROWS_AT_ONCE = 1 << 18


class Footways:
    """The walkable area of the lanes of a network.

    Args:
        network: the lanes.
        names: names of lanes, by their indices.
        beyond_m: width beside a lane that is included, if it is footway.
    """

    def __init__(
        self, network: RoadNetwork, names: Sequence[str], *, beyond_m: float = BODY_M
    ) -> None:
        self._network, self._names, self._beyond_m = network, names, beyond_m
        self._rooms: dict[int, shapely.Geometry | None] = {}

    def way_in(self, lane: NDArray[np.integer], xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return displacements (N, 2) from points (N, 2) on lanes into the walkable area, metres.

        nan for points inside, and on lanes that are no footways or too narrow.
        """
        displacement = np.full(xy.shape, np.nan)
        order = np.argsort(lane, kind="stable")
        for rows_of_lane in np.split(order, np.flatnonzero(np.diff(lane[order])) + 1):
            room = self._room(int(lane[rows_of_lane[0]])) if len(rows_of_lane) else None
            if room is None:
                continue
            away = np.flatnonzero(~shapely.intersects_xy(room, *xy[rows_of_lane].T))
            if len(away):
                line = shapely.shortest_line(shapely.points(xy[rows_of_lane[away]]), room)
                ends = shapely.get_coordinates(line).reshape(-1, 2, 2)
                displacement[rows_of_lane[away]] = ends[:, 1] - ends[:, 0]
        return displacement

    def _room(self, number: int) -> shapely.Geometry | None:
        if number not in self._rooms:
            room = None
            lane = self._network.lane_by_id.get(self._names[number])
            if lane is not None and lane.kind in ("sidewalk", "walkingarea"):
                footway = self._network.footway(lane.level)
                room = shapely.intersection(lane.polygon.buffer(self._beyond_m), footway)
                room = room.buffer(-BODY_M)
                room = None if room.is_empty else room
                if room is not None:
                    shapely.prepare(room)
            self._rooms[number] = room
        return self._rooms[number]


def on_footways(simulated: Simulated, demand: Demand, network: RoadNetwork) -> Simulated:
    """Return SUMO's output with pedestrians moved onto the footways.

    Pedestrians on crossings, and on lanes without sufficient width, stay.

    Args:
        simulated: SUMO's output.
        demand: the trips that it refers to.
        network: the lanes.
    """
    on_foot = np.array([trip.actor_class == "pedestrian" for trip in demand.trips], np.bool_)
    if not len(simulated.trip):
        return simulated
    rows = np.flatnonzero(on_foot[simulated.trip])
    front = simulated.front.copy()
    footways = Footways(network, simulated.lanes)
    for part_rows in (rows[k : k + _ROWS_AT_ONCE] for k in range(0, len(rows), _ROWS_AT_ONCE)):
        displacement = footways.way_in(simulated.lane[part_rows], front[part_rows])
        is_near = np.linalg.norm(displacement, axis=1) <= FARTHEST_M
        front[part_rows[is_near]] += displacement[is_near]
    return replace(simulated, front=front)
