"""Several datasets as one: the frames of one after those of the other."""

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

#: So many folders down a dataset is looked for.
_DEEP = 3


class Datasets(Frames):
    """Several datasets as one: an index over their frames; `urbantwin.Datasets` adds a summary.

    Args:
        paths: folders of datasets.

    Raises:
        InputError: one is none, or there are none.
    """

    #: What a folder is opened as.
    dataset_type: ClassVar[type[Dataset]] = Dataset

    def __init__(self, paths: Iterable[str | os.PathLike[str]]) -> None:
        found: list[Dataset] = []
        for path in paths:
            one = path if isinstance(path, Dataset) else self.dataset_type(path)
            found += one.parts.values() or [one]
        if not found:
            raise InputError("there are no datasets", expected="folders of datasets")
        self._datasets = tuple(found)
        places = [Path(os.path.realpath(one.folder)) for one in found]
        if len(set(places)) < len(places):
            raise InputError("a dataset is given twice", expected="each dataset once")
        self._names = short_names(places)
        self._divided: SplitDocument | None = None

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Self:
        """Open all datasets in a folder, in the order of their names, or of a split by scenario.

        Raises:
            InputError: there are none, or one is damaged.
        """
        if says_split(Path(folder)):
            document = read_split_document(Path(folder))
            divided = cls(path for path, _, _ in document.rows)
            divided._divided = document
            return divided
        found = datasets_inside(Path(folder))
        if not found:
            raise InputError(
                "holds no dataset", file=Path(folder), expected="a folder with datasets in it"
            )
        return cls(found)

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets."""
        return self._datasets

    @cached_property
    def _located(self) -> list[Located]:
        return [
            (one, name, number)
            for one, name in zip(self.datasets, self._names, strict=True)
            for number in range(len(one.names))
        ]

    def _part(self, dataset: Dataset, split: str) -> Collection[str]:
        if self._divided is None:
            return super()._part(dataset, split)
        if dataset.folder not in (chosen := self._divided.datasets(split)):
            return ()
        kept = chosen[dataset.folder]
        return dataset.names if kept is None else kept

    def __repr__(self) -> str:
        """Return how many there are, and their names."""
        return f"{len(self.datasets)} datasets of {len(self)} frames: {', '.join(self._names)}"


def datasets_inside(folder: Path) -> list[Path]:
    """Return the folders of datasets in a folder, not far below it, by name."""
    found: list[Path] = []
    below = [folder]
    for _ in range(_DEEP):
        inside: list[Path] = []
        for place in below:
            try:
                inside += sorted(one for one in place.iterdir() if one.is_dir())
            except OSError:
                continue
        inside = [one for one in inside if not one.name.startswith(".")]
        own = [one for one in inside if kind_of(one) == "dataset"]
        found += own
        below = [one for one in inside if one not in own]
    return sorted(found)


def short_names(places: list[Path]) -> list[str]:
    """Return the ends of paths, as long as they must be to differ."""
    longest = max(len(place.parts) for place in places)
    for parts in range(1, longest + 1):
        names = ["/".join(place.parts[-parts:]) for place in places]
        if len(set(names)) == len(names):
            return names
    return [str(place) for place in places]
