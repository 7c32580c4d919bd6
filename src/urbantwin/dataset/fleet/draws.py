"""Random numbers of a node: each belongs to a seed, a purpose and a frame, in whatever order."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

__all__ = ["Purpose", "normal_draws", "uniform_draws"]

#: Bit of the key that sensors' own draws do not have, see `lidar.timing`.
_OF_NODES = 1 << 46
_WORDS = 8  # of a frame


class Purpose(IntEnum):
    """What numbers are drawn for."""

    NOISE = 1
    WALK = 2
    RADIO = 3


def uniform_draws(seed: int, purpose: Purpose, frames: int) -> NDArray[np.float64]:
    """Return numbers (F, 8) in (0, 1) of the frames 0, 1, 2, ...; a longer table begins the same.

    Args:
        seed: of the node.
        purpose: what they are for.
        frames: how many.
    """
    key = np.array([seed % 2**64, _OF_NODES | purpose], np.uint64)
    words = np.random.Philox(key=key).random_raw(frames * _WORDS).reshape(frames, _WORDS)
    return np.asarray(((words >> np.uint64(11)) + 0.5) * 2.0**-53, np.float64)


def normal_draws(seed: int, purpose: Purpose, frames: int) -> NDArray[np.float64]:
    """Return standard normal numbers (F, 8) of the frames; the arguments as `uniform_draws`."""
    return np.asarray(ndtri(uniform_draws(seed, purpose, frames)), np.float64)
