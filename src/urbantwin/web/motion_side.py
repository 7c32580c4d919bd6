"""A motion as frames without points: the boxes of all actors at every step."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.traffic import Motion
from urbantwin.web.shown_boxes import ShownBoxes
from urbantwin.web.side import FrameEntry

__all__ = ["MotionSide"]


class MotionSide:
    """A motion as a side (see `side.Side`).

    Args:
        motion: the motion.
        chosen: steps to show.
    """

    def __init__(self, motion: Motion, *, chosen: Callable[[int], Sequence[int]] = range) -> None:
        self.motion = motion
        times = motion.times()
        self.entries = [
            FrameEntry(f"{row:06d}", round(float(times[row]), 6)) for row in chosen(len(times))
        ]
        self.name, self.role = "motion", "only"
        self.rate_hz = 1.0 / motion.step_s
        self.fields: list[str] = []
        self.has_points, self.has_boxes = False, True

    @property
    def full_scale(self) -> float:
        """Full scale of the intensity; not used for a motion."""
        return 1.0

    def frame(self, index: int) -> Frame:
        """Raise an error: a motion has no points."""
        raise InputError("has no points", place=self.entries[index].name, expected="a dataset")

    def boxes(self, index: int) -> ShownBoxes:
        """Return the boxes of all actors at a step, site frame."""
        rows = self.motion.at(self.entries[index].time_s)
        box = np.column_stack(
            [rows[name].astype(float) for name in ("x", "y", "z", "length", "width", "height")]
            + [rows["yaw"].astype(float)]
        ).reshape(-1, 7)
        box[:, 2] += box[:, 5] / 2
        speed = rows["speed"].astype(float)
        velocity = np.column_stack(
            [speed * np.cos(box[:, 6]), speed * np.sin(box[:, 6]), np.zeros(len(box))]
        ).reshape(-1, 3)
        return ShownBoxes(
            box=box,
            class_names=[str(one) for one in rows["class"]],
            track=rows["track"].astype(np.int64),
            velocity=velocity,
        )
