"""Rasterisation of targets: heat of centres, and ignored cells."""

import numpy as np
from numba import njit

__all__ = ["drawn_centres", "drawn_ignored"]


@njit(cache=True, nogil=True)
def drawn_centres(heat, x, y, sigma, cell_m, least):
    """Draw a Gaussian around each centre; return the cells that regress its box.

    Args:
        heat: (rows, columns) float32, changed in place: the maximum of old and new values; 1 in
            the cell of a centre.
        x: (B,) distance from the western border of the grid, metres.
        y: (B,) distance from the southern border, metres.
        sigma: (B,) standard deviations, metres.
        cell_m: edge of a cell, metres.
        least: lowest heat of a cell that regresses a box; of several boxes, that of highest heat.

    Returns:
        cells (P,), box of each cell (P,), weight of each cell (P,).
    """
    rows, columns = heat.shape
    best = np.zeros(heat.shape, np.float32)
    whose = np.full(heat.shape, -1, np.int64)
    for b in range(len(x)):
        middle_row = int(np.floor(y[b] / cell_m))
        middle_column = int(np.floor(x[b] / cell_m))
        if not (0 <= middle_row < rows and 0 <= middle_column < columns):
            continue
        reach = int(np.ceil(3 * sigma[b] / cell_m))
        for row in range(max(0, middle_row - reach), min(rows, middle_row + reach + 1)):
            for column in range(
                max(0, middle_column - reach), min(columns, middle_column + reach + 1)
            ):
                # From the middle of the centre's cell: it has 1, and its neighbours less, alike.
                away = (row - middle_row) ** 2 + (column - middle_column) ** 2
                value = np.exp(-away * (cell_m / sigma[b]) ** 2 / 2)
                heat[row, column] = max(heat[row, column], value)
                if value >= least and value > best[row, column]:
                    best[row, column] = value
                    whose[row, column] = b
    cell = np.flatnonzero(whose.ravel() >= 0)
    return cell, whose.ravel()[cell], best.ravel()[cell]


@njit(cache=True, nogil=True)
def drawn_ignored(counts, boxes, low, cell_m, margin):
    """Set cells whose centres lie in ignored boxes to 0.

    Args:
        counts: (rows, columns) float32, changed in place.
        boxes: (B, 7).
        low: (2,) the south-western corner, metres.
        cell_m: edge of a cell.
        margin: margin of the boxes in plan, metres.
    """
    rows, columns = counts.shape
    for b in range(len(boxes)):
        half_l = boxes[b, 3] / 2 + margin
        half_w = boxes[b, 4] / 2 + margin
        reach = np.sqrt(half_l * half_l + half_w * half_w)
        c = np.cos(boxes[b, 6])
        s = np.sin(boxes[b, 6])
        first_row = max(0, int(np.floor((boxes[b, 1] - reach - low[1]) / cell_m)))
        last_row = min(rows - 1, int(np.floor((boxes[b, 1] + reach - low[1]) / cell_m)))
        first_column = max(0, int(np.floor((boxes[b, 0] - reach - low[0]) / cell_m)))
        last_column = min(columns - 1, int(np.floor((boxes[b, 0] + reach - low[0]) / cell_m)))
        for row in range(first_row, last_row + 1):
            y = low[1] + (row + 0.5) * cell_m - boxes[b, 1]
            for column in range(first_column, last_column + 1):
                x = low[0] + (column + 0.5) * cell_m - boxes[b, 0]
                if abs(x * c + y * s) <= half_l and abs(y * c - x * s) <= half_w:
                    counts[row, column] = 0.0
