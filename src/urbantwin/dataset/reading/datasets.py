"""Several datasets as one sequence of frames."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

from urbantwin.artefact import kind_of
from urbantwin.dataset.reading.dataset import Dataset
from urbantwin.dataset.reading.selection import Frames, Located
from urbantwin.dataset.split import SplitDocument, read_split_document, says_split
from urbantwin.errors import InputError

__all__ = ["Datasets", "datasets_inside", "short_names"]

#: Depth of the search for datasets, in folders.
_DEEP = 3


class Datasets(Frames):
    """Several datasets as one: an index over their frames; `urbantwin.Datasets` adds a summary.

    Args:
        paths: folders of datasets.

    Raises:
        InputError: a folder is not a dataset, or there are none.
    """

    #: Class of the opened datasets.
    dataset_type: ClassVar[type[Dataset]] = Dataset

    def __init__(self, paths: Iterable[str | os.PathLike[str]]) -> None:
        datasets: list[Dataset] = []
        for path in paths:
            dataset = path if isinstance(path, Dataset) else self.dataset_type(path)
            datasets += dataset.parts.values() or [dataset]
        if not datasets:
            raise InputError("there are no datasets", expected="folders of datasets")
        self._datasets = tuple(datasets)
        places = [Path(os.path.realpath(dataset.folder)) for dataset in datasets]
        if len(set(places)) < len(places):
            raise InputError("a dataset is given twice", expected="each dataset once")
        self._names = short_names(places)
        self._divided: SplitDocument | None = None

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Self:
        """Open all datasets in a folder, by name, or those of a split by scenario.

        Raises:
            InputError: none there, or one is damaged.
        """
        if says_split(Path(folder)):
            document = read_split_document(Path(folder))
            divided = cls(path for path, _, _ in document.rows)
            divided._divided = document
            return divided
        folders = datasets_inside(Path(folder))
        if not folders:
            raise InputError(
                "holds no dataset", file=Path(folder), expected="a folder with datasets in it"
            )
        return cls(folders)

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets."""
        return self._datasets

    @cached_property
    def _located(self) -> list[Located]:
        return [
            (dataset, name, number)
            for dataset, name in zip(self.datasets, self._names, strict=True)
            for number in range(len(dataset.names))
        ]

    def _part(self, dataset: Dataset, split: str) -> Collection[str]:
        if self._divided is None:
            return super()._part(dataset, split)
        if dataset.folder not in (chosen := self._divided.datasets(split)):
            return ()
        frames = chosen[dataset.folder]
        return dataset.names if frames is None else frames

    def __repr__(self) -> str:
        """Return the number of datasets and frames, and the names."""
        return f"{len(self.datasets)} datasets of {len(self)} frames: {', '.join(self._names)}"


def datasets_inside(folder: Path) -> list[Path]:
    """Return the folders of datasets in a folder, at most a few levels deep, by name."""
    datasets: list[Path] = []
    below = [folder]
    for _ in range(_DEEP):
        inside: list[Path] = []
        for place in below:
            try:
                inside += sorted(entry for entry in place.iterdir() if entry.is_dir())
            except OSError:
                continue
        inside = [entry for entry in inside if not entry.name.startswith(".")]
        own = [entry for entry in inside if kind_of(entry) == "dataset"]
        datasets += own
        below = [entry for entry in inside if entry not in own]
    return sorted(datasets)


def short_names(places: list[Path]) -> list[str]:
    """Return the shortest ends of paths that differ."""
    longest = max(len(place.parts) for place in places)
    for parts in range(1, longest + 1):
        names = ["/".join(place.parts[-parts:]) for place in places]
        if len(set(names)) == len(names):
            return names
    return [str(place) for place in places]
