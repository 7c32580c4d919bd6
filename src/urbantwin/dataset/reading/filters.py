"""Which boxes of a dataset, and which of its frames, somebody asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.lidar.labels import LEVELS

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.dataset.reading.dataset import Dataset

__all__ = ["BoxFilter", "FrameFilter"]

#: Labels have 16 bits for a track (`lidar.annotated.LAST_TRACK`, which loads scipy).
_LAST_TRACK = 0xFFFF


@dataclass(frozen=True)
class BoxFilter:
    """What boxes must meet; see `Frames.where`."""

    classes: tuple[str, ...] = ()
    within_m: float | None = None
    beyond_m: float | None = None
    min_points: int | None = None
    max_occlusion: float | None = None
    max_truncation: float | None = None
    difficulty: tuple[str, ...] = ()
    counted: bool = False
    tracks: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        """Refuse what no box can meet.

        Raises:
            InputError: a number is negative or none, or there is no such level.
        """
        for name in ("within_m", "beyond_m", "min_points", "max_occlusion", "max_truncation"):
            value = getattr(self, name)
            if value is not None and not (_is_number(value) and value >= 0):
                raise InputError(f"is {value!r}", place=name, expected="a number, 0 or more")
        for track in self.tracks or ():
            if not isinstance(track, int | np.integer) or not 0 < track <= _LAST_TRACK:
                raise InputError(
                    f"{track!r} is no track", place="tracks", expected=f"1 to {_LAST_TRACK}"
                )
        levels = [one.name for one in LEVELS]
        for name in self.difficulty:
            if name not in levels:
                raise InputError(
                    f"{name!r} is no level", place="difficulty", expected=", ".join(levels)
                )

    @property
    def is_open(self) -> bool:
        """Whether it takes every box."""
        return self == BoxFilter()

    def check(self, known: Collection[str]) -> None:
        """Refuse a class that no dataset has.

        Raises:
            InputError: it names those that there are.
        """
        for name in self.classes:
            if name not in known:
                raise InputError(
                    f"{name!r} is no class of its boxes",
                    place="classes",
                    expected=", ".join(sorted(known)),
                )

    def kept(self, dataset: Dataset) -> NDArray[np.bool_]:
        """Return which rows (B,) of ``boxes.parquet`` are taken.

        A box whose occlusion nobody knows, as it has no point even alone, meets no bound of it.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        table = dataset.boxes
        found = np.ones(table.num_rows, np.bool_)
        if self.classes:
            found &= _plain(pc.is_in(table["class"], pa.array(self.classes)))
        if self.difficulty:
            found &= _plain(pc.is_in(_column(dataset, "difficulty"), pa.array(self.difficulty)))
        if self.counted:
            found &= _plain(pc.is_null(_column(dataset, "ignored")))
        if self.tracks is not None:
            found &= np.isin(table["track"].to_numpy(), np.array(self.tracks, np.int64))
        if self.min_points is not None:
            found &= table["num_points"].to_numpy() >= self.min_points
        for name, most in (("occlusion", self.max_occlusion), ("truncation", self.max_truncation)):
            if most is not None:
                found &= _plain(
                    pc.fill_null(pc.less_equal(_column(dataset, name), float(most)), False)
                )
        if self.within_m is not None:
            found &= dataset.box_range_m <= self.within_m
        if self.beyond_m is not None:
            found &= dataset.box_range_m >= self.beyond_m
        return found


@dataclass(frozen=True)
class FrameFilter:
    """What frames must meet; see `Frames.where`."""

    split: str | None = None
    sequences: tuple[str, ...] | None = None
    frames: tuple[str, ...] | None = None
    start: float | None = None
    stop: float | None = None
    every: int = 1

    def __post_init__(self) -> None:
        """Refuse what is no span and no step.

        Raises:
            InputError: a time is none, or ``every`` is below 1.
        """
        for name in ("start", "stop"):
            value = getattr(self, name)
            if value is not None and not _is_number(value):
                raise InputError(f"is {value!r}", place=name, expected="a time, seconds")
        if isinstance(self.every, bool) or not isinstance(self.every, int) or self.every < 1:
            raise InputError(f"is {self.every!r}", place="every", expected="1 or more")

    def kept(
        self,
        frames: Iterable[tuple[Dataset, str, int]],
        sequences: Collection[str],
        part: Callable[[Dataset, str], Collection[str]],
    ) -> list[int]:
        """Return which of some frames are taken, by their number among them.

        Args:
            frames: of each its dataset, the name of its sequence, and its number in the dataset.
            sequences: names that there are.
            part: from a dataset and the name of a split to the names of its frames.

        Raises:
            InputError: there is no such sequence, split or frame.
        """
        for name in self.sequences or ():
            if name not in sequences:
                raise InputError(
                    f"there is no sequence {name!r}",
                    place="sequences",
                    expected=", ".join(sorted(sequences)),
                )
        found, seen = [], set()
        splits: dict[int, frozenset[str]] = {}
        for number, (dataset, sequence, own) in enumerate(frames):
            name, time_s = dataset.names[own], float(dataset.times_s[own])
            if self.sequences is not None and sequence not in self.sequences:
                continue
            if self.start is not None and time_s < self.start - 1e-6:
                continue
            if self.stop is not None and time_s > self.stop + 1e-6:
                continue
            if self.split is not None:
                if id(dataset) not in splits:
                    splits[id(dataset)] = frozenset(part(dataset, self.split))
                if name not in splits[id(dataset)]:
                    continue
            seen.add(name)
            if self.frames is None or name in self.frames:
                found.append(number)
        for name in self.frames or ():
            if name not in seen:
                raise InputError(
                    f"there is no frame {name!r}", place="frames", expected="names of frames"
                )
        return found[:: self.every]


def _column(dataset: Dataset, name: str) -> pa.ChunkedArray:
    if name not in dataset.boxes.column_names:
        raise InputError(
            f"does not say the {name} of boxes",
            file=dataset.folder / "boxes.parquet",
            expected="boxes as they are recorded now; this dataset is of an older version",
        )
    return dataset.boxes[name]


def _is_number(value: Any) -> bool:  # noqa: ANN401
    return (
        isinstance(value, int | float | np.integer | np.floating)
        and not isinstance(value, bool)
        and math.isfinite(value)
    )


def _plain(mask: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    return np.asarray(mask.to_numpy(zero_copy_only=False), np.bool_)
