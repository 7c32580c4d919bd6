"""Field of view and range of a sensor, from its beams."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.beams import dead_beams
from urbantwin.lidar.pattern import beam_directions, pattern_directions
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sensor import Sensor

__all__ = ["FieldOfView", "turns_of"]

#: Most sectors of azimuth, and least rays of a channel in each, so that no sector is empty.
_MOST_SECTORS, _RAYS_PER_SECTOR = 720, 2
#: Sectors of a coarse field of view: every catalogue sensor has beams in each.
_COARSE = 120
#: Number of beams in the sample.
_SAMPLE = 900
#: Vertical margin of a sensor with one channel, radians.
_MARGIN = np.radians(0.25)
#: Most frames of a non-repeating pattern.
_FRAMES = 20


class FieldOfView:
    """The elevations between the lowest and the highest beam, by sector of azimuth.

    Directions are unit vectors in the sensor frame (x forward, y left, z up). Sectors without a
    working beam are outside.

    Args:
        beams: (N, 3) working beams.
        range_m: minimum and maximum range, metres.
        sectors: number of sectors of azimuth.
        margin: extend it by half a channel spacing beyond the outermost beams.

    Attributes:
        range_m: minimum and maximum range, metres.
        all_around: lowest and highest elevation seen in every direction, radians; the first is
            above the second if a sector is empty.
        sample: (S, 3) some of the beams, evenly spread.
        per_steradian: mean number of beams per steradian of the field.
    """

    def __init__(
        self,
        beams: NDArray[np.floating],
        range_m: tuple[float, float],
        sectors: int = _COARSE,
        *,
        margin: bool = False,
    ) -> None:
        self.range_m = range_m
        self._sectors = sectors
        elevation = _elevation(beams)
        sector = self._sector(beams)
        self._low = np.full(sectors, np.inf)
        self._high = np.full(sectors, -np.inf)
        np.minimum.at(self._low, sector, elevation)
        np.maximum.at(self._high, sector, elevation)
        seen = self._high > self._low
        band = np.sin(self._high[seen]) - np.sin(self._low[seen])
        self.per_steradian = len(beams) / max(float(band.sum()) * 2 * np.pi / sectors, 1e-9)
        self.sample = beams[:: max(1, len(beams) // _SAMPLE)].copy()
        if margin:
            levels = np.unique(np.round(elevation, 5))
            below, above = np.diff(levels)[[0, -1]] / 2 if len(levels) > 1 else (_MARGIN, _MARGIN)
            self._low -= below
            self._high += above
        self.all_around = (float(self._low.max()), float(self._high.min()))

    @classmethod
    def of(cls, mounted: MountedSensor, dead: NDArray[np.bool_] | None = None) -> FieldOfView:
        """Return the field of view of a sensor, in fine sectors.

        Args:
            mounted: the sensor.
            dead: (C, K) beams in an outage; ignored for a non-repeating pattern.
        """
        sensor, columns = mounted.sensor, mounted.columns
        turns = [_beams(sensor, columns, mounted.rate_hz, turn) for turn in _turns(mounted)]
        beams = turns[0][~dead] if dead is not None and len(turns) == 1 else np.concatenate(turns)
        sectors = int(np.clip(columns // _RAYS_PER_SECTOR, 8, _MOST_SECTORS))
        return cls(beams.reshape(-1, 3), _range_m(sensor), sectors, margin=True)

    @classmethod
    def coarse(cls, sensor: Sensor, columns: int) -> FieldOfView:
        """Return the field of view of one turn, in coarse sectors."""
        beams = _beams(sensor, columns, sensor.rate_hz, 0)
        # Channels vary fastest, so that the sample has all azimuths.
        return cls(beams.transpose(1, 0, 2).reshape(-1, 3), _range_m(sensor))

    def holds(self, directions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which unit vectors (..., 3) are inside, at any range."""
        elevation, sector = _elevation(directions), self._sector(directions)
        return np.asarray((elevation >= self._low[sector]) & (elevation <= self._high[sector]))

    def sees(
        self, directions: NDArray[np.floating], range_m: NDArray[np.floating]
    ) -> NDArray[np.bool_]:
        """Return which unit vectors (N, 3) at ranges (N,) are inside and in range."""
        near, far = self.range_m
        return np.asarray(self.holds(directions) & (range_m >= near) & (range_m <= far))

    def _sector(self, directions: NDArray[np.floating]) -> NDArray[np.int64]:
        azimuth = np.arctan2(directions[..., 1], directions[..., 0]).astype(np.float64)
        share = (azimuth / (2 * np.pi) + 0.5) * self._sectors
        return np.asarray(np.clip(share.astype(np.int64), 0, self._sectors - 1))


def turns_of(
    mounted: MountedSensor,
) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.bool_]]]:
    """Yield the distinct turns of a sensor: number, beams (N, 3), and which of them (N,) work."""
    for turn in _turns(mounted):
        beams = _beams(mounted.sensor, mounted.columns, mounted.rate_hz, turn)
        dead = dead_beams(mounted, turn / mounted.rate_hz)
        works = np.ones(beams.shape[:2], np.bool_) if dead is None else ~dead
        yield turn, beams.reshape(-1, 3), works.ravel()


def _turns(mounted: MountedSensor) -> range:
    pattern = mounted.sensor.pattern
    period = 1.0 if pattern is None else np.ceil(pattern.period_s * mounted.rate_hz)
    return range(int(np.clip(period, 1, _FRAMES)))


def _beams(sensor: Sensor, columns: int, rate_hz: float, turn: int) -> NDArray[np.float64]:
    """Return the beams (C, K, 3) of a turn."""
    if sensor.pattern is None:
        return beam_directions(sensor, columns)
    return pattern_directions(sensor.pattern, columns, turn, rate_hz)


def _range_m(sensor: Sensor) -> tuple[float, float]:
    return sensor.assumed_range_min_m, sensor.assumed_range_max_m


def _elevation(directions: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.arcsin(np.clip(directions[..., 2].astype(np.float64), -1.0, 1.0))
