"""Which rays of a spinning sensor can touch a box: its rectangle of rings and columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.pattern import beam_azimuths, beam_elevations
from urbantwin.lidar.sensor import Sensor

__all__ = ["AngularBounds", "RayGrid", "RayList", "Rays", "angular_bounds"]

#: The twelve edges of a box whose corner i has its x, y, z at the high end where bits 0, 1, 2
#: of i are set.
_EDGES = np.array(
    [(corner, corner | bit) for bit in (1, 2, 4) for corner in range(8) if not corner & bit]
)
#: Elevations are widened by this, radians: far above float32's rounding, far below a ring.
_ELEVATION_MARGIN = 1e-4
#: Closer to the sensor's axis than this, metres, a corner has no azimuth.
_AXIS_MARGIN_M = 1e-3


@dataclass(frozen=True, eq=False)
class AngularBounds:
    """Bounds of A boxes as seen from a sensor, radians, each (A,) float64.

    Attributes:
        azimuth: where the box begins, counter-clockwise.
        width: how far it reaches from there; 2 pi for a box around the sensor's axis.
        lowest: lowest elevation.
        highest: highest elevation.
    """

    azimuth: NDArray[np.float64]
    width: NDArray[np.float64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]


def angular_bounds(corners: NDArray[np.float64]) -> AngularBounds:
    """Bound the directions in which boxes lie.

    Azimuth: the corners leave a widest gap. It is more than half a turn exactly when the sensor's
    axis passes outside the box. Elevation: along an edge ``p + t d`` it has one extreme, where
    ``t = (p_z p.d - d_z p.p) / (d_z p.d - p_z d.d)`` with horizontal dot products; inside a face
    it has none, because a plane that does not hold the sensor touches no cone about its axis.

    Args:
        corners: (A, 8, 3) corners in the sensor frame, in the order of binary counting
            (bit 0 = x, bit 1 = y, bit 2 = z).
    """
    azimuth = np.sort(np.arctan2(corners[..., 1], corners[..., 0]), axis=1)
    gaps = np.diff(azimuth, axis=1, append=azimuth[:, :1] + 2 * np.pi)
    widest = gaps.argmax(axis=1)
    rows = np.arange(len(corners))
    gap = gaps[rows, widest]
    start = azimuth[rows, (widest + 1) % 8]

    p = corners[:, _EDGES[:, 0]]
    d = corners[:, _EDGES[:, 1]] - p
    pp, pd, dd = ((u[..., :2] * v[..., :2]).sum(-1) for u, v in ((p, p), (p, d), (d, d)))
    slope = d[..., 2] * pd - p[..., 2] * dd
    t = np.divide(
        p[..., 2] * pd - d[..., 2] * pp, slope, out=np.zeros_like(slope), where=slope != 0
    )
    extreme = p + np.clip(t, 0.0, 1.0)[..., None] * d
    points = np.concatenate([corners, extreme], axis=1)
    distance = np.hypot(points[..., 0], points[..., 1])
    elevation = np.arctan2(points[..., 2], distance)

    around = (gap <= np.pi + 1e-6) | (distance.min(axis=1) < _AXIS_MARGIN_M)
    up = corners[..., 2].max(axis=1) > 0
    down = corners[..., 2].min(axis=1) < 0
    return AngularBounds(
        start,
        np.where(around, 2 * np.pi, 2 * np.pi - gap),
        np.where(around & down, -np.pi / 2, elevation.min(axis=1)),
        np.where(around & up, np.pi / 2, elevation.max(axis=1)),
    )


class Rays(Protocol):
    """The rays of a sensor, which can tell those that point into given bounds."""

    def rays_within(
        self, azimuth: float, width: float, lowest: float, highest: float
    ) -> NDArray[np.int64]:
        """Return at least every ray that points into the given bounds."""
        ...


class RayList:
    """Rays that stand in no rows and columns: those of a pattern that does not repeat.

    Args:
        directions: (N, 3) unit vectors, sensor frame.
    """

    def __init__(self, directions: NDArray[np.float64]) -> None:
        self._azimuth = np.arctan2(directions[:, 1], directions[:, 0])
        self._elevation = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))

    def rays_within(
        self, azimuth: float, width: float, lowest: float, highest: float
    ) -> NDArray[np.int64]:
        """Return every ray that points into the given bounds, padded a little."""
        past = np.mod(self._azimuth - (azimuth - _ELEVATION_MARGIN), 2 * np.pi)
        return np.flatnonzero(
            (past <= width + 2 * _ELEVATION_MARGIN)
            & (self._elevation >= lowest - _ELEVATION_MARGIN)
            & (self._elevation <= highest + _ELEVATION_MARGIN)
        )


class RayGrid:
    """The rays of a spinning sensor by ring and column: ray = ring * columns + column.

    Rings may stand at any elevation, in any order, each at its own offset in azimuth.

    Args:
        sensor: the sensor.
        columns: firings per turn.
    """

    def __init__(self, sensor: Sensor, columns: int) -> None:
        self.columns = columns
        self._elevation = beam_elevations(sensor)
        self._azimuth = beam_azimuths(sensor, columns)[:, 0]
        self._clockwise = sensor.spin == "cw"
        self._step = 2 * np.pi / columns

    def rays_within(
        self, azimuth: float, width: float, lowest: float, highest: float
    ) -> NDArray[np.int64]:
        """Return every ray that points into the given bounds, padded by one column."""
        rings = np.flatnonzero(
            (self._elevation >= lowest - _ELEVATION_MARGIN)
            & (self._elevation <= highest + _ELEVATION_MARGIN)
        )
        count = int(width / self._step) + 4
        if count >= self.columns:
            columns = np.arange(self.columns)[None, :]
        else:
            if self._clockwise:
                first = self._azimuth[rings] - (azimuth + width)
            else:
                first = azimuth - self._azimuth[rings]
            start = np.floor(first / self._step).astype(np.int64) - 1
            columns = (start[:, None] + np.arange(count)) % self.columns
        return (rings[:, None] * self.columns + columns).ravel()
