"""Where people on foot are: on footways, neither on lanes that are driven on nor in buildings.

SUMO's walkers cross the walking areas of corners in straight lines and wait anywhere on them. The
areas reach to the middle of curves that vehicles cut, and know nothing of the walls beside them.
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

#: Room that a person takes to each side, metres (Highway Capacity Manual 2010, chapter 4: a body of
#: 0.60 m by 0.50 m).
BODY_M = 0.3
#: Nobody is moved farther, metres: who is farther away is where no footway was found, or where a
#: crossing begins that does not reach one, and would slide.
FARTHEST_M = 1.2
#: So many rows are looked at together.
_ROWS = 1 << 18


class Footways:
    """The room that people have on the lanes of a network.

    Args:
        network: the lanes.
        names: of lanes, by their numbers.
        beyond_m: how far the room goes on beside a lane, where there is a footway.
    """

    def __init__(
        self, network: RoadNetwork, names: Sequence[str], *, beyond_m: float = BODY_M
    ) -> None:
        self._network, self._names, self._beyond_m = network, names, beyond_m
        self._rooms: dict[int, shapely.Geometry | None] = {}

    def way_in(self, lane: NDArray[np.integer], xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return from points on lanes (N, 2) the way into the room there (N, 2), metres.

        It is nan for who is inside, and on lanes that are no footways or have no room for anybody.
        """
        way = np.full(xy.shape, np.nan)
        order = np.argsort(lane, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(lane[order])) + 1):
            room = self._room(int(lane[mine[0]])) if len(mine) else None
            if room is None:
                continue
            away = np.flatnonzero(~shapely.intersects_xy(room, *xy[mine].T))
            if len(away):
                line = shapely.shortest_line(shapely.points(xy[mine[away]]), room)
                ends = shapely.get_coordinates(line).reshape(-1, 2, 2)
                way[mine[away]] = ends[:, 1] - ends[:, 0]
        return way

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
    """Return what SUMO saw with everybody who walks along or waits moved onto the footways.

    Who is on a crossing stays, and who is on what has no room for anybody.

    Args:
        simulated: what SUMO saw.
        demand: the trips that it refers to.
        network: the lanes.
    """
    on_foot = np.array([trip.actor_class == "pedestrian" for trip in demand.trips], np.bool_)
    if not len(simulated.trip):
        return simulated
    rows = np.flatnonzero(on_foot[simulated.trip])
    front = simulated.front.copy()
    footways = Footways(network, simulated.lanes)
    for some in (rows[k : k + _ROWS] for k in range(0, len(rows), _ROWS)):
        way = footways.way_in(simulated.lane[some], front[some])
        near = np.linalg.norm(way, axis=1) <= FARTHEST_M
        front[some[near]] += way[near]
    return replace(simulated, front=front)
