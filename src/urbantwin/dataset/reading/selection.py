"""Sequences of frames with filters: a dataset, several of them, and selections."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.columns import POINT
from urbantwin.dataset.reading.filters import BoxFilter, FrameFilter
from urbantwin.dataset.reading.frame import Frame
from urbantwin.errors import InputError
from urbantwin.extras import check_extra

if TYPE_CHECKING:
    from urbantwin.dataset.reading.dataset import Dataset
    from urbantwin.dataset.reading.torch_frames import FrameDataset, Transform

__all__ = ["Frames", "Located", "Selection"]

#: A frame: dataset, name of the sequence, and index in the dataset.
Located = tuple["Dataset", str, int]


class Frames(Sequence[Frame]):
    """Frames in order of time, of one dataset or of several in sequence.

    Frames are read at first use. Instances can be pickled, without what was read.
    """

    @property
    @abstractmethod
    def datasets(self) -> tuple[Dataset, ...]:
        """Datasets of the frames."""

    @property
    @abstractmethod
    def _located(self) -> Sequence[Located]:
        """The frames."""

    def _kept(self, dataset: Dataset) -> NDArray[np.bool_] | None:
        """Return the selected boxes (B,) of a dataset; ``None``: all."""
        del dataset
        return None

    def _part(self, dataset: Dataset, split: str) -> Collection[str]:
        """Return the names of a dataset's frames in a split."""
        return dataset.split(split)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(dataset.names[number] for dataset, _, number in self._located)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (F,) of the frames, seconds from the start of the motion."""
        return np.array(
            [dataset.times_s[number] for dataset, _, number in self._located], np.float64
        )

    @property
    def sequences(self) -> tuple[str, ...]:
        """Name of each frame's sequence: the folder of its dataset."""
        return tuple(name for _, name, _ in self._located)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._located)

    @overload
    def __getitem__(self, index: int | str) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | str | slice) -> Frame | list[Frame]:
        """Return a frame by index, from 0, or by name; for a slice, a list of frames.

        Raises:
            IndexError: index out of range.
            InputError: no such name, or several frames have it.
        """
        located = self._located  # raises an error for one dataset per sensor
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        if isinstance(index, str):
            index = self._number_of(index)
        if not -len(located) <= index < len(located):
            raise IndexError(f"frame {index} of {len(located)}")
        dataset, _, number = located[index]
        return Frame(
            dataset,
            dataset.names[number],
            float(dataset.times_s[number]),
            partial(self._kept, dataset),
        )

    def __iter__(self) -> Iterator[Frame]:
        """Return the frames in sequence, without caching."""
        return (self[number] for number in range(len(self)))

    def _number_of(self, name: str) -> int:
        matches = [
            k
            for k, (dataset, _, number) in enumerate(self._located)
            if dataset.names[number] == name
        ]
        if len(matches) != 1:
            raise InputError(
                f"has {len(matches) or 'no'} frame{'s' * (len(matches) > 1)} {name}",
                file=self.datasets[0].folder if len(self.datasets) == 1 else None,
                expected="the name of one frame, or its number",
            )
        return matches[0]

    def where(  # noqa: PLR0913 - one parameter per filter
        self,
        *,
        classes: str | Iterable[str] = (),
        within_m: float | None = None,
        beyond_m: float | None = None,
        min_points: int | None = None,
        max_occlusion: float | None = None,
        max_truncation: float | None = None,
        difficulty: str | Iterable[str] = (),
        counted: bool = False,
        tracks: int | Iterable[int] | None = None,
        split: str | None = None,
        sequences: str | Iterable[str] | None = None,
        frames: str | Iterable[str] | None = None,
        start: float | None = None,
        stop: float | None = None,
        every: int = 1,
        with_boxes: bool = False,
    ) -> Selection:
        """Select boxes or frames.

        Boxes are filtered by class, range, points, occlusion, truncation, difficulty or track;
        frames without a remaining box stay, unless ``with_boxes`` is given. Points are never
        removed; `Frame.on_boxes` gives those on remaining boxes. Frames are filtered by split,
        sequence, name and time. A selection can be filtered again: both conditions then hold.

        Args:
            classes: classes of boxes.
            within_m: largest horizontal distance of a box's centre to the nearest sensor, metres.
            beyond_m: smallest such distance, metres.
            min_points: smallest number of points.
            max_occlusion: largest occlusion, 0..1.
            max_truncation: largest truncation, 0..1.
            difficulty: difficulty levels.
            counted: leave out ignored boxes (``ignored`` gives the reason).
            tracks: track ids.
            split: frames of ``ImageSets/NAME.txt``: ``train``, ``val``, ``test``; for a split by
                scenario, those of its datasets in that part.
            sequences: frames of these datasets, by folder name.
            frames: frames by name.
            start: earliest time of a frame in the motion, seconds.
            stop: latest time of a frame, seconds.
            every: keep every N-th of the remaining frames.
            with_boxes: keep only frames with a remaining box.

        Raises:
            InputError: no such class, level, split, sequence or frame.

        Example:
            >>> near = dataset.where(classes=["car"], within_m=40, min_points=5, split="train")
            >>> near[0].boxes.num_rows
        """
        boxes = BoxFilter(
            classes=_several(classes),
            within_m=within_m,
            beyond_m=beyond_m,
            min_points=min_points,
            max_occlusion=max_occlusion,
            max_truncation=max_truncation,
            difficulty=_several(difficulty),
            counted=counted,
            tracks=None if tracks is None else _several(tracks),
        )
        boxes.check({name for dataset in self.datasets for name in dataset.box_classes})
        chosen = FrameFilter(
            split=split,
            sequences=None if sequences is None else _several(sequences),
            frames=None if frames is None else _several(frames),
            start=start,
            stop=stop,
            every=every,
        )
        return Selection(self, boxes, chosen, with_boxes=with_boxes)

    def windows(self, length: int, step: int = 1) -> list[range]:
        """Return runs of consecutive frames without a gap, as ranges of indices.

        Input of sequence models: ``[frames[k] for k in frames.windows(5)[0]]``.

        Args:
            length: frames per run.
            step: frames between the starts of two runs.

        Raises:
            InputError: a value is below 1.
        """
        for name, value in (("length", length), ("step", step)):
            if value < 1:
                raise InputError(f"is {value}", place=name, expected="1 or more")
        times, owners = self.times_s, [id(dataset) for dataset, _, _ in self._located]
        gaps = np.diff(times)
        same = np.array([a == b for a, b in pairwise(owners)], np.bool_)
        usual = gaps[same & (gaps > 0)].min(initial=np.inf)
        follows = same & (gaps > 0) & (gaps < 1.5 * usual)
        ends = [0, *(np.flatnonzero(~follows) + 1).tolist(), len(times)]
        return [
            range(first, first + length)
            for begin, end in pairwise(ends)
            for first in range(begin, end - length + 1, step)
        ]

    def torch(
        self,
        fields: Sequence[str] = POINT,
        *,
        labels: bool = True,
        flow: bool = False,
        transform: Transform | None = None,
        seed: int = 0,
    ) -> FrameDataset:
        """Return the frames as a PyTorch ``Dataset`` of tensors.

        Needs PyTorch: ``pip install 'urbantwin[detector]'``.

        Args:
            fields: columns of ``points``, by name; any of `Frame.cloud`.
            labels: include ``semantic`` and ``instance``.
            flow: include the flow to the next frame; see `Frame.flow`.
            transform: called with a sample and its own numpy random generator, returns the sample
                to use.
            seed: seed of the generators.

        Raises:
            InputError: PyTorch is missing, or no such field.

        Example:
            >>> samples = dataset.where(split="train", classes=["car"]).torch()
            >>> loader = samples.loader(batch_size=4, workers=2, shuffle=True)
        """
        check_extra("detector", "a dataset of PyTorch", modules=("torch",))
        from urbantwin.dataset.reading.torch_frames import FrameDataset

        return FrameDataset(
            self,
            classes=tuple(
                sorted({name for dataset in self.datasets for name in dataset.box_classes})
            ),
            fields=fields,
            labels=labels,
            flow=flow,
            transform=transform,
            seed=seed,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Leave out cached data: every process reads its own."""
        cls = type(self)
        return {
            name: value
            for name, value in self.__dict__.items()
            if not isinstance(getattr(cls, name, None), cached_property)
        }


class Selection(Frames):
    """A selection of frames and boxes; see `Frames.where`.

    Attributes:
        source: the frames that were filtered.
        boxes: filter of boxes.
        chosen: filter of frames.
        with_boxes: keep only frames with a remaining box.
    """

    def __init__(
        self, source: Frames, boxes: BoxFilter, chosen: FrameFilter, *, with_boxes: bool = False
    ) -> None:
        self.source, self.boxes, self.chosen = source, boxes, chosen
        self.with_boxes = with_boxes
        # Raise errors of the filter now.
        _ = source._located if chosen == FrameFilter() else self._located

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets that its frames are of."""
        return self.source.datasets

    @cached_property
    def _located(self) -> list[Located]:
        source = self.source._located
        accepted = self.chosen.kept(source, {name for _, name, _ in source}, self._part)
        located = [source[number] for number in accepted]
        if self.with_boxes:
            located = [entry for entry in located if self._has_boxes(entry[0], entry[2])]
        return located

    @cached_property
    def _masks(self) -> dict[Path, NDArray[np.bool_] | None]:
        return {}

    def _kept(self, dataset: Dataset) -> NDArray[np.bool_] | None:
        if dataset.folder not in self._masks:
            mask = self.source._kept(dataset)
            if not self.boxes.is_open:
                own = self.boxes.kept(dataset)
                mask = own if mask is None else mask & own
            self._masks[dataset.folder] = mask
        return self._masks[dataset.folder]

    def _part(self, dataset: Dataset, split: str) -> Collection[str]:
        return self.source._part(dataset, split)

    def _has_boxes(self, dataset: Dataset, number: int) -> bool:
        rows, mask = dataset.box_rows(dataset.names[number]), self._kept(dataset)
        return bool(len(rows)) if mask is None else bool(mask[rows].any())

    def __repr__(self) -> str:
        """Return the number of selected frames."""
        return f"{len(self)} of {len(self.source)} frames of {self.source!r}"


def _several(given: Any) -> tuple[Any, ...]:  # noqa: ANN401
    """Return a value or values as a tuple."""
    if isinstance(given, str | int | np.integer):
        return (given,)
    return tuple(given)
