"""Boxes with scores: what a detector or a tracker says of the frames of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Detections", "joined"]


@dataclass(frozen=True, eq=False)
class Detections:
    """What was found in frames.

    Attributes:
        frames: names of all frames that were looked at, in order; also those without a box.
        frame: (N,) int64, which of ``frames`` a box is in.
        box: (N, 7) float64 in the frame of the points: centre x, y, z, length (along heading),
            width, height in metres, yaw in radians counter-clockwise from +x.
        class_names: (N,) each one of ``taxonomy.ACTOR_CLASSES``.
        score: (N,) float64, 0..1.
        track: (N,) int64, the same object's number in every frame; -1 where it is not followed.
        time_s: (frames,) float64, when each frame was taken, seconds; None where nothing says.
        filled: (N,) bool, where a tracker put a box that nobody detected; None where none did.
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
        """Refuse columns of different lengths: a caller's mistake, never a file's."""
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
        """Return how many boxes there are."""
        return len(self.frame)

    @property
    def tracked(self) -> bool:
        """Whether any box is of an object that is followed."""
        return bool((self.track >= 0).any())

    def of(self, frame_index: int) -> Detections:
        """Return the boxes of one frame; ``frames`` and their numbers stay."""
        return self.only(self.frame == frame_index)

    def only(self, chosen: ArrayLike) -> Detections:
        """Return some of the boxes: a mask (N,) or indices; ``frames`` stay."""
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
    """Return the detections of frame after frame as one table, none of them tracked.

    Args:
        frames: names of the frames.
        found: of each frame in the same order, boxes (n, 7), names of classes and scores (n,).
        time_s: when each frame was taken.
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
