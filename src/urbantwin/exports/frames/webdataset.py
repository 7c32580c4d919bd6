"""WebDataset: tar shards per part of the split, with whole frames as samples.

Source: the WebDataset format (Aizman et al. 2019): files of a sample are adjacent and share the
name up to the first dot. Its reader decodes ``.npy`` and ``.json``.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.exports.frames.box_rows import box_rows
from urbantwin.exports.frames.shards import write_in_order
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress

__all__ = ["new_shard", "write_webdataset"]


def write_webdataset(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``PART-NNNNNN.tar``, with a sample per frame.

    Its files are ``points.npy`` (N, 4), ``semantic.npy`` and ``instance.npy`` (N,), ``rays.npy``
    (N,) with named fields, ``boxes.json`` (rows) and ``json`` (time, part, poses as 4x4 matrices).
    """
    write_in_order(source, folder, "webdataset", tell)
    return []


class _Shard:
    """A tar file that samples are added to."""

    def __init__(self, stem: Path) -> None:
        path = stem.with_name(f"{stem.name}.tar")
        self._stream = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115

    @property
    def size(self) -> int:
        return int(self._stream.offset)

    def add(self, frame: Frame, dataset: str, part: str | None, levels: Mapping[str, Any]) -> None:
        """Add a sample; its key is the frame's name, after that of the dataset, if given."""
        key = f"{dataset}/{frame.name}" if dataset else frame.name
        for name, content in _files(frame, dataset, part, levels):
            told = tarfile.TarInfo(f"{key}.{name}")  # no time, no owner
            told.size = len(content)
            self._stream.addfile(told, io.BytesIO(content))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


def new_shard(stem: Path) -> _Shard:
    """Begin a shard ``STEM.tar``."""
    return _Shard(stem)


def _files(
    frame: Frame, dataset: str, part: str | None, levels: Mapping[str, Any]
) -> Iterator[tuple[str, bytes]]:
    values = frame.points
    yield "points.npy", _npy(values)
    yield "semantic.npy", _npy(frame.semantic)
    yield "instance.npy", _npy(frame.instance)
    yield "rays.npy", _npy(frame.rays)
    yield "boxes.json", _json(list(box_rows(frame.objects)))
    told = {
        "name": frame.name,
        **({"dataset": dataset} if dataset else {}),
        **({"levels": dict(levels)} if levels else {}),
        "time_s": frame.time_s,
        "part": part,
        "site_SE3_frame": pose_matrix(frame.site_SE3_dataset),
        "site_SE3_sensors": {
            name: pose_matrix(pose) for name, pose in frame.site_SE3_sensors.items()
        },
    }
    yield "json", _json(told)


def _npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.ascontiguousarray(array), allow_pickle=False)
    return stream.getvalue()


def _json(value: object) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()
