"""Boxes with scores in the frames of a recording, from a detector or a tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Detections", "joined"]


@dataclass(frozen=True, eq=False)
class Detections:
    """Detected boxes in frames.

    Attributes:
        frames: names of all processed frames, in order; also those without a box.
        frame: (N,) int64, index in ``frames`` of each box.
        box: (N, 7) float64 in the frame of the points: centre x, y, z, length (along heading),
            width, height in metres, yaw in radians counter-clockwise from +x.
        class_names: (N,) each one of ``taxonomy.ACTOR_CLASSES``.
        score: (N,) float64, 0..1.
        track: (N,) int64, number of the object over all frames; -1 if it is not tracked.
        time_s: (frames,) float64, time of each frame, seconds; None if unknown.
        filled: (N,) bool, boxes that a tracker interpolated without a detection; None if there are
            none.
    """

    frames: tuple[str, ...]
    frame: NDArray[np.int64]
    box: NDArray[np.float64]
    class_names: tuple[str, ...]
    score: NDArray[np.float64]
    track: NDArray[np.int64]
    time_s: NDArray[np.float64] | None = None
    filled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Raise ValueError for columns of different lengths: a caller's mistake, never a file's."""
        count = len(self.frame)
        lengths = {len(self.box), len(self.class_names), len(self.score), len(self.track)}
        lengths |= set() if self.filled is None else {len(self.filled)}
        if lengths != {count} or self.box.shape != (count, 7):
            raise ValueError(f"{count} detections with columns of {sorted(lengths)}")
        if count and not 0 <= self.frame.min() <= self.frame.max() < len(self.frames):
            raise ValueError("a detection in a frame that is not there")
        if self.time_s is not None and len(self.time_s) != len(self.frames):
            raise ValueError(f"{len(self.time_s)} times of {len(self.frames)} frames")

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.frame)

    @property
    def tracked(self) -> bool:
        """Whether any box is of a tracked object."""
        return bool((self.track >= 0).any())

    def of(self, frame_index: int) -> Detections:
        """Return the boxes of one frame; ``frames`` and their numbers are unchanged."""
        return self.only(self.frame == frame_index)

    def only(self, chosen: ArrayLike) -> Detections:
        """Return the boxes of a mask (N,) or of indices; ``frames`` is unchanged."""
        rows = np.arange(len(self))[np.asarray(chosen)]
        return replace(
            self,
            frame=self.frame[rows],
            box=self.box[rows],
            class_names=tuple(self.class_names[row] for row in rows),
            score=self.score[rows],
            track=self.track[rows],
            filled=None if self.filled is None else self.filled[rows],
        )


def joined(
    frames: Sequence[str],
    found: Sequence[tuple[NDArray[np.float64], Sequence[str], NDArray[np.float64]]],
    time_s: NDArray[np.float64] | None = None,
) -> Detections:
    """Return the detections of several frames as one table, without tracks.

    Args:
        frames: names of the frames.
        found: boxes (n, 7), class names and scores (n,) of each frame, in the same order.
        time_s: time of each frame, seconds.
    """
    counts = [len(boxes) for boxes, _, _ in found]
    total = sum(counts)
    return Detections(
        frames=tuple(frames),
        frame=np.repeat(np.arange(len(found), dtype=np.int64), counts),
        box=np.concatenate([np.reshape(b, (-1, 7)) for b, _, _ in found] or [np.zeros((0, 7))]),
        class_names=tuple(name for _, names, _ in found for name in names),
        score=np.concatenate([np.ravel(s) for _, _, s in found] or [np.zeros(0)]).astype(float),
        track=np.full(total, -1, np.int64),
        time_s=time_s,
    )
