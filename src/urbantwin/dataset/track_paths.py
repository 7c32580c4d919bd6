"""Tracks as paths: where an actor's body is at any time, from the rows of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.motion_interpolation import FASTEST_M_S
from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.lidar.sensor_path import poses_along

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["BodyPoses", "TrackPaths", "paths_of_boxes"]

#: A body that lies within this of where it was has not moved, metres.
_SAME_PLACE_M = 1e-3
_POSE = ("x", "y", "z", "yaw", "pitch", "roll")


class BodyPoses(NamedTuple):
    """Where a body is at T times.

    Attributes:
        rotation: (T, 3, 3) ``site_SE3_body``.
        translation: (T, 3) metres.
        stretch: (T,) number of the stretch of its path that each time lies in; -1: it is not
            known where the body is.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    stretch: NDArray[np.int64]


class _Stretch(NamedTuple):
    """A part of a path: from when to when, and how; of one row alone nobody knows how."""

    first_s: float
    last_s: float
    path: ActorPath | None


class TrackPaths:
    """Paths of all tracks of a table.

    A path is a row of stretches: where a track was not there for longer than ``gap_s``, or was put
    elsewhere, it ends and begins anew. Within a stretch the body goes straight from row to row and
    turns about one axis at one speed, which is how recording moves it; before and after it, for
    ``beyond_s`` and not nearer to another one, it goes straight on.

    Args:
        table: with ``track``, ``time_s``, ``x``, ``y``, ``z``, ``yaw``, ``pitch``, ``roll``, in any
            order of rows; metres, radians and seconds, site frame.
        gap_s: a track without a row for longer has left, unless it stands where it stood.
        beyond_s: so long before its first and after its last row a body goes on.
    """

    def __init__(self, table: pa.Table, gap_s: float, beyond_s: float) -> None:
        track = table["track"].to_numpy()
        time_s = table["time_s"].to_numpy()
        order = np.lexsort((time_s, track))
        self._gap_s, self._beyond_s = gap_s, beyond_s
        self._tracks, first = np.unique(track[order], return_index=True)
        self._ends = np.append(first, len(order))
        self._time_s = time_s[order]
        self._pose = np.column_stack([table[name].to_numpy()[order] for name in _POSE])
        self._kept: dict[int, list[_Stretch]] = {}

    def _stretches(self, track: int) -> list[_Stretch]:
        number = int(np.searchsorted(self._tracks, track))
        if number == len(self._tracks) or self._tracks[number] != track:
            return []
        rows = slice(self._ends[number], self._ends[number + 1])
        time_s, pose = self._time_s[rows], self._pose[rows]
        fresh = np.append(True, np.diff(time_s) > 0)
        time_s, pose = time_s[fresh], pose[fresh]
        step_s = np.diff(time_s)
        moved = np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1)
        left = (step_s > self._gap_s) & (moved > _SAME_PLACE_M)
        cuts = np.flatnonzero(left | (moved > FASTEST_M_S * step_s)) + 1
        turns = rotation_from_ypr(*pose[:, 3:].T)
        return [
            _Stretch(
                float(time_s[own[0]]),
                float(time_s[own[-1]]),
                ActorPath(time_s[own], turns[own], pose[own, :3]) if len(own) > 1 else None,
            )
            for own in np.split(np.arange(len(time_s)), cuts)
        ]

    def at(self, track: int, time_s: NDArray[np.float64]) -> BodyPoses:
        """Return where the body of a track is at times (T,), seconds from the motion's start."""
        count = len(time_s)
        rotation = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
        translation, stretch = np.zeros((count, 3)), np.full(count, -1)
        if track not in self._kept:
            self._kept[track] = self._stretches(track)
        every = self._kept[track]
        if not every:
            return BodyPoses(rotation, translation, stretch)
        # (stretches, T): how long before or after each one a time is; 0 within it.
        first, last = (np.array([one[end] for one in every])[:, None] for end in (0, 1))
        away_s = np.maximum(np.maximum(first - time_s, time_s - last), 0.0)
        nearest = away_s.argmin(axis=0)
        near = away_s.min(axis=0) <= self._beyond_s
        for number, (_, _, path) in enumerate(every):
            mine = near & (nearest == number)
            if path is not None and mine.any():
                rotation[mine], translation[mine] = poses_along(path, time_s[mine])
                stretch[mine] = number
        return BodyPoses(rotation, translation, stretch)


def paths_of_boxes(tracklets: pa.Table, times_s: NDArray[np.float64]) -> TrackPaths:
    """Return paths from labelled box to labelled box, where nothing better is known.

    Boxes are upright in the frame of the points, and between two frames a body goes straight.

    Args:
        tracklets: see `tracklets.tracklet_table`.
        times_s: of the frames.
    """
    step_s = float(np.diff(times_s).min()) if len(times_s) > 1 else 1.0
    # A box is seen at any time of a turn: from one to the next up to two turns pass.
    return TrackPaths(tracklets, gap_s=2.5 * step_s, beyond_s=2.0 * step_s)
