"""Spawn points of vehicles: on driving lanes, outside junctions, apart from each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.export.carla.frame import carla_transform
from urbantwin.geometry import Pose, stations_of_points
from urbantwin.roads import RoadNetwork

__all__ = ["spawn_points"]

#: From one point of a lane to the next, and from its ends, metres: a bus fits between.
EVERY_M, FROM_END_M = 15.0, 7.5
#: Above the road, so that no wheel starts inside it (CARLA's documentation: 0.5 to 1 m).
ABOVE_M = 0.5
#: The direction of a lane is taken over this length, metres.
REACH_M = 1.0


def spawn_points(network: RoadNetwork) -> list[dict[str, Any]]:
    """Return places for vehicles in CARLA's frame, in the order of the lanes.

    Each has ``location`` (x, y, z, metres) and ``rotation`` (pitch, yaw, roll, degrees), which
    ``carla.Transform`` takes as they are, the ``lane`` it is on, that lane's ``allowed`` classes
    and ``speed_limit_kmh``, and ``at_m`` from the lane's start.
    """
    found = []
    for lane in network.lanes:
        if lane.junction or lane.kind not in ("driving", "bus") or len(lane.centre) < 2:
            continue
        along = stations_of_points(lane.centre[:, :2])
        room = float(along[-1]) - 2 * FROM_END_M
        if room < 0:
            continue
        count = int(room // EVERY_M) + 1
        first = (float(along[-1]) - (count - 1) * EVERY_M) / 2
        for at in first + EVERY_M * np.arange(count):
            behind, here, ahead = (
                np.array([np.interp(s, along, lane.centre[:, k]) for k in range(3)])
                for s in (at - REACH_M, at, at + REACH_M)
            )
            way = ahead - behind
            yaw = np.arctan2(way[1], way[0])
            pitch = -np.arctan2(way[2], np.hypot(way[0], way[1]))
            pose = Pose.from_ypr(here + [0, 0, ABOVE_M], float(yaw), float(pitch))
            found.append(
                {
                    **carla_transform(pose),
                    "lane": lane.id,
                    "at_m": round(float(at), 2),
                    "allowed": list(lane.allowed),
                    "speed_limit_kmh": round(lane.speed_limit * 3.6, 1),
                }
            )
    return found
