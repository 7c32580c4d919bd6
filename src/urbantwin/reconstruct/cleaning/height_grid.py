"""A square grid over part of the site, with heights of a mesh or of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
import shapely.geometry
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import shapes
from scipy.ndimage import distance_transform_edt

__all__ = ["Grid", "filled"]


@dataclass(frozen=True)
class Grid:
    """Cells from west to east (columns) and south to north (rows).

    Attributes:
        west: edge of the first column, site frame, metres.
        south: edge of the first row.
        step: cell size, metres.
        rows: number of rows.
        columns: number of columns.
    """

    west: float
    south: float
    step: float
    rows: int
    columns: int

    @classmethod
    def over(cls, bounds: tuple[float, float, float, float], step: float) -> Grid:
        """Return the grid of whole cells that covers bounds (west, south, east, north)."""
        west = np.floor(bounds[0] / step) * step
        south = np.floor(bounds[1] / step) * step
        columns = max(int(np.ceil((bounds[2] - west) / step)), 1)
        rows = max(int(np.ceil((bounds[3] - south) / step)), 1)
        return cls(float(west), float(south), step, rows, columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.columns

    def centres(self, mask: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the centres (N, 2) of all cells, row by row, or of those of a mask."""
        if mask is None:
            row, column = (k.ravel() for k in np.indices(self.shape))
        else:
            row, column = np.nonzero(mask)
        return np.column_stack(
            [self.west + (column + 0.5) * self.step, self.south + (row + 0.5) * self.step]
        )

    def cells(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows and columns (N,) of points (N, 2), clipped to the grid."""
        row = np.floor((xy[:, 1] - self.south) / self.step).astype(np.int64)
        column = np.floor((xy[:, 0] - self.west) / self.step).astype(np.int64)
        return np.clip(row, 0, self.rows - 1), np.clip(column, 0, self.columns - 1)

    def inside(self, shape: shapely.Geometry) -> NDArray[np.bool_]:
        """Return the mask of cells (rows, columns) with their centre in an area."""
        mask = np.zeros(self.shape, bool)
        if shape.is_empty:
            return mask
        shapely.prepare(shape)
        west, south, east, north = shape.bounds
        low, left = self.cells(np.array([[west, south]]))
        high, right = self.cells(np.array([[east, north]]))
        x = self.west + (np.arange(left[0], right[0] + 1) + 0.5) * self.step
        y = self.south + (np.arange(low[0], high[0] + 1) + 0.5) * self.step
        gx, gy = np.meshgrid(x, y)
        mask[low[0] : high[0] + 1, left[0] : right[0] + 1] = shapely.contains_xy(shape, gx, gy)
        return mask

    def squares(self, mask: NDArray[np.bool_]) -> shapely.Geometry:
        """Return the area of the cells of a mask."""
        transform = Affine(self.step, 0.0, self.west, 0.0, self.step, self.south)
        found = shapes(mask.astype(np.uint8), mask=mask, connectivity=4, transform=transform)
        return shapely.union_all([shapely.geometry.shape(one) for one, _ in found])

    def lowest(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the minimum height of points (N, 3) in each cell, nan without points."""
        out = np.full(self.shape, np.inf)
        row, column = self.cells(points)
        np.minimum.at(out, (row, column), points[:, 2])
        out[np.isinf(out)] = np.nan
        return out

    def highest(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the maximum height of points (N, 3) in each cell, nan without points."""
        return -self.lowest(points * np.array([1.0, 1.0, -1.0]))


def filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a grid with missing values (nan) replaced by the nearest known ones."""
    missing = np.isnan(values)
    if not missing.any() or missing.all():
        return np.nan_to_num(values) if missing.all() else values
    row, column = distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.asarray(values[row, column])
