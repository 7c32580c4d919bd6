"""Poses as JSON has them."""

from __future__ import annotations

import numpy as np

from urbantwin.geometry import Pose

__all__ = ["pose_matrix"]


def pose_matrix(pose: Pose) -> list[list[float]]:
    """Return a pose as the rows of a 4x4 matrix, without negative zeros."""
    rows = np.eye(4)
    rows[:3, :3] = pose.rotation
    rows[:3, 3] = pose.translation
    return [[float(value) + 0.0 for value in row] for row in rows]
