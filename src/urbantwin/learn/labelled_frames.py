"""Training sets: levelled frames in a cache folder, with counts and an object bank."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import write_json
from urbantwin.artefact.document import read_json_value
from urbantwin.errors import InputError
from urbantwin.learn.augmentation.pasting import ObjectBank, bank_of, read_bank, write_bank
from urbantwin.learn.frame_reading import Reading, as_names, frame_file, next_file, read_frames
from urbantwin.learn.frames import LevelFrame, read_level_frame
from urbantwin.learn.model import Design
from urbantwin.progress import Progress
from urbantwin.taxonomy import semantic_classes

__all__ = ["LabelledFrames", "labelled_frames", "unlabelled_frames"]

_INDEX = "frames.json"
_BANK = "objects.npz"
#: Semantic classes that are not learned: unlabelled, outlier.
_UNKNOWN = (0, 1)


@dataclass(frozen=True)
class LabelledFrames:
    """Levelled frames in a folder.

    Attributes:
        folder: cache folder.
        rigs: index of each frame's recording.
        objects: number of objects of each class, in the order of the classes.
        points: number of points by name of the semantic class.
        followed: indices of frames whose next sweep is cached, too.
    """

    folder: Path
    rigs: tuple[int, ...]
    objects: tuple[int, ...]
    points: Mapping[str, int]
    followed: tuple[int, ...] = ()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.rigs)

    def frame(self, number: int) -> LevelFrame:
        """Read a frame."""
        return read_level_frame(frame_file(self.folder, number))

    def following(self, number: int) -> NDArray[np.float32]:
        """Read the points (N, 3) of a frame's next sweep, in the frame's own coordinates."""
        return np.asarray(np.load(next_file(self.folder, number)), np.float32)

    @property
    def bank(self) -> ObjectBank:
        """Objects cut out of the frames."""
        return read_bank(self.folder / _BANK)


def unlabelled_frames(
    recordings: Sequence[Path],
    design: Design,
    folder: Path,
    tell: Progress,
    *,
    names: Sequence[Collection[str] | None] | None = None,
    following: bool = False,
    workers: int = 1,
) -> LabelledFrames:
    """Return levelled frames of recordings without labels; see `labelled_frames`.

    Args:
        recordings: recordings that `open_recording` reads; labels are not read.
        design: range and use of intensity.
        folder: cache folder.
        tell: progress callback.
        names: names of the frames to use in each recording; ``None``: all.
        following: cache the next sweep of each frame, too (`next_sweep`).
        workers: number of processes.

    Raises:
        InputError: a recording cannot be used, or no frame has a next sweep.
    """
    index = folder / _INDEX
    if index.is_file():
        told = read_json_value(index, "an index of levelled frames")
        return LabelledFrames(folder, tuple(told["rigs"]), (), {}, tuple(told["followed"]))
    folder.mkdir(parents=True, exist_ok=True)
    reading = Reading(
        tuple(recordings), as_names(recordings, names), design, folder, False, following
    )
    rigs, read = read_frames(reading, workers, tell)
    if following and not read.followed:
        raise InputError(
            f"none of {len(rigs)} frames is followed by a sweep of the same place",
            file=", ".join(map(str, recordings)),
            expected="consecutive sweeps of static sensors, or of sensors with known poses",
        )
    write_json(index, {"rigs": rigs, "followed": read.followed})
    return LabelledFrames(folder, tuple(rigs), (), {}, tuple(read.followed))


def labelled_frames(
    datasets: Sequence[Path],
    design: Design,
    folder: Path,
    tell: Progress,
    *,
    known: Collection[str] = (),
    names: Sequence[Collection[str] | None] | None = None,
    workers: int = 1,
) -> LabelledFrames:
    """Return levelled frames of labelled datasets; frames in the cache are not made again.

    Args:
        datasets: labelled datasets, our own or any that `open_recording` reads.
        design: classes and range.
        folder: cache folder.
        tell: progress callback.
        known: classes that may be absent because the initial weights already cover them.
        names: names of the frames to use in each dataset; ``None``: all.
        workers: number of processes.

    Raises:
        InputError: a dataset cannot be used, or a class has no box.
    """
    index = folder / _INDEX
    if index.is_file():
        told = read_json_value(index, "an index of levelled frames")
        return LabelledFrames(folder, tuple(told["rigs"]), tuple(told["objects"]), told["points"])
    folder.mkdir(parents=True, exist_ok=True)
    reading = Reading(tuple(datasets), as_names(datasets, names), design, folder, True)
    rigs, read = read_frames(reading, workers, tell)
    objects, points = read.objects, read.points
    for name, count in zip(design.classes, objects, strict=True):
        if not count and name not in known:
            others = " ".join(
                f"--class {one}" for one, n in zip(design.classes, objects, strict=True) if n
            )
            raise InputError(
                f"no box of class {name} in {len(rigs)} frames",
                file=", ".join(map(str, datasets)),
                expected=f"boxes of every requested class; these have some: `{others}`",
            )
    of_points = {one.name: int(points[one.id]) for one in semantic_classes().values()
                 if points[one.id] and one.id not in _UNKNOWN}  # fmt: skip
    found = LabelledFrames(folder, tuple(rigs), tuple(int(one) for one in objects), of_points)
    # A bank holds a few hundred objects of each class and rig: 400 frames are enough for it.
    some = np.unique(np.linspace(0, len(rigs) - 1, 400).astype(int))
    bank = bank_of([(found.frame(k), rigs[k]) for k in some], len(design.classes))
    write_bank(folder / _BANK, bank)
    write_json(index, {"rigs": rigs, "objects": list(found.objects), "points": of_points})
    return found
