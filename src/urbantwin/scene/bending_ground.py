"""Where measured ground bends: vertices that its triangles need to show curbs."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.ground import Elevation

__all__ = ["bending_ground"]

#: Sizes of cells, each half of the one before, metres; and how far the ground may leave the plane
#: of a cell's corners before it is halved.
_CELLS_M = (4.0, 2.0, 1.0, 0.5, 0.25)
_OFF_M = 0.008


def bending_ground(elevation: Elevation, measured: shapely.Geometry) -> NDArray[np.float64]:
    """Return the corners (N, 2) of cells that are as small as the ground asks for.

    Cells of 4 m are halved, down to the grid of the heights, while the ground in them is more than
    8 mm off what its corners say.

    Args:
        elevation: the ground.
        measured: where it is finely known; elsewhere nothing is returned.
    """
    if measured.is_empty:
        return np.zeros((0, 2))
    shapely.prepare(measured)
    west, south, east, north = measured.bounds
    first = np.floor(np.array([west, south]) / _CELLS_M[0]).astype(int)
    last = np.ceil(np.array([east, north]) / _CELLS_M[0]).astype(int)
    grid = np.stack(np.meshgrid(*map(np.arange, first, last)), axis=-1).reshape(-1, 2)
    corner = grid * _CELLS_M[0]
    found = []
    for size in _CELLS_M:
        middle = corner + size / 2
        near = shapely.dwithin(measured, shapely.points(middle), size * 0.75)
        corner = corner[near]
        if size < elevation.step or not len(corner):
            break
        found.append(_corners(corner, size).reshape(-1, 2))
        bent = corner[_off(elevation, corner, size) > _OFF_M]
        corner = _corners(bent, size / 2).reshape(-1, 2)
    points = np.unique(np.round(np.concatenate(found), 3), axis=0)
    inside: NDArray[np.float64] = points[shapely.contains_xy(measured, points[:, 0], points[:, 1])]
    return inside


def _corners(corner: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the corners (N, 4, 2) of cells by their lowest one."""
    return np.asarray(corner[:, None] + size * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]))


def _off(elevation: Elevation, corner: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return how far (N,) the ground in cells is off what their corners say, metres."""
    share = np.linspace(0, 1, max(3, round(size / elevation.step) + 1))
    u, v = (grid.ravel() for grid in np.meshgrid(share, share))
    weight = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    at_corners = elevation.raw_at(_corners(corner, size).reshape(-1, 2)).reshape(-1, 4)
    inner = corner[:, None] + size * np.column_stack([u, v])
    there = elevation.raw_at(inner.reshape(-1, 2)).reshape(len(corner), -1)
    return np.asarray(np.abs(there - at_corners @ weight).max(axis=1))
