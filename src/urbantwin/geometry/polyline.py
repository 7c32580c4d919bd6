"""Polylines in plan: the distance of each point along them, and parallel lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["moved_left", "stations_of_points"]


def stations_of_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance (N,) of each point (N, D) from the first, along the line through all."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def moved_left(points: NDArray[np.float64], offset: float) -> NDArray[np.float64]:
    """Return a polyline (N, 2) moved to its left by metres, point by point, its bends mitred."""
    leg = np.diff(points, axis=0)
    normal = np.column_stack([-leg[:, 1], leg[:, 0]])
    normal /= np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
    corner = np.vstack([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    scale = 2.0 / np.maximum((corner * corner).sum(axis=1, keepdims=True), 0.5)
    scale[[0, -1]] = 1.0
    return np.asarray(points + offset * corner * scale)
