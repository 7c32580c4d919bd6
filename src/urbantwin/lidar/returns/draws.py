"""Random numbers of rays: counter-based, so that order and number of workers do not matter.

Ray n of a sensor in a frame has the same two numbers per purpose whatever else is computed, in any
order: Philox (Salmon et al. 2011, SC11, "Parallel random numbers: as easy as 1, 2, 3") keyed with
seed, sensor and frame, with the purpose in its counter.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

__all__ = [
    "LEVELS",
    "Draws",
    "Purpose",
    "TurnDraws",
    "draw",
    "standard_noise",
    "standard_quantiles",
    "truncated_noise",
]

#: Number of equally likely levels of a draw.
LEVELS = 1 << 16


class Purpose(IntEnum):
    """Purpose of random numbers: turning an effect off does not change the draws of others."""

    FIRST_ECHO = 0
    SECOND_ECHO = 1
    CLUTTER = 2
    BLOOMING = 3
    CROSSTALK = 4
    ADDED = 5
    MISSING = 6
    MEASURED = 7
    STIRRING = 8


class Draws(NamedTuple):
    """Two numbers for each of N rays.

    Attributes:
        detection: (N,) uint16, uniform; a ray returns where it is below 65,536 p.
        noise: (N,) uint16, uniform; quantile of the noise, of 65,536.
    """

    detection: NDArray[np.uint16]
    noise: NDArray[np.uint16]


class TurnDraws(NamedTuple):
    """Random draws of the N beams of a turn.

    Attributes:
        first: draws of the first echoes.
        second: draws of the second echoes; those of the first if the sensor reports one per beam.
        dead: (N,) bool, beams that report nothing; (0,) for none.
        quantiles: see `standard_quantiles`.
    """

    first: Draws
    second: Draws
    dead: NDArray[np.bool_]
    quantiles: NDArray[np.float32]


def draw(
    seed: int, sensor: int, frame: int, rays: int, purpose: Purpose = Purpose.FIRST_ECHO
) -> Draws:
    """Return the draws of one sensor in one frame for one purpose."""
    key = np.array([seed % 2**64, (sensor << 48) | frame], np.uint64)
    counter = np.array([0, 0, 0, int(purpose)], np.uint64)
    words = np.random.Philox(key=key, counter=counter).random_raw((rays + 1) // 2)
    levels = words.astype("<u8", copy=False).view("<u2")
    return Draws(levels[:rays], levels[rays : 2 * rays])


def standard_noise(noise: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return standard normal numbers (N,) by draw: the medians of 65,536 equal shares."""
    return standard_quantiles().take(noise)


def truncated_noise(
    noise: NDArray[np.uint16], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return standard normal numbers (N,) truncated to [low, high].

    A draw inside is kept. One outside is uniform over its tail and is mapped to the inside by the
    inverse distribution, which gives exactly the distribution of repeated drawing.

    Args:
        noise: (N,) draws.
        low: (N,) not above 0.
        high: (N,) not below 0.
    """
    uniform = (noise.astype(np.float64) + 0.5) / LEVELS
    below, above = ndtr(low), ndtr(high)
    left, right = uniform < below, uniform > above
    tail = np.divide(uniform, below, out=np.zeros_like(uniform), where=left)
    np.divide(uniform - above, 1 - above, out=tail, where=right)
    chosen = np.where(left | right, below + tail * (above - below), uniform)
    return np.asarray(np.clip(ndtri(chosen), low, high))


@cache
def standard_quantiles() -> NDArray[np.float32]:
    """Return the standard normal number of each of the 65,536 draws."""
    return np.asarray(ndtri((np.arange(LEVELS) + 0.5) / LEVELS), np.float32)
