"""Tracks from detections: association, filtering, and one class and size per track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import Detections, detected_class
from urbantwin.geometry import Pose, wrapped
from urbantwin.progress import Progress, untold
from urbantwin.tracking.estimation import Estimate, estimates, fronted
from urbantwin.tracking.linking import Linking, linked, underside
from urbantwin.tracking.road_user import RoadUser, group_of
from urbantwin.traffic.recorded.rejoined import chains
from urbantwin.traffic.recorded.track import RecordedTrack

__all__ = ["rejoined_rows", "tracked"]


def rejoined_rows(
    found: Detections,
    tracks: Sequence[NDArray[np.int64]],
    users: Sequence[RoadUser],
    time_s: NDArray[np.float64],
) -> list[NDArray[np.int64]]:
    """Return the rows of tracks with those of one road user joined (`traffic.recorded.rejoined`).

    Args:
        found: detections in a fixed frame of reference.
        tracks: rows of each track.
        users: motion model of each detection (N,): only tracks of one model are joined.
        time_s: (frames,) seconds.
    """
    as_recorded = [
        RecordedTrack(
            name=str(number),
            actor_class=users[int(rows[0])].name,
            time_s=time_s[found.frame[rows]],
            xy=found.box[rows, :2],
            yaw=found.box[rows, 6],
            z=found.box[rows, 2],
            size=np.median(found.box[rows, 3:6], axis=0),
        )
        for number, rows in enumerate(tracks)
    ]
    joined = [np.concatenate([tracks[k] for k in chain]) for chain in chains(as_recorded)]
    return sorted(joined, key=lambda rows: int(rows[0]))


#: Factor on its track's score of a box without a detection.
_FILLED_SCORE_FACTOR = 0.5

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


def tracked(
    found: Detections,
    time_s: Floats,
    *,
    poses: Sequence[Pose] | None = None,
    how: Linking | None = None,
    smooth: bool = False,
    tell: Progress = untold,
) -> Detections:
    """Return the tracks of detections: boxes by frame, with gaps filled.

    The score of a track with n detections is their mean times n / (n + 1), and half of that where
    it is filled. Its class is the one with the largest sum of scores, and its size the weighted
    median of that class's detections. Detections in no track are left out.

    Args:
        found: the detections.
        time_s: (frames,) times of the frames, seconds, ascending.
        poses: pose of the boxes' frame in the world for every frame of a moving sensor; ``None``
            for a stationary one.
        how: parameters of the association.
        smooth: use later detections, too: broken tracks are joined, and states smoothed.
        tell: called with the fraction done and what is being done.
    """
    still = _transformed(found, poses)
    users = [group_of(name) for name in still.class_names]
    tell(0.0, "linking")
    tracks = linked(still, users, time_s, how or Linking(), lambda share: tell(0.7 * share, "link"))
    if smooth:
        tell(0.7, "joining")
        tracks = rejoined_rows(still, tracks, users, time_s)
    tell(0.8, "filtering")
    seen = underside(still.box)
    made: list[Estimate | None] = [None] * len(tracks)
    for name in sorted({users[int(rows[0])].name for rows in tracks}):
        numbers = [k for k, rows in enumerate(tracks) if users[int(rows[0])].name == name]
        user = users[int(tracks[numbers[0]][0])]
        where = estimates(
            [still.frame[tracks[k]] for k in numbers],
            [seen[tracks[k]] for k in numbers],
            user,
            time_s,
            smooth=smooth,
        )
        for k, estimate in zip(numbers, where, strict=True):
            made[k] = estimate
    boxes = _boxes(still, tracks, [estimate for estimate in made if estimate is not None], users)
    boxes = replace(boxes, time_s=time_s)
    tell(1.0, "filtering")
    return _transformed(boxes, None if poses is None else [pose.inverse() for pose in poses])


def _boxes(
    found: Detections, tracks: Sequence[Rows], made: Sequence[Estimate], users: Sequence[RoadUser]
) -> Detections:
    frames, boxes, names, scores, numbers, filled = [], [], list[str](), [], [], []
    for number, (rows, estimate) in enumerate(zip(tracks, made, strict=True)):
        name, size = _class_and_size(found, rows)
        count, score = len(estimate.frame), found.score[rows]
        yaw = fronted(estimate, found.frame[rows], found.box[rows, 6], score, users[int(rows[0])])
        middle = estimate.state[:, 2] + size[2] / 2
        box = np.column_stack([estimate.state[:, :2], middle, np.tile(size, (count, 1)), yaw])
        gap = np.ones(count, np.bool_)
        gap[found.frame[rows] - estimate.frame[0]] = False
        mean = float(score.mean()) * len(rows) / (len(rows) + 1)
        frames.append(estimate.frame)
        boxes.append(box)
        names += [name] * count
        scores.append(np.where(gap, _FILLED_SCORE_FACTOR * mean, mean))
        numbers.append(np.full(count, number, np.int64))
        filled.append(gap)
    none = not tracks
    table = Detections(
        frames=found.frames,
        frame=np.zeros(0, np.int64) if none else np.concatenate(frames),
        box=np.zeros((0, 7)) if none else np.concatenate(boxes),
        class_names=tuple(names),
        score=np.zeros(0) if none else np.concatenate(scores),
        track=np.zeros(0, np.int64) if none else np.concatenate(numbers),
        time_s=found.time_s,
        filled=np.zeros(0, np.bool_) if none else np.concatenate(filled),
    )
    return table.only(np.lexsort((table.track, table.frame)))


def _class_and_size(found: Detections, rows: Rows) -> tuple[str, Floats]:
    """Return the class of a track, and its length, width and height."""
    score, names = found.score[rows], [found.class_names[row] for row in rows]
    votes = dict.fromkeys(sorted(set(names)), 0.0)
    alike = dict.fromkeys([detected_class(name) or name for name in votes], 0.0)
    for name, weight in zip(names, score.tolist(), strict=True):
        votes[name] += weight
        alike[detected_class(name) or name] += weight
    # First the detector's class, then its most frequent member.
    kind = max(alike, key=lambda class_name: alike[class_name])
    members = {
        member: weight
        for member, weight in votes.items()
        if (detected_class(member) or member) == kind
    }
    name = max(members, key=lambda member: members[member])
    is_member = np.array([class_name in members for class_name in names])
    size, weight = found.box[rows[is_member], 3:6], score[is_member]
    return name, np.array([_median(side, weight) for side in size.T])


def _median(values: Floats, weight: Floats) -> float:
    """Return the median of values with weights above zero."""
    order = np.argsort(values, kind="stable")
    along = np.cumsum(weight[order]) - weight[order] / 2
    return float(np.interp(along[-1] / 2 + weight[order][-1] / 4, along, values[order]))


def _transformed(found: Detections, poses: Sequence[Pose] | None) -> Detections:
    """Return boxes transformed by each frame's pose; they stay upright."""
    if poses is None:
        return found
    box = found.box.copy()
    for number in np.unique(found.frame):
        rows = np.flatnonzero(found.frame == number)
        pose = poses[int(number)]
        box[rows, :3] = pose.apply(box[rows, :3])
        ahead = np.column_stack([np.cos(box[rows, 6]), np.sin(box[rows, 6]), np.zeros(len(rows))])
        ahead = ahead @ pose.rotation.T
        box[rows, 6] = wrapped(np.arctan2(ahead[:, 1], ahead[:, 0]))
    return replace(found, box=box)
