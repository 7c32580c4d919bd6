"""Frames of a dataset for PyTorch: tensors, batches of ragged frames, workers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from urbantwin.dataset.reading.columns import POINT, VELOCITY
from urbantwin.dataset.reading.frame_files import RAY_TYPE
from urbantwin.errors import InputError

if TYPE_CHECKING:
    from urbantwin.dataset.reading.frame import Frame

__all__ = ["FIELDS", "FrameDataset", "Sample", "Transform", "collated"]

#: All data of one frame, by name.
Sample = dict[str, Any]
#: Changes a sample; random numbers come from the given generator only.
Transform = Callable[[Sample, np.random.Generator], Sample]

#: Possible columns of ``points``.
FIELDS = (*POINT, *(RAY_TYPE.names or ()), "semantic", "instance")
#: Arrays with a row per point, and per box: concatenated in a batch.
_PER_POINT = ("points", "semantic", "instance", "flow")
_PER_BOX = ("boxes", "box_class", "box_track", "box_points", "box_occlusion", "box_velocity")


class FrameDataset(Dataset[Sample]):
    """A map-style dataset: ``samples[3]`` is a dict of tensors.

    - ``points`` (N, F) float32, the requested fields; with ``labels`` also ``semantic`` and
      ``instance`` (N,) int32, with ``flow`` also ``flow`` (N, 3), ``nan`` where unknown;
    - ``boxes`` (B, 7) float32, x, y, z, length, width, height, yaw; ``box_class`` (B,) int64,
      indices in `classes`; ``box_track``, ``box_points`` (B,) int64; ``box_occlusion`` (B,),
      ``nan`` where unknown; ``box_velocity`` (B, 3), metres per second;
    - ``frame`` (its name), ``number`` and ``time_s``.

    The same seed, epoch and index give the same sample, in any process.

    Args:
        frames: frames, which are not cached.
        classes: classes of boxes, in the order of their indices.
        fields: columns of ``points``, of `FIELDS`.
        labels: include ``semantic`` and ``instance``.
        flow: include ``flow``.
        transform: changes a sample.
        seed: seed of transforms and of the shuffled order.

    Raises:
        InputError: no such field.
    """

    def __init__(
        self,
        frames: Sequence[Frame],
        *,
        classes: Sequence[str],
        fields: Sequence[str] = POINT,
        labels: bool = True,
        flow: bool = False,
        transform: Transform | None = None,
        seed: int = 0,
    ) -> None:
        for name in fields:
            if name not in FIELDS:
                raise InputError(
                    f"points have no field {name!r}", place="fields", expected=", ".join(FIELDS)
                )
        self.frames, self.classes, self.fields = frames, tuple(classes), tuple(fields)
        self.labels, self.flow, self.transform, self.seed = labels, flow, transform, seed
        self._number = {name: number for number, name in enumerate(self.classes)}
        # Shared, so that persistent workers know the epoch.
        self._epoch: Tensor = torch.zeros((), dtype=torch.int64)
        self._epoch.share_memory_()

    @property
    def epoch(self) -> int:
        """Epoch of transforms and order."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch, from 0: transforms and order differ between epochs."""
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.frames)

    def __getitem__(self, number: int) -> Sample:
        """Return a sample."""
        number = int(number)
        frame = self.frames[number]
        boxes = frame.boxes
        names = boxes["class"].to_pylist()
        for name in names:
            if name not in self._number:
                raise InputError(
                    f"has a box of class {name[:40]}",
                    place=f"frame {frame.name}",
                    expected=", ".join(self.classes),
                )
        velocity = np.column_stack(
            [boxes[name_of_column].to_numpy() for name_of_column in VELOCITY]
        )
        occlusion = boxes["occlusion"].to_numpy(zero_copy_only=False)
        sample: Sample = {
            "points": _tensor(self._points(frame), np.float32),
            "boxes": _tensor(frame.box_array, np.float32),
            "box_class": torch.tensor(
                [self._number[name_of_column] for name_of_column in names], dtype=torch.int64
            ),
            "box_track": _tensor(boxes["track"].to_numpy(), np.int64),
            "box_points": _tensor(boxes["num_points"].to_numpy(), np.int64),
            "box_occlusion": _tensor(occlusion, np.float32),
            "box_velocity": _tensor(velocity, np.float32),
            "frame": frame.name,
            "number": number % len(self),
            "time_s": frame.time_s,
        }
        if self.labels:
            sample["semantic"] = _tensor(frame.semantic, np.int32)
            sample["instance"] = _tensor(frame.instance, np.int32)
        if self.flow:
            sample["flow"] = _tensor(frame.flow(), np.float32)
        if self.transform is not None:
            draw = np.random.default_rng([self.seed, self.epoch, number % len(self)])
            sample = self.transform(sample, draw)
        return sample

    def _points(self, frame: Frame) -> NDArray[np.float32]:
        if self.fields == POINT:
            return frame.points
        columns = [
            frame.points[:, POINT.index(name)] if name in POINT else getattr(frame, name)
            for name in self.fields
        ]
        return np.column_stack(columns).astype(np.float32).reshape(len(frame.points), -1)

    def loader(
        self,
        batch_size: int = 1,
        *,
        workers: int = 0,
        shuffle: bool = False,
        **more: Any,  # noqa: ANN401
    ) -> DataLoader[Sample]:
        """Return a loader of batches (see `collated`), the same for any number of workers.

        Args:
            batch_size: frames per batch.
            workers: reading processes; 0: this process.
            shuffle: random order by seed and epoch.
            more: arguments of ``torch.utils.data.DataLoader``.
        """
        return DataLoader(
            self,
            batch_size=batch_size,
            sampler=_Shuffled(self) if shuffle else None,
            num_workers=workers,
            collate_fn=more.pop("collate_fn", collated),
            persistent_workers=more.pop("persistent_workers", workers > 0),
            **more,
        )


