"""Stationing of polylines: the distance along them of each point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["stations_of_points"]


def stations_of_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance (N,) of each point (N, D) from the first, along the line through all."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
