"""Labelled objects of frames, and which of them a detector has to find."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.criterion import JUDGED

__all__ = ["FEWEST_POINTS", "Truth", "counted_objects", "counting", "roles_of", "why_not"]

#: Boxes with fewer points are neutral.
FEWEST_POINTS = 5
#: Names in datasets of objects of unknown class.
_UNKNOWN = {"unknown", "misc", "dontcare", "unknownunmovable", "unknownmovable", "other"}
#: Classes whose objects are neutral for a similar class: in all datasets, and in KITTI (Geiger et
#: al. 2012, the development kit: neighbouring classes are not counted).
_LIKE = {"tram": ("truck", "bus")}
_LIKE_IN_KITTI = {"van": ("car",), "personsitting": ("pedestrian",)}


@dataclass(frozen=True, eq=False)
class Truth:
    """The labelled objects of several frames.

    Attributes:
        frames: names of the frames.
        time_s: (frames,) time of each frame, seconds; NaN if unknown.
        frame: (L,) index in ``frames``.
        box: (L, 7) centre, size, yaw in the frame of the points.
        class_names: (L,) actor classes, or ``other``.
        source_names: (L,) class names of the dataset.
        track: (L,) number of the object; -1 without a track.
        num_points: (L,) points in each box.
        occlusion: (L,) 0..1, NaN if unknown.
        ignored: (L,) reason why an object does not count, empty if it does.
        range_m: (L,) distance from the nearest sensor to the centre in plan, metres.
    """

    frames: tuple[str, ...]
    time_s: NDArray[np.float64]
    frame: NDArray[np.int64]
    box: NDArray[np.float64]
    class_names: tuple[str, ...]
    source_names: tuple[str, ...]
    track: NDArray[np.int64]
    num_points: NDArray[np.int64]
    occlusion: NDArray[np.float64]
    ignored: tuple[str, ...]
    range_m: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of objects."""
        return len(self.frame)


def why_not(
    marked: Sequence[str] | None,
    num_points: NDArray[np.int64],
    range_m: NDArray[np.float64],
    *,
    fewest_points: int = FEWEST_POINTS,
    most_m: float | None = None,
) -> tuple[str, ...]:
    """Return the reason why each box does not count, the dataset's or ours; empty if it counts."""
    reasons = list(marked) if marked is not None else [""] * len(num_points)
    for index, (points, away) in enumerate(zip(num_points, range_m, strict=True)):
        if reasons[index]:
            continue
        if points < fewest_points:
            reasons[index] = "few points"
        elif most_m is not None and away > most_m:
            reasons[index] = "far"
    return tuple(reasons)


def counted_objects(truth: Truth) -> frozenset[tuple[str, int]]:
    """Return frame and track of every tracked object that counts."""
    return frozenset(
        (truth.frames[frame], track)
        for frame, track, ignored in zip(
            truth.frame.tolist(), truth.track.tolist(), truth.ignored, strict=True
        )
        if track >= 0 and not ignored
    )


def counting(truth: Truth, objects: Collection[tuple[str, int]]) -> Truth:
    """Return the same objects, of which only the named ones count, whatever their points.

    Two recordings of one motion are evaluated on the same objects in this way: an object that one
    recording does not see is missed instead of ignored.

    Args:
        truth: labels of one recording.
        objects: frame and track of the objects that count.
    """
    keys = zip(truth.frame.tolist(), truth.track.tolist(), truth.ignored, strict=True)
    ignored = tuple(
        "" if (truth.frames[frame], track) in objects else reason or "does not count there"
        for frame, track, reason in keys
    )
    return replace(truth, ignored=ignored)


def roles_of(truth: Truth, class_name: str, *, layout: str, vans: bool) -> NDArray[np.int64]:
    """Return the role of each labelled object (L,) in the evaluation of a class.

    1: to be found. -1: neutral. 0: an object of another class.

    Args:
        truth: the objects.
        class_name: one of ``JUDGED``.
        layout: layout of the recording: KITTI's neighbouring classes are neutral.
        vans: count KITTI's vans as cars, as in all other datasets.
    """
    members = JUDGED[class_name]
    roles = np.zeros(len(truth), np.int64)
    for index, (actor, source, ignored) in enumerate(
        zip(truth.class_names, truth.source_names, truth.ignored, strict=True)
    ):
        plain = "".join(letter for letter in source.lower() if letter.isalpha())
        like = _LIKE_IN_KITTI.get(plain, ()) if layout == "kitti" else ()
        if vans and plain == "van":
            like = ()
        if class_name in like:
            roles[index] = -1
        elif actor in members:
            roles[index] = -1 if ignored else 1
        elif class_name in _LIKE.get(actor, ()) or (actor == "other" and plain in _UNKNOWN):
            roles[index] = -1
    return roles
