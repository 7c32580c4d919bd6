"""Datasets as training takes them: their frames levelled and kept, and what is in them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import write_json
from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.document import read_json_value
from urbantwin.artefact.inventory import INVENTORY
from urbantwin.errors import InputError, StageError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.labelled_view import View, view_of
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.learn.augmentation.pasting import ObjectBank, bank_of, read_bank, write_bank
from urbantwin.learn.frames import (
    BEYOND_M,
    LevelFrame,
    level_frame_from,
    levelled,
    read_level_frame,
    refuse_upside_down,
    write_level_frame,
)
from urbantwin.learn.model import Design
from urbantwin.processes import worker_pool
from urbantwin.progress import Progress
from urbantwin.taxonomy import semantic_classes

__all__ = ["LabelledFrames", "digest_of", "labelled_frames", "unlabelled_frames"]

_INDEX = "frames.json"
_BANK = "objects.npz"
#: Semantic classes that say nothing: unlabelled, outlier.
_UNKNOWN = (0, 1)
#: Intensities are told from 0 to 1.
_MOST_INTENSITY = 1.0


@dataclass(frozen=True)
class LabelledFrames:
    """Levelled frames in a folder.

    Attributes:
        folder: of their files.
        rigs: (frames,) the number of each frame's dataset.
        objects: how many of each class count, in the order of the classes.
        points: how many points there are of each semantic class that is known.
    """

    folder: Path
    rigs: tuple[int, ...]
    objects: tuple[int, ...]
    points: Mapping[str, int]

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.rigs)

    def frame(self, number: int) -> LevelFrame:
        """Read one."""
        return read_level_frame(_file(self.folder, number))

    @property
    def bank(self) -> ObjectBank:
        """Objects that are cut out of them."""
        return read_bank(self.folder / _BANK)


def digest_of(dataset: Path) -> str:
    """Return what tells a dataset from another: the SHA-256 of its list of checksums.

    Of a recording without one, that of the names and sizes of its files.
    """
    sums = dataset / INVENTORY
    if sums.is_file():
        return sha256_of(sums)
    files = sorted(one for one in dataset.rglob("*") if one.is_file())
    text = "\n".join(f"{one.relative_to(dataset)} {one.stat().st_size}" for one in files)
    return hashlib.sha256(text.encode()).hexdigest()


def unlabelled_frames(
    recordings: Sequence[Path],
    design: Design,
    folder: Path,
    tell: Progress,
    *,
    names: Sequence[Collection[str] | None] | None = None,
    workers: int = 1,
) -> LabelledFrames:
    """Return the frames of recordings without labels, levelled; see `labelled_frames`.

    Args:
        recordings: that `open_recording` reads; no label of them is looked at.
        design: how far it looks, and whether it is told of intensities.
        folder: where levelled frames are kept.
        tell: called with the share that is done.
        names: of the frames of each recording, all for ``None``.
        workers: processes that read; with one, this one.

    Raises:
        InputError: a recording cannot be used.
    """
    index = folder / _INDEX
    if index.is_file():
        told = read_json_value(index, "an index of levelled frames")
        return LabelledFrames(folder, tuple(told["rigs"]), (), {})
    folder.mkdir(parents=True, exist_ok=True)
    reading = _Reading(
        tuple(recordings), _as_names(recordings, names), design, folder, labels=False
    )
    rigs = _read(reading, workers, tell)[0]
    write_json(index, {"rigs": rigs})
    return LabelledFrames(folder, tuple(rigs), (), {})


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
    reading = _Reading(tuple(datasets), _as_names(datasets, names), design, folder, labels=True)
    rigs, objects, points = _read(reading, workers, tell)
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


_Names = tuple[frozenset[str] | None, ...]


def _as_names(recordings: Sequence[Path], names: Sequence[Collection[str] | None] | None) -> _Names:
    if names is None:
        return (None,) * len(recordings)
    return tuple(None if one is None else frozenset(one) for one in names)


@dataclass(frozen=True)
class _Reading:
    """Which frames are read, and how.

    Attributes:
        recordings: where they are.
        names: of the frames of each that may be seen, all for ``None``.
        design: how far it looks, what it tells apart.
        folder: where levelled frames are kept.
        labels: whether their labels are looked at.
    """

    recordings: tuple[Path, ...]
    names: _Names
    design: Design
    folder: Path
    labels: bool

    def chosen(self, rig: int) -> Recording:
        """Open a recording with the frames that may be seen.

        Raises:
            InputError: it cannot be read, or has none of them.
        """
        recording = open_recording(self.recordings[rig])
        wanted = self.names[rig]
        if wanted is None:
            return recording
        found = recording.only(set(wanted))
        if not len(found):
            raise InputError(
                "has no frame of its list",
                file=self.recordings[rig],
                expected="names of its frames in ImageSets, or --part all",
            )
        return found


class _Reader:
    """Reads frames of recordings one by one, and keeps them levelled."""

    def __init__(self, reading: _Reading) -> None:
        self._reading = reading
        self._open: tuple[int, Recording, View | None] | None = None

    def read(self, rig: int, number: int, at: int) -> _Counts:
        """Read a frame of a recording, which becomes number ``at`` of all; return what it has."""
        reading, design = self._reading, self._reading.design
        if self._open is None or self._open[0] != rig:
            recording = reading.chosen(rig)
            self._open = rig, recording, view_of(recording) if reading.labels else None
        _, recording, view = self._open
        path, frame = reading.recordings[rig], recording.read(number)
        if design.intensity:
            _check_intensity(frame, path)
        if view is None:
            refuse_upside_down(frame, path)
            level = levelled(frame, design.range_m + BEYOND_M, intensity=design.intensity).frame
        else:
            marks = None if frame.boxes is None else frame.boxes.ignored
            level = level_frame_from(
                frame,
                design.classes,
                design.range_m,
                file=path,
                intensity=design.intensity,
                ignored=None if marks is None else np.array([one != "" for one in marks], bool),
                labelled=view.covers,
            )
        write_level_frame(_file(reading.folder, at), level)
        return (
            np.bincount(level.number[level.number >= 0], minlength=len(design.classes)),
            np.bincount(level.semantic, minlength=256),
        )


#: Objects of each class, and points of each semantic class.
_Counts = tuple[NDArray[np.int64], NDArray[np.int64]]


def _read(
    reading: _Reading, workers: int, tell: Progress
) -> tuple[list[int], NDArray[np.int64], NDArray[np.int64]]:
    """Read all frames; return the recording of each, and what they have together.

    Raises:
        InputError: a recording cannot be used.
        StageError: a process was killed.
    """
    counts = [len(reading.chosen(rig)) for rig in range(len(reading.recordings))]
    rigs = [rig for rig, count in enumerate(counts) for _ in range(count)]
    numbers = [number for count in counts for number in range(count)]
    frames = range(len(rigs))
    objects = np.zeros(len(reading.design.classes), np.int64)
    points = np.zeros(256, np.int64)

    def add(found: Iterator[_Counts]) -> None:
        for at, (more, seen) in enumerate(found):
            name = reading.recordings[rigs[at]].name
            np.add(objects, more, out=objects)
            np.add(points, seen, out=points)
            tell((at + 1) / len(rigs), f"reading {name}: {at + 1} of {len(rigs)}")

    if workers == 1:
        add(map(_Reader(reading).read, rigs, numbers, frames))
        return rigs, objects, points
    try:
        with worker_pool(workers, _start, reading) as pool:
            add(pool.map(_read_one, rigs, numbers, frames, chunksize=8))
    except BrokenProcessPool:
        raise StageError(
            "a process that reads frames was killed (out of memory?): "
            "give the same command again, with fewer workers"
        ) from None
    return rigs, objects, points


_reader: _Reader | None = None


def _start(reading: _Reading) -> None:
    global _reader  # noqa: PLW0603 - a worker's only state: the recordings that it has opened
    _reader = _Reader(reading)


def _read_one(rig: int, number: int, at: int) -> _Counts:
    assert _reader is not None
    return _reader.read(rig, number, at)


def _file(folder: Path, number: int) -> Path:
    return folder / f"{number:06}.npz"


def _check_intensity(frame: Frame, dataset: Path) -> None:
    if frame.intensity is None:
        raise InputError(
            "has no intensities", file=dataset, place=f"frame {frame.name}", expected="0 to 1"
        )
    most = float(np.nanmax(frame.intensity, initial=0.0))
    if most > _MOST_INTENSITY:
        raise InputError(
            f"has intensities up to {most:g}",
            file=dataset,
            place=f"frame {frame.name}",
            expected="0 to 1",
        )
