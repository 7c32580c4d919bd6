"""WebDataset: shards of tar files, one for each part of the split, whose samples are whole frames.

Source: the WebDataset format (Aizman et al. 2019): files of one sample stand side by side and share
the name up to the first dot. ``.npy`` and ``.json`` are what its reader decodes by itself.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.manifest_schema import pose_matrix
from urbantwin.exports.frames.box_rows import box_rows
from urbantwin.exports.frames.source import FrameSource, SourceFrame
from urbantwin.progress import Progress

__all__ = ["write_webdataset"]

#: A shard is closed when it has become so large: some hundred megabytes stream well.
_SHARD_BYTES = 250_000_000
#: Shards of frames that are in no part of the split.
_NO_PART = "rest"


def write_webdataset(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``PART-NNNNNN.tar``, in which every frame is a sample.

    Its files are ``points.npy`` (N, 4), ``semantic.npy`` and ``instance.npy`` (N,), ``rays.npy``
    (N,) with named fields, ``boxes.json`` (rows) and ``json`` (time, part, poses as 4x4 matrices).
    """
    parts: dict[str, list[int]] = {}
    for number, name in enumerate(source.names):
        parts.setdefault(source.part_of(name) or _NO_PART, []).append(number)
    done = 0
    for part, numbers in parts.items():
        shard, stream = 0, None
        for number in numbers:
            frame = source[number]
            tell(done / len(source), f"frame {frame.name}")
            if stream is None:
                stream = tarfile.open(  # noqa: SIM115 - it stays open for the next frames
                    folder / f"{part}-{shard:06d}.tar", "w", format=tarfile.USTAR_FORMAT
                )
            for name, content in _files(frame, part):
                told = tarfile.TarInfo(f"{frame.name}.{name}")  # no time, no owner
                told.size = len(content)
                stream.addfile(told, io.BytesIO(content))
            done += 1
            if stream.offset >= _SHARD_BYTES:
                stream.close()
                shard, stream = shard + 1, None
        if stream is not None:
            stream.close()
    return []


def _files(frame: SourceFrame, part: str) -> Iterator[tuple[str, bytes]]:
    values = np.column_stack([frame.points, frame.intensity]).astype("<f4")
    yield "points.npy", _npy(values)
    yield "semantic.npy", _npy(frame.semantic)
    yield "instance.npy", _npy(frame.instance)
    yield "rays.npy", _npy(frame.rays)
    yield "boxes.json", _json(list(box_rows(frame.boxes)))
    told = {
        "name": frame.name,
        "time_s": frame.time_s,
        "part": None if part == _NO_PART else part,
        "site_SE3_frame": pose_matrix(frame.site_SE3_frame),
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
