"""Angles and the smallest differences between them."""

from __future__ import annotations

import math
from typing import overload

import numpy as np
from numpy.typing import NDArray

__all__ = ["wrapped"]


@overload
def wrapped(angle: float, turn: float = ...) -> float: ...
@overload
def wrapped(angle: NDArray[np.float64], turn: float = ...) -> NDArray[np.float64]: ...
def wrapped(
    angle: float | NDArray[np.float64], turn: float = math.tau
) -> float | NDArray[np.float64]:
    """Return angles normalised to within half a turn of zero.

    A number is wrapped exactly, to [-turn/2, turn/2] (the remainder of IEEE 754). Numpy has no such
    remainder: arrays are wrapped to [-turn/2, turn/2), within a rounding error.

    Args:
        angle: any angle, or an array of them of any shape.
        turn: a full turn in the same unit: 2 pi for radians, 360 for degrees.
    """
    if isinstance(angle, np.ndarray):
        return (angle + turn / 2) % turn - turn / 2
    return math.remainder(angle, turn)
