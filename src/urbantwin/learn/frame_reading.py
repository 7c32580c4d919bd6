"""Reading and levelling of training frames by one or several processes, cached in files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError, StageError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.labelled_view import View, view_of
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.learn.frames import (
    BEYOND_M,
    level_frame_from,
    levelled,
    refuse_upside_down,
    write_level_frame,
)
from urbantwin.learn.model import Design
from urbantwin.learn.next_sweep import followed, next_sweep
from urbantwin.processes import worker_pool
from urbantwin.progress import Progress

__all__ = ["Read", "Reading", "as_names", "frame_file", "next_file", "read_frames"]

#: Upper bound of intensities.
_MOST_INTENSITY = 1.0

_Names = tuple[frozenset[str] | None, ...]


def as_names(recordings: Sequence[Path], names: Sequence[Collection[str] | None] | None) -> _Names:
    """Return the allowed frame names of each recording as sets; ``None``: all frames."""
    if names is None:
        return (None,) * len(recordings)
    return tuple(None if one is None else frozenset(one) for one in names)


@dataclass(frozen=True)
class Reading:
    """Selection of frames to read, and the form to read them in.

    Attributes:
        recordings: paths of the recordings.
        names: allowed frame names of each recording; ``None``: all frames.
        design: range, classes and use of intensity.
        folder: cache of levelled frames.
        labels: whether labels are read.
        following: whether the next sweep of each frame is cached, too.
    """

    recordings: tuple[Path, ...]
    names: _Names
    design: Design
    folder: Path
    labels: bool
    following: bool = False

    def chosen(self, rig: int) -> Recording:
        """Open a recording with its allowed frames.

        Raises:
            InputError: the recording cannot be read, or has none of these frames.
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
    """Reads frames one by one and caches them levelled."""

    def __init__(self, reading: Reading) -> None:
        self._reading = reading
        self._open: tuple[int, Recording, View | None] | None = None
        self._followed: list[bool] = []
        self._ahead: tuple[int, Frame] | None = None

    def read(self, rig: int, number: int, at: int) -> Read:
        """Read frame ``number`` of a recording, cache it as frame ``at``; return its counts."""
        reading, design = self._reading, self._reading.design
        if self._open is None or self._open[0] != rig:
            recording = reading.chosen(rig)
            self._open = rig, recording, view_of(recording) if reading.labels else None
            if reading.following:
                whole = open_recording(reading.recordings[rig])
                self._followed, self._ahead = followed(whole, recording.names), None
        _, recording, view = self._open
        path, frame = reading.recordings[rig], self._frame(recording, number)
        if design.intensity:
            _check_intensity(frame, path)
        after = None
        if view is None:
            refuse_upside_down(frame, path)
            reach = design.range_m + BEYOND_M
            alone = levelled(frame, reach, intensity=design.intensity)
            level = alone.frame
            if reading.following and self._followed[number]:
                self._ahead = number + 1, recording.read(number + 1)
                after = next_sweep(frame, alone, self._ahead[1], reach)
            if after is not None:
                np.save(next_file(reading.folder, at), after)
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
        write_level_frame(frame_file(reading.folder, at), level)
        return Read(
            np.bincount(level.number[level.number >= 0], minlength=len(design.classes)),
            np.bincount(level.semantic, minlength=256),
            [] if after is None else [at],
        )

    def _frame(self, recording: Recording, number: int) -> Frame:
        """Return a frame, which may have been read already as the next sweep of another."""
        if self._ahead is not None and self._ahead[0] == number:
            return self._ahead[1]
        return recording.read(number)


@dataclass(frozen=True, eq=False)
class Read:
    """Counts over frames: objects by class, points by semantic class, frames with a next sweep."""

    objects: NDArray[np.int64]
    points: NDArray[np.int64]
    followed: list[int]


def read_frames(reading: Reading, workers: int, tell: Progress) -> tuple[list[int], Read]:
    """Read all frames; return the index of each frame's recording, and the total counts.

    Raises:
        InputError: a recording cannot be used.
        StageError: a process was killed.
    """
    counts = [len(reading.chosen(rig)) for rig in range(len(reading.recordings))]
    rigs = [rig for rig, count in enumerate(counts) for _ in range(count)]
    numbers = [number for count in counts for number in range(count)]
    frames = range(len(rigs))
    read = Read(np.zeros(len(reading.design.classes), np.int64), np.zeros(256, np.int64), [])

    def add(found: Iterator[Read]) -> None:
        for at, one in enumerate(found):
            name = reading.recordings[rigs[at]].name
            np.add(read.objects, one.objects, out=read.objects)
            np.add(read.points, one.points, out=read.points)
            read.followed.extend(one.followed)
            tell((at + 1) / len(rigs), f"reading {name}: {at + 1} of {len(rigs)}")

    if workers == 1:
        add(map(_Reader(reading).read, rigs, numbers, frames))
        return rigs, read
    try:
        with worker_pool(workers, _start, reading) as pool:
            add(pool.map(_read_one, rigs, numbers, frames, chunksize=8))
    except BrokenProcessPool:
        raise StageError(
            "a process that reads frames was killed (out of memory?): "
            "give the same command again, with fewer workers"
        ) from None
    return rigs, read


_reader: _Reader | None = None


def _start(reading: Reading) -> None:
    global _reader  # noqa: PLW0603 - state of a worker process: its open recordings
    _reader = _Reader(reading)


def _read_one(rig: int, number: int, at: int) -> Read:
    assert _reader is not None
    return _reader.read(rig, number, at)


def frame_file(folder: Path, number: int) -> Path:
    """Return the path of a cached frame."""
    return folder / f"{number:06}.npz"


def next_file(folder: Path, number: int) -> Path:
    """Return the path of the cached next sweep of a frame."""
    return folder / f"{number:06}-next.npy"


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
