"""Output of a recording: a folder that appears when complete, or storage with an address."""

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

#: Folder of marks of an incomplete recording on storage, by the recipe's key.
_PARTIAL = ".urbantwin-partial"


@dataclass(frozen=True)
class OutputPlace:
    """A dataset in the making.

    Attributes:
        folder: local folder of tables, manifest and everything but frames.
        storage: final destination, if not the folder itself.
        marks: place of the frames' marks on storage.
    """

    folder: Path
    storage: Storage | None = None
    marks: Storage | None = None

    @property
    def is_whole(self) -> bool:
        """Whether an interrupted run reached the inventory, which is written last."""
        if self.storage is not None:
            return INVENTORY in self.storage.names()
        return (self.folder / INVENTORY).is_file()

    @property
    def is_elsewhere(self) -> bool:
        """Whether files of frames are outside the folder."""
        return self.storage is not None

    def frames(self, part: str) -> FramePlace:
        """Return the place of a part's frames; the part's name is empty for a single dataset."""
        if self.storage is None or self.marks is None:
            return FolderPlace(self.folder / part)
        return StoredPlace(self.storage / part, self.marks / (part or MARKS))

    def fetch_frame(self, part: str, entries: Iterable[Mapping[str, Any]]) -> None:
        """Download the frame with the most labelled actors, for pictures."""
        if self.storage is None:
            return
        busiest = max(entries, key=lambda entry: (entry["boxes"]["num_points"] > 0).sum())
        for name in busiest["sha256"]:
            path = self.folder / part / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes((self.storage / part).read(name))

    def remove_marks(self, parts: Iterable[str]) -> None:
        """Remove the marks of frames from a complete folder."""
        for part in parts:
            shutil.rmtree(self.folder / part / MARKS, ignore_errors=True)


def check_output(out: Path | Storage, *, kind: str, inputs: Sequence[Path | None] = ()) -> None:
    """Check that a place can be written, before any work.

    Raises:
        InputError: see `artefact.check_folder`; or storage that is rejected, or not empty.
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
    """Yield a place for a dataset, with what an interrupted run with the same key left.

    A folder appears when it is complete. On storage files are in place from the beginning, and the
    dataset is complete when its inventory, which is written last, is there.

    Args:
        out: the folder, or the storage, which must be empty.
        kind: kind of the artefact.
        inputs: inputs of the dataset.
        key: 16 hexadecimal digits that identify the recipe.

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
        files = (file for file in folder.rglob("*") if file.is_file())
        others = [file for file in files if file.parent.name not in FOLDERS]
        for path in sorted(others, key=lambda file: (file.name == INVENTORY, file)):
            out.write(path.relative_to(folder).as_posix(), path.read_bytes())
        partial.remove()


def _check_storage(out: Storage, kind: str, key: str | None) -> None:
    """Check that storage holds nothing but what a run with the same key left.

    Raises:
        InputError: it holds something else, or is rejected.
        StageError: the storage fails.
    """
    names = out.names()
    left = {name.split("/")[1] for name in names if name.startswith(f"{_PARTIAL}/")}
    expected = "an empty place: what is on storage is never replaced"
    if INVENTORY in names and not left:  # otherwise only marks remain to be removed
        raise InputError(f"holds a {kind} already", file=str(out), expected=expected)
    if left and key is not None and left != {key}:
        raise InputError(
            "holds what a run with other options left", file=str(out), expected=expected
        )
    if names and not left:
        raise InputError(f"holds other files ({names[0]})", file=str(out), expected=expected)
