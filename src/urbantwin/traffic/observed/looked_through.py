"""Who was out of sight for a frame, and who was not there: sensors look through where nobody is.

Two vehicles that follow each other may be taken for one that nobody saw in between. If beams went
through the place where it would have been then, at the height of its doors, it was not there, and
the track is of two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.recording import RecordedFrame
from urbantwin.traffic.observed.association import LARGE_M, SeenTrack
from urbantwin.traffic.observed.box_fit import extents

__all__ = ["looked_through", "parts_in_sight", "seen_length"]

#: Heights above the ground where vehicles are closed, metres: above their sills, below windows.
_LOW_M, _HIGH_M = 0.35, 0.75
#: Half as wide and as deep as the part of a vehicle that is asked about, metres.
_BESIDE_M, _DEEP_M = 0.6, 1.5
#: Half as wide and as deep as the place before an end that must be free, metres.
_END_M = 0.25
#: So much of a length is not seen, metres: bumpers are round, and rings lie apart. Of cars of our
#: own simulation.
_ROUND_M = 0.2
#: So many beams tell.
_FEWEST = 5


def looked_through(
    frame: RecordedFrame,
    sensors: NDArray[np.float64],
    place: NDArray[np.float64],
    ground_m: float,
    *,
    beside_m: float = _BESIDE_M,
    deep_m: float = _DEEP_M,
) -> bool:
    """Return whether more beams of a frame went through the middle of a place than ended there.

    Args:
        frame: of sensors that stand still.
        sensors: (S, 3) where they stand, metres.
        place: (2,) east and north, metres.
        ground_m: height of the ground there.
        beside_m: half as wide as the place is as sensors see it, metres.
        deep_m: half as deep.
    """
    through, met = 0, 0
    for number, at in enumerate(sensors):
        way = place - at[:2]
        distance = float(np.linalg.norm(way))
        if distance < 2 * deep_m:
            continue
        ahead = way / distance
        seen = frame.points[frame.sensor == number] - at
        along = seen[:, :2] @ ahead
        seen, along = seen[along > distance - deep_m], along[along > distance - deep_m]
        share = distance / along
        aside = np.abs(seen[:, 1] * ahead[0] - seen[:, 0] * ahead[1]) * share
        above = at[2] + seen[:, 2] * share - ground_m
        here = (aside < beside_m) & (above > _LOW_M) & (above < _HIGH_M)
        beyond = along > distance + deep_m
        through += int((here & beyond).sum())
        met += int((here & ~beyond).sum())
    return through >= _FEWEST and through > met


def seen_length(
    points: NDArray[np.float64],
    yaw: float,
    frame: RecordedFrame,
    sensors: NDArray[np.float64],
    ground_m: float,
) -> float | None:
    """Return how long a vehicle is, metres; ``None`` where more of it may be hidden.

    Sensors look through the places just before its front and just behind its rear.

    Args:
        points: (N, 2) what one sensor saw of it from above, metres: several that are not
            synchronous see who drives at several places.
        yaw: the way of its longer side, radians.
        frame: in which it was seen.
        sensors: (S, 3) where they stand, metres.
        ground_m: height of the ground there.
    """
    low, high = extents(points, yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    across = (low[1] + high[1]) / 2
    free = all(
        looked_through(
            frame, sensors, turn @ (along, across), ground_m, beside_m=_END_M, deep_m=_END_M
        )
        for along in (low[0] - 2 * _END_M, high[0] + 2 * _END_M)
    )
    return float(high[0] - low[0]) + _ROUND_M if free else None


def parts_in_sight(
    track: SeenTrack, nobody: Callable[[int, NDArray[np.float64]], bool]
) -> Iterator[SeenTrack]:
    """Yield the parts of a vehicle's track between frames in which it was not there.

    Args:
        track: of anybody.
        nobody: whether nobody can have been in a frame, by its number, at a place (2,).
    """
    first = 0
    for k, (last, one) in enumerate(zip(track.seen, track.seen[1:], strict=False), 1):
        if min(last.diagonal, one.diagonal) <= LARGE_M:
            continue
        steps = one.frame - last.frame
        between = (
            (last.frame + step, last.middle + step / steps * (one.middle - last.middle))
            for step in range(1, steps)
        )
        if any(nobody(*moment) for moment in between):
            yield SeenTrack(track.seen[first:k])
            first = k
    yield SeenTrack(track.seen[first:], track.velocity)
