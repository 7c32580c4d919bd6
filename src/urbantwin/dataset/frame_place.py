"""Place of the frames' files, with a mark for each complete frame: a folder, or storage."""

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

#: Folder of the marks of finished frames; not part of the dataset.
MARKS = "done"
_SEEN = "seen"

Entry = dict[str, Any]


class FramePlace(Protocol):
    """Place of frames. A frame with a mark is complete: the mark is written last."""

    def prepare(self, folders: Iterable[str]) -> None:
        """Prepare it for files in these folders."""

    def check(self) -> None:
        """Check that this process sees what `prepare` wrote.

        Raises:
            InputError: it does not.
        """

    def write(self, name: str, *parts: bytes | memoryview) -> None:
        """Write a file of a frame."""

    def mark(self, name: str, entry: Mapping[str, Any]) -> None:
        """Mark a frame as complete, with its table entry."""

    def entries(self, names: Iterable[str]) -> list[Entry | None]:
        """Return the entries of the frames' marks, ``None`` without a valid mark."""


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
        """Write a file through to the disk, and drop it from the page cache.

        So a marked frame survives a loss of power. On virtual machines the next frame then reuses
        the same memory: with fresh pages for every frame, writing takes five times as long.
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
    """Storage with an address. Marks are beside the dataset's files until it is complete.

    Attributes:
        files: storage of the files.
        marks: storage of the marks.
    """

    files: Storage
    marks: Storage

    def prepare(self, folders: Iterable[str]) -> None:
        """See `FramePlace`; storage has no folders."""
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
        requested = list(names)
        present = set(self.marks.names())
        contents = self.marks.read_all(
            [f"{name}.json" for name in requested if f"{name}.json" in present]
        )
        return [_parsed_or_none(contents.get(f"{name}.json", b"")) for name in requested]


_SHARED = "a folder that every worker sees, or an address of storage that it reaches"


def _read_or_none(path: Path) -> Any:  # noqa: ANN401
    """Return the content of a JSON file, or ``None`` if it is missing or damaged."""
    try:
        return _parsed_or_none(path.read_bytes())
    except OSError:
        return None


def _parsed_or_none(content: bytes) -> Any:  # noqa: ANN401
    try:
        return json.loads(content)  # our own file: `parse_json` is not needed
    except (ValueError, RecursionError):
        return None


def _write_all(descriptor: int, part: bytes | memoryview) -> None:
    """Write all bytes: on a full disk or with size limits, the system writes a part."""
    while len(part):
        part = part[os.write(descriptor, part) :]


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Add the file's name to errors of the system."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
