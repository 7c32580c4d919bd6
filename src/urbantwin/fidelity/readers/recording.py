"""A recording: the frames of one sensor or rig in order, of any dataset."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame

__all__ = ["Recording", "cropped_recording", "file_and_choice"]


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames that are read on demand.

    Attributes:
        path: the folder or file.
        layout: its layout, one of ``readers.LAYOUTS``.
        names: names of the frames in order, without folders.
        read_frame: reads the frame of an index; raises InputError for an invalid file.
        notes: notes about the whole recording that qualify results.
        again: reopens it; sent to other processes instead of an open recording.
    """

    path: Path
    layout: str
    names: tuple[str, ...]
    read_frame: Callable[[int], Frame] = field(repr=False)
    notes: tuple[str, ...] = ()
    again: Callable[[], Recording] | None = field(default=None, repr=False)

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Pickle the function that opens it."""
        return super().__reduce__() if self.again is None else (self.again, ())

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.names)

    def read(self, index: int) -> Frame:
        """Read one frame, 0 <= index < len.

        Raises:
            InputError: its file, or its labels, are invalid; the other frames can still be read.
        """
        if not 0 <= index < len(self.names):
            raise IndexError(f"frame {index} of {len(self.names)}")
        return self.read_frame(index)

    def __iter__(self) -> Iterator[Frame]:
        """Read the frames one after the other."""
        return (self.read(index) for index in range(len(self)))

    def only(self, names: Collection[str]) -> Recording:
        """Return the recording with only the frames of the given names."""
        numbers = [number for number, name in enumerate(self.names) if name in names]
        again = None if self.again is None else partial(_only, self.again, names)
        return replace(
            self,
            names=tuple(self.names[number] for number in numbers),
            read_frame=lambda index: self.read(numbers[index]),
            again=again,
        )


def _only(again: Callable[[], Recording], names: Collection[str]) -> Recording:
    return again().only(names)


def cropped_recording(recording: Recording, half_m: tuple[float, ...]) -> Recording:
    """Return a recording whose frames have the points within (x, y, z) metres of the origin."""
    return replace(
        recording,
        read_frame=partial(_read_cropped, recording, half_m),
        again=partial(cropped_recording, recording, half_m),
    )


def _read_cropped(recording: Recording, half_m: tuple[float, ...], index: int) -> Frame:
    frame = recording.read(index)
    inside = (np.abs(frame.points) <= half_m).all(axis=1)
    if not inside.any():
        raise InputError(
            f"frame {recording.names[index]} has no point within "
            f"{' x '.join(f'{half:g}' for half in half_m)} m of the origin",
            file=recording.path,
            expected="points in the same frame as the other side's",
        )
    return frame if inside.all() else frame.only(inside)


def file_and_choice(path: Path) -> tuple[Path, str | None]:
    """Return a path and the part selected after a colon, or None.

    ``bag.mcap:/lidar/points``, ``a.pcap:192.168.1.201``. A path that exists is never split.
    """
    text = str(path)
    if ":" not in text or path.exists():
        return path, None
    at = text.find(":")
    while at >= 0:
        file = Path(text[:at])
        if text[:at] and text[at + 1 :] and file.exists():
            return file, text[at + 1 :]
        at = text.find(":", at + 1)
    return path, None
