"""Sway: how the pole of a roadside sensor swings in the wind.

The wind's gusts shake a pole at all frequencies; it answers at its first mode. We take gusts of
equal strength at all frequencies near it, so that the displacement has the spectrum of a damped
oscillator, ``1 / ((1 - r^2)^2 + (2 zeta r)^2)`` with ``r = f / f_0`` (the square of the
magnification factor of a single degree of freedom: Clough and Penzien, Dynamics of Structures,
1993, chapter 3). It is made from tones of equal power with random phases (spectral
representation: Shinozuka and Deodatis 1991, Appl. Mech. Rev. 44(4)), so the motion is known at
any time without any time before it.

The pole is a cantilever: where its top is displaced by d, it leans by ``1.3765 d / height``
(slope over deflection of the first mode at the free end: Blevins, Formulas for Natural Frequency
and Mode Shape, 1979, table 8-1).

Points are computed without the sway: the reported pose stands still.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.geometry import Pose
from urbantwin.lidar.sensor_path import FixedPath
from urbantwin.site.rig import SwaySpec

__all__ = ["SwayingPath", "displacement"]

#: How many tones make the motion in each direction.
TONES = 32
#: Slope times length over deflection of a cantilever's free end in its first mode.
SLOPE_OF_FIRST_MODE = 1.3765
#: The spectrum is taken up to so many times the first mode; the power beyond is negligible.
_HIGHEST = 4.0
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
    tones = _tones(sway.frequency_hz, sway.damping, seed, pole)
    angle = 2 * np.pi * tones[0] * time_s[:, None, None] + tones[1]
    return np.asarray(sway.rms_m * np.sqrt(2.0 / TONES) * np.cos(angle).sum(axis=-1))


@lru_cache(maxsize=256)
def _tones(frequency_hz: float, damping: float, seed: int, pole: int) -> NDArray[np.float64]:
    """Return frequency, Hz, and phase, radians (2, 2, TONES) of the tones in both directions.

    Every tone stands for the same share of the power, at a place drawn within that share.
    """
    key = np.array([seed % 2**64, (pole << 48) | _OF_SWAY], np.uint64)
    words = np.random.Philox(key=key).random_raw(4 * TONES)
    draws = ((words >> np.uint64(11)) + 0.5).reshape(2, 2, TONES) * 2.0**-53
    # Finer near the mode, where a lightly damped pole has all its power.
    span = np.linspace(-1.0, 1.0, 4001)
    ratio = np.clip(1.0 + damping * np.sinh(span * np.arcsinh(_HIGHEST / damping)), 0.0, _HIGHEST)
    power = 1.0 / ((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2)
    below = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(ratio))])
    share = (np.arange(TONES) + draws[0]) / TONES
    frequency = frequency_hz * np.interp(share * below[-1], below, ratio)
    return np.stack([frequency, 2 * np.pi * draws[1]])
