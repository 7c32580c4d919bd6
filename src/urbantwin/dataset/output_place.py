"""Where a recording goes: a folder, which appears when it is whole, or storage with an address."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.artefact import INVENTORY, check_folder, passing_folder, replaced_folder
from urbantwin.artefact.storage import Storage
from urbantwin.dataset.frame_place import MARKS, FolderPlace, FramePlace, StoredPlace
from urbantwin.dataset.reading.frame_files import FOLDERS
from urbantwin.errors import InputError

__all__ = ["OutputPlace", "check_output", "opened_output"]

#: Of a recording on storage that is not whole: marks, in a folder of its recipe's key.
_PARTIAL = ".urbantwin-partial"


@dataclass(frozen=True)
class OutputPlace:
    """A dataset that is being made.

    Attributes:
        folder: of this machine: tables, manifest and all else but the frames go there.
        storage: where all of it goes in the end, if that is not the folder itself.
        marks: where the marks of frames go on storage.
    """

    folder: Path
    storage: Storage | None = None
    marks: Storage | None = None

    @property
    def is_whole(self) -> bool:
        """Whether an interrupted run came as far as the inventory, which is written last."""
        if self.storage is not None:
            return INVENTORY in self.storage.names()
        return (self.folder / INVENTORY).is_file()

    @property
    def is_elsewhere(self) -> bool:
        """Whether files of frames are not in the folder."""
        return self.storage is not None

    def frames(self, part: str) -> FramePlace:
        """Return where the frames of a part go; the name of a dataset of one part is empty."""
        if self.storage is None or self.marks is None:
            return FolderPlace(self.folder / part)
        return StoredPlace(self.storage / part, self.marks / (part or MARKS))

    def fetch_frame(self, part: str, entries: Iterable[Mapping[str, Any]]) -> None:
        """Bring the frame with the most labelled actors here, of which pictures are drawn."""
        if self.storage is None:
            return
        busiest = max(entries, key=lambda one: (one["boxes"]["num_points"] > 0).sum())
        for name in busiest["sha256"]:
            path = self.folder / part / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes((self.storage / part).read(name))

    def remove_marks(self, parts: Iterable[str]) -> None:
        """Remove the marks of frames from a folder that is whole."""
        for part in parts:
            shutil.rmtree(self.folder / part / MARKS, ignore_errors=True)


def check_output(out: Path | Storage, *, kind: str, inputs: Sequence[Path | None] = ()) -> None:
    """Refuse a place that cannot be written, before any work.

    Raises:
        InputError: see `artefact.check_folder`; or storage that is refused, or holds something.
        StageError: the storage fails.
    """
    if isinstance(out, Path):
        check_folder(out, kind=kind, inputs=inputs)
    else:
        _check_storage(out, kind, None)


@contextmanager
def opened_output(
    out: Path | Storage, *, kind: str, inputs: Sequence[Path | None], key: str
) -> Iterator[OutputPlace]:
    """Yield a place for a dataset; what an interrupted run with the same key left is in it.

    A folder appears when it is whole. On storage files have their places from the beginning, and
    the dataset is whole when its inventory is there, which comes last.

    Args:
        out: the folder, or the storage, which must be empty.
        kind: the artefact's kind.
        inputs: what it is made from.
        key: 16 hexadecimal digits that say what is made.

    Raises:
        InputError: see `check_output`.
        StageError: the disk is full, or the storage fails.
    """
    if isinstance(out, Path):
        with replaced_folder(out, kind=kind, inputs=inputs, key=key) as folder:
            yield OutputPlace(folder)
        return
    _check_storage(out, kind, key)
    partial = out / _PARTIAL
    with passing_folder("urbantwin-storage") as folder:
        yield OutputPlace(folder, out, partial / key)
        files = (one for one in folder.rglob("*") if one.is_file())
        own = [one for one in files if one.parent.name not in FOLDERS]
        for path in sorted(own, key=lambda one: (one.name == INVENTORY, one)):
            out.write(path.relative_to(folder).as_posix(), path.read_bytes())
        partial.remove()


def _check_storage(out: Storage, kind: str, key: str | None) -> None:
    """Refuse storage that holds something else than what the run with a key left.

    Raises:
        InputError: it does, or it is refused.
        StageError: the storage fails.
    """
    names = out.names()
    left = {name.split("/")[1] for name in names if name.startswith(f"{_PARTIAL}/")}
    expected = "an empty place: what is on storage is never replaced"
    if INVENTORY in names and not left:  # else only marks are left to be removed
        raise InputError(f"holds a {kind} already", file=str(out), expected=expected)
    if left and key is not None and left != {key}:
        raise InputError(
            "holds what a run with other options left", file=str(out), expected=expected
        )
    if names and not left:
        raise InputError(f"holds other files ({names[0]})", file=str(out), expected=expected)
