"""The field of view of a sensor: between which elevations its beams point, by azimuth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.pattern import beam_directions, pattern_directions
from urbantwin.lidar.sensor import Sensor

__all__ = ["FieldOfView"]

#: Azimuths are told apart by so much, degrees; every sensor of the catalogue has a beam in each.
_SECTOR_DEG = 3.0
#: About so many beams stand for all of them where a share of the points is estimated.
_SAMPLE = 900


class FieldOfView:
    """Where the beams of a sensor point, in its own frame (x forward, y left, z up).

    Between the lowest and the highest beam of a sector of azimuth everything counts as seen: what
    stands there is taller than the gap between two beams.

    Args:
        beams: (N, 3) unit vectors.
        farthest_m: the farthest that is reported.

    Attributes:
        farthest_m: as given.
        sample: (S, 3) some of the beams, evenly spread.
        per_steradian: beams, on average over where there are any.
    """

    def __init__(self, beams: NDArray[np.float64], farthest_m: float) -> None:
        self.farthest_m = farthest_m
        self.sample = beams[:: max(1, len(beams) // _SAMPLE)]
        count = int(360 / _SECTOR_DEG)
        self._lowest = np.full(count, np.inf)
        self._highest = np.full(count, -np.inf)
        sector, height = _sector(beams, count), np.arcsin(np.clip(beams[:, 2], -1.0, 1.0))
        np.minimum.at(self._lowest, sector, height)
        np.maximum.at(self._highest, sector, height)
        some = self._highest > self._lowest
        band = np.sin(self._highest[some]) - np.sin(self._lowest[some])
        self.per_steradian = len(beams) / max(float(band.sum()) * 2 * np.pi / count, 1e-9)

    @classmethod
    def of_sensor(cls, sensor: Sensor, columns: int) -> FieldOfView:
        """Return the field of view of a turn, or of a frame of a pattern that does not repeat."""
        if sensor.pattern is None:
            beams = beam_directions(sensor, columns)
        else:
            beams = pattern_directions(sensor.pattern, columns, 0, sensor.rate_hz)
        # Channels before columns: every so-many-th is then of another azimuth.
        return cls(beams.transpose(1, 0, 2).reshape(-1, 3), sensor.assumed_range_max_m)

    def holds(self, directions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which unit vectors (..., 3) of the sensor's frame lie within."""
        height = np.arcsin(np.clip(directions[..., 2], -1.0, 1.0))
        sector = _sector(directions, len(self._lowest))
        return np.asarray((height >= self._lowest[sector]) & (height <= self._highest[sector]))


def _sector(directions: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    turn = np.arctan2(directions[..., 1], directions[..., 0]) / (2 * np.pi)
    return np.floor(turn * count).astype(np.int64) % count
