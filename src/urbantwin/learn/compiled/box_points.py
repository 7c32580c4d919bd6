"""Which points lie in which boxes."""

import numpy as np
from numba import njit

__all__ = ["points_in_boxes"]


@njit(cache=True, nogil=True)
def points_in_boxes(points, boxes, margin):
    """Return for each point the first box that it lies in, -1 for none.

    Args:
        points: (N, >= 3) metres.
        boxes: (B, 7) centre x, y, z, length, width, height, yaw.
        margin: metres that boxes are grown by, each way.
    """
    owner = np.full(len(points), -1, np.int64)
    for b in range(len(boxes)):
        half_l = boxes[b, 3] / 2 + margin
        half_w = boxes[b, 4] / 2 + margin
        half_h = boxes[b, 5] / 2 + margin
        reach = np.sqrt(half_l * half_l + half_w * half_w)
        c = np.cos(boxes[b, 6])
        s = np.sin(boxes[b, 6])
        for i in range(len(points)):
            x = points[i, 0] - boxes[b, 0]
            if x > reach or x < -reach:
                continue
            y = points[i, 1] - boxes[b, 1]
            if y > reach or y < -reach or owner[i] >= 0:
                continue
            if abs(points[i, 2] - boxes[b, 2]) > half_h:
                continue
            if abs(x * c + y * s) <= half_l and abs(y * c - x * s) <= half_w:
                owner[i] = b
    return owner
