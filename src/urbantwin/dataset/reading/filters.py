"""Filters of boxes and frames."""

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

#: Highest track id: labels store it in 16 bits (`lidar.annotated.LAST_TRACK`, which imports scipy).
_LAST_TRACK = 0xFFFF


@dataclass(frozen=True)
class BoxFilter:
    """Conditions on boxes; see `Frames.where`."""

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
        """Validate the conditions.

        Raises:
            InputError: a value is negative or not a number, or a difficulty is unknown.
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
        levels = [level.name for level in LEVELS]
        for name in self.difficulty:
            if name not in levels:
                raise InputError(
                    f"{name!r} is no level", place="difficulty", expected=", ".join(levels)
                )

    @property
    def is_open(self) -> bool:
        """Whether it accepts every box."""
        return self == BoxFilter()

    def check(self, known: Collection[str]) -> None:
        """Raise an error for a class that no dataset has.

        Raises:
            InputError: the error lists the classes.
        """
        for name in self.classes:
            if name not in known:
                raise InputError(
                    f"{name!r} is no class of its boxes",
                    place="classes",
                    expected=", ".join(sorted(known)),
                )

    def kept(self, dataset: Dataset) -> NDArray[np.bool_]:
        """Return which rows (B,) of ``boxes.parquet`` are accepted.

        A box of unknown occlusion, without points even unoccluded, meets no bound of it.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        table = dataset.boxes
        accepted = np.ones(table.num_rows, np.bool_)
        if self.classes:
            accepted &= _plain(pc.is_in(table["class"], pa.array(self.classes)))
        if self.difficulty:
            accepted &= _plain(pc.is_in(_column(dataset, "difficulty"), pa.array(self.difficulty)))
        if self.counted:
            accepted &= _plain(pc.is_null(_column(dataset, "ignored")))
        if self.tracks is not None:
            accepted &= np.isin(table["track"].to_numpy(), np.array(self.tracks, np.int64))
        if self.min_points is not None:
            accepted &= table["num_points"].to_numpy() >= self.min_points
        for name, most in (("occlusion", self.max_occlusion), ("truncation", self.max_truncation)):
            if most is not None:
                accepted &= _plain(
                    pc.fill_null(pc.less_equal(_column(dataset, name), float(most)), False)
                )
        if self.within_m is not None:
            accepted &= dataset.box_range_m <= self.within_m
        if self.beyond_m is not None:
            accepted &= dataset.box_range_m >= self.beyond_m
        return accepted


@dataclass(frozen=True)
class FrameFilter:
    """Conditions on frames; see `Frames.where`."""

    split: str | None = None
    sequences: tuple[str, ...] | None = None
    frames: tuple[str, ...] | None = None
    start: float | None = None
    stop: float | None = None
    every: int = 1

    def __post_init__(self) -> None:
        """Validate the conditions.

        Raises:
            InputError: a time is not a number, or ``every`` is below 1.
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
        """Return the indices of the accepted frames.

        Args:
            frames: dataset, name of the sequence, and index within the dataset of each frame.
            sequences: existing names of sequences.
            part: returns the names of a dataset's frames in a split.

        Raises:
            InputError: no such sequence, split or frame.
        """
        for name in self.sequences or ():
            if name not in sequences:
                raise InputError(
                    f"there is no sequence {name!r}",
                    place="sequences",
                    expected=", ".join(sorted(sequences)),
                )
        accepted, seen = [], set()
        splits: dict[int, frozenset[str]] = {}
        for number, (dataset, sequence, index) in enumerate(frames):
            name, time_s = dataset.names[index], float(dataset.times_s[index])
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
                accepted.append(number)
        for name in self.frames or ():
            if name not in seen:
                raise InputError(
                    f"there is no frame {name!r}", place="frames", expected="names of frames"
                )
        return accepted[:: self.every]


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
