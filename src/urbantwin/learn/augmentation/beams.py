"""Sensors with fewer beams than the one that recorded: rings and columns are taken away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.frames import RINGS

__all__ = ["thinned"]

#: How often anything is taken away.
_OFTEN = 0.5
#: At most so much of single points, where rings are not known.
_MOST_DROPPED = 0.5


def thinned(ring: NDArray[np.int32], draw: np.random.Generator) -> NDArray[np.bool_]:
    """Return which points (N,) stay.

    Of half of the samples every second, third or fourth ring stays, of all sensors alike, or one
    of the sensors is lost; where no rings are known, points are taken away at random. A tenth of
    the points of another sample is lost one by one: drop-out.

    Args:
        ring: (N,) as `frames.LevelFrame` has it.
        draw: random numbers.
    """
    stays = np.ones(len(ring), bool)
    kind, first, share = draw.random(), int(draw.integers(0, 4)), draw.random()
    if kind < _OFTEN / 2 and (ring >= 0).any():
        keep = 2 + first % 3
        stays &= (ring % RINGS) % keep == first % keep
    elif kind < _OFTEN * 0.7:
        sensors = np.unique(ring[ring >= 0] // RINGS)
        if len(sensors) > 2:
            stays &= ring // RINGS != sensors[first % len(sensors)]
        else:
            stays &= draw.random(len(ring)) > _MOST_DROPPED * share
    elif kind < _OFTEN:
        stays &= draw.random(len(ring)) > 0.1
    return stays
