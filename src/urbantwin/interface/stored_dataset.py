"""Datasets on remote storage: summary and download."""

from __future__ import annotations

import hashlib
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from urbantwin.artefact import INVENTORY, passing_folder, replaced_folder, sha256_of
from urbantwin.artefact.inventory import read_inventory
from urbantwin.artefact.storage import Storage
from urbantwin.errors import InputError
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.result_warning import ResultWarning

__all__ = ["StoredDataset"]

#: Number of files requested together.
_TOGETHER = 64


class StoredDataset(Artefact):
    """A dataset on storage, ``s3://bucket/name``; `fetch` downloads it to a folder.

    Attributes:
        url: its URL.

    Raises:
        InputError: there is no complete dataset, or the storage denies access.

    Example:
        >>> dataset = ut.open("s3://bucket/dataset").fetch("dataset")
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._storage = Storage.of(url)
        self._manifests  # noqa: B018 - fails at once where there is none

    @classmethod
    def open(cls, url: str) -> StoredDataset:
        """Open a dataset on storage.

        Raises:
            InputError: there is no complete dataset, or the storage denies access.
        """
        return cls(url)

    @cached_property
    def _inventory(self) -> bytes:
        try:
            return self._storage.read(INVENTORY)
        except InputError as error:
            raise InputError(
                error.problem, file=error.file, expected="a whole dataset of `urbantwin record`"
            ) from None

    @cached_property
    def _sums(self) -> dict[str, str]:
        """SHA-256 of every file, by name."""
        with passing_folder("urbantwin-storage") as folder:
            (folder / INVENTORY).write_bytes(self._inventory)
            sums = read_inventory(folder)
        for name in sums:
            path = PurePosixPath(name)
            if path.is_absolute() or ".." in path.parts:
                raise InputError(f"names {name!r:.60}", file=f"{self._storage}/{INVENTORY}")
        return sums

    @cached_property
    def _manifests(self) -> dict[str, bytes]:
        names = [name for name in self._sums if PurePosixPath(name).name == "dataset.json"]
        if "dataset.json" not in names:
            raise InputError("holds no dataset", file=str(self._storage))
        return {name: self._storage.read(name) for name in names}

    def _here(self, folder: Path) -> Dataset:
        """Return a dataset that consists of the manifests only."""
        for name, content in self._manifests.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return Dataset(folder)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Content of ``dataset.json``."""
        with passing_folder("urbantwin-storage") as folder:
            return self._here(folder).manifest

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings of the dataset and of each sensor's dataset."""
        with passing_folder("urbantwin-storage") as folder:
            return self._here(folder).warnings

    def fetch(self, out: AnyPath, *, progress: ShowProgress = True) -> Dataset:
        """Download the dataset to a folder; after an interruption, the same call continues.

        Args:
            out: folder to write; an older dataset in it is replaced.
            progress: show progress.

        Returns:
            The downloaded dataset.

        Raises:
            InputError: ``out`` holds other files, or a file is missing or damaged.
            StageError: the disk is full, or the storage fails.
        """
        place = Path(out)
        key = hashlib.sha256(self._inventory).hexdigest()[:16]
        with (
            shown_stage("fetch", progress) as tell,
            replaced_folder(place, kind="dataset", key=key) as folder,
        ):
            left = [
                name
                for name, digest in self._sums.items()
                if not ((folder / name).is_file() and sha256_of(folder / name) == digest)
            ]
            for begin in range(0, len(left), _TOGETHER):
                names = left[begin : begin + _TOGETHER]
                tell(begin / len(left), f"{begin} of {len(left)} files")
                found = self._storage.read_all(names)
                for name in names:
                    self._keep(folder, name, found.get(name))
            (folder / INVENTORY).write_bytes(self._inventory)
        return Dataset(place)

    def _keep(self, folder: Path, name: str, content: bytes | None) -> None:
        """Check a downloaded file against the inventory, and write it."""
        if content is None:
            content = self._storage.read(name)  # raises the error of the failed download
        if hashlib.sha256(content).hexdigest() != self._sums[name]:
            raise InputError("is damaged", file=f"{self._storage}/{name}", expected=INVENTORY)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)

    def __repr__(self) -> str:
        """Return the number of files, and the URL."""
        return f"StoredDataset of {len(self._sums)} files ({self._storage})"

    def summary(self) -> Summary:
        """Return the dataset's summary."""
        with passing_folder("urbantwin-storage") as folder:
            return Summary(**{**self._here(folder).summary(), "path": str(self._storage)})
