"""The directions and distances that a sensor sees, taken from its beams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.pattern import beam_directions, pattern_directions
from urbantwin.lidar.rig import MountedSensor

__all__ = ["FieldOfView"]

#: Sectors of azimuth at most, and rays of a channel in each at least: no sector without any.
_MOST_SECTORS, _RAYS_PER_SECTOR = 720, 2
#: How far beyond the outermost beams one still counts as seen, radians, if they are alone.
_MARGIN = np.radians(0.25)
#: Frames of a pattern that does not repeat, at most.
_FRAMES = 20


class FieldOfView:
    """What lies between the lowest and the highest beam of every sector of azimuth.

    It reaches half a channel's spacing beyond them, as a pixel reaches beyond its middle. Beams
    that do not work, and sectors in which none does, are not part of it.

    Args:
        beams: (N, 3) unit vectors of the beams that work, sensor frame.
        per_turn: beams of a channel in a turn.
        range_min_m: nearest distance that is measured.
        range_max_m: farthest.

    Attributes:
        range_m: nearest and farthest distance.
        all_around: lowest and highest elevation that is seen in every direction, radians; the
            first above the second where a sector is blind.
    """

    def __init__(
        self,
        beams: NDArray[np.floating],
        per_turn: int,
        range_min_m: float,
        range_max_m: float,
    ) -> None:
        self.range_m = (range_min_m, range_max_m)
        self._sectors = int(np.clip(per_turn // _RAYS_PER_SECTOR, 8, _MOST_SECTORS))
        elevation = np.arcsin(np.clip(beams[:, 2].astype(np.float64), -1.0, 1.0))
        sector = self._sector(np.arctan2(beams[:, 1], beams[:, 0]).astype(np.float64))
        self._low = np.full(self._sectors, np.inf)
        self._high = np.full(self._sectors, -np.inf)
        np.minimum.at(self._low, sector, elevation)
        np.maximum.at(self._high, sector, elevation)
        levels = np.unique(np.round(elevation, 5))
        below, above = np.diff(levels)[[0, -1]] / 2 if len(levels) > 1 else (_MARGIN, _MARGIN)
        self._low -= below
        self._high += above
        self.all_around = (float(self._low.max()), float(self._high.min()))

    @classmethod
    def of(cls, mounted: MountedSensor, dead: NDArray[np.bool_] | None = None) -> FieldOfView:
        """Return what a sensor sees.

        Args:
            mounted: the sensor.
            dead: (C, K) beams that do not work; of a pattern that does not repeat it is not
                known which ever work, and all count.
        """
        sensor, columns = mounted.sensor, mounted.columns
        if sensor.pattern is None:
            beams = beam_directions(sensor, columns)
            beams = beams.reshape(-1, 3) if dead is None else beams[~dead]
        else:
            count = int(np.clip(np.ceil(sensor.pattern.period_s * mounted.rate_hz), 1, _FRAMES))
            turns = range(count)
            beams = np.concatenate(
                [
                    pattern_directions(sensor.pattern, columns, turn, mounted.rate_hz)
                    for turn in turns
                ]
            ).reshape(-1, 3)
        return cls(beams, columns, sensor.assumed_range_min_m, sensor.assumed_range_max_m)

    def sees(
        self, directions: NDArray[np.floating], range_m: NDArray[np.floating]
    ) -> NDArray[np.bool_]:
        """Return which places (N,) are seen, given by unit vectors (N, 3) and distances (N,)."""
        elevation = np.arcsin(np.clip(directions[:, 2].astype(np.float64), -1.0, 1.0))
        sector = self._sector(np.arctan2(directions[:, 1], directions[:, 0]).astype(np.float64))
        near, far = self.range_m
        return np.asarray(
            (elevation >= self._low[sector])
            & (elevation <= self._high[sector])
            & (range_m >= near)
            & (range_m <= far)
        )

    def _sector(self, azimuth: NDArray[np.float64]) -> NDArray[np.int64]:
        share = (azimuth / (2 * np.pi) + 0.5) * self._sectors
        return np.clip(share.astype(np.int64), 0, self._sectors - 1)
