"""Turns of a spinning sensor in the angles that its packets report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["PART_LEFT_OUT", "turn_numbers", "whole_turns"]

#: A first or last turn with less than this share of what most turns have is left out.
_WHOLE = 0.95
PART_LEFT_OUT = "A turn that the capture has only part of, first or last, is left out."
#: An angle may step back this far within a turn, degrees.
_BACK_DEG = 5.0


def turn_numbers(angle_deg: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which turn each firing belongs to, from 0: a turn begins where the angle passes 0.

    A sensor may turn either way, and may report a sector only.

    Args:
        angle_deg: (N,) angles in the order of firing, 0..360.
    """
    if not len(angle_deg):
        return np.zeros(0, np.int64)
    step = np.diff(angle_deg)
    short = (step + 180) % 360 - 180
    way = -1.0 if np.median(short) < 0 else 1.0
    forward = (way * step + _BACK_DEG) % 360 - _BACK_DEG
    start = way * angle_deg[0] % 360
    # What lies a hair before 0 is not to begin a turn by rounding.
    along = start + np.concatenate([[0.0], np.cumsum(forward)]) + 1e-6
    turn = np.maximum.accumulate(np.floor(along / 360).astype(np.int64))
    return np.asarray(turn - turn[0], np.int64)


def whole_turns(sizes: Sequence[int]) -> tuple[int, int]:
    """Return the first turn that is whole, and the one behind the last.

    A sensor that looks only one way sends less in every turn: whole is what most are.

    Args:
        sizes: how much of each turn there is.
    """
    most = max(sizes)
    first, last = 0, len(sizes)
    if len(sizes) > 1 and sizes[0] < _WHOLE * most:
        first = 1
    if last - first > 1 and sizes[-1] < _WHOLE * most:
        last -= 1
    return first, last
