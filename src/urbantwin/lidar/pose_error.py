"""Poses that are reported wrong: how localisation wanders about where a sensor is, and drifts off.

What wanders is a first-order Gauss-Markov process on each axis, the usual model of slowly varying
errors of navigation (Brown and Hwang, Introduction to Random Signals and Applied Kalman Filtering,
2012, section 4.5): normal, with the correlation ``exp(-t / memory)`` between moments t apart. It is
made from tones of equal power (spectral representation: Shinozuka and Deodatis 1991, Appl. Mech.
Rev. 44(4)), so that it is known at any time without any time before it. What drifts goes off
steadily in a direction that the seed draws, from no error at the motion's start.

Only what is reported is wrong: beams are cast from where the sensor is, and their points lie where
it is believed to be.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.lidar.sensor_path import SensorPath
from urbantwin.site.rig import PoseErrorSpec

__all__ = ["MisplacedPath", "pose_error"]

#: How many tones make what wanders on each axis.
TONES = 32
#: The spectrum is taken up to so many times its corner; 1.6 % of the power lies beyond.
_HIGHEST = 40.0
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
    frequency_hz, phase, ways = _drawn(seed, sensor)
    angle = 2 * np.pi * (frequency_hz / spec.memory_s) * time_s[:, None, None] + phase
    wander = np.sqrt(2.0 / TONES) * np.cos(angle).sum(axis=-1)
    size = np.repeat([spec.rms_m, np.radians(spec.rms_deg)], 3)
    speed = np.repeat([spec.drift_m_per_min, np.radians(spec.drift_deg_per_min)], 3) / 60.0
    return np.asarray(size * wander + speed * ways * time_s[:, None])


@lru_cache(maxsize=256)
def _drawn(
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
    below = (np.arange(TONES) + place) / TONES * np.arctan(_HIGHEST)
    ways = []
    for high, turn in draws[2 * count :].reshape(2, 2):  # even on the sphere (Archimedes)
        up = 2 * high - 1
        flat = np.sqrt(1 - up * up)
        ways += [flat * np.cos(2 * np.pi * turn), flat * np.sin(2 * np.pi * turn), up]
    return np.asarray(np.tan(below) / (2 * np.pi)), np.asarray(2 * np.pi * phase), np.array(ways)
