"""What is labelled in frames, and which of it a detector has to find."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.criterion import JUDGED

__all__ = ["FEWEST_POINTS", "Truth", "counted_objects", "counting", "roles_of", "why_not"]

#: Boxes with fewer points neither help nor hurt.
FEWEST_POINTS = 5
#: What data sets call objects that they themselves do not know.
_UNKNOWN = {"unknown", "misc", "dontcare", "unknownunmovable", "unknownmovable", "other"}
#: Too like a class to be wrong for it, too unlike to be asked for: of every data set, and of KITTI
#: (Geiger et al. 2012, the development kit: neighbouring classes are not counted).
_LIKE = {"tram": ("truck", "bus")}
_LIKE_IN_KITTI = {"van": ("car",), "personsitting": ("pedestrian",)}


@dataclass(frozen=True, eq=False)
class Truth:
    """The labelled objects of several frames.

    Attributes:
        frames: names of the frames.
        time_s: (frames,) when each was taken, seconds; NaN where nothing says.
        frame: (L,) which of ``frames``.
        box: (L, 7) centre, size, yaw in the frame of the points.
        class_names: (L,) classes of actors, or ``other``.
        source_names: (L,) as the data calls them.
        track: (L,) the object's number; -1 where the data does not follow it.
        num_points: (L,) points in each.
        occlusion: (L,) 0..1, NaN where it is not known.
        ignored: (L,) why each does not count, empty where it does.
        range_m: (L,) from the nearest sensor to its centre, in plan.
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
        """Return how many there are."""
        return len(self.frame)


def why_not(
    marked: Sequence[str] | None,
    num_points: NDArray[np.int64],
    range_m: NDArray[np.float64],
    *,
    fewest_points: int = FEWEST_POINTS,
    most_m: float | None = None,
) -> tuple[str, ...]:
    """Return of every box why it does not count: the data's reason, or ours; empty if it does."""
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
    """Return frame and track of every object that counts and is followed."""
    return frozenset(
        (truth.frames[frame], track)
        for frame, track, ignored in zip(
            truth.frame.tolist(), truth.track.tolist(), truth.ignored, strict=True
        )
        if track >= 0 and not ignored
    )


def counting(truth: Truth, objects: Collection[tuple[str, int]]) -> Truth:
    """Return the same objects, of which those count that are named, however few points they have.

    Two recordings of one motion are judged by the same objects so: what one of them does not see
    counts as missed, and not as not to be found.

    Args:
        truth: of one of them.
        objects: frame and track of those that count.
    """
    keys = zip(truth.frame.tolist(), truth.track.tolist(), truth.ignored, strict=True)
    ignored = tuple(
        "" if (truth.frames[frame], track) in objects else reason or "does not count there"
        for frame, track, reason in keys
    )
    return replace(truth, ignored=ignored)


def roles_of(truth: Truth, class_name: str, *, layout: str, vans: bool) -> NDArray[np.int64]:
    """Return what each labelled object (L,) is when a class is judged.

    1: to be found. -1: neither to be found nor wrong to be found. 0: another thing.

    Args:
        truth: the objects.
        class_name: one of ``JUDGED``.
        layout: of the recording: KITTI's neighbouring classes do not count.
        vans: count KITTI's vans as cars, as those of all other data sets.
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
