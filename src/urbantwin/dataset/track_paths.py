"""Poses of tracks at any time, from the rows of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from urbantwin.dataset.motion_interpolation import FASTEST_M_S
from urbantwin.dataset.reading.columns import POSE
from urbantwin.geometry import rotation_from_ypr

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["BodyPoses", "TrackPaths", "paths_of_boxes"]

#: Smaller displacements count as no motion, metres.
_SAME_PLACE_M = 1e-3


class BodyPoses(NamedTuple):
    """Poses of bodies at T times.

    Attributes:
        rotation: (T, 3, 3) ``site_SE3_body``.
        translation: (T, 3) metres.
        stretch: (T,) index of the path segment of each time; -1: pose unknown.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    stretch: NDArray[np.int64]


class TrackPaths:
    """Paths of all tracks of a table.

    A path consists of segments: it is interrupted where a track is absent for longer than
    ``gap_s``, or was relocated. Within a segment, motion between rows is linear with constant
    angular velocity, as in recording; before and after a segment it is extrapolated for up to
    ``beyond_s``, but not beyond the middle towards the next segment.

    Args:
        table: with ``track``, ``time_s``, ``x``, ``y``, ``z``, ``yaw``, ``pitch``, ``roll``, in any
            order of rows; metres, radians and seconds, site frame.
        gap_s: largest gap between rows of a moving track.
        beyond_s: largest extrapolation before the first and after the last row.
    """

    def __init__(self, table: pa.Table, gap_s: float, beyond_s: float) -> None:
        track, time_s = table["track"].to_numpy(), table["time_s"].to_numpy()
        order = np.lexsort((time_s, track))
        track, time_s = track[order], time_s[order]
        fresh = np.ones(len(track), np.bool_)
        fresh[1:] = (np.diff(track) != 0) | (np.diff(time_s) > 0)
        order, track, self._time_s = order[fresh], track[fresh], time_s[fresh]
        self._pose = np.column_stack([table[name].to_numpy()[order] for name in POSE])
        self._tracks, self._first = np.unique(track, return_index=True)
        self._beyond_s = beyond_s
        step_s = np.diff(self._time_s)
        moved = np.linalg.norm(np.diff(self._pose[:, :3], axis=0), axis=1)
        begins = (np.diff(track) != 0) | (moved > FASTEST_M_S * step_s)
        begins |= (step_s > gap_s) & (moved > _SAME_PLACE_M)
        #: Index of the segment of each row.
        self._stretch = np.concatenate([[0], np.cumsum(begins)])[: len(track)]

    def at(self, track: ArrayLike, time_s: NDArray[np.float64]) -> BodyPoses:
        """Return the poses of tracks, each at a time.

        Args:
            track: (T,) track of each, or one for all.
            time_s: (T,) seconds from the motion's start.
        """
        tracks = np.broadcast_to(np.asarray(track, np.int64), time_s.shape)
        leg = np.full(len(time_s), -1)
        order = np.argsort(tracks, kind="stable")
        cuts = np.flatnonzero(np.diff(tracks[order])) + 1
        for own in np.split(order, cuts) if len(order) else ():
            number = int(np.searchsorted(self._tracks, tracks[own[0]]))
            if number < len(self._tracks) and self._tracks[number] == tracks[own[0]]:
                leg[own] = self._legs(number, time_s[own])
        rotation = np.broadcast_to(np.eye(3), (len(time_s), 3, 3)).copy()
        translation, stretch = np.zeros((len(time_s), 3)), np.full(len(time_s), -1)
        known = np.flatnonzero(leg >= 0)
        legs, which = np.unique(leg[known], return_inverse=True)
        if len(legs):
            begin, end = self._pose[legs], self._pose[legs + 1]
            times = self._time_s[legs]
            share = (time_s[known] - times[which]) / (self._time_s[legs + 1] - times)[which]
            step = end[:, :3] - begin[:, :3]
            translation[known] = begin[which, :3] + share[:, None] * step[which]
            a, b = (rotation_from_ypr(*ends[:, 3:].T) for ends in (begin, end))
            turn = Rotation.from_matrix(np.swapaxes(a, 1, 2) @ b).as_rotvec()
            turned = Rotation.from_rotvec(share[:, None] * turn[which]).as_matrix()
            rotation[known] = a[which] @ turned
            stretch[known] = self._stretch[legs][which]
        return BodyPoses(rotation, translation, stretch)

    def _legs(self, number: int, time_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the row (T,) before each time from which to interpolate; -1 if unknown."""
        low = int(self._first[number])
        high = len(self._time_s)
        if number + 1 < len(self._first):
            high = int(self._first[number + 1])
        row = low + np.searchsorted(self._time_s[low:high], time_s, side="right") - 1
        before, after = np.maximum(row, low), np.minimum(row + 1, high - 1)
        stretch, times = self._stretch, self._time_s
        inside = (row >= low) & (row + 1 < high) & (stretch[before] == stretch[after])
        # Otherwise extrapolate the nearer segment, by its last pair of rows or its first.
        since = np.where(row >= low, time_s - times[before], np.inf)
        until = np.where(row + 1 < high, times[after] - time_s, np.inf)
        leg = np.where(since <= until, before - 1, after)
        sound = (np.minimum(since, until) <= self._beyond_s) & (leg >= low) & (leg + 1 < high)
        sound &= stretch[np.clip(leg, low, high - 1)] == stretch[np.clip(leg + 1, low, high - 1)]
        return np.where(inside, row, np.where(sound, leg, -1))


def paths_of_boxes(tracklets: pa.Table, times_s: NDArray[np.float64]) -> TrackPaths:
    """Return paths interpolated between labelled boxes, for datasets without trajectories.

    Boxes are upright in the frame of the points, and motion between frames is linear.

    Args:
        tracklets: see `tracklets.tracklet_table`.
        times_s: times of the frames.
    """
    step_s = float(np.diff(times_s).min()) if len(times_s) > 1 else 1.0
    # A box is seen at any time of a turn: up to two turns pass between two boxes.
    return TrackPaths(tracklets, gap_s=2.5 * step_s, beyond_s=2.0 * step_s)
