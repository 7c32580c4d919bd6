"""Assignment of points to boxes."""

import numpy as np
from numba import njit

__all__ = ["points_in_boxes"]

#: Cell size of the index of boxes, metres, and most cells along an edge.
_CELL_M, _MOST_CELLS = 4.0, 512


@njit(cache=True, nogil=True)
def points_in_boxes(points, boxes, margin):
    """Return the first box that contains each point (N,), -1 for none.

    Args:
        points: (N, >= 3) metres.
        boxes: (B, 7) centre x, y, z, length, width, height, yaw.
        margin: margin of the boxes on each side, metres.
    """
    owner = np.full(len(points), -1, np.int64)
    if not len(boxes):
        return owner
    half = boxes[:, 3:6] / 2 + margin
    reach = np.hypot(half[:, 0], half[:, 1])
    c, s = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    west, east = (boxes[:, 0] - reach).min(), (boxes[:, 0] + reach).max()
    south, north = (boxes[:, 1] - reach).min(), (boxes[:, 1] + reach).max()
    edge = max(_CELL_M, max(east - west, north - south) / _MOST_CELLS)
    columns, rows = int((east - west) / edge) + 1, int((north - south) / edge) + 1
    first, inside = _by_cell(boxes, reach, west, south, edge, columns, rows)
    for i in range(len(points)):
        px, py = points[i, 0], points[i, 1]
        if not (west <= px <= east and south <= py <= north):
            continue
        cell = int((py - south) / edge) * columns + int((px - west) / edge)
        for b in inside[first[cell] : first[cell + 1]]:
            x, y = px - boxes[b, 0], py - boxes[b, 1]
            if (
                abs(points[i, 2] - boxes[b, 2]) <= half[b, 2]
                and abs(x * c[b] + y * s[b]) <= half[b, 0]
                and abs(y * c[b] - x * s[b]) <= half[b, 1]
            ):
                owner[i] = b
                break
    return owner


@njit(cache=True, nogil=True)
def _by_cell(boxes, reach, west, south, edge, columns, rows):
    """Return the boxes in each cell, ascending.

    Returns:
        first (columns * rows + 1,) and indices of boxes: those of a cell are
        ``[first[cell] : first[cell + 1]]``.
    """
    span = np.empty((len(boxes), 4), np.int64)
    first = np.zeros(columns * rows + 1, np.int64)
    for b in range(len(boxes)):
        span[b, 0] = int((boxes[b, 0] - reach[b] - west) / edge)
        span[b, 1] = min(int((boxes[b, 0] + reach[b] - west) / edge), columns - 1)
        span[b, 2] = int((boxes[b, 1] - reach[b] - south) / edge)
        span[b, 3] = min(int((boxes[b, 1] + reach[b] - south) / edge), rows - 1)
        for row in range(span[b, 2], span[b, 3] + 1):
            for column in range(span[b, 0], span[b, 1] + 1):
                first[row * columns + column + 1] += 1
    first = np.cumsum(first)
    filled = first.copy()
    inside = np.empty(first[-1], np.int64)
    for b in range(len(boxes)):
        for row in range(span[b, 2], span[b, 3] + 1):
            for column in range(span[b, 0], span[b, 1] + 1):
                cell = row * columns + column
                inside[filled[cell]] = b
                filled[cell] += 1
    return first, inside
