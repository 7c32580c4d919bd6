"""The ground as fixed sensors saw it: a grid of heights, curbs kept."""

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

#: Between nodes of the grid, metres.
GRID_M = 0.25
#: The lowest tenth of a cell's points may be noise; what lies this far above it is its ground.
_LOWEST_SHARE, _THICK_M = 0.1, 0.06
#: A cell whose ground is off its neighbours' median by more, metres, is something on the ground.
_OFF_M, _AROUND = 0.25, 9
#: Cells of one piece of ground are so near in plan, metres, and no steeper than this, noise aside:
#: the lower edge of what is seen of a facade is as steep as the lowest beam.
_BESIDE_M, _NOISE_M, _STEEPEST = 0.6, 0.05, 0.15
#: From the largest piece on the ground rises or falls so much, metres and per metre, followed
#: outward so many times.
_CURB_M, _SLOPE, _OUTWARD = 0.2, 0.06, 2
#: Farther than this from any ground that was seen nothing is said, metres.
_REACH_M = 10.0
#: Cells this near to one that was seen count as seen, metres: between rings on the ground.
_SEEN_M = 1.0


class RecordedGround:
    """Heights of the ground.

    Attributes:
        grid: its nodes.
        heights: (rows, columns) metres; nan where nothing is known.
        seen: (rows, columns) whether ground was measured within a metre.
    """

    def __init__(self, grid: Raster, heights: NDArray[np.float64], seen: NDArray[np.bool_]) -> None:
        self.grid, self.heights, self.seen = grid, heights, seen
        self._filled = _nearest(heights)

    def above(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how high (N,) points are above the ground, metres; beyond it, its border's."""
        return np.asarray(points[:, 2] - self.grid.sample(self._filled, points[:, :2]))


def recorded_ground(points: NDArray[np.float64]) -> RecordedGround:
    """Return the ground among points of what stands still.

    Bare earth is found by SMRF as in a survey from the air; of its points each cell of the grid
    takes the lowest, averaged over what is as low. Between cells heights are linear.

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
    """Return which points (N, 3) of cells are of the ground that all of it hangs together with.

    Where a sensor sees no ground (around its own foot) the lowest it sees may be a facade, or an
    arm with signals. The ground is the largest piece whose neighbours are as high, and what lies
    no higher or lower than its slope allows from there, outward.
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
