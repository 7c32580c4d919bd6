"""Grouping of points into pillars."""

import numpy as np
from numba import njit

__all__ = ["cells_of", "filled_rows", "gathered"]


@njit(cache=True, nogil=True)
def cells_of(points, low, cell_m, rows, columns, lowest_m, highest_m):
    """Return the cell (N,) of each point, row-major from the south-west; -1 outside.

    Args:
        points: (N, >= 3) x, y and the height above the ground, metres.
        low: (2,) the south-western corner.
        cell_m: edge of a cell.
        rows: of the grid, from the south.
        columns: from the west.
        lowest_m: lower bound of heights, metres.
        highest_m: upper bound of heights, metres.
    """
    cell = np.full(len(points), -1, np.int64)
    for i in range(len(points)):
        if not lowest_m <= points[i, 2] < highest_m:
            continue
        column = int(np.floor((points[i, 0] - low[0]) / cell_m))
        row = int(np.floor((points[i, 1] - low[1]) / cell_m))
        if 0 <= row < rows and 0 <= column < columns:
            cell[i] = row * columns + column
    return cell


@njit(cache=True, nogil=True)
def gathered(points, cell, low, cell_m, rows, columns, most, shorten):
    """Return the features of the pillars of occupied cells.

    Of a cell with more than ``most`` points, ``most`` are chosen evenly in their order.

    Args:
        points: (N, K) float32, K >= 3: x, y, height above the ground, then further values.
        cell: (N,) as `cells_of` returns it.
        low: (2,) the south-western corner.
        cell_m: edge of a cell.
        rows: of the grid.
        columns: of it.
        most: largest number of points in a pillar.
        shorten: unit of heights, metres.

    Returns:
        features (P, most, K + 5) float32: offset from the centre of the cell (2, in cells),
        height, offset from the mean of the points (2, in cells), height above it, highest and
        lowest height, then further values; number of points (P,) int64; cells (P,) int64,
        ascending.
    """
    count = np.zeros(rows * columns, np.int64)
    for i in range(len(cell)):
        if cell[i] >= 0:
            count[cell[i]] += 1
    pillar = np.full(rows * columns, -1, np.int64)
    pillars = 0
    for one in range(rows * columns):
        if count[one]:
            pillar[one] = pillars
            pillars += 1
    where = np.zeros(pillars, np.int64)
    size = np.zeros(pillars, np.int64)
    for one in range(rows * columns):
        if count[one]:
            where[pillar[one]] = one
            size[pillar[one]] = count[one]
    mean = np.zeros((pillars, 3))
    high = np.full(pillars, -np.inf)
    bottom = np.full(pillars, np.inf)
    for i in range(len(cell)):
        if cell[i] >= 0:
            p = pillar[cell[i]]
            for k in range(3):
                mean[p, k] += points[i, k]
            high[p] = max(high[p], points[i, 2])
            bottom[p] = min(bottom[p], points[i, 2])
    for p in range(pillars):
        mean[p] /= size[p]
    told = points.shape[1]
    features = np.zeros((pillars, most, told + 5), np.float32)
    kept = np.zeros(pillars, np.int64)
    seen = np.zeros(pillars, np.int64)
    for i in range(len(cell)):
        if cell[i] < 0:
            continue
        p = pillar[cell[i]]
        order = seen[p]
        seen[p] += 1
        if size[p] > most and (order + 1) * most // size[p] == order * most // size[p]:
            continue
        k = kept[p]
        kept[p] += 1
        row = where[p] // columns
        column = where[p] % columns
        features[p, k, 0] = (points[i, 0] - low[0]) / cell_m - column - 0.5
        features[p, k, 1] = (points[i, 1] - low[1]) / cell_m - row - 0.5
        features[p, k, 2] = points[i, 2] / shorten
        features[p, k, 3] = (points[i, 0] - mean[p, 0]) / cell_m
        features[p, k, 4] = (points[i, 1] - mean[p, 1]) / cell_m
        features[p, k, 5] = points[i, 2] - mean[p, 2]
        features[p, k, 6] = high[p] / shorten
        features[p, k, 7] = bottom[p] / shorten
        for other in range(3, told):
            features[p, k, 5 + other] = points[i, other]
    return features, kept, where


@njit(cache=True, nogil=True)
def filled_rows(features, points):
    """Return the used rows of pillars (N, K), pillar by pillar.

    Args:
        features: (P, most, K) float32.
        points: (P,) int64: number of used rows, the first ones of each pillar.
    """
    rows = np.empty((points.sum(), features.shape[2]), np.float32)
    at = 0
    for p in range(len(points)):
        for m in range(points[p]):
            for k in range(features.shape[2]):
                rows[at, k] = features[p, m, k]
            at += 1
    return rows
