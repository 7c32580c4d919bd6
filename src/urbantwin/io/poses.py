"""Rotations and poses from files: quaternions and matrices, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import Pose

__all__ = ["checked_pose", "heading", "pose_of_quaternion", "quaternion_rotation"]

#: Tolerance of rotations for rounded digits; maximum coordinate, metres.
_ROUND, _FURTHEST_M = 0.01, 1e8


def quaternion_rotation(w: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return the rotation (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def pose_of_quaternion(w: float, x: float, y: float, z: float, place: ArrayLike) -> Pose:
    """Return the pose of a quaternion (any length but 0) and a position (3,) in metres.

    Raises:
        ValueError: the quaternion is zero or not finite.
    """
    quaternion = np.array([w, x, y, z], np.float64)
    length = np.linalg.norm(quaternion)
    if not np.isfinite(length) or length < 1e-9:
        raise ValueError(f"({w:g}, {x:g}, {y:g}, {z:g}) is not a rotation")
    return checked_pose(quaternion_rotation(*(quaternion / length)), place)


def checked_pose(rotation: ArrayLike, place: ArrayLike) -> Pose:
    """Return the pose of a rotation (3, 3) and a position (3,) in metres.

    Raises:
        ValueError: the matrix is not a rotation, or a number is not finite.
    """
    matrix, position = np.asarray(rotation, np.float64), np.asarray(place, np.float64)
    if matrix.size != 9 or position.size != 3:
        raise ValueError(f"{matrix.size} and {position.size} numbers are not a pose")
    matrix, position = matrix.reshape(3, 3), position.reshape(3)
    if not np.isfinite(position).all() or np.abs(position).max() > _FURTHEST_M:
        raise ValueError("a place that is not finite, or too far away")
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not off < _ROUND or np.linalg.det(matrix) < 0:
        raise ValueError("a matrix that is not a rotation")
    return Pose(matrix, position)


def heading(rotation: NDArray[np.float64]) -> float:
    """Return the yaw, in radians, of the x axis after a rotation (3, 3)."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
