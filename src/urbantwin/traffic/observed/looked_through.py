"""Free-space checks: whether a vehicle can have been at a place in a frame.

Two vehicles that follow each other may be associated to one track with a missing frame. If beams
passed through the interpolated place in that frame, at the height of doors, no vehicle was there,
and the track is split.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.recording import RecordedFrame
from urbantwin.traffic.observed.association import LARGE_M, SeenTrack
from urbantwin.traffic.observed.box_fit import extents

__all__ = ["looked_through", "parts_in_sight", "seen_length"]

#: Heights above the ground at which vehicles are closed, metres: above sills, below windows.
_MIN_HEIGHT_M, _MAX_HEIGHT_M = 0.35, 0.75
#: Half width and half depth of the part of a vehicle that is checked, metres.
_HALF_WIDTH_M, _HALF_DEPTH_M = 0.6, 1.5
#: Half width and half depth of the free space beyond an end, metres.
_END_HALF_SIZE_M = 0.25
#: Length that is not visible, metres, because bumpers are round and rings far apart; measured on
#: cars of UrbanTwin's simulation.
_ROUND_M = 0.2
#: Least number of beams.
_MIN_BEAMS = 5


def looked_through(
    frame: RecordedFrame,
    sensors: NDArray[np.float64],
    place: NDArray[np.float64],
    ground_m: float,
    *,
    beside_m: float = _HALF_WIDTH_M,
    deep_m: float = _HALF_DEPTH_M,
) -> bool:
    """Return whether more beams of a frame passed through a place than ended there.

    Args:
        frame: frame of stationary sensors.
        sensors: (S, 3) their positions, metres.
        place: (2,) the place, metres.
        ground_m: height of the ground there, metres.
        beside_m: half width of the place as seen from a sensor, metres.
        deep_m: half depth, metres.
    """
    through, ended = 0, 0
    for number, origin in enumerate(sensors):
        to_place = place - origin[:2]
        distance = float(np.linalg.norm(to_place))
        if distance < 2 * deep_m:
            continue
        ahead = to_place / distance
        seen = frame.points[frame.sensor == number] - origin
        along = seen[:, :2] @ ahead
        seen, along = seen[along > distance - deep_m], along[along > distance - deep_m]
        share = distance / along
        lateral_m = np.abs(seen[:, 1] * ahead[0] - seen[:, 0] * ahead[1]) * share
        above = origin[2] + seen[:, 2] * share - ground_m
        in_window = (lateral_m < beside_m) & (above > _MIN_HEIGHT_M) & (above < _MAX_HEIGHT_M)
        beyond = along > distance + deep_m
        through += int((in_window & beyond).sum())
        ended += int((in_window & ~beyond).sum())
    return through >= _MIN_BEAMS and through > ended


def seen_length(
    points: NDArray[np.float64],
    yaw: float,
    frame: RecordedFrame,
    sensors: NDArray[np.float64],
    ground_m: float,
) -> float | None:
    """Return the length of a vehicle, metres; ``None`` if more of it may be hidden.

    Beams pass through the places just before its front and just behind its rear.

    Args:
        points: (N, 2) its points in plan from one sensor, metres: sensors that are not synchronised
            see a moving vehicle at several places.
        yaw: direction of its longer side, radians.
        frame: the frame.
        sensors: (S, 3) positions of the sensors, metres.
        ground_m: height of the ground there, metres.
    """
    low, high = extents(points, yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    across = (low[1] + high[1]) / 2
    free = all(
        looked_through(
            frame,
            sensors,
            turn @ (along, across),
            ground_m,
            beside_m=_END_HALF_SIZE_M,
            deep_m=_END_HALF_SIZE_M,
        )
        for along in (low[0] - 2 * _END_HALF_SIZE_M, high[0] + 2 * _END_HALF_SIZE_M)
    )
    return float(high[0] - low[0]) + _ROUND_M if free else None


def parts_in_sight(
    track: SeenTrack, nobody: Callable[[int, NDArray[np.float64]], bool]
) -> Iterator[SeenTrack]:
    """Yield the parts of a vehicle's track between frames in which it cannot have been there.

    Args:
        track: the track.
        nobody: returns whether no vehicle can have been at a place (2,) in a frame, by its number.
    """
    first = 0
    for k, (last, current) in enumerate(zip(track.seen, track.seen[1:], strict=False), 1):
        if min(last.diagonal, current.diagonal) <= LARGE_M:
            continue
        steps = current.frame - last.frame
        between = (
            (last.frame + step, last.middle + step / steps * (current.middle - last.middle))
            for step in range(1, steps)
        )
        if any(nobody(*moment) for moment in between):
            yield SeenTrack(track.seen[first:k])
            first = k
    yield SeenTrack(track.seen[first:], track.velocity)
