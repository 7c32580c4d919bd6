"""Trees of a survey: tops of a canopy height model, and the crowns around them.

Tops are local maxima in a window that grows with the height (Popescu and Wynne 2004, "Seeing the
trees in the forest", PE&RS 70(5), eq. for deciduous and mixed stands); crowns are grown downhill
from them to a share of the top's height (Dalponte and Coomes 2016, "Tree-centric mapping of forest
carbon density from airborne laser scanning and hyperspectral data", Methods Ecol. Evol. 7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial import cKDTree

from urbantwin.reconstruct.airborne.raster import Raster
from urbantwin.reconstruct.reconstruction import SurveyedTree

__all__ = ["find_trees"]

_CELL_M = 0.5
#: Minimum height of a tree, metres: shrubs, cars and people are lower.
LOWEST_M = 3.0
#: Minimum height of a crown relative to its top (Dalponte and Coomes 2016: 0.45).
_CROWN_SHARE = 0.4
#: Maximum radius of the window, cells.
_WIDEST = 10
#: Maximum dip between tops of one crown, as a share of their height.
_DIP = 0.06
#: Minimum diameter of a crown, metres (poles are narrower), and minimum share of its circle (wires
#: fill less).
_NARROWEST_M, _ROUNDEST = 1.6, 0.3
#: Minimum number of points of a tree, and minimum thickness of its layer (0.1 to 0.9 quantile of
#: heights, metres).
_FEWEST, _THINNEST_M = 10, 0.6
#: Minimum share of points that are not the last return of their pulse: leaves let light through,
#: roofs do not.
_THROUGH = 0.12


@dataclass(frozen=True, eq=False)
class _Crowns:
    number: NDArray[np.int64]
    grid: Raster


def find_trees(
    points: NDArray[np.float64],
    above: NDArray[np.float64],
    last: NDArray[np.bool_] | None,
    *,
    vegetation: NDArray[np.bool_] | None,
) -> tuple[SurveyedTree, ...]:
    """Return the trees among points that are neither ground nor building.

    Args:
        points: (N, 3) site frame.
        above: (N,) heights above the ground, metres.
        last: (N,) whether a point is its pulse's last return, if known.
        vegetation: (N,) points classified as vegetation; ``None`` if unclassified: trees are then
            recognised by their rough surface and multiple returns.

    Returns:
        Trees from west to east.
    """
    high = (above > 1.0) & (above < 60.0)
    if vegetation is not None:
        high &= vegetation
    if high.sum() < _FEWEST:
        return ()
    xyh = np.column_stack([points[high, :2], above[high]])
    through = None if last is None else ~last[high]
    crowns, tops = _crowns(xyh)
    cell = crowns.grid.cells(xyh[:, :2])
    number = crowns.number.ravel()[cell]
    trees = []
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(1, len(tops) + 2))
    for k, top in enumerate(tops):
        mine = order[starts[k] : starts[k + 1]]
        tree = _tree(
            xyh[mine], top, None if through is None else through[mine], sure=vegetation is not None
        )
        if tree is not None:
            trees.append(tree)
    return tuple(sorted(trees, key=lambda tree: (tree.x, tree.y)))


def _crowns(xyh: NDArray[np.float64]) -> tuple[_Crowns, NDArray[np.float64]]:
    """Return a map of crowns (0 for none), and their tops (K, 3): x, y, height."""
    grid = Raster.over(xyh.min(axis=0), xyh.max(axis=0), _CELL_M, pad=4)
    canopy = np.nan_to_num(grid.extreme(xyh, highest=True))
    # Pits between branches are not gaps between trees.
    closed = np.where(canopy > 0, canopy, np.minimum(maximum_filter(canopy, size=3), 60.0) * 0.9)
    smooth = gaussian_filter(np.where(canopy > 0, canopy, np.where(closed > 2, closed, 0.0)), 1.0)
    # Popescu and Wynne 2004: width of the crown = 3.09632 + 0.00895 h^2, metres.
    width = 3.09632 + 0.00895 * smooth**2
    radius = np.clip(np.rint(width / 2 / _CELL_M), 2, _WIDEST).astype(int)
    top = np.zeros(grid.shape, bool)
    for r in np.unique(radius).tolist():
        window = np.hypot(*np.mgrid[-r : r + 1, -r : r + 1]) <= r
        highest = maximum_filter(smooth, footprint=window)
        top |= (radius == r) & (smooth >= highest) & (smooth > LOWEST_M * 0.8)
    rows, columns = np.nonzero(top)
    if not len(rows):
        return _Crowns(np.zeros(grid.shape, np.int64), grid), np.zeros((0, 3))
    basin = _uphill(smooth, rows, columns)
    root = _one_crown(smooth, basin, np.column_stack([rows, columns]))
    rows, columns, basin = rows[root[0]], columns[root[0]], root[1][basin]
    basin[smooth < 1.5] = 0
    peak = np.concatenate([[0.0], smooth[rows, columns]])
    basin[smooth < _CROWN_SHARE * peak[basin]] = 0
    x = grid.west + columns * _CELL_M
    y = grid.south + rows * _CELL_M
    return _Crowns(basin, grid), np.column_stack([x, y, smooth[rows, columns]])


def _uphill(
    canopy: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the index (1, 2, ...) of the top at the end of each cell's steepest ascent.

    A lesser maximum belongs to the nearest top; to none (0) if it is far.
    """
    height, width = canopy.shape
    padded = np.pad(canopy, 1, constant_values=-1.0)
    shifts = [(dy, dx) for dy in (0, -1, 1) for dx in (0, -1, 1)]
    around = np.stack(
        [padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width] for dy, dx in shifts]
    )
    step = np.array([dy * width + dx for dy, dx in shifts])[around.argmax(axis=0)]
    way = np.arange(canopy.size) + step.ravel()
    while not np.array_equal(further := way[way], way):
        way = further
    ends = np.unique(way)
    place = np.column_stack(np.divmod(ends, width))
    tops = cKDTree(np.column_stack([rows, columns]))
    away, nearest = tops.query(place, distance_upper_bound=_WIDEST)
    number = np.zeros(canopy.size, np.int64)
    number[ends] = np.where(np.isfinite(away), nearest + 1, 0)
    return np.asarray(number[way].reshape(canopy.shape))


