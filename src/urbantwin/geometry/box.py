"""Boxes: centre x, y, z, length (along heading), width, height, yaw counter-clockwise from +x."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bounding_box", "box_corners", "points_in_box"]


def bounding_box(points: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Return the tight box (7,) of (N, 3) points for a heading of ``yaw`` radians."""
    c, s = np.cos(yaw), np.sin(yaw)
    along = points[:, 0] * c + points[:, 1] * s
    across = -points[:, 0] * s + points[:, 1] * c
    low = np.array([along.min(), across.min(), points[:, 2].min()])
    high = np.array([along.max(), across.max(), points[:, 2].max()])
    u, v, z = (low + high) / 2
    return np.array([u * c - v * s, u * s + v * c, z, *(high - low), yaw])


def box_corners(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (8, 3) of a box (7,): the floor counter-clockwise, then the roof."""
    x, y, z, length, width, height, yaw = box
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    flat = signs * [length, width]
    c, s = np.cos(yaw), np.sin(yaw)
    xy = flat @ np.array([[c, s], [-s, c]]) + [x, y]
    low, high = np.full(4, z - height / 2), np.full(4, z + height / 2)
    return np.vstack([np.column_stack([xy, low]), np.column_stack([xy, high])])


def points_in_box(
    points: NDArray[np.floating], box: NDArray[np.float64], margin: float = 0.0
) -> NDArray[np.bool_]:
    """Return which of (N, 3) points are in a box (7,), grown by ``margin`` metres on each side."""
    offset = np.asarray(points, np.float64)[:, :3] - box[:3]
    c, s = np.cos(box[6]), np.sin(box[6])
    half = box[3:6] / 2 + margin
    along = np.abs(offset[:, 0] * c + offset[:, 1] * s) <= half[0]
    across = np.abs(-offset[:, 0] * s + offset[:, 1] * c) <= half[1]
    upright = np.abs(offset[:, 2]) <= half[2]
    return np.asarray(along & across & upright)
