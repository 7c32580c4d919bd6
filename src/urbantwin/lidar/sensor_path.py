"""Where a sensor is while it turns: fixed, swaying with its pole, or carried by an actor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.geometry import Pose
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.site.rig import PoseErrorSpec, SwaySpec

__all__ = [
    "FixedPath",
    "MisplacedPath",
    "RidingPath",
    "SensorPath",
    "SwayingPath",
    "displacement",
    "pose_error",
    "poses_along",
]

#: How many tones make the motion in each direction.
TONES = 32
#: Slope times length over deflection of a cantilever's free end in its first mode.
SLOPE_OF_FIRST_MODE = 1.3765
#: The spectrum is taken up to so many times the first mode; the power beyond is negligible.
_HIGHEST_MODE = 4.0
#: Tells the draws of sway from those of returns, whose keys hold a frame's number there.
_OF_SWAY = 0b11 << 46


@dataclass(frozen=True, eq=False)
class SwayingPath:
    """A sensor on a pole that swings about where it is believed to be.

    Attributes:
        site_SE3_sensor: where it is at rest.
        sway: how it swings.
        height_m: of the sensor above the foot of the pole.
        time_s: of the frame, from the motion's start.
        seed: of all random numbers.
        pole: the pole's number; sensors on one pole swing together.
    """

    site_SE3_sensor: Pose  # noqa: N815
    sway: SwaySpec
    height_m: float
    time_s: float
    seed: int
    pole: int

    @property
    def is_fixed(self) -> bool:
        """It is not."""
        return False

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses of the swinging sensor."""
        moved = displacement(self.sway, self.time_s + time_s, self.seed, self.pole)
        # Leaning towards the displacement: about the horizontal axis to the left of it.
        lean = moved * (SLOPE_OF_FIRST_MODE / self.height_m)
        axis = np.column_stack([-lean[:, 1], lean[:, 0], np.zeros(len(lean))])
        rotation = Rotation.from_rotvec(axis).as_matrix() @ self.site_SE3_sensor.rotation
        translation = np.tile(self.site_SE3_sensor.translation, (len(moved), 1))
        translation[:, :2] += moved
        return rotation, translation

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where it is at rest."""
        return FixedPath(self.site_SE3_sensor).true_poses(time_s)


def displacement(
    sway: SwaySpec, time_s: NDArray[np.float64], seed: int, pole: int
) -> NDArray[np.float64]:
    """Return how far (T, 2) a pole's top is east and north of its rest, metres.

    Args:
        sway: how it swings.
        time_s: (T,) from the motion's start.
        seed: of all random numbers.
        pole: its number.
    """
    tones = _sway_tones(sway.frequency_hz, sway.damping, seed, pole)
    angle = 2 * np.pi * tones[0] * time_s[:, None, None] + tones[1]
    return np.asarray(sway.rms_m * np.sqrt(2.0 / TONES) * np.cos(angle).sum(axis=-1))


@lru_cache(maxsize=256)
def _sway_tones(frequency_hz: float, damping: float, seed: int, pole: int) -> NDArray[np.float64]:
    """Return frequency, Hz, and phase, radians (2, 2, TONES) of the tones in both directions.

    Every tone stands for the same share of the power, at a place drawn within that share.
    """
    key = np.array([seed % 2**64, (pole << 48) | _OF_SWAY], np.uint64)
    words = np.random.Philox(key=key).random_raw(4 * TONES)
    draws = ((words >> np.uint64(11)) + 0.5).reshape(2, 2, TONES) * 2.0**-53
    # Finer near the mode, where a lightly damped pole has all its power.
    span = np.linspace(-1.0, 1.0, 4001)
    ratio = np.clip(
        1.0 + damping * np.sinh(span * np.arcsinh(_HIGHEST_MODE / damping)), 0.0, _HIGHEST_MODE
    )
    power = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2)
    below = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(ratio))])
    share = (np.arange(TONES) + draws[0]) / TONES
    frequency = frequency_hz * np.interp(share * below[-1], below, ratio)
    return np.stack([frequency, 2 * np.pi * draws[1]])


#: The spectrum is taken up to so many times its corner; 1.6 % of the power lies beyond.
_HIGHEST_WANDER = 40.0
#: Tells these draws from those of returns, timing and sway.
_OF_POSE_ERROR = 1 << 46
_AXES = 6


@dataclass(frozen=True, eq=False)
class MisplacedPath:
    """A sensor whose pose is reported wrong.

    Attributes:
        path: where it is, and where it would be reported without that.
        error: how wrong.
        time_s: of the frame, from the motion's start.
        seed: of all random numbers.
        sensor: its number.
    """

    path: SensorPath
    error: PoseErrorSpec
    time_s: float
    seed: int
    sensor: int

    @property
    def is_fixed(self) -> bool:
        """Whether the sensor itself stands still."""
        return self.path.is_fixed

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where it is."""
        return self.path.true_poses(time_s)

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return where it is believed to be: moved, and turned about its own place."""
        rotation, translation = self.path.reported_poses(time_s)
        off = pose_error(self.error, self.time_s + time_s, self.seed, self.sensor)
        return Rotation.from_rotvec(off[:, 3:]).as_matrix() @ rotation, translation + off[:, :3]


def pose_error(
    spec: PoseErrorSpec, time_s: NDArray[np.float64], seed: int, sensor: int
) -> NDArray[np.float64]:
    """Return how wrong a pose is (T, 6): metres and radians along and about east, north and up.

    Args:
        spec: how wrong it is.
        time_s: (T,) from the motion's start.
        seed: of all random numbers.
        sensor: its number.
    """
    frequency_hz, phase, ways = _wander_tones(seed, sensor)
    angle = 2 * np.pi * (frequency_hz / spec.memory_s) * time_s[:, None, None] + phase
    wander = np.sqrt(2.0 / TONES) * np.cos(angle).sum(axis=-1)
    size = np.repeat([spec.rms_m, np.radians(spec.rms_deg)], 3)
    speed = np.repeat([spec.drift_m_per_min, np.radians(spec.drift_deg_per_min)], 3) / 60.0
    return np.asarray(size * wander + speed * ways * time_s[:, None])


@lru_cache(maxsize=256)
def _wander_tones(
    seed: int, sensor: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return tones (6, TONES), their frequency times the memory and phase, and drift's ways (6,).

    Every tone stands for the same share of the power, at a place drawn within that share.
    """
    key = np.array([seed % 2**64, (sensor << 48) | _OF_POSE_ERROR], np.uint64)
    count = _AXES * TONES
    words = np.random.Philox(key=key).random_raw(2 * count + 4)
    draws = ((words >> np.uint64(11)) + 0.5) * 2.0**-53
    place, phase = draws[: 2 * count].reshape(2, _AXES, TONES)
    below = (np.arange(TONES) + place) / TONES * np.arctan(_HIGHEST_WANDER)
    ways = []
    for high, turn in draws[2 * count :].reshape(2, 2):  # even on the sphere (Archimedes)
        up = 2 * high - 1
        flat = np.sqrt(1 - up * up)
        ways += [flat * np.cos(2 * np.pi * turn), flat * np.sin(2 * np.pi * turn), up]
    return np.asarray(np.tan(below) / (2 * np.pi)), np.asarray(2 * np.pi * phase), np.array(ways)


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
