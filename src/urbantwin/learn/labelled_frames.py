"""Datasets as training takes them: their frames levelled and kept, and what is in them."""

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
#: Semantic classes that say nothing: unlabelled, outlier.
_UNKNOWN = (0, 1)


@dataclass(frozen=True)
class LabelledFrames:
    """Levelled frames in a folder.

    Attributes:
        folder: of their files.
        rigs: (frames,) the number of each frame's dataset.
        objects: how many of each class count, in the order of the classes.
        points: how many points there are of each semantic class that is known.
        followed: the numbers of those whose next sweep is kept, too.
    """

    folder: Path
    rigs: tuple[int, ...]
    objects: tuple[int, ...]
    points: Mapping[str, int]
    followed: tuple[int, ...] = ()

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.rigs)

    def frame(self, number: int) -> LevelFrame:
        """Read one."""
        return read_level_frame(frame_file(self.folder, number))

    def following(self, number: int) -> NDArray[np.float32]:
        """Read the points (N, 3) of the sweep after one that is followed, where its own are."""
        return np.asarray(np.load(next_file(self.folder, number)), np.float32)

    @property
    def bank(self) -> ObjectBank:
        """Objects that are cut out of them."""
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
    """Return the frames of recordings without labels, levelled; see `labelled_frames`.

    Args:
        recordings: that `open_recording` reads; no label of them is looked at.
        design: how far it looks, and whether it is told of intensities.
        folder: where levelled frames are kept.
        tell: called with the share that is done.
        names: of the frames of each recording, all for ``None``.
        following: keep the sweep after each, too (`next_sweep`).
        workers: processes that read; with one, this one.

    Raises:
        InputError: a recording cannot be used, or no frame of any is followed by another.
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
            expected="sweeps one after the other, of sensors that stand or whose poses are told",
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
    """Return the frames of datasets, levelled; what a folder already has is not made again.

    Args:
        datasets: labelled: ours, or any that `open_recording` reads.
        design: the classes, and how far it looks.
        folder: where levelled frames are kept.
        tell: called with the share that is done.
        known: classes that need not be there: the model that is begun with has learned them.
        names: of the frames of each dataset that may be seen, all for ``None``.
        workers: processes that read; with one, this one.

    Raises:
        InputError: a dataset cannot be used, or has no box of a class.
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
                expected=f"boxes of every class asked for; there are some with `{others}`",
            )
    of_points = {one.name: int(points[one.id]) for one in semantic_classes().values()
                 if points[one.id] and one.id not in _UNKNOWN}  # fmt: skip
    found = LabelledFrames(folder, tuple(rigs), tuple(int(one) for one in objects), of_points)
    # A bank holds some hundred objects of each class and rig: of long datasets a part is looked at.
    some = np.unique(np.linspace(0, len(rigs) - 1, 400).astype(int))
    bank = bank_of([(found.frame(k), rigs[k]) for k in some], len(design.classes))
    write_bank(folder / _BANK, bank)
    write_json(index, {"rigs": rigs, "objects": list(found.objects), "points": of_points})
    return found
