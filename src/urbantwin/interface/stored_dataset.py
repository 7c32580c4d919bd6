"""A dataset on storage with an address: what it holds, and bringing it here."""

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

#: So many files are asked for together.
_TOGETHER = 64


class StoredDataset(Artefact):
    """A dataset on storage, ``s3://bucket/name``; `fetch` brings it to a folder.

    Attributes:
        url: where it is.

    Raises:
        InputError: there is no whole dataset, or the storage refuses it.

    Example:
        >>> dataset = ut.open("s3://bucket/dataset").fetch("dataset")
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._storage = Storage.of(url)
        self._manifests  # noqa: B018 - that there is one is known before somebody asks

    @classmethod
    def open(cls, url: str) -> StoredDataset:
        """Open a dataset on storage.

        Raises:
            InputError: there is no whole dataset, or the storage refuses it.
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
        """The checksum of every file by its name."""
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
        """Return a dataset of the manifests alone."""
        for name, content in self._manifests.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return Dataset(folder)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """``dataset.json``."""
        with passing_folder("urbantwin-storage") as folder:
            return self._here(folder).manifest

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """What is wrong with it, and with the dataset of each sensor."""
        with passing_folder("urbantwin-storage") as folder:
            return self._here(folder).warnings

    def fetch(self, out: AnyPath, *, progress: ShowProgress = True) -> Dataset:
        """Bring all of it to a folder; after an interruption, the same call goes on from there.

        Args:
            out: the folder to write; an older dataset there is replaced.
            progress: show how far it is.

        Returns:
            The dataset there.

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
        """Write a file that was brought here, if it is what the inventory says."""
        if content is None:
            content = self._storage.read(name)  # which says why it did not come
        if hashlib.sha256(content).hexdigest() != self._sums[name]:
            raise InputError("is damaged", file=f"{self._storage}/{name}", expected=INVENTORY)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)

    def __repr__(self) -> str:
        """Return how many files it has, and where it is."""
        return f"StoredDataset of {len(self._sums)} files ({self._storage})"

    def summary(self) -> Summary:
        """Return what the dataset holds in a few values."""
        with passing_folder("urbantwin-storage") as folder:
            return Summary(**{**self._here(folder).summary(), "path": str(self._storage)})
