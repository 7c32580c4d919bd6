"""The beams of a sensor, as casting takes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.footprint import Footprint
from urbantwin.lidar.pattern import (
    beam_azimuths,
    beam_directions,
    beam_elevations,
    pattern_directions,
)
from urbantwin.lidar.returns.encoder import as_reported, encoder_errors
from urbantwin.lidar.rig import MountedSensor

__all__ = ["Beams", "Rings"]


class Rings(NamedTuple):
    """The channels of a spinning sensor by elevation.

    Attributes:
        order: (C,) int64, their numbers, lowest first.
        elevation: (C,) float64, radians, ascending.
        azimuth: (C,) float64, of column 0, radians counter-clockwise.
        step: radians from column to column.
        turn: +1 counter-clockwise, -1 clockwise.
    """

    order: NDArray[np.int64]
    elevation: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    step: float
    turn: int


@dataclass(frozen=True, eq=False)
class Beams:
    """N beams of a turn: beam = channel * columns + column.

    Attributes:
        directions: (N, 3) float64 unit vectors, sensor frame.
        columns: K.
        channels: C.
        footprint: the rays that every beam is made of.
        believed: (N, 3) float64, where the sensor says that they point: its encoder has steps.
        aside: the most that it is wrong by, radians.
        rings: by elevation; ``None`` for a pattern that stands in no columns.
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
            turn: its number; it matters to a sensor whose pattern does not repeat.
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
        """All beams in rows of neighbours, rows, columns, and whether a row goes around.

        Rows are rings by elevation, each turned so that columns have the same azimuth.
        """
        if self.rings is None:
            return np.arange(len(self.directions), dtype=np.int32), 1, len(self.directions), False
        rings = self.rings
        shift = np.rint(rings.turn * (rings.azimuth[0] - rings.azimuth) / rings.step)
        column = (np.arange(self.columns) + shift[:, None].astype(np.int64)) % self.columns
        rays = (rings.order[:, None] * self.columns + column).astype(np.int32)
        return rays.ravel(), self.channels, self.columns, True
