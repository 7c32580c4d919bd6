"""Where signal poles stand: at the kerb beside each signalised approach's stop line."""

from __future__ import annotations

import math

import numpy as np
import shapely

from urbantwin.roads import RoadNetwork

__all__ = ["signal_places"]

#: Distance of a pole from the carriageway's edge (MUTCD 2009, 4D.16: at least 0.6 m), and how far
#: outwards a free place is looked for where a turning lane or a corner is in the way.
CLEARANCE_M = 0.6
SEARCH_M = 8.0


def signal_places(
    network: RoadNetwork, carriageway: shapely.Geometry
) -> list[tuple[float, float, float]]:
    """Return (x, y, heading of the traffic that it faces) of each pole; metres and radians.

    Args:
        network: the lanes.
        carriageway: where poles may not stand, site frame.
    """
    approaches: dict[tuple[str, str], list[tuple[int, float, float, float]]] = {}
    for signal in network.signals:
        lane = network.lane_by_id[signal.lane]
        if lane.kind in ("driving", "bus", "bicycle") and lane.level == 0:
            number = int(lane.id.rsplit("_", 1)[1])
            approaches.setdefault((signal.program, lane.road), []).append(
                (number, signal.x, signal.y, signal.yaw)
            )
    outward = -1.0 if network.driving_side == "right" else 1.0
    keep_off = shapely.buffer(carriageway, CLEARANCE_M - 0.05)
    shapely.prepare(keep_off)
    places = []
    for _, lanes in sorted(approaches.items()):
        _, x, y, yaw = min(lanes)
        across = np.array([-math.sin(yaw), math.cos(yaw)]) * outward
        for offset in np.arange(1.0, SEARCH_M, 0.25):
            spot = np.array([x, y]) + across * offset
            if not shapely.contains_xy(keep_off, *spot):
                places.append((float(spot[0]), float(spot[1]), yaw))
                break
    return places
