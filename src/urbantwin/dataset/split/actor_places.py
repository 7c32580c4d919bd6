"""Positions of every actor in range in every frame, for rating a split."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.dataset.result_warnings import BEYOND
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

__all__ = ["ActorPlaces", "Recorded", "moments_of", "places_of"]

#: Track ids are smaller: they have 16 bits.
_TRACKS = 1 << 20
#: Track id of a rig on an actor; no actor has it.
_RIG = 0
#: Actors that move less in the whole recording are static, metres.
_STANDS_M = 1.0
#: Times that differ by less are equal, seconds.
_SAME_S = 1e-6


@dataclass(frozen=True)
class Recorded:
    """The part of a dataset that a split needs.

    Attributes:
        folder: its folder.
        frames: ``name`` and ``time_s`` of each, and ``dataset_SE3_site`` for a rig on an actor.
        dataset_SE3_site: rows of the pose of a fixed rig.
    """

    folder: Path
    frames: Sequence[Mapping[str, Any]]
    dataset_SE3_site: Any  # noqa: N815


@dataclass(frozen=True, eq=False)
class ActorPlaces:
    """Rows of an actor in range at a moment, ordered by moment, then by track.

    Attributes:
        times_s: (T,) times of the moments.
        moment: (N,) index of the moment.
        track: (N,) track id; 0 is the rig on an actor.
        ends: (N, 4) x, y of the centres of its front and its rear, site frame, metres.
        length: (N,) length of the actor, metres.
        parked: (N,) bool.
    """

    times_s: NDArray[np.float64]
    moment: NDArray[np.int64]
    track: NDArray[np.int64]
    ends: NDArray[np.float64]
    length: NDArray[np.float64]
    parked: NDArray[np.bool_]

    def at(self, moment: int) -> slice:
        """Return the rows of a moment."""
        first, last = np.searchsorted(self.moment, [moment, moment + 1])
        return slice(int(first), int(last))

    def rows_at(
        self, moments: NDArray[np.int64], tracks: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the rows (R,) of actors (R,) at moments (R,), and which of them exist."""
        wanted = moments * _TRACKS + tracks
        rows = np.minimum(np.searchsorted(self._order, wanted), len(self._order) - 1)
        return rows, self._order[rows] == wanted

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """Sort key of the rows."""
        return self.moment * _TRACKS + self.track

    def within(self, moments: NDArray[np.int64], *, parked: bool) -> set[int]:
        """Return the tracks of actors, parked or not, at some moments."""
        selected = np.isin(self.moment, moments) & (self.parked == parked) & (self.track != _RIG)
        return set(self.track[selected].tolist())

    def has_moved(self) -> NDArray[np.bool_]:
        """Return which rows (N,) are of an actor that moves at some time."""
        _, actor = np.unique(self.track, return_inverse=True)
        middle = (self.ends[:, :2] + self.ends[:, 2:]) / 2
        low = np.full((actor.max(initial=-1) + 1, 2), np.inf)
        high = -low
        np.minimum.at(low, actor, middle)
        np.maximum.at(high, actor, middle)
        moves = np.hypot(*(high - low).T) > _STANDS_M
        return np.asarray(moves[actor] & ~self.parked & (self.track != _RIG))

    def differs(self, one: int, other: int, moved_m: float) -> bool:
        """Return whether an actor came, went, moved or turned farther between two moments."""
        first, second = self.at(one), self.at(other)
        if not np.array_equal(self.track[first], self.track[second]):
            return True
        way = self.ends[second] - self.ends[first]
        farthest = max(
            np.hypot(*way[:, :2].T).max(initial=0), np.hypot(*way[:, 2:].T).max(initial=0)
        )
        return bool(farthest > moved_m)


def moments_of(times_s: Sequence[float] | NDArray[np.float64]) -> NDArray[np.int64]:
    """Return times in whole microseconds: equal for simultaneous frames of several datasets."""
    return np.round(np.asarray(times_s, np.float64) / _SAME_S).astype(np.int64)


def places_of(recorded: Sequence[Recorded]) -> ActorPlaces:
    """Return the positions of actors in frames of one motion, independent of the sensors.

    Actors outside the region or out of range of all sensors are left out. Positions are those at
    the frame's time, not at the time of the rays.

    Raises:
        InputError: a table is missing or damaged, or a frame's pose is unknown.
    """
    times = np.unique(np.concatenate([moments_of(_times(dataset)) for dataset in recorded]))
    parts = [_rows(dataset, times) for dataset in recorded]
    moment, track, ends, length, parked = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    _, first = np.unique(moment * _TRACKS + track, return_index=True)
    return ActorPlaces(
        times * _SAME_S, moment[first], track[first], ends[first], length[first], parked[first]
    )


def _times(one: Recorded) -> list[float]:
    return [float(frame["time_s"]) for frame in one.frames]


def _rows(one: Recorded, times: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Return moment, track, ends, length and parked of a dataset's actors and moving rig."""
    objects, frame = _boxes(one)
    moments = np.searchsorted(times, moments_of(_times(one)))
    yaw, length = objects.box[:, 6], objects.box[:, 3]
    middle = objects.box[:, :3].copy()
    middle[:, :2] -= objects.velocity[:, :2] * objects.observed_s[:, None]
    along = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(frame))]) * length[:, None] / 2
    front, rear = middle + along, middle - along
    is_mounted = any("dataset_SE3_site" in told for told in one.frames)
    poses = [_pose(one, told) for told in (one.frames if is_mounted else one.frames[:1])]
    for k, pose in enumerate(poses):
        in_frame = frame == k if is_mounted else slice(None)
        front[in_frame], rear[in_frame] = pose.apply(front[in_frame]), pose.apply(rear[in_frame])
    ends = np.hstack([front[:, :2], rear[:, :2]])
    count = len(poses) if is_mounted else 0
    rig_ends = [pose.apply(np.array([[2.0, 0, 0], [-2.0, 0, 0]]))[:, :2].ravel() for pose in poses]
    return (
        np.concatenate([moments[frame], moments[:count]]),
        np.concatenate([objects.track, np.full(count, _RIG)]),
        np.concatenate([ends, np.array(rig_ends[:count]).reshape(-1, 4)]),
        np.concatenate([length, np.full(count, 4.0)]),
        np.concatenate([objects.parked, np.zeros(count, bool)]),
    )


def _boxes(one: Recorded) -> tuple[LabelledObjects, NDArray[np.int64]]:
    """Return the boxes in range, and the index of the frame of each."""
    objects = LabelledObjects.in_folder(one.folder)
    number = {str(frame["name"]): k for k, frame in enumerate(one.frames)}
    frame = np.array([number.get(name, -1) for name in objects.frame.tolist()], np.int64)
    selected = (frame >= 0) & ~np.isin(objects.ignored, BEYOND)
    return objects.take(selected), frame[selected]


def _pose(one: Recorded, told: Mapping[str, Any]) -> Pose:
    """Return the pose of the dataset's frame in the site at a moment.

    Raises:
        InputError: unknown.
    """
    matrix = told.get("dataset_SE3_site", one.dataset_SE3_site)
    if matrix is None:
        file = one.folder / "dataset.json"
        raise InputError("is missing", file=file, place="dataset_SE3_site")
    return pose_of_matrix(matrix).inverse()
