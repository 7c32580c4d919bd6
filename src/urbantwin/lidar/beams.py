"""Beams of a turn: directions, footprint, reported azimuths and outages.

**Footprint.** A laser beam is Gaussian: at angle r from its axis its irradiance is ``exp(-r^2 / (2
s^2))`` of that on the axis, with s the full width at half maximum over ``2 sqrt(2 ln 2)``; its
power has a mean square angle of ``2 s^2``. Seven rays of equal share, one on the axis and six at
``sqrt(7 / 3) s``, have the same mean square and, by symmetry, the same first and third moments.
Therefore the mean range of a surface over them is correct to second order.

**Encoder resolution.** A sensor reports its azimuth in steps (``azimuth_step_deg``: a hundredth of
a degree in packets of Velodyne and Hesai). Columns on whole steps, like those of 0.2 degrees or of
an Ouster, are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.pattern import (
    beam_azimuths,
    beam_directions,
    beam_elevations,
    pattern_directions,
)
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sensor import Sensor

__all__ = ["Beams", "Footprint", "Rings", "as_reported", "dead_beams", "encoder_errors"]


@dataclass(frozen=True, eq=False)
class Footprint:
    """Rays that represent a beam.

    Attributes:
        offset: (S, 2) float64, offsets from the axis, horizontal (left) and vertical (up), radians;
            the first ray is the axis.
        share: (S,) float64, share of the beam's power; sums to 1.
    """

    offset: NDArray[np.float64]
    share: NDArray[np.float64]

    @property
    def reach(self) -> float:
        """Largest offset from the axis, radians."""
        return float(np.abs(self.offset).max())

    @classmethod
    def thin(cls) -> Footprint:
        """Return a beam of a single ray."""
        return cls(np.zeros((1, 2)), np.ones(1))

    @classmethod
    def of(cls, sensor: Sensor) -> Footprint:
        """Return the beam of a sensor."""
        across, up = np.radians(sensor.assumed_divergence_deg) / np.sqrt(8 * np.log(2))
        turn = np.radians(60.0 * np.arange(6) + 30.0)
        ring = np.sqrt(7 / 3) * np.column_stack([across * np.cos(turn), up * np.sin(turn)])
        return cls(np.vstack([np.zeros((1, 2)), ring]), np.full(7, 1 / 7))


def encoder_errors(sensor: Sensor, columns: int) -> NDArray[np.float64]:
    """Return the error of the reported azimuth of each column (K,), radians counter-clockwise."""
    step = sensor.azimuth_step_deg
    if step is None or sensor.pattern is not None:
        return np.zeros(columns)
    step = 360.0 / round(360.0 / step)  # a whole number of steps per turn
    true = 360.0 * np.arange(columns) / columns
    error = np.rint(true / step) * step - true
    error[np.abs(error) < 1e-9] = 0.0
    return np.radians(error if sensor.spin == "ccw" else -error)


def as_reported(
    directions: NDArray[np.float64], sensor: Sensor, columns: int
) -> NDArray[np.float64]:
    """Return the directions (C * K, 3) that a sensor reports for beams (C * K, 3)."""
    error = encoder_errors(sensor, columns)
    if not error.any():
        return directions
    fans = directions.reshape(-1, columns, 3)
    cosine, sine = np.cos(error), np.sin(error)
    x, y = fans[..., 0], fans[..., 1]
    turned = np.stack([x * cosine - y * sine, x * sine + y * cosine, fans[..., 2]], axis=-1)
    return np.ascontiguousarray(turned.reshape(-1, 3))


#: Tolerance at the borders of a sector, degrees: azimuths are binary fractions.
_ON_THE_BORDER_DEG = 1e-9


def dead_beams(mounted: MountedSensor, time_s: float) -> NDArray[np.bool_] | None:
    """Return the beams (C, K) in an outage; ``None`` if all work.

    Args:
        mounted: the sensor.
        time_s: time of the frame, seconds from the motion's start; an outage then lasts for the
            frame.
    """
    active = tuple(
        number
        for number, outage in enumerate(mounted.outages)
        if outage.start_s <= time_s and (outage.stop_s is None or time_s < outage.stop_s)
    )
    if not active:
        return None
    # Beams of a non-repeating pattern differ by frame.
    frame = round(time_s * mounted.rate_hz) if mounted.sensor.pattern is not None else 0
    return _dead(mounted, active, frame)


@lru_cache(maxsize=16)
def _dead(mounted: MountedSensor, active: tuple[int, ...], frame: int) -> NDArray[np.bool_]:
    azimuth_deg = np.degrees(_azimuths(mounted, frame))
    dead = np.zeros(azimuth_deg.shape, bool)
    for number in active:
        outage = mounted.outages[number]
        hit = np.ones(azimuth_deg.shape, bool)
        if outage.sector_deg is not None:
            first, last = outage.sector_deg
            width = 360.0 if abs(last - first) >= 360.0 else (last - first) % 360.0
            past = (azimuth_deg - first + _ON_THE_BORDER_DEG) % 360.0
            hit &= past <= width + 2 * _ON_THE_BORDER_DEG
        if outage.channels is not None:
            broken = np.zeros(len(azimuth_deg), bool)
            broken[outage.channels] = True
            hit &= broken[:, None]
        dead |= hit
    dead.flags.writeable = False
    return dead


def _azimuths(mounted: MountedSensor, frame: int) -> NDArray[np.float64]:
    """Return the azimuths (C, K) of the beams of a frame, radians."""
    pattern = mounted.sensor.pattern
    if pattern is None:
        return beam_azimuths(mounted.sensor, mounted.columns)
    beams = pattern_directions(pattern, mounted.columns, frame, mounted.rate_hz)
    return np.asarray(np.arctan2(beams[..., 1], beams[..., 0]))


class Rings(NamedTuple):
    """Channels of a spinning sensor, sorted by elevation.

    Attributes:
        order: (C,) int64, channel numbers, lowest elevation first.
        elevation: (C,) float64, radians, ascending.
        azimuth: (C,) float64, azimuth in column 0, radians counter-clockwise.
        step: azimuth step between columns, radians.
        turn: +1 counter-clockwise, -1 clockwise.
    """

    order: NDArray[np.int64]
    elevation: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    step: float
    turn: int


@dataclass(frozen=True, eq=False)
class Beams:
    """The N beams of a turn: beam = channel * columns + column.

    Attributes:
        directions: (N, 3) float64 unit vectors, sensor frame.
        columns: K.
        channels: C.
        footprint: rays that represent each beam.
        believed: (N, 3) float64, directions that the sensor reports: its encoder has finite steps.
        aside: largest error of these, radians.
        rings: channels by elevation; ``None`` for a scan pattern without columns.
    """

    directions: NDArray[np.float64]
    columns: int
    channels: int
    footprint: Footprint
    believed: NDArray[np.float64]
    aside: float
    rings: Rings | None

    @classmethod
    def of(cls, mounted: MountedSensor, turn: int = 0) -> Beams:
        """Return the beams of a sensor.

        Args:
            mounted: the sensor.
            turn: number of the turn; only a non-repeating pattern depends on it.
        """
        sensor, columns = mounted.sensor, mounted.columns
        spread = mounted.effects.footprint
        footprint = Footprint.of(sensor) if spread else Footprint.thin()
        if sensor.pattern is not None:
            directions = pattern_directions(
                sensor.pattern, columns, turn, mounted.turns_per_second
            ).reshape(-1, 3)
            return cls(directions, columns, sensor.channels, footprint, directions, 0.0, None)
        turning = mounted.turns_per_second if mounted.effects.rolling_shutter else 0.0
        elevation = beam_elevations(sensor)
        order = np.argsort(elevation, kind="stable")
        rings = Rings(
            order,
            elevation[order],
            beam_azimuths(sensor, columns, turns_per_second=turning)[order, 0],
            2 * np.pi / columns,
            -1 if sensor.spin == "cw" else 1,
        )
        directions = beam_directions(sensor, columns, turns_per_second=turning).reshape(-1, 3)
        believed, aside = directions, 0.0
        if mounted.effects.quantisation:
            believed = as_reported(directions, sensor, columns)
            aside = float(np.abs(encoder_errors(sensor, columns)).max())
        return cls(directions, columns, sensor.channels, footprint, believed, aside, rings)

    @cached_property
    def neighbours(self) -> tuple[NDArray[np.int32], int, int, bool]:
        """Beams in rows of neighbours, number of rows and columns, and whether rows are closed.

        Rows are rings by elevation, shifted so that columns have the same azimuth.
        """
        if self.rings is None:
            return np.arange(len(self.directions), dtype=np.int32), 1, len(self.directions), False
        rings = self.rings
        shift = np.rint(rings.turn * (rings.azimuth[0] - rings.azimuth) / rings.step)
        column = (np.arange(self.columns) + shift[:, None].astype(np.int64)) % self.columns
        rays = (rings.order[:, None] * self.columns + column).astype(np.int32)
        return rays.ravel(), self.channels, self.columns, True
