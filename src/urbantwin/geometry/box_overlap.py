"""Intersection of upright boxes, in plan and in space."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["box_footprints", "box_ious", "plan_overlaps", "shared_heights"]


def box_footprints(boxes: NDArray[np.float64]) -> NDArray[np.object_]:
    """Return the polygons (...) of boxes (..., 7) in plan: centre, length, width, height, yaw."""
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    local = signs * boxes[..., None, 3:5]
    c, s = np.cos(boxes[..., 6, None]), np.sin(boxes[..., 6, None])
    x = local[..., 0] * c - local[..., 1] * s + boxes[..., 0, None]
    y = local[..., 0] * s + local[..., 1] * c + boxes[..., 1, None]
    return np.asarray(shapely.polygons(np.stack([x, y], axis=-1)), dtype=object)


def plan_overlaps(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the common areas (...) of boxes (..., 7) in plan, m2; shapes broadcast."""
    common = shapely.intersection(box_footprints(first), box_footprints(second))
    return np.asarray(shapely.area(common), np.float64)


def shared_heights(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights (...) of the intersection of boxes (..., 7), metres; shapes broadcast."""
    low = np.maximum(first[..., 2] - first[..., 5] / 2, second[..., 2] - second[..., 5] / 2)
    high = np.minimum(first[..., 2] + first[..., 5] / 2, second[..., 2] + second[..., 5] / 2)
    return np.asarray(np.maximum(high - low, 0.0))


def box_ious(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volumes in common over the volumes of either (A, B) of upright boxes.

    Args:
        first: (A, 7) centre, length, width, height, yaw; metres and radians.
        second: (B, 7).
    """
    a, b = first[:, None], second[None, :]
    common = plan_overlaps(a, b) * shared_heights(a, b)
    either = a[..., 3:6].prod(axis=-1) + b[..., 3:6].prod(axis=-1) - common
    return np.asarray(np.divide(common, either, out=np.zeros_like(common), where=either > 0))
