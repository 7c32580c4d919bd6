"""Paths of all objects, as a packet, and as rows for the search for events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.errors import InputError
from urbantwin.geometry import Pose, wrapped
from urbantwin.web.motion_side import MotionSide
from urbantwin.web.packet import packet
from urbantwin.web.recorded_side import RecordedSide
from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["Tracks", "tracks_of", "tracks_packet"]

#: An object with less total motion than this has a single position, metres.
_STANDS_M = 0.05


@dataclass(frozen=True, eq=False)
class Tracks:
    """One row per object and frame, sorted by frame, then track.

    Attributes:
        frame: (R,) index of the shown frame.
        time_s: (F,) times of the frames, seconds.
        track: (R,) track number of the object.
        box: (R, 7) boxes in the scene's frame.
        velocity: (R, 3) metres per second; zeros if unknown.
        points: (R,) number of points on the object; -1 if unknown.
        class_names: (R,) class names.
        companion: (R,) whether it is attached to another object: towed or leashed.
    """

    frame: NDArray[np.int64]
    time_s: NDArray[np.float64]
    track: NDArray[np.int64]
    box: NDArray[np.float64]
    velocity: NDArray[np.float64]
    points: NDArray[np.int64]
    class_names: NDArray[np.str_]
    companion: NDArray[np.bool_]


def tracks_of(side: RecordedSide | MotionSide) -> Tracks | None:
    """Return the tracks of a side; None if it has none, or they would have to be read."""
    if isinstance(side, MotionSide):
        return _of_frames(side, [side.boxes(index) for index in range(len(side.entries))])
    if side.own is not None and side.own.objects is not None:
        return _of_objects(side, side.own.objects)
    if not (side.surveyed and side.tracked):
        return None
    found = []
    for index in range(len(side.entries)):
        try:
            found.append(ShownBoxes.of(side.frame(index).boxes))
        except InputError:
            found.append(ShownBoxes.of(None))
    return _of_frames(side, found)


def _of_frames(side: RecordedSide | MotionSide, found: Sequence[ShownBoxes]) -> Tracks:
    frame = np.repeat(np.arange(len(found)), [len(one) for one in found])
    unknown = [np.full(len(one), -1, np.int64) for one in found]
    still = [np.zeros((len(one), 3)) for one in found]
    names = [name for one in found for name in one.class_names]
    return Tracks(
        frame=frame,
        time_s=np.array([one.time_s for one in side.entries]),
        track=np.concatenate([one.track for one in found]),
        box=np.concatenate([one.box for one in found]),
        velocity=np.concatenate(
            [s if b.velocity is None else b.velocity for b, s in zip(found, still, strict=True)]
        ),
        points=np.concatenate(
            [u if b.points is None else b.points for b, u in zip(found, unknown, strict=True)]
        ),
        class_names=np.array(names, np.str_),
        companion=np.isin(names, ("trailer", "animal")),
    )


def _of_objects(side: RecordedSide, objects: LabelledObjects) -> Tracks:
    """Return the tracks of a dataset of ours: no frame is read."""
    number = {entry.name: index for index, entry in enumerate(side.entries)}
    frame = np.array([number.get(one, -1) for one in objects.frame.tolist()], np.int64)
    rows = np.flatnonzero(frame >= 0)
    rows = rows[np.lexsort((objects.track[rows], frame[rows]))]
    objects, frame = objects.take(rows), frame[rows]
    box, velocity = objects.box, objects.velocity
    for index in np.unique(frame):
        pose = side.scene_SE3_frame(int(index))
        if pose is not None:
            mine = frame == index
            box[mine], velocity[mine] = _moved(box[mine], velocity[mine], pose)
    return Tracks(
        frame=frame,
        time_s=np.array([one.time_s for one in side.entries]),
        track=objects.track,
        box=box,
        velocity=velocity,
        points=objects.num_points,
        class_names=objects.class_name,
        companion=np.isin(objects.class_name, ("trailer", "animal")),
    )


def _moved(
    box: NDArray[np.float64], velocity: NDArray[np.float64], pose: Pose
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    moved = box.copy()
    moved[:, :3] = pose.apply(box[:, :3])
    turn = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    moved[:, 6] = wrapped(box[:, 6] + turn)
    return moved, velocity @ pose.rotation.T


def tracks_packet(tracks: Tracks | None) -> bytes:
    """Return the packet of all paths."""
    rows = []
    if tracks is not None:
        for number in np.unique(tracks.track[tracks.track >= 0]):
            mine = np.flatnonzero(tracks.track == number)
            box = tracks.box[mine]
            if np.ptp(box[:, :3], axis=0).max() < _STANDS_M:
                mine, box = mine[:1], box[:1]
            at = np.column_stack([box[:, :3], box[:, 6]])
            rows.append(
                {
                    "track": int(number),
                    "class": str(tracks.class_names[mine[0]]),
                    "time_s": [round(float(one), 4) for one in tracks.time_s[tracks.frame[mine]]],
                    "at": [[round(float(value), 3) for value in place] for place in at],
                    "size": [round(float(one), 3) for one in box[0, 3:6]],
                }
            )
    return packet({"tracks": rows}, {})
