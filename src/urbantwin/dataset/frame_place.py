"""Where the files of frames go, with a mark for each frame that is whole: a folder, or storage."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from urbantwin.artefact.storage import Storage
from urbantwin.errors import InputError

__all__ = ["MARKS", "FolderPlace", "FramePlace", "StoredPlace"]

#: Folder of the marks of finished frames; no part of the dataset.
MARKS = "done"
_SEEN = "seen"

Entry = dict[str, Any]


class FramePlace(Protocol):
    """Where frames go. A frame that has its mark is whole: the mark is written last."""

    def prepare(self, folders: Iterable[str]) -> None:
        """Make it ready for files in these folders."""

    def check(self) -> None:
        """Refuse it in a process that does not see what `prepare` wrote.

        Raises:
            InputError: this one does not.
        """

    def write(self, name: str, *parts: bytes | memoryview) -> None:
        """Write a file of a frame."""

    def mark(self, name: str, entry: Mapping[str, Any]) -> None:
        """Mark a frame as whole, with what the tables say of it."""

    def entries(self, names: Iterable[str]) -> list[Entry | None]:
        """Return what the marks of frames hold, ``None`` for those without a whole one."""


@dataclass(frozen=True)
class FolderPlace:
    """A folder of this machine, or one that all machines share."""

    folder: Path

    def prepare(self, folders: Iterable[str]) -> None:
        """See `FramePlace`."""
        for name in (MARKS, *folders):
            (self.folder / name).mkdir(parents=True, exist_ok=True)

    def check(self) -> None:
        """See `FramePlace`."""
        if not (self.folder / MARKS).is_dir():
            raise InputError("is not seen from there", file=self.folder, expected=_SHARED)

    def write(self, name: str, *parts: bytes | memoryview) -> None:
        """Write a file through to the disk, and give its memory back.

        A frame that is marked as finished is then really there after a loss of power. And where
        the machine is a virtual one, the next frame finds memory that it has already: with fresh
        pages for every frame, writing takes five times as long.
        """
        path = self.folder / name
        with path.open("wb", buffering=0) as stream, _named(path):
            for part in parts:
                _write_all(stream.fileno(), part)
            os.fdatasync(stream.fileno())
            if hasattr(os, "posix_fadvise"):
                os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)

    def mark(self, name: str, entry: Mapping[str, Any]) -> None:
        """See `FramePlace`."""
        mark = self.folder / MARKS / f"{name}.json"
        unfinished = mark.with_suffix(".part")
        unfinished.write_text(json.dumps(entry, allow_nan=False), encoding="utf-8")
        unfinished.replace(mark)

    def entries(self, names: Iterable[str]) -> list[Entry | None]:
        """See `FramePlace`."""
        return [_read_or_none(self.folder / MARKS / f"{name}.json") for name in names]


@dataclass(frozen=True)
class StoredPlace:
    """Storage with an address. Its marks are beside the dataset's files until that is whole.

    Attributes:
        files: where the files go.
        marks: where the marks go.
    """

    files: Storage
    marks: Storage

    def prepare(self, folders: Iterable[str]) -> None:
        """See `FramePlace`: folders there are but names."""
        self.marks.write(_SEEN, b"")

    def check(self) -> None:
        """See `FramePlace`."""
        try:
            self.marks.read(_SEEN)
        except InputError as error:
            raise InputError(
                f"is not seen from there ({error.problem})", file=str(self.files), expected=_SHARED
            ) from None

    def write(self, name: str, *parts: bytes | memoryview) -> None:
        """See `FramePlace`."""
        self.files.write(name, *parts)

    def mark(self, name: str, entry: Mapping[str, Any]) -> None:
        """See `FramePlace`."""
        self.marks.write(f"{name}.json", json.dumps(entry, allow_nan=False).encode())

    def entries(self, names: Iterable[str]) -> list[Entry | None]:
        """See `FramePlace`."""
        asked = list(names)
        there = set(self.marks.names())
        found = self.marks.read_all([f"{one}.json" for one in asked if f"{one}.json" in there])
        return [_parsed_or_none(found.get(f"{one}.json", b"")) for one in asked]


_SHARED = "a folder that every worker sees, or an address of storage that it reaches"


def _read_or_none(path: Path) -> Any:  # noqa: ANN401
    """Return what a JSON file holds, or ``None`` if it is missing, truncated or damaged."""
    try:
        return _parsed_or_none(path.read_bytes())
    except OSError:
        return None


def _parsed_or_none(content: bytes) -> Any:  # noqa: ANN401
    try:
        return json.loads(content)  # our own: nothing that `parse_json` would refuse
    except (ValueError, RecursionError):
        return None


def _write_all(descriptor: int, part: bytes | memoryview) -> None:
    """Write all of it: where a disk fills up or files are limited, the system writes a part."""
    while len(part):
        part = part[os.write(descriptor, part) :]


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Add the file's name to errors of the system."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
