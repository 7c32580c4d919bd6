"""Poses of a sensor over a frame: fixed, swaying with its pole, carried, or reported with errors.

**Sway.** Wind gusts excite a pole at all frequencies; it responds at its first mode. Gusts of equal
power near it give the displacement the spectrum of a damped oscillator, ``1 / ((1 - r^2)^2 + (2
zeta r)^2)`` with ``r = f / f_0`` (the squared magnification factor of a single degree of freedom:
Clough and Penzien, Dynamics of Structures, 1993, chapter 3). The pole is a cantilever: a
displacement d of its top tilts it by ``1.3765 d / height`` (slope over deflection of the first mode
at the free end: Blevins, Formulas for Natural Frequency and Mode Shape, 1979, table 8-1). Points
are computed with the pose at rest.

**Pose errors.** The error on each axis is a first-order Gauss-Markov process, the usual model of
slowly varying navigation errors (Brown and Hwang, Introduction to Random Signals and Applied Kalman
Filtering, 2012, section 4.5): normal, with correlation ``exp(-t / memory)`` over time t. A drift
grows linearly from zero at the motion's start, in a random direction. Only the reported pose is
wrong: beams are cast from the true pose, and points computed with the reported one.

Both are sums of tones of equal power (spectral representation: Shinozuka and Deodatis 1991, Appl.
Mech. Rev. 44(4)), so that they can be evaluated at any time independently.
"""

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


class SensorPath(Protocol):
    """Poses of a sensor over one frame; times are seconds relative to the frame's."""

    @property
    def is_fixed(self) -> bool:
        """Whether the true pose is constant over all frames, so that ray hits can be cached."""
        ...

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ``site_SE3_sensor`` at times (T,): rotations (T, 3, 3), translations (T, 3)."""
        ...

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses with which points are computed, in the same form.

        A swaying pole is assumed to be at rest; a vehicle's motion is known.
        """
        ...


@dataclass(frozen=True, eq=False)
class FixedPath:
    """A sensor that does not move."""

    site_SE3_sensor: Pose  # noqa: N815

    @property
    def is_fixed(self) -> bool:
        """Always true."""
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
    """A sensor on an actor.

    Attributes:
        carrier: path of the actor (``site_SE3_asset``), seconds relative to the frame's time.
        carrier_SE3_sensor: pose of the sensor on it.
        deskew: whether points are corrected for the motion during the frame.
    """

    carrier: ActorPath
    carrier_SE3_sensor: Pose  # noqa: N815
    deskew: bool = True

    @property
    def is_fixed(self) -> bool:
        """Always false."""
        return False

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the carrier's poses times the sensor's pose on it."""
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

    The vectorised form of ``ActorPath.at``.
    """
    last = len(path.time_s) - 2
    k = np.clip(np.searchsorted(path.time_s, time_s, side="right") - 1, 0, last)
    share = (time_s - path.time_s[k]) / np.diff(path.time_s)[k]
    between = np.swapaxes(path.rotation[:-1], 1, 2) @ path.rotation[1:]
    turn = Rotation.from_matrix(between).as_rotvec()
    rotation = path.rotation[k] @ Rotation.from_rotvec(share[:, None] * turn[k]).as_matrix()
    step = np.diff(path.translation, axis=0)
    return rotation, path.translation[k] + share[:, None] * step[k]


#: Number of tones per axis.
TONES = 32
#: Slope times length over deflection of a cantilever's free end, first mode.
SLOPE_OF_FIRST_MODE = 1.3765
#: Upper end of the spectrum, relative to the first mode; the power beyond is negligible.
_HIGHEST_MODE = 4.0
#: Separates the random numbers of sway from those of returns, whose keys hold a frame's number
#: here.
_OF_SWAY = 0b11 << 46


@dataclass(frozen=True, eq=False)
class SwayingPath:
    """A sensor on a swaying pole.

    Attributes:
        site_SE3_sensor: pose at rest.
        sway: amplitude, frequency and damping.
        height_m: height of the sensor above the foot of the pole.
        time_s: time of the frame from the motion's start.
        seed: random seed.
        pole: index of the pole; sensors on one pole move together.
    """

    site_SE3_sensor: Pose  # noqa: N815
    sway: SwaySpec
    height_m: float
    time_s: float
    seed: int
    pole: int

    @property
    def is_fixed(self) -> bool:
        """Always false."""
        return False

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the poses of the swaying sensor."""
        moved = displacement(self.sway, self.time_s + time_s, self.seed, self.pole)
        # The tilt is towards the displacement: about the horizontal axis to its left.
        lean = moved * (SLOPE_OF_FIRST_MODE / self.height_m)
        axis = np.column_stack([-lean[:, 1], lean[:, 0], np.zeros(len(lean))])
        rotation = Rotation.from_rotvec(axis).as_matrix() @ self.site_SE3_sensor.rotation
        translation = np.tile(self.site_SE3_sensor.translation, (len(moved), 1))
        translation[:, :2] += moved
        return rotation, translation

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pose at rest."""
        return FixedPath(self.site_SE3_sensor).true_poses(time_s)


