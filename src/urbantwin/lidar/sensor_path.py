"""Where a sensor is while it turns: fixed, swaying with its pole, or carried by an actor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.geometry import Pose
from urbantwin.lidar.actor_path import ActorPath

__all__ = ["FixedPath", "RidingPath", "SensorPath", "poses_along"]


class SensorPath(Protocol):
    """The poses of a sensor in the course of one frame; times are seconds from the frame's."""

    @property
    def is_fixed(self) -> bool:
        """Whether it never moves, in no frame: what its rays hit can be kept."""
        ...

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ``site_SE3_sensor`` at times (T,): rotations (T, 3, 3), translations (T, 3)."""
        ...

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses that points are computed with, in the same form.

        A pole that sways is believed to stand still; a vehicle knows how it moves.
        """
        ...


@dataclass(frozen=True, eq=False)
class FixedPath:
    """A sensor that stands still."""

    site_SE3_sensor: Pose  # noqa: N815

    @property
    def is_fixed(self) -> bool:
        """It is."""
        return True

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the same pose for every time."""
        pose, count = self.site_SE3_sensor, len(time_s)
        return (
            np.repeat(pose.rotation[None], count, axis=0),
            np.repeat(pose.translation[None], count, axis=0),
        )

    reported_poses = true_poses


@dataclass(frozen=True, eq=False)
class RidingPath:
    """A sensor that an actor carries.

    Attributes:
        carrier: the actor's path (``site_SE3_asset``), seconds from the frame's time.
        carrier_SE3_sensor: where the sensor is on it.
        deskew: whether points are corrected for its motion during the frame.
    """

    carrier: ActorPath
    carrier_SE3_sensor: Pose  # noqa: N815
    deskew: bool = True

    @property
    def is_fixed(self) -> bool:
        """It is not."""
        return False

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the carrier's poses, times the sensor's on it."""
        rotation, translation = poses_along(self.carrier, time_s)
        offset = rotation @ self.carrier_SE3_sensor.translation
        return rotation @ self.carrier_SE3_sensor.rotation, translation + offset

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the true poses; without ``deskew`` the one at the frame's time for all times."""
        return self.true_poses(time_s if self.deskew else np.zeros(len(time_s)))


def poses_along(
    path: ActorPath, time_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the poses of a path at times (T,): rotations (T, 3, 3), translations (T, 3).

    What ``ActorPath.at`` gives for one time.
    """
    last = len(path.time_s) - 2
    k = np.clip(np.searchsorted(path.time_s, time_s, side="right") - 1, 0, last)
    share = (time_s - path.time_s[k]) / np.diff(path.time_s)[k]
    between = np.swapaxes(path.rotation[:-1], 1, 2) @ path.rotation[1:]
    turn = Rotation.from_matrix(between).as_rotvec()
    rotation = path.rotation[k] @ Rotation.from_rotvec(share[:, None] * turn[k]).as_matrix()
    step = np.diff(path.translation, axis=0)
    return rotation, path.translation[k] + share[:, None] * step[k]
