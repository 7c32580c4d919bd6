"""Exact distances from points to the nearest of many triangles."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.compiled import nearest_triangle
from urbantwin.fidelity.compiled.box_tree import arranged, boxed
from urbantwin.processes import threads

__all__ = ["NearestTriangle"]

#: Triangles per leaf, and number of neighbouring points that are queried in sequence.
_TRIANGLES, _NEIGHBOURS = 4, 8
#: Minimum number of points per thread.
_LEAST_POINTS = 1_000


class NearestTriangle:
    """Computes exact distances to the nearest of many triangles.

    Triangles are in the leaves of a balanced tree of boxes, split by their centres. A part of the
    tree is skipped if its box is farther than the best triangle so far.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices, F >= 1.
    """

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
        a, b, c = (np.asarray(vertices, np.float64)[faces[:, k]] for k in range(3))
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        order, levels = arranged((low + high) / 2, _TRIANGLES)
        self._box = boxed(low, high, order, levels)
        self._corner = a[order]
        self._side1, self._side2 = b[order] - self._corner, c[order] - self._corner

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance (N,) of (N, 3) points to the nearest triangle, metres."""
        points = np.ascontiguousarray(points, np.float64)
        if not len(points):
            return np.zeros(0)
        found = np.empty(len(points))
        turn, _ = arranged(points, _NEIGHBOURS)
        runs = max(1, min(threads(), len(points) // _LEAST_POINTS))

        def fill(part: NDArray[np.int64]) -> None:
            nearest_triangle.nearest_squares(
                points, part, self._corner, self._side1, self._side2, self._box, found
            )

        if runs == 1:
            fill(turn)
        else:
            with ThreadPoolExecutor(runs) as pool:
                list(pool.map(fill, np.array_split(turn, runs)))
        return np.sqrt(found)
