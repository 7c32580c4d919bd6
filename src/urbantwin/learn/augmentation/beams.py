"""Augmentation by sensors with fewer beams: removal of rings, sensors or points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.frames import RINGS

__all__ = ["thinned"]

#: Probability that points are removed.
_OFTEN = 0.5
#: Largest share of single points that is removed where rings are unknown.
_MOST_DROPPED = 0.5


def thinned(ring: NDArray[np.int32], draw: np.random.Generator) -> NDArray[np.bool_]:
    """Return the mask (N,) of points that remain.

    In a quarter of the samples every second, third or fourth ring remains (of all sensors); in a
    tenth one of several sensors is removed, or random points where there are no more than two; in
    15 % a tenth of the points is removed at random (drop-out).

    Args:
        ring: (N,) as in `frames.LevelFrame`.
        draw: random generator.
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