class _Shuffled(Sampler[int]):
    """An order determined by seed and epoch of a dataset."""

    def __init__(self, samples: FrameDataset) -> None:
        self._samples = samples

    def __len__(self) -> int:
        return len(self._samples)

    def __iter__(self) -> Iterator[int]:
        draw = np.random.default_rng([self._samples.seed, self._samples.epoch])
        return iter(draw.permutation(len(self._samples)).tolist())


def collated(samples: Sequence[Sample]) -> Sample:
    """Return a batch of frames of different sizes.

    Arrays with a row per point or per box are concatenated; ``point_frame`` and ``box_frame`` give
    the frame in the batch of each row (the first column of batches in OpenPCDet and
    MinkowskiEngine). Everything else, including additions of a transform, is a list over the
    samples.
    """
    batch: Sample = {}
    for name in dict.fromkeys(name for sample in samples for name in sample):
        values = [sample[name] for sample in samples]
        batch[name] = _joined(values) if name in (*_PER_POINT, *_PER_BOX) else values
    for index, name in (("point_frame", "points"), ("box_frame", "boxes")):
        counts = [len(sample[name]) for sample in samples]
        batch[index] = torch.from_numpy(np.repeat(np.arange(len(samples), dtype=np.int32), counts))
    return batch


def _joined(values: Sequence[Tensor]) -> Tensor:
    """Concatenate like ``torch.cat``, in a single thread.

    On a busy machine the threads of ``torch.cat`` wait for each other: four frames took ten times
    as long.
    """
    if any(value.device.type != "cpu" for value in values):
        return torch.cat(list(values))
    return torch.from_numpy(np.concatenate([value.numpy() for value in values]))


def _tensor(values: NDArray[Any], kind: type[np.generic]) -> Tensor:
    """Return a tensor with its own memory: arrays of files may be read-only."""
    return torch.from_numpy(np.array(values, kind, order="C"))
