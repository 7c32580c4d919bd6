"""The ground seen by fixed sensors: a height grid that keeps curbs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, median_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from urbantwin.reconstruct.airborne.ground_filter import ground_by_filter
from urbantwin.reconstruct.airborne.raster import Raster
from urbantwin.reconstruct.airborne.tin import tin_heights

__all__ = ["GRID_M", "RecordedGround", "recorded_ground"]

#: Spacing of the grid, metres.
GRID_M = 0.25
#: Share of a cell's lowest points that may be noise; points up to this above are its ground,
#: metres.
_LOWEST_SHARE, _THICK_M = 0.1, 0.06
#: A cell that deviates more from the median of its neighbours (metres; window size in cells) is an
#: object on the ground.
_OFF_M, _AROUND = 0.25, 9
#: Maximum distance in plan of connected ground cells (metres), their height noise (metres) and
#: their maximum slope. The lower edge of the visible part of a facade is as steep as the lowest
#: beam.
_BESIDE_M, _NOISE_M, _STEEPEST = 0.6, 0.05, 0.15
#: Height step and slope by which ground may differ from the largest piece, metres and per metre,
#: and number of outward passes.
_CURB_M, _SLOPE, _OUTWARD = 0.2, 0.06, 2
#: Distance from measured ground beyond which heights are unknown, metres.
_REACH_M = 10.0
#: Distance within which cells count as measured, metres, to bridge rings on the ground.
_SEEN_M = 1.0


class RecordedGround:
    """Heights of the ground.

    Attributes:
        grid: its nodes.
        heights: (rows, columns) metres; nan if unknown.
        seen: (rows, columns) whether ground was measured within a metre.
    """

    def __init__(self, grid: Raster, heights: NDArray[np.float64], seen: NDArray[np.bool_]) -> None:
        self.grid, self.heights, self.seen = grid, heights, seen
        self._filled = _nearest(heights)

    def above(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of (N, 3) points above the ground, metres; extrapolated outside."""
        return np.asarray(points[:, 2] - self.grid.sample(self._filled, points[:, :2]))


def recorded_ground(points: NDArray[np.float64]) -> RecordedGround:
    """Return the ground among static points.

    Bare earth is found by SMRF as in an airborne survey. Each cell of the grid takes the mean of
    its lowest bare points. Between cells heights are linear.

    Args:
        points: (N, 3) metres.
    """
    bare = points[ground_by_filter(points)]
    grid = Raster.over(bare.min(axis=0), bare.max(axis=0), GRID_M)
    cell = grid.cells(bare[:, :2])
    order = np.lexsort((bare[:, 2], cell))
    bare, cell = bare[order], cell[order]
    cells, first, count = np.unique(cell, return_index=True, return_counts=True)
    low = bare[first + (_LOWEST_SHARE * (count - 1)).astype(int), 2]
    number = np.repeat(np.arange(len(cells)), count)
    near = (bare[:, 2] >= low[number] - _THICK_M) & (bare[:, 2] <= low[number] + _THICK_M)
    sums = np.array([np.bincount(number[near], bare[near, axis], len(cells)) for axis in range(3)])
    middle = (sums / np.bincount(number[near], minlength=len(cells))).T
    raw = np.full(grid.shape, np.nan)
    raw.ravel()[cells] = middle[:, 2]
    level = median_filter(_nearest(raw), _AROUND)
    kept = np.abs(raw.ravel()[cells] - level.ravel()[cells]) < _OFF_M
    kept[kept] = _hangs_together(middle[kept])
    heights = tin_heights(middle[kept], grid.west, grid.south, GRID_M, grid.shape)
    known = np.zeros(grid.shape, bool)
    known.ravel()[cells[kept]] = True
    away = distance_transform_edt(~known) * GRID_M
    heights[away > _REACH_M] = np.nan
    return RecordedGround(grid, heights, away <= _SEEN_M)


def _hangs_together(middle: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of cell points (N, 3) that belong to the connected ground.

    Where a sensor sees no ground (around its own foot) the lowest points may be on a facade or on a
    signal arm. The ground is the largest connected piece of similar height, extended outward to
    points within the allowed slope.
    """
    tree = cKDTree(middle[:, :2])
    pair = tree.query_pairs(_BESIDE_M, output_type="ndarray")
    step = np.abs(middle[pair[:, 0]] - middle[pair[:, 1]])
    flat = step[:, 2] < _NOISE_M + _STEEPEST * np.hypot(step[:, 0], step[:, 1])
    first, second = pair[flat].T
    joined = coo_matrix((np.ones(len(first)), (first, second)), (len(middle), len(middle)))
    _, piece = connected_components(joined, directed=False)
    kept: NDArray[np.bool_] = piece == np.bincount(piece).argmax()
    for _ in range(_OUTWARD):
        away, nearest = cKDTree(middle[kept, :2]).query(middle[:, :2])
        off = np.abs(middle[:, 2] - middle[kept][nearest, 2])
        found = kept | (off < _CURB_M + _SLOPE * away)
        if (found == kept).all():
            break
        kept = found
    return kept


def _nearest(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    hole = np.isnan(grid)
    if hole.all():
        return np.zeros_like(grid)
    at = distance_transform_edt(hole, return_distances=False, return_indices=True)
    filled: NDArray[np.float64] = grid[tuple(at)]
    return filled
