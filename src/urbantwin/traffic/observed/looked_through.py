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

__all__ = ["looked_through", "parts_in_sight"]

#: Heights above the ground where vehicles are closed, metres: above their sills, below windows.
_LOW_M, _HIGH_M = 0.35, 0.75
#: Half as wide and as deep as the part of a vehicle that is asked about, metres.
_BESIDE_M, _DEEP_M = 0.6, 1.5
#: So many beams tell.
_FEWEST = 5


def looked_through(
    frame: RecordedFrame,
    sensors: NDArray[np.float64],
    place: NDArray[np.float64],
    ground_m: float,
) -> bool:
    """Return whether more beams of a frame went through the middle of a place than ended there.

    Args:
        frame: of sensors that stand still.
        sensors: (S, 3) where they stand, metres.
        place: (2,) east and north, metres.
        ground_m: height of the ground there.
    """
    through, met = 0, 0
    for number, at in enumerate(sensors):
        way = place - at[:2]
        distance = float(np.linalg.norm(way))
        if distance < 2 * _DEEP_M:
            continue
        ahead = way / distance
        seen = frame.points[frame.sensor == number] - at
        along = seen[:, :2] @ ahead
        seen, along = seen[along > distance - _DEEP_M], along[along > distance - _DEEP_M]
        share = distance / along
        aside = np.abs(seen[:, 1] * ahead[0] - seen[:, 0] * ahead[1]) * share
        above = at[2] + seen[:, 2] * share - ground_m
        here = (aside < _BESIDE_M) & (above > _LOW_M) & (above < _HIGH_M)
        beyond = along > distance + _DEEP_M
        through += int((here & beyond).sum())
        met += int((here & ~beyond).sum())
    return through >= _FEWEST and through > met


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
