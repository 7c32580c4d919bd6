"""The beams of a recording's sensors: where they point, and at which ranges something stands."""

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
    """The beams of one sensor, a cell of ring and column each.

    Attributes:
        place: (3,) where they leave, metres.
        channel: (N,) the ring as its maker numbers it.
        ring: (N,) rank of the ring, the lowest first.
        elevation: (N,) in the sensor's frame, radians.
        azimuth: (N,) in the sensor's frame, -pi to pi, radians.
        direction: (N, 3) unit vectors in the frame of the points.
        range_m: (N, M) float64, at which something always stands, the most frequent first; 0: none.
        share: (N, M) of the unobstructed looks, those that came back from there.
        column_rad: between columns, radians.
        ring_rad: (N,) between the rings above and below, halved, radians.
        silent: (K, 3) directions in which no look of any frame came back.
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
        """Return what stands in each beam (N, 3), the most frequent first; its place if nothing."""
        return self.place + self.direction * self.range_m[:, mode, None]


def recorded_beams(looks: Looks) -> list[Beams]:
    """Return the beams of every sensor that something came back from, in any frame."""
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
    # Columns run one way round; each ring's first column looks in a direction of its own.
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
