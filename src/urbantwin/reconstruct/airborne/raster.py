"""Grids of cells over points, and interpolation of gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, map_coordinates

from urbantwin.reconstruct.airborne.tin import tin_heights

__all__ = ["Raster", "filled"]


@dataclass(frozen=True)
class Raster:
    """A grid of square cells; the centre of (row, column) is at west + column step, ...

    Attributes:
        west, south: centre of the first cell, site frame, metres.
        step: cell size, metres.
        shape: rows from south to north, columns from west to east.
    """

    west: float
    south: float
    step: float
    shape: tuple[int, int]

    @classmethod
    def over(
        cls, low: NDArray[np.float64], high: NDArray[np.float64], step: float, pad: int = 1
    ) -> Raster:
        """Return the grid over a box, with cell centres at multiples of ``step``."""
        first = np.floor(np.asarray(low[:2]) / step).astype(int) - pad
        last = np.ceil(np.asarray(high[:2]) / step).astype(int) + pad
        columns, rows = (int(n) for n in last - first + 1)
        return cls(float(first[0] * step), float(first[1] * step), step, (rows, columns))

    def cells(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the flat cell index (N,) of each point; -1 outside."""
        column = np.rint((xy[:, 0] - self.west) / self.step).astype(np.int64)
        row = np.rint((xy[:, 1] - self.south) / self.step).astype(np.int64)
        inside = (column >= 0) & (column < self.shape[1]) & (row >= 0) & (row < self.shape[0])
        return np.where(inside, row * self.shape[1] + column, -1)

    def middles(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of every cell, each of the grid's shape."""
        x = self.west + np.arange(self.shape[1]) * self.step
        y = self.south + np.arange(self.shape[0]) * self.step
        east, north = np.meshgrid(x, y)
        return east, north

    def extreme(self, points: NDArray[np.float64], *, highest: bool = False) -> NDArray[np.float64]:
        """Return the lowest (or highest) z of the points of each cell; nan without points."""
        cell = self.cells(points[:, :2])
        inside = cell >= 0
        grid = np.full(self.shape[0] * self.shape[1], -np.inf if highest else np.inf)
        take = np.maximum if highest else np.minimum
        take.at(grid, cell[inside], points[inside, 2])
        return np.where(np.isfinite(grid), grid, np.nan).reshape(self.shape)

    def count(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the number of points in each cell."""
        cell = self.cells(xy)
        size = self.shape[0] * self.shape[1]
        return np.bincount(cell[cell >= 0], minlength=size).reshape(self.shape)

    def area(self, chosen: NDArray[np.bool_]) -> shapely.Geometry:
        """Return the area in plan of the cells of a mask (rows, columns)."""
        edges = np.diff(np.pad(chosen.astype(np.int8), ((0, 0), (1, 1))), axis=1)
        row, first = np.nonzero(edges > 0)
        last = np.nonzero(edges < 0)[1]  # in the same order for each row
        west = self.west + (first - 0.5) * self.step
        south = self.south + (row - 0.5) * self.step
        east = self.west + (last - 0.5) * self.step
        return shapely.union_all(shapely.box(west, south, east, south + self.step))

    def sample(self, grid: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a grid's values (N,) at points, bilinear; clipped to the border."""
        rows = (xy[:, 1] - self.south) / self.step
        columns = (xy[:, 0] - self.west) / self.step
        return np.asarray(map_coordinates(grid, [rows, columns], order=1, mode="nearest"))


def filled(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a grid without nan: gaps interpolated linearly, nearest values beyond the hull."""
    hole = np.isnan(grid)
    if not hole.any() or hole.all():
        return np.nan_to_num(grid)
    nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
    result: NDArray[np.float64] = grid[tuple(nearest)]
    rim = ~hole & binary_dilation(hole, np.ones((3, 3)))
    rows, columns = np.nonzero(rim)
    bridge = tin_heights(np.column_stack([columns, rows, grid[rim]]), 0.0, 0.0, 1.0, grid.shape)
    spanned = hole & np.isfinite(bridge)
    result[spanned] = bridge[spanned]
    return result
