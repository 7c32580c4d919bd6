"""Motion of every actor during a frame.

A spinning sensor sees each actor at the time of each ray, so a frame needs the motion's steps from
the first firing of its sensors to the last, not only the poses at its own time.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import OrderedDict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.motion_interpolation import (
    FASTEST_M_S,
    SAME_TIME_S,
    MotionTable,
    Rows,
    interpolated,
)
from urbantwin.dataset.reading.columns import POSE
from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar.actor_path import ActorPath

__all__ = ["FrameMotion", "FrameMotions"]

#: Number of cached steps: the next frame needs most of them too.
_KEPT_STEPS = 64


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Actors at a frame's time, and their poses around it.

    Attributes:
        rows: (A,) the actors at the frame's time, as rows of the motion's table.
        time_s: (S,) float64 ascending, seconds relative to the frame's time, which is included.
        poses: (S, A, 6) float64, x, y, z, yaw, pitch, roll at these times; NaN where an actor is
            absent, or was relocated without driving.
    """

    rows: Rows
    time_s: NDArray[np.float64]
    poses: NDArray[np.float64]

    def paths(self) -> list[ActorPath | None]:
        """Return the path of each actor; ``None`` with a single known pose."""
        present = ~np.isnan(self.poses[:, :, 0])
        count, first = present.sum(axis=0), present.argmax(axis=0)
        spans = list(zip(first.tolist(), (first + count).tolist(), strict=True))
        time_s = {span: self.time_s[slice(*span)] for span in set(spans)}
        angles = np.where(present[:, :, None], self.poses[:, :, 3:], 0.0)
        turns = rotation_from_ypr(*angles.transpose(2, 1, 0))
        places = np.ascontiguousarray(self.poses[:, :, :3].transpose(1, 0, 2))
        return [
            ActorPath(time_s[a, b], turns[actor, a:b], places[actor, a:b]) if b - a > 1 else None
            for actor, (a, b) in enumerate(spans)
        ]


class _Step(NamedTuple):
    """One step of a motion: rows, tracks (A,) and poses (A, 6)."""

    rows: Rows
    track: NDArray[np.int32]
    poses: NDArray[np.float64]


class FrameMotions:
    """Motion during each frame; consecutive frames share cached steps."""

    def __init__(self, motion: MotionTable) -> None:
        self._motion = motion
        self._times: list[float] = motion.times().tolist()
        self._steps: OrderedDict[int, _Step] = OrderedDict()

    def around(self, time_s: float, start_s: float = 0.0, stop_s: float = 0.0) -> FrameMotion:
        """Return the motion of actors around a time.

        Linear between steps. An actor in only one of the two steps around the time is absent.
        Before the first step and after the last, the two nearest steps are returned, for
        extrapolation.

        Args:
            time_s: the frame's time, within the motion's first and last step.
            start_s: earliest time needed, seconds relative to ``time_s``.
            stop_s: latest time needed.

        Raises:
            ValueError: the time is outside the motion.
        """
        times = self._times
        if not times[0] - SAME_TIME_S <= time_s <= times[-1] + SAME_TIME_S:
            raise ValueError(f"{time_s} s is outside the motion")
        after = bisect_left(times, time_s - SAME_TIME_S)
        on_step = times[after] <= time_s + SAME_TIME_S
        before = after if on_step else after - 1
        low, high = self._span(time_s, before, after, min(start_s, 0.0), max(stop_s, 0.0))

        known_s = np.array(times[low : high + 1]) - time_s
        if on_step:
            rows = self._step(after).rows
            known_s[after - low] = 0.0
        else:
            step_s = times[after] - times[before]
            share = (time_s - times[before]) / step_s
            rows = interpolated(self._step(before).rows, self._step(after).rows, share, step_s)
        track = rows["track"]
        poses = np.array([_poses_of(track, self._step(n)) for n in range(low, high + 1)])
        if not on_step:
            known_s = np.insert(known_s, after - low, 0.0)
            poses = np.insert(poses, after - low, _poses(rows), axis=0)
        _cut_where_put(known_s, poses)
        return FrameMotion(rows, known_s, poses)

    def _span(
        self, time_s: float, before: int, after: int, start_s: float, stop_s: float
    ) -> tuple[int, int]:
        """Return the first and the last step of a `FrameMotion`."""
        times = self._times
        if stop_s - start_s <= SAME_TIME_S:
            return before, after
        low = bisect_right(times, time_s + start_s + SAME_TIME_S) - 1
        high = bisect_left(times, time_s + stop_s - SAME_TIME_S)
        # Beyond the motion's ends: one step more, for extrapolation.
        if high >= len(times):
            low = min(low, len(times) - 2)
        if low < 0:
            high = max(high, 1)
        return max(min(low, before), 0), min(max(high, after), len(times) - 1)

    def _step(self, number: int) -> _Step:
        if number not in self._steps:
            rows = self._motion.at(self._times[number])
            self._steps[number] = _Step(rows, rows["track"].copy(), _poses(rows))
            while len(self._steps) > _KEPT_STEPS:
                self._steps.popitem(last=False)
        return self._steps[number]


def _poses(rows: Rows) -> NDArray[np.float64]:
    return np.stack([rows[name] for name in POSE], axis=-1)


def _poses_of(track: NDArray[np.int32], step: _Step) -> NDArray[np.float64]:
    """Return the poses (A, 6) of actors in a step, by track; NaN if absent."""
    if not len(step.track):
        return np.full((len(track), len(POSE)), np.nan)
    row = np.minimum(step.track.searchsorted(track), len(step.track) - 1)
    poses = step.poses[row]
    poses[step.track[row] != track] = np.nan
    return poses


def _cut_where_put(time_s: NDArray[np.float64], poses: NDArray[np.float64]) -> None:
    """Set poses to NaN that an actor did not drive to from its pose at time 0."""
    now = int(np.flatnonzero(time_s == 0.0)[0])
    step_s = np.diff(time_s)[:, None]
    moved = np.linalg.norm(np.diff(poses[:, :, :3], axis=0), axis=2)
    # Absent in one of two steps: NaN, so it did not drive.
    drove = moved <= FASTEST_M_S * step_s
    if drove.all():
        return
    for step in range(now + 1, len(time_s)):
        poses[step, ~drove[now:step].all(axis=0)] = np.nan
    for step in range(now):
        poses[step, ~drove[step:now].all(axis=0)] = np.nan