def _one_crown(
    canopy: NDArray[np.float64], basin: NDArray[np.int64], tops: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Join tops of one crown: near each other, with a small dip between them.

    Returns:
        Kept tops (K,), and the new number of each old one (0 remains 0).
    """
    deepest: dict[tuple[int, int], float] = {}
    for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        a, b = basin[one], basin[other]
        border = a != b
        saddle = np.minimum(canopy[one], canopy[other])[border]
        pairs = np.sort(np.column_stack([a[border], b[border]]), axis=1)
        kinds, number = np.unique(pairs, axis=0, return_inverse=True)
        highest = np.full(len(kinds), -np.inf)
        np.maximum.at(highest, number.ravel(), saddle)
        for (i, j), z in zip(kinds.tolist(), highest.tolist(), strict=True):
            deepest[i, j] = max(deepest.get((i, j), -np.inf), z)
    peak = canopy[tops[:, 0], tops[:, 1]]
    root = np.arange(len(tops))
    for (i, j), z in sorted(deepest.items(), key=lambda item: -item[1]):
        if i == 0:
            continue
        low, high = sorted((root[i - 1], root[j - 1]), key=lambda k: (peak[k], k))
        apart = float(np.linalg.norm(tops[low] - tops[high])) * _CELL_M
        near = apart < 0.8 * (3.09632 + 0.00895 * peak[high] ** 2)
        if low != high and near and peak[low] - z < _DIP * peak[low]:
            root[root == low] = high
    kept, number = np.unique(root, return_inverse=True)
    return kept, np.concatenate([[0], number.ravel() + 1])


def _tree(
    xyh: NDArray[np.float64],
    top: NDArray[np.float64],
    through: NDArray[np.bool_] | None,
    *,
    sure: bool,
) -> SurveyedTree | None:
    """Return the tree of a crown's points; ``None`` for other objects."""
    if len(xyh) < _FEWEST:
        return None
    height = float(np.percentile(xyh[:, 2], 99.5))
    upper = xyh[xyh[:, 2] > _CROWN_SHARE * height]
    if height < LOWEST_M or len(upper) < _FEWEST:
        return None
    grid = Raster.over(upper.min(axis=0), upper.max(axis=0), _CELL_M)
    area = float((grid.count(upper[:, :2]) > 0).sum()) * _CELL_M**2
    crown = 2.0 * float(np.sqrt(area / np.pi))
    middle = upper[:, :2].mean(axis=0)
    reach = float(np.percentile(np.linalg.norm(upper[:, :2] - middle, axis=1), 95))
    if crown < _NARROWEST_M or area < _ROUNDEST * np.pi * reach**2:
        return None
    if not sure and not _leafy(upper, through):
        return None
    at = (top[:2] + middle) / 2
    own = xyh[np.linalg.norm(xyh[:, :2] - at, axis=1) < crown / 2 + 0.3]
    if len(own) < _FEWEST or own[:, 2].max() < LOWEST_M:
        return None
    height = float(np.percentile(own[:, 2], 99.5))
    # lowest branches: few pulses hit trunk and undergrowth below
    base = float(np.percentile(own[:, 2], 8))
    return SurveyedTree(
        round(float(at[0]), 3),
        round(float(at[1]), 3),
        round(height, 2),
        round(crown, 2),
        round(min(base, 0.6 * height), 2),
    )


def _leafy(upper: NDArray[np.float64], through: NDArray[np.bool_] | None) -> bool:
    """Return whether a crown's points are thick, partly transparent and not planar."""
    low, high = np.percentile(upper[:, 2], [10, 90])
    thick = high - low >= _THINNEST_M
    lets_through = through is None or through.mean() >= _THROUGH
    return bool(thick and lets_through and not _flat(upper))


def _flat(points: NDArray[np.float64]) -> bool:
    """Return whether points lie in one plane: an unmapped roof."""
    spread = points - points.mean(axis=0)
    values = np.linalg.eigvalsh(spread.T @ spread / len(points))
    return bool(np.sqrt(max(values[0], 0.0)) < 0.15)
