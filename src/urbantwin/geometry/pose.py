"""Poses: rigid transforms between right-handed frames.

``a_SE3_b`` transforms points of frame b to frame a. Angles follow ROS REP-103: x forward, y left, z
up; R = Rz(yaw) Ry(pitch) Rx(roll). Positive yaw is counter-clockwise from above, positive pitch
moves the front **down**, positive roll lowers the right side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Pose", "rotation_from_ypr", "ypr_from_rotation"]


def rotation_from_ypr(yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> NDArray[np.float64]:
    """Return rotation matrices (..., 3, 3) of angles in radians (broadcast together)."""
    yaw, pitch, roll = np.broadcast_arrays(
        np.asarray(yaw, np.float64), np.asarray(pitch, np.float64), np.asarray(roll, np.float64)
    )
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    turned = np.empty((*yaw.shape, 3, 3))
    for number, row in enumerate(rows):
        for column, values in enumerate(row):
            turned[..., number, column] = values
    return turned


def ypr_from_rotation(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return yaw, pitch, roll in radians of one (3, 3) rotation matrix."""
    yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    # Numpy's clip is a hundred times slower for a single number.
    pitch = float(-np.arcsin(min(max(float(rotation[2, 0]), -1.0), 1.0)))
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return yaw, pitch, roll


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform: ``rotation`` (3, 3) then ``translation`` (3,), metres, float64."""

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    @classmethod
    def from_ypr(
        cls, translation: ArrayLike, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
    ) -> Pose:
        """Build a pose from a position in metres and angles in radians."""
        return cls(
            rotation_from_ypr(yaw, pitch, roll), np.asarray(translation, np.float64).reshape(3)
        )

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (N, 3) points of the inner frame in the outer frame."""
        return np.asarray(points, np.float64) @ self.rotation.T + self.translation

    def inverse(self) -> Pose:
        """Return the transform the other way."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Pose) -> Pose:
        """Chain: ``a_SE3_b @ b_SE3_c`` is ``a_SE3_c``."""
        return Pose(self.rotation @ other.rotation, self.apply(other.translation[None])[0])

    def quaternion(self) -> tuple[float, float, float, float]:
        """Return the rotation as a unit quaternion w, x, y, z with w >= 0."""
        from scipy.spatial.transform import Rotation

        w, x, y, z = Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True)
        return float(w), float(x), float(y), float(z)
