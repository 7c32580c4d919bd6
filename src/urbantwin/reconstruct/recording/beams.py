"""The beams of a recording's sensors: directions and static ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.recording.looks import Looks
from urbantwin.reconstruct.recording.recorded_frames import RecordingSensor
from urbantwin.reconstruct.recording.still_ranges import COLUMNS, StillRanges

__all__ = ["Beams", "recorded_beams"]


@dataclass(frozen=True, eq=False)
class Beams:
    """The beams of one sensor, one per cell of ring and column.

    Attributes:
        place: (3,) origin of the beams, metres.
        channel: (N,) ring in the manufacturer's numbering.
        ring: (N,) rank of the ring by elevation, the lowest first.
        elevation: (N,) elevation in the sensor frame, radians.
        azimuth: (N,) azimuth in the sensor frame, -pi to pi, radians.
        direction: (N, 3) unit vectors in the frame of the points.
        range_m: (N, M) float64, static ranges, the most frequent first; 0: none.
        share: (N, M) share of each range in the unobstructed firings.
        column_rad: angle between columns, radians.
        ring_rad: (N,) half of the angle between the rings above and below, radians.
        silent: (K, 3) directions without a return in any frame.
    """

    place: NDArray[np.float64]
    channel: NDArray[np.int64]
    ring: NDArray[np.int64]
    elevation: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    direction: NDArray[np.float64]
    range_m: NDArray[np.float64]
    share: NDArray[np.float64]
    column_rad: float
    ring_rad: NDArray[np.float64]
    silent: NDArray[np.float64]

    def points(self, mode: int = 0) -> NDArray[np.float64]:
        """Return the static point (N, 3) of each beam at a mode; the origin if there is none."""
        return self.place + self.direction * self.range_m[:, mode, None]


def recorded_beams(looks: Looks) -> list[Beams]:
    """Return the beams of every sensor with a return in any frame."""
    sums = [np.zeros((len(one.cells), 3)) for one in looks.still]
    for number in range(len(looks.frames)):
        frame = looks.frames.read(number)
        for k, (sensor, still) in enumerate(zip(looks.frames.sensors, looks.still, strict=True)):
            rows = frame.sensor == k
            cell = np.searchsorted(still.cells, frame.ring[rows] * COLUMNS + frame.column[rows])
            away = frame.points[rows] - sensor.place
            away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
            for axis in range(3):
                sums[k][:, axis] += np.bincount(cell, away[:, axis], len(still.cells))
    return [
        _beams(sensor, still, one)
        for sensor, still, one in zip(looks.frames.sensors, looks.still, sums, strict=True)
    ]


def _beams(sensor: RecordingSensor, still: StillRanges, sums: NDArray[np.float64]) -> Beams:
    direction = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    turned = sensor.pose.rotation
    local = direction @ turned
    elevation = np.arcsin(np.clip(local[:, 2], -1, 1))
    azimuth = np.arctan2(local[:, 1], local[:, 0])
    column = still.cells % COLUMNS
    channels, of_ring = np.unique(still.cells // COLUMNS, return_inverse=True)
    level = np.array([np.median(elevation[of_ring == one]) for one in range(len(channels))])
    order = np.argsort(level)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    ring, level = rank[of_ring], level[order]
    gap = np.gradient(level) if len(level) > 1 else np.full(len(level), 0.01)
    step = 2 * np.pi / sensor.columns
    # Columns advance in one direction of rotation; each ring has its own azimuth offset.
    ways = {
        way: np.array(
            [
                np.exp(1j * (azimuth - way * step * column))[ring == one].mean()
                for one in range(len(level))
            ]
        )
        for way in (-1, 1)
    }
    way = max(ways, key=lambda one: float(np.abs(ways[one]).mean()))
    seen = np.zeros((len(level), sensor.columns), bool)
    seen[ring, column] = True
    of, at = np.nonzero(~seen)
    around = np.angle(ways[way])[of] + way * step * at
    silent = np.column_stack(
        [np.cos(level[of]) * np.cos(around), np.cos(level[of]) * np.sin(around), np.sin(level[of])]
    )
    modes = still.modes
    return Beams(
        sensor.place,
        channels[of_ring],
        ring,
        elevation,
        azimuth,
        direction,
        modes.range_m.astype(np.float64),
        modes.share.astype(np.float64),
        step,
        np.abs(gap)[ring],
        silent @ turned.T,
    )
