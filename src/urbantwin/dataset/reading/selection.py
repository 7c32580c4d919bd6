"""Frames in a row that can be filtered: a dataset, several of them, and what was selected."""

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

#: A frame: its dataset, the name of its sequence, and its number in the dataset.
Located = tuple["Dataset", str, int]


class Frames(Sequence[Frame]):
    """Frames in the order of time, of one dataset or of several, one after the other.

    Nothing of a frame is read before it is asked for. It can be pickled: what was read is not
    part of that.
    """

    @property
    @abstractmethod
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets that its frames are of."""

    @property
    @abstractmethod
    def _located(self) -> Sequence[Located]:
        """Its frames."""

    def _kept(self, dataset: Dataset) -> NDArray[np.bool_] | None:
        """Return which boxes (B,) of a dataset it shows; ``None``: all."""
        del dataset
        return None

    def _part(self, dataset: Dataset, split: str) -> Collection[str]:
        """Return the names of a dataset's frames that are of a split."""
        return dataset.split(split)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(dataset.names[number] for dataset, _, number in self._located)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (F,) of the frames, seconds from the start of the motion."""
        return np.array([one.times_s[number] for one, _, number in self._located], np.float64)

    @property
    def sequences(self) -> tuple[str, ...]:
        """Name of each frame's sequence: that of the folder of its dataset."""
        return tuple(name for _, name, _ in self._located)

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self._located)

    @overload
    def __getitem__(self, index: int | str) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | str | slice) -> Frame | list[Frame]:
        """Return the frame of a number, from 0, or of a name; of a slice, a list of frames.

        Raises:
            IndexError: there is no such number.
            InputError: there is no such name, or several frames have it.
        """
        located = self._located  # refuses a dataset for each sensor
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
        """Return the frames one after the other; nothing of one is kept for the next."""
        return (self[number] for number in range(len(self)))

    def _number_of(self, name: str) -> int:
        found = [k for k, (one, _, number) in enumerate(self._located) if one.names[number] == name]
        if len(found) != 1:
            raise InputError(
                f"has {len(found) or 'no'} frame{'s' * (len(found) > 1)} {name}",
                file=self.datasets[0].folder if len(self.datasets) == 1 else None,
                expected="the name of one frame, or its number",
            )
        return found[0]

    def where(  # noqa: PLR0913 - a filter each
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
        """Return the same frames with some of their boxes, or some of the frames.

        Boxes are filtered by what is said of them: classes, range, points, occlusion, truncation,
        difficulty, tracks. All frames stay then, those too that have no box left, unless
        ``with_boxes`` is given. Points are never taken away; `Frame.on_boxes` tells those on boxes
        that are left. Frames are filtered by split, sequence, name and time. What is selected can
        be filtered again, and both must hold then.

        Args:
            classes: of boxes.
            within_m: no box whose middle is farther from the nearest sensor, in plan, metres.
            beyond_m: none that is nearer.
            min_points: so many points or more.
            max_occlusion: so much hidden or less, 0..1.
            max_truncation: so much outside of what the rig sees or less, 0..1.
            difficulty: one of these levels.
            counted: none that is to be ignored (``ignored`` says why).
            tracks: of these tracks.
            split: frames of ``ImageSets/NAME.txt``: ``train``, ``val``, ``test``; of a split by
                scenario, those of its datasets of that part.
            sequences: frames of these datasets, by the names of their folders.
            frames: frames of these names.
            start: no frame before this time of the motion, seconds.
            stop: no frame after it.
            every: only each N-th of the frames that are left.
            with_boxes: only frames with a box that is left.

        Raises:
            InputError: there is no such class, level, split, sequence or frame.

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
        boxes.check({name for one in self.datasets for name in one.box_classes})
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
        """Return runs of frames that follow each other without a gap, by their numbers.

        What sequence models learn from: ``[frames[k] for k in frames.windows(5)[0]]``.

        Args:
            length: frames of each.
            step: frames from one's beginning to the next one's.

        Raises:
            InputError: one of them is below 1.
        """
        for name, value in (("length", length), ("step", step)):
            if value < 1:
                raise InputError(f"is {value}", place=name, expected="1 or more")
        times, owners = self.times_s, [id(one) for one, _, _ in self._located]
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
            labels: read ``semantic`` and ``instance``, too.
            flow: tell where each point goes until the next frame, too; see `Frame.flow`.
            transform: called with a sample and a random generator (of numpy) of its own, returns
                the sample that is taken.
            seed: of what transforms draw.

        Raises:
            InputError: PyTorch is missing, or there is no such field.

        Example:
            >>> samples = dataset.where(split="train", classes=["car"]).torch()
            >>> loader = samples.loader(batch_size=4, workers=2, shuffle=True)
        """
        check_extra("detector", "a dataset of PyTorch", modules=("torch",))
        from urbantwin.dataset.reading.torch_frames import FrameDataset

        return FrameDataset(
            self,
            classes=tuple(sorted({name for one in self.datasets for name in one.box_classes})),
            fields=fields,
            labels=labels,
            flow=flow,
            transform=transform,
            seed=seed,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what was read: every process reads its own."""
        kept = type(self)
        return {
            name: value
            for name, value in self.__dict__.items()
            if not isinstance(getattr(kept, name, None), cached_property)
        }


class Selection(Frames):
    """Some frames with some of their boxes; see `Frames.where`.

    Attributes:
        source: what was selected from.
        boxes: what boxes must meet.
        chosen: what frames must meet.
        with_boxes: only frames with a box that is left.
    """

    def __init__(
        self, source: Frames, boxes: BoxFilter, chosen: FrameFilter, *, with_boxes: bool = False
    ) -> None:
        self.source, self.boxes, self.chosen = source, boxes, chosen
        self.with_boxes = with_boxes
        # What does not exist is told now.
        _ = source._located if chosen == FrameFilter() else self._located

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The datasets that its frames are of."""
        return self.source.datasets

    @cached_property
    def _located(self) -> list[Located]:
        all_of_them = self.source._located
        kept = self.chosen.kept(all_of_them, {name for _, name, _ in all_of_them}, self._part)
        found = [all_of_them[number] for number in kept]
        if self.with_boxes:
            found = [one for one in found if self._has_boxes(one[0], one[2])]
        return found

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
        """Return how many frames are left of how many."""
        return f"{len(self)} of {len(self.source)} frames of {self.source!r}"


def _several(given: Any) -> tuple[Any, ...]:  # noqa: ANN401
    """Return what was given as a tuple: one value stands for itself."""
    if isinstance(given, str | int | np.integer):
        return (given,)
    return tuple(given)
