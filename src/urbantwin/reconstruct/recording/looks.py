"""Returns of the beams of fixed sensors in all frames, and the moving points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.progress import Progress, each, untold
from urbantwin.reconstruct.recording.recorded_frames import (
    RecordedFrame,
    RecordedFrames,
    RecordingSensor,
)
from urbantwin.reconstruct.recording.still_ranges import COLUMNS, StillRanges, moves_as_nearest

__all__ = ["LEAST_FRAMES", "Looks", "moving_points"]

#: Minimum number of frames: some see behind a moving object, and two agree on a static one.
LEAST_FRAMES = 5
#: Minimum share of the points on static surfaces; otherwise the sensors moved, or frames show two
#: places.
_LEAST_STILL = 0.6


class Looks:
    """Static ranges of each sensor of a recording.

    Beams are cells of ring and column, whose static ranges are found by `StillRanges`. Slow objects
    are separated only by frames over a longer time: a person who walks 1 m in all frames, or a
    vehicle that waits in all of them, is static.

    Attributes:
        frames: the recording.
        still: static ranges of each sensor.

    Args:
        frames: `LEAST_FRAMES` or more.
        tell: called with the fraction done and the current step.

    Raises:
        InputError: too few frames, or a file cannot be read.
    """

    def __init__(self, frames: RecordedFrames, tell: Progress = untold) -> None:
        if len(frames) < LEAST_FRAMES:
            count = len(frames)
            raise InputError(
                f"{count} {'frame does' if count == 1 else 'frames do'} not show what is static",
                file=frames.folder,
                expected=f"{LEAST_FRAMES} frames or more, better 50 over half a minute",
            )
        self.frames = frames
        seen: list[list[tuple[NDArray[np.int64], NDArray[np.float64]]]]
        seen = [[] for _ in frames.sensors]
        for number in each(range(len(frames)), tell, "frames"):
            frame = frames.read(number)
            for kept, (_, cell, range_m) in zip(seen, self._of(frame), strict=True):
                kept.append((cell, range_m))
        self._count = sum(len(range_m) for kept in seen for _, range_m in kept)
        self.still: list[StillRanges] = [
            _still(sensor, kept) for sensor, kept in zip(frames.sensors, seen, strict=True)
        ]

    @property
    def still_share(self) -> float:
        """Share of static points among all points on rings."""
        still = sum(
            float((m.share.sum(axis=1) * m.looks).sum()) for m in (one.modes for one in self.still)
        )
        return still / max(self._count, 1)

    def check_standing(self) -> None:
        """Raise an error for moving sensors, or frames of two places.

        Raises:
            InputError: too few points are static.
        """
        if self.still_share < _LEAST_STILL:
            raise InputError(
                f"{self.still_share:.0%} of the points are static",
                file=self.frames.folder,
                expected="frames of one place, of static sensors",
            )

    def moving(self, frame: RecordedFrame) -> NDArray[np.bool_]:
        """Return the mask of the moving points (N,) of a frame.

        A point on no ring is classified as its nearest neighbour on a ring.
        """
        found = np.zeros(len(frame.points), bool)
        for still, (rows, cell, range_m) in zip(self.still, self._of(frame), strict=True):
            found[rows] = still.moving(cell, range_m, frame.points[rows])
        moves_as_nearest(found, frame.points, frame.sensor >= 0)
        return found

    def _of(
        self, frame: RecordedFrame
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]]:
        """Yield for each sensor the rows (M,) of its points, their cells and their ranges."""
        for number, sensor in enumerate(self.frames.sensors):
            rows = np.flatnonzero(frame.sensor == number)
            range_m = np.linalg.norm(frame.points[rows] - sensor.place, axis=1)
            yield rows, frame.ring[rows] * COLUMNS + frame.column[rows], range_m


def moving_points(frames: RecordedFrames, tell: Progress = untold) -> Iterator[NDArray[np.bool_]]:
    """Yield the mask of the moving points (N,) of every frame of a recording.

    Args:
        frames: frames of fixed sensors.
        tell: called with the fraction done and the current step.

    Raises:
        InputError: there are too few frames, or a file cannot be read.
    """
    looks = Looks(frames, tell)
    for number in range(len(frames)):
        yield looks.moving(frames.read(number))


def _still(
    sensor: RecordingSensor, seen: list[tuple[NDArray[np.int64], NDArray[np.float64]]]
) -> StillRanges:
    cell, range_m = (np.concatenate(part) for part in zip(*seen, strict=True))
    number = np.repeat(np.arange(len(seen)), [len(one) for one, _ in seen])
    return StillRanges(cell, number, range_m, frames=len(seen), turns=sensor.columns)
