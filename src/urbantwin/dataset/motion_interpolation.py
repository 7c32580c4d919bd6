"""Interpolation of the motion: actors at a step, or between two steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose, rotation_from_ypr, wrapped
from urbantwin.lidar import PosedActor
from urbantwin.lidar.actor_path import ActorPath

__all__ = ["MotionTable", "Rows", "interpolated", "posed_actors", "rows_at"]

#: Rows of the motion's table of actors at one time, one per actor, sorted by track.
Rows = NDArray[np.void]

#: Times that differ by less are the same step: steps are whole milliseconds.
SAME_TIME_S = 1e-6
#: An actor that moved faster than this between two steps was relocated and did not drive.
FASTEST_M_S = 70.0

_LINEAR = ("x", "y", "z", "pitch", "roll", "length", "width", "height", "speed")


class MotionTable(Protocol):
    """The part of a motion that recording needs."""

    def times(self) -> NDArray[np.float64]:
        """Return the times of the steps, seconds, ascending."""

    def at(self, time_s: float) -> Rows:
        """Return the rows of the step at that time."""


def rows_at(motion: MotionTable, time_s: float) -> Rows:
    """Return the actors at any time.

    At a step these are the step's own rows. Between two steps they are interpolated, and an actor
    in only one of the two is absent.

    Args:
        motion: the motion.
        time_s: within the motion's first and last step.
    """
    times = motion.times()
    after = int(np.searchsorted(times, time_s - SAME_TIME_S))
    if after < len(times) and abs(times[after] - time_s) <= SAME_TIME_S:
        return motion.at(float(times[after]))
    if after in (0, len(times)):
        raise ValueError(f"{time_s} s is outside the motion")
    start, end = float(times[after - 1]), float(times[after])
    share = (time_s - start) / (end - start)
    return interpolated(motion.at(start), motion.at(end), share, end - start)


def interpolated(before: Rows, after: Rows, share: float, step_s: float) -> Rows:
    """Interpolate the actors that are in both of two steps.

    Positions and angles are linear (yaw the short way round); asset, gait phase and lane are those
    of the nearer step.

    Args:
        before: rows of the earlier step.
        after: rows of the later step.
        share: 0 at the earlier step, 1 at the later.
        step_s: time between the two, seconds.
    """
    _, first, last = np.intersect1d(before["track"], after["track"], return_indices=True)
    a, b = before[first], after[last]
    jump = np.sqrt(sum((b[axis] - a[axis]) ** 2 for axis in ("x", "y", "z")))
    drove = np.asarray(jump <= FASTEST_M_S * step_s)
    a, b = a[drove], b[drove]
    rows: Rows = (a if share < 0.5 else b).copy()
    for name in _LINEAR:
        rows[name] = a[name] + share * (b[name] - a[name])
    turn = wrapped(b["yaw"] - a["yaw"])
    rows["yaw"] = a["yaw"] + share * turn
    return rows


def posed_actors(rows: Rows, paths: Sequence[ActorPath | None] | None = None) -> list[PosedActor]:
    """Convert rows of the motion to the scanner's actors.

    The velocity is that of the path, so that labels describe the motion that the rays see. Without
    a path it is the speed along the heading, following the road's grade.

    Args:
        rows: the actors.
        paths: path of each around the time of the rows; constant velocity if not given.
    """
    ways = [None] * len(rows) if paths is None else paths
    rotations = rotation_from_ypr(rows["yaw"], rows["pitch"], rows["roll"])
    translations = np.column_stack([rows["x"], rows["y"], rows["z"]])
    velocities = rows["speed"][:, None] * rotations[:, :, 0]
    alike: dict[int, dict[int, ActorPath]] = {}
    for n, path in enumerate(ways):
        if path is not None:  # most have the same samples
            alike.setdefault(id(path.time_s), {})[n] = path
    for group in alike.values():
        k, took_s = next(iter(group.values())).leg(0.0)
        ends = np.array([path.translation[k : k + 2] for path in group.values()])
        velocities[list(group)] = (ends[:, 1] - ends[:, 0]) / took_s
    sizes = np.column_stack([rows[name] for name in ("length", "width", "height")])
    # By column: reading a field of a row takes as long as a whole column.
    columns = [rows[name].tolist() for name in ("track", "class", "asset", "phase")]
    return [
        PosedActor(
            track,
            str(actor_class),
            str(asset),
            phase,
            Pose(turn, place),
            velocity,
            path,
            (size[0], size[1], size[2]) if known else None,
        )
        for track, actor_class, asset, phase, turn, place, velocity, path, size, known in zip(
            *columns,
            rotations,
            translations,
            velocities,
            ways,
            sizes.tolist(),
            (sizes.min(axis=1, initial=np.inf) > 0).tolist(),
            strict=True,
        )
    ]
