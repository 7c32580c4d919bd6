"""The tight boxes of posed meshes."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["tight_boxes"]


@per_block
def tight_boxes(rotation, place, hull, first, count):
    """Return the tight boxes (A, 7) of actors, their yaw that of their own x axis.

    Args:
        rotation: (A, 3, 3) of the actors' poses.
        place: (A, 3).
        hull: (3, H) vertices of the hulls of all shapes, in their own frames.
        first: (A,) where each actor's hull begins.
        count: (A,) how many vertices it has.
    """
    boxes = np.empty((len(place), 7))
    for a in range(len(place)):
        yaw = np.arctan2(rotation[a, 1, 0], rotation[a, 0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for n in range(first[a], first[a] + count[a]):
            x, y, z = hull[0, n], hull[1, n], hull[2, n]
            u = rotation[a, 0, 0] * x + rotation[a, 0, 1] * y + rotation[a, 0, 2] * z
            v = rotation[a, 1, 0] * x + rotation[a, 1, 1] * y + rotation[a, 1, 2] * z
            w = rotation[a, 2, 0] * x + rotation[a, 2, 1] * y + rotation[a, 2, 2] * z
            u, v = c * u + s * v, c * v - s * u
            low[0], high[0] = min(low[0], u), max(high[0], u)
            low[1], high[1] = min(low[1], v), max(high[1], v)
            low[2], high[2] = min(low[2], w), max(high[2], w)
        u, v = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
        boxes[a, 0] = place[a, 0] + c * u - s * v
        boxes[a, 1] = place[a, 1] + s * u + c * v
        boxes[a, 2] = place[a, 2] + (low[2] + high[2]) / 2
        for i in range(3):
            boxes[a, 3 + i] = high[i] - low[i]
        boxes[a, 6] = yaw
    return boxes