def displacement(
    sway: SwaySpec, time_s: NDArray[np.float64], seed: int, pole: int
) -> NDArray[np.float64]:
    """Return the displacement (T, 2) of a pole's top to the east and north, metres.

    Args:
        sway: amplitude, frequency and damping.
        time_s: (T,) from the motion's start.
        seed: random seed.
        pole: index of the pole.
    """
    tones = _sway_tones(sway.frequency_hz, sway.damping, seed, pole)
    angle = 2 * np.pi * tones[0] * time_s[:, None, None] + tones[1]
    return np.asarray(sway.rms_m * np.sqrt(2.0 / TONES) * np.cos(angle).sum(axis=-1))


@lru_cache(maxsize=256)
def _sway_tones(frequency_hz: float, damping: float, seed: int, pole: int) -> NDArray[np.float64]:
    """Return frequencies, Hz, and phases, radians (2, 2, TONES) of the tones in both directions.

    Every tone represents an equal share of the power, at a random frequency within it.
    """
    key = np.array([seed % 2**64, (pole << 48) | _OF_SWAY], np.uint64)
    words = np.random.Philox(key=key).random_raw(4 * TONES)
    draws = ((words >> np.uint64(11)) + 0.5).reshape(2, 2, TONES) * 2.0**-53
    # A finer grid near the mode, which holds all power of a lightly damped pole.
    span = np.linspace(-1.0, 1.0, 4001)
    ratio = np.clip(
        1.0 + damping * np.sinh(span * np.arcsinh(_HIGHEST_MODE / damping)), 0.0, _HIGHEST_MODE
    )
    power = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2)
    below = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(ratio))])
    share = (np.arange(TONES) + draws[0]) / TONES
    frequency = frequency_hz * np.interp(share * below[-1], below, ratio)
    return np.stack([frequency, 2 * np.pi * draws[1]])


#: Upper end of the spectrum, relative to its corner; 1.6 % of the power is beyond.
_HIGHEST_WANDER = 40.0
#: Separates these random numbers from those of returns, timing and sway.
_OF_POSE_ERROR = 1 << 46
_AXES = 6


@dataclass(frozen=True, eq=False)
class MisplacedPath:
    """A sensor with errors of its reported pose.

    Attributes:
        path: true path, and path reported without errors.
        error: size of the errors.
        time_s: time of the frame from the motion's start.
        seed: random seed.
        sensor: index of the sensor.
    """

    path: SensorPath
    error: PoseErrorSpec
    time_s: float
    seed: int
    sensor: int

    @property
    def is_fixed(self) -> bool:
        """Whether the true pose is fixed."""
        return self.path.is_fixed

    def true_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the true poses."""
        return self.path.true_poses(time_s)

    def reported_poses(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the reported poses: shifted, and rotated about the sensor's own position."""
        rotation, translation = self.path.reported_poses(time_s)
        off = pose_error(self.error, self.time_s + time_s, self.seed, self.sensor)
        return Rotation.from_rotvec(off[:, 3:]).as_matrix() @ rotation, translation + off[:, :3]


def pose_error(
    spec: PoseErrorSpec, time_s: NDArray[np.float64], seed: int, sensor: int
) -> NDArray[np.float64]:
    """Return the pose error (T, 6): metres along and radians about east, north and up.

    Args:
        spec: size of the errors.
        time_s: (T,) from the motion's start.
        seed: random seed.
        sensor: index of the sensor.
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
    """Return frequencies times memory, phases (6, TONES), and the drift's directions (6,).

    Every tone represents an equal share of the power, at a random frequency within it.
    """
    key = np.array([seed % 2**64, (sensor << 48) | _OF_POSE_ERROR], np.uint64)
    count = _AXES * TONES
    words = np.random.Philox(key=key).random_raw(2 * count + 4)
    draws = ((words >> np.uint64(11)) + 0.5) * 2.0**-53
    place, phase = draws[: 2 * count].reshape(2, _AXES, TONES)
    below = (np.arange(TONES) + place) / TONES * np.arctan(_HIGHEST_WANDER)
    ways = []
    for high, turn in draws[2 * count :].reshape(2, 2):  # uniform on the sphere (Archimedes)
        up = 2 * high - 1
        flat = np.sqrt(1 - up * up)
        ways += [flat * np.cos(2 * np.pi * turn), flat * np.sin(2 * np.pi * turn), up]
    return np.asarray(np.tan(below) / (2 * np.pi)), np.asarray(2 * np.pi * phase), np.array(ways)
