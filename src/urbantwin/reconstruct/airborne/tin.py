"""Heights of a triangulation at the nodes of a grid."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

__all__ = ["tin_heights"]


def tin_heights(
    points: NDArray[np.float64], west: float, south: float, step: float, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Return heights (rows, columns) of the Delaunay triangulation of points at a grid's nodes.

    Args:
        points: (N, 3), metres.
        west: x of the grid's first node, metres.
        south: y of the grid's first node, metres.
        step: spacing of the nodes, metres.
        shape: rows and columns.

    Returns:
        Linear within each triangle; nan beyond the hull.
    """
    grid = np.full(shape, np.nan)
    if len(points) < 3:
        return grid
    node = np.column_stack([(points[:, 0] - west) / step, (points[:, 1] - south) / step])
    try:
        triangles = Delaunay(node).simplices.astype(np.int64)
    except QhullError:
        return grid
    _draw(np.ascontiguousarray(node), np.ascontiguousarray(points[:, 2]), triangles, grid)
    return grid


@njit(cache=True)
def _draw(  # pragma: no cover  (compiled)
    xy: NDArray[np.float64],
    z: NDArray[np.float64],
    triangles: NDArray[np.int64],
    grid: NDArray[np.float64],
) -> None:
    rows, columns = grid.shape
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        ax, ay, bx, by, cx, cy = xy[i, 0], xy[i, 1], xy[j, 0], xy[j, 1], xy[k, 0], xy[k, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:
            continue
        first = max(0, int(np.ceil(min(ay, by, cy) - 1e-9)))
        last = min(rows - 1, int(np.floor(max(ay, by, cy) + 1e-9)))
        left = max(0, int(np.ceil(min(ax, bx, cx) - 1e-9)))
        right = min(columns - 1, int(np.floor(max(ax, bx, cx) + 1e-9)))
        for row in range(first, last + 1):
            for column in range(left, right + 1):
                u = ((column - ax) * (cy - ay) - (cx - ax) * (row - ay)) / area
                v = ((bx - ax) * (row - ay) - (column - ax) * (by - ay)) / area
                if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9:
                    grid[row, column] = z[i] + u * (z[j] - z[i]) + v * (z[k] - z[i])
