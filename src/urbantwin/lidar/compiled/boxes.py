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
        hull: x, y and z (H,) of vertices of all shapes that can touch a bound, in their own frames.
        first: (A,) where those of each actor begin.
        count: (A,) how many they are.
    """
    boxes = np.empty((len(place), 7))
    hull_x, hull_y, hull_z = hull
    for a in range(len(place)):
        yaw = np.arctan2(rotation[a, 1, 0], rotation[a, 0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation[a]
        # Numbers, not arrays of three: they stay in registers.
        low_u = low_v = low_w = np.inf
        high_u = high_v = high_w = -np.inf
        for n in range(first[a], first[a] + count[a]):
            x, y, z = hull_x[n], hull_y[n], hull_z[n]
            u, v, w = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
            u, v = c * u + s * v, c * v - s * u
            low_u, high_u = min(low_u, u), max(high_u, u)
            low_v, high_v = min(low_v, v), max(high_v, v)
            low_w, high_w = min(low_w, w), max(high_w, w)
        u, v = (low_u + high_u) / 2, (low_v + high_v) / 2
        boxes[a, 0] = place[a, 0] + c * u - s * v
        boxes[a, 1] = place[a, 1] + s * u + c * v
        boxes[a, 2] = place[a, 2] + (low_w + high_w) / 2
        boxes[a, 3], boxes[a, 4], boxes[a, 5] = high_u - low_u, high_v - low_v, high_w - low_w
        boxes[a, 6] = yaw
    return boxes
