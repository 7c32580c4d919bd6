"""Where a sensor is while it turns: fixed, swaying with its pole, or carried by an actor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose

__all__ = ["FixedPath", "SensorPath"]


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
        """Return where whoever writes the points believes the sensor is, in the same form.

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
            np.broadcast_to(pose.rotation, (count, 3, 3)),
            np.broadcast_to(pose.translation, (count, 3)),
        )

    reported_poses = true_poses
