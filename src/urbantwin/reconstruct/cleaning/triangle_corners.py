"""What the three corners of many triangles have in common.

Numpy reduces along an axis of three slowly: taken corner by corner the same is five times faster.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bounds_of_faces", "every_corner", "some_corner"]


def bounds_of_faces(
    vertices: NDArray[np.float64], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest coordinates (F, D) of triangles.

    Args:
        vertices: (V, D) metres.
        faces: (F, 3) indices.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def every_corner(flag: NDArray[np.bool_], faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which triangles (F,) have the flag (V,) at all their corners."""
    return np.asarray(flag[faces[:, 0]] & flag[faces[:, 1]] & flag[faces[:, 2]])


def some_corner(flag: NDArray[np.bool_], faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which triangles (F,) have the flag (V,) at one of their corners."""
    return np.asarray(flag[faces[:, 0]] | flag[faces[:, 1]] | flag[faces[:, 2]])
