"""Where people on foot are: on footways, neither on lanes that are driven on nor in buildings.

SUMO's walkers cross the walking areas of corners in straight lines and wait anywhere on them. The
areas reach to the middle of curves that vehicles cut, and know nothing of the walls beside them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand import Demand
from urbantwin.traffic.simulation import Simulated

__all__ = ["on_footways"]

#: Room that a person takes to each side, metres (Highway Capacity Manual 2010, chapter 4: a body of
#: 0.60 m by 0.50 m).
BODY_M = 0.3
#: Nobody is moved farther, metres: who is farther away is where no footway was found, or where a
#: crossing begins that does not reach one, and would slide.
FARTHEST_M = 1.2


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
    rows = rows[np.argsort(simulated.lane[rows], kind="stable")]
    front = simulated.front.copy()
    for mine in np.split(rows, np.flatnonzero(np.diff(simulated.lane[rows])) + 1):
        if not len(mine):
            continue
        lane = network.lane_by_id.get(simulated.lanes[simulated.lane[mine[0]]])
        if lane is None or lane.kind not in ("sidewalk", "walkingarea"):
            continue
        footway = network.footway(lane.level)
        room = shapely.intersection(lane.polygon.buffer(BODY_M), footway).buffer(-BODY_M)
        points = shapely.points(front[mine])
        away = np.flatnonzero(~shapely.intersects(room, points))
        if room.is_empty or not len(away):
            continue
        line = shapely.shortest_line(points[away], room)
        nearest = shapely.get_coordinates(line).reshape(-1, 2, 2)[:, 1]
        near = shapely.length(line) <= FARTHEST_M
        front[mine[away[near]]] = nearest[near]
    return replace(simulated, front=front)
