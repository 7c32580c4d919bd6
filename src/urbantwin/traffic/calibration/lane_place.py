"""Lateral position of bicycles in a lane, which determines whether cars can overtake."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.paths.lane_below import LanesBelow

__all__ = ["lane_offset"]

#: Speed, m/s, below which a bicycle is about to stop or start; least number of bicycles.
_MIN_RIDING_MS, _MIN_BICYCLES = 2.0, 10
_MIN_SAMPLES = 10


def lane_offset(
    tracks: Sequence[SeenTrack], roads: RoadNetwork, until_s: float
) -> tuple[float | None, int]:
    """Return the lateral offset of bicycles from a lane's middle, metres, and their number.

    Positive towards the middle of the street, negative towards the kerb, for either driving side.
    The median of their medians on lanes shared with cars; ``None`` for fewer than ten.

    Args:
        tracks: all tracks.
        roads: the lanes.
        until_s: only tracks that begin before this time count, seconds.
    """
    below = LanesBelow(roads)
    inwards = -1.0 if roads.driving_side == "left" else 1.0
    offsets_m = []
    for seen in tracks:
        if seen.track.actor_class != "bicycle" or seen.time_s[0] >= until_s:
            continue
        rides = np.abs(seen.speed) >= _MIN_RIDING_MS
        xy, yaw = seen.xy[rides], seen.yaw[rides]
        names = below.at(xy, yaw, "bicycle")
        left: list[float] = []
        for name in sorted(set(names.tolist())):
            lane = roads.lane_by_id.get(str(name))
            if lane is None or not lane.road or "car" not in lane.allowed:
                continue
            on = names == name
            line = shapely.LineString(lane.centre[:, :2])
            station_m = shapely.line_locate_point(line, shapely.points(xy[on]))
            foot = shapely.get_coordinates(shapely.line_interpolate_point(line, station_m))
            beside = xy[on] - foot
            left += (np.cos(yaw[on]) * beside[:, 1] - np.sin(yaw[on]) * beside[:, 0]).tolist()
        if len(left) >= _MIN_SAMPLES:
            offsets_m.append(inwards * float(np.median(left)))
    if len(offsets_m) < _MIN_BICYCLES:
        return None, len(offsets_m)
    return round(float(np.median(offsets_m)), 2), len(offsets_m)
