"""Position and rotation axis of a sensor, and their constraints from pieces of rings.

A beam that rotates about an axis ``a`` sweeps a cone: all its points have one elevation, ``a.u =
sin e`` with ``u`` the line of sight from the sensor's position. Along a piece of a ring with
direction ``t``, at a distance ``r``, the elevation is constant:

    d(a.u)/dt = (a.t - (t.u)(a.u)) / r = 0

Every piece gives this one equation for position and axis, whatever surface it lies on. Range errors
move points along ``u``, which stays on the cone, and do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.ring_pieces import RingPieces

__all__ = ["LEAST_RISE", "Standpoint", "across", "ring_likelihood_ratio", "ring_residuals"]

#: Minimum sine of elevation of a line of sight: seen from its own height, a level line is on a cone
#: wherever the sensor is.
LEAST_RISE = 0.05
#: Minimum distance of two sensors, metres: nearer ones are duplicates.
APART_M = 0.25
_ROOT = float(np.sqrt(np.pi / 2))


@dataclass(frozen=True, eq=False)
class Standpoint:
    """Position and rotation axis of a sensor.

    Attributes:
        place: (3,) float64, metres, in the frame of the points.
        axis: (3,) unit vector, up.
    """

    place: NDArray[np.float64]
    axis: NDArray[np.float64]

    @property
    def tilt(self) -> float:
        """Angle between the axis and z, radians."""
        return float(np.arctan2(np.hypot(self.axis[0], self.axis[1]), self.axis[2]))

    def elevation_deg(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the elevation (N,) at which (N, 3) points are seen, degrees."""
        away = points - self.place
        far = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-9)
        return np.asarray(np.degrees(np.arcsin(np.clip(away @ self.axis / far, -1, 1))))

    def is_beside(self, other: Standpoint) -> bool:
        """Return whether another standpoint is too near to be a separate sensor."""
        return bool(np.sqrt(((self.place - other.place) ** 2).sum()) < APART_M)

    def moved(self, step: NDArray[np.float64]) -> Standpoint:
        """Return it shifted by x, y, z (metres) and rotated by two angles `across` (radians)."""
        first, second = across(self.axis)
        axis = self.axis + step[3] * first + step[4] * second
        return Standpoint(self.place + step[:3], axis / np.sqrt((axis**2).sum()))


def across(axis: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors (3,) orthogonal to an axis that is not along x, and to each other."""
    first = np.cross(axis, [1.0, 0.0, 0.0])
    first /= np.sqrt((first**2).sum())
    return first, np.cross(axis, first)


@dataclass(frozen=True, eq=False)
class RingResiduals:
    """Deviation of pieces of rings from the cone of the beam through them.

    Attributes:
        off: (P,) sine of the angle off the cone, 0 for a ring of this sensor.
        jacobian: (P, 5) its derivative by the steps of `Standpoint.moved`.
        rise: (P,) absolute sine of the angle between line of sight and the horizontal, at least
            `LEAST_RISE`: the largest residual of a level line that is no ring of this sensor.
    """

    off: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    rise: NDArray[np.float64]


def ring_residuals(pieces: RingPieces, seen_from: Standpoint) -> RingResiduals:
    """Return the residuals of pieces as rings of a sensor."""
    away = pieces.middle - seen_from.place
    far = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-6)
    sight = away / far[:, None]
    axis, along = seen_from.axis, pieces.along
    toward = (along * sight).sum(axis=1)
    sine = sight @ axis
    sideways = along - toward[:, None] * sight
    upward = axis - sine[:, None] * sight
    by_place = (sine[:, None] * sideways + toward[:, None] * upward) / far[:, None]
    first, second = across(axis)
    return RingResiduals(
        along @ axis - toward * sine,
        np.column_stack([by_place, sideways @ first, sideways @ second]),
        np.maximum(np.abs(sight[:, 2]), LEAST_RISE),
    )


def ring_likelihood_ratio(found: RingResiduals, spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the likelihood ratio (P,) of pieces: rings of a sensor against lines of any direction.

    The residual of a level line is the sine of its direction times the rise.

    Args:
        found: the residuals of the pieces.
        spread: (P,) standard deviation of the residuals.
    """
    return np.asarray(_ROOT * found.rise / spread * np.exp(-0.5 * (found.off / spread) ** 2))
