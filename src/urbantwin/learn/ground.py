"""Ground surface of a single frame, so that heights do not depend on the mounting height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    map_coordinates,
    percentile_filter,
)

__all__ = ["Ground", "ground_of", "is_upside_down"]

#: Cell size of the grid of lowest points, metres.
_CELL_M = 2.0
#: Share of a cell's lowest points that is skipped: they may be multipath echoes below ground.
_LOWEST_SHARE = 0.05
#: Window (cells) and percentile of the initial ground: valid even among parked cars and hedges.
_WINDOW, _QUARTER = 11, 25
#: Largest distance of a cell's lowest point from the surface: first round, then below and above
#: it, metres.
_START_M, _BELOW_M, _ABOVE_M = 1.2, 0.6, 0.25
#: Standard deviation of the smoothing filter, cells.
_SMOOTH = 1.5
_ROUNDS = 5
#: `is_upside_down`: distance of objects from the surface, metres; fewest points for a decision.
_CLEAR_M, _FEW = 0.7, 20
#: Height range of a cell with an object, and height of its top and bottom edges, metres.
_TALL_M, _EDGE_M = 1.0, 0.25


@dataclass(frozen=True, eq=False)
class Ground:
    """Ground heights on a grid of `_CELL_M`.

    Attributes:
        west: x of the centres of the first column, metres.
        south: y of the centres of the first row, metres.
        heights: (rows, columns) metres, all finite.
    """

    west: float
    south: float
    heights: NDArray[np.float64]

    def at(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return ground heights (N,) at places (N, 2+), metres; outside, those of the border."""
        row = (places[:, 1] - self.south) / _CELL_M
        column = (places[:, 0] - self.west) / _CELL_M
        found = map_coordinates(self.heights, [row, column], order=1, mode="nearest")
        return np.asarray(found, np.float64)


def ground_of(points: NDArray[np.float64]) -> Ground:
    """Estimate the ground of one frame.

    Takes the lowest points of 2 m cells and removes those above their surroundings: first against
    a plane and the lower quartile around, then iteratively against their own smoothed surface.
    Slopes, crowns and gutters remain; parked cars, hedges and facades are removed.

    Args:
        points: (N, 3) metres, z up, N >= 1.
    """
    cells = _cells_of(points)
    seen, shape = cells.seen, cells.shape
    lowest = cells.sorted_z[cells.first + (_LOWEST_SHARE * cells.count).astype(np.int64)]

    plane = _plane(np.column_stack([*seen, np.ones(len(lowest))]), lowest)
    rows, columns = np.indices(shape)
    tilt = plane[0] * rows + plane[1] * columns + plane[2]
    raw = np.full(shape, np.nan)
    raw[seen] = lowest - tilt[seen]
    level = percentile_filter(_filled(raw), _QUARTER, size=_WINDOW, mode="nearest")
    level = gaussian_filter(level, _SMOOTH)
    below, above = _START_M, _START_M / 2
    for _ in range(_ROUNDS):
        off = raw - level
        weight = np.where((off > -below) & (off < above), 1.0, 0.0)
        value = np.where(weight > 0, raw, 0.0)
        share = gaussian_filter(weight, _SMOOTH)
        known = share > 1e-3
        level = _filled(np.where(known, gaussian_filter(value, _SMOOTH) / np.maximum(share, 1e-3),
                                 np.nan))  # fmt: skip
        below, above = _BELOW_M, _ABOVE_M
    middle = points[:, :2].min(axis=0) + _CELL_M / 2
    return Ground(float(middle[0]), float(middle[1]), level + tilt)


def is_upside_down(points: NDArray[np.float64]) -> bool:
    """Return whether z points down: two independent signs must agree.

    Objects then hang below the surface of median cell heights (which is the same upside down), and
    the sharp edge of objects, where they meet the ground, is at their top.

    Args:
        points: (N, 3) metres.
    """
    cells = _cells_of(points)
    z, first, count = cells.sorted_z, cells.first, cells.count
    middle = np.full(cells.shape, np.nan)
    middle[cells.seen] = z[first + count // 2]
    surface = percentile_filter(_filled(middle), 50, size=_WINDOW, mode="nearest")[cells.seen]
    off = z - np.repeat(surface, count)
    above, below = int((off > _CLEAR_M).sum()), int((off < -_CLEAR_M).sum())
    low, high = z[first], z[first + count - 1]
    tall = np.repeat(high - low > _TALL_M, count)
    at_foot = int((tall & (z < np.repeat(low, count) + _EDGE_M)).sum())
    at_head = int((tall & (z > np.repeat(high, count) - _EDGE_M)).sum())
    return below > 2 * above + _FEW and at_head > at_foot


@dataclass(frozen=True, eq=False)
class _Cells:
    """Points sorted by cell of `_CELL_M`, and by height within a cell."""

    shape: tuple[int, int]
    seen: tuple[NDArray[np.int64], NDArray[np.int64]]  # rows and columns of the occupied ones
    sorted_z: NDArray[np.float64]
    first: NDArray[np.int64]  # of each occupied cell's points
    count: NDArray[np.int64]


def _cells_of(points: NDArray[np.float64]) -> _Cells:
    low = points[:, :2].min(axis=0)
    column, row = np.floor((points[:, :2] - low) / _CELL_M).astype(np.int64).T
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    cell = row * shape[1] + column
    order = np.lexsort((points[:, 2], cell))
    cells, first, count = np.unique(cell[order], return_index=True, return_counts=True)
    return _Cells(shape, (cells // shape[1], cells % shape[1]), points[order, 2], first, count)


def _plane(design: NDArray[np.float64], lowest: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fit a plane (3,) to the lowest points; outliers above are rejected first."""
    plane = np.array([0.0, 0.0, float(np.percentile(lowest, 30))])
    for reach in (4.0, 2.0, 1.0, 0.5):
        off = lowest - design @ plane
        near = (off > -2 * reach) & (off < reach)
        if near.sum() < 10:
            break
        plane = np.linalg.lstsq(design[near], lowest[near], rcond=None)[0]
    return np.asarray(plane)


def _filled(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fill the gaps (NaN) of a grid with the nearest value."""
    hole = np.isnan(grid)
    if hole.all():
        return np.zeros_like(grid)
    at = distance_transform_edt(hole, return_distances=False, return_indices=True)
    return np.asarray(grid[tuple(at)])
