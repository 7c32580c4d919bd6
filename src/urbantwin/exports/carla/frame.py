"""CARLA's frame: x east, y south, z up, metres; angles in degrees, clockwise from above.

CARLA reads OpenDRIVE's x and y as x and -y (LibCarla, ``carla/road/element``: "Unreal's Y axis
hack"), because Unreal's frame is left-handed. Unreal's own unit is the centimetre; CARLA's Python
interface and the files beside the package use metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import Pose

__all__ = ["carla_points", "carla_transform", "pose_of_carla"]


def carla_points(points: ArrayLike) -> NDArray[np.float64]:
    """Return points (N, 3) of the site frame in CARLA's frame, metres."""
    return np.asarray(points, np.float64).reshape(-1, 3) * [1.0, -1.0, 1.0]


def carla_transform(pose: Pose) -> dict[str, dict[str, float]]:
    """Return a pose as arguments of ``carla.Transform``.

    A ``carla.Rotation`` is about Unreal's axes: yaw clockwise from above, positive pitch lifts the
    nose, positive roll lowers the right side. With F the mirror of y, the rotation of a pose R (x
    forward, y left) is F R F there, so yaw and pitch change their signs, and roll does not.

    Returns:
        ``location`` (x, y, z, metres) and ``rotation`` (pitch, yaw, roll, degrees).
    """
    r = pose.rotation
    yaw = math.atan2(r[1, 0], r[0, 0])
    pitch = -math.asin(min(1.0, max(-1.0, float(r[2, 0]))))
    roll = math.atan2(r[2, 1], r[2, 2])
    x, y, z = carla_points(pose.translation)[0]
    angles = {"pitch": -pitch, "yaw": -yaw, "roll": roll}
    return {
        "location": {"x": _short(x), "y": _short(y), "z": _short(z)},
        "rotation": {name: _short(math.degrees(value)) for name, value in angles.items()},
    }


def pose_of_carla(location: Sequence[float], rotation: Sequence[float]) -> Pose:
    """Return the pose in the site frame of a CARLA transform.

    Args:
        location: x, y, z in CARLA's frame, metres.
        rotation: pitch, yaw, roll, degrees.
    """
    pitch, yaw, roll = np.radians(np.asarray(rotation, np.float64))
    return Pose.from_ypr(carla_points(location)[0], -float(yaw), -float(pitch), float(roll))


def _short(value: float) -> float:
    """A tenth of a millimetre, or of a milli-degree; no negative zero."""
    return round(float(value), 4) + 0.0
