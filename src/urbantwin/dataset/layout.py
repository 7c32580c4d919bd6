"""The files of one frame, in the layouts of OpenPCDet (custom dataset) and SemanticKITTI."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_json_value
from urbantwin.dataset.box_columns import box_columns, label_lines
from urbantwin.dataset.frame_columns import columns_of_frame, parquet_bytes
from urbantwin.dataset.frame_files import RAY_TYPE, STORED
from urbantwin.dataset.frame_las import laz_bytes
from urbantwin.errors import InputError
from urbantwin.lidar import LabelledFrame

__all__ = ["FOLDERS", "folders_of", "frame_name", "read_json_or_none", "write_frame"]

FOLDERS = ("points", "labels", "semantic", "rays")

_RAY_FIELDS = {name: {"time": "time_s"}.get(name, name) for name in RAY_TYPE.names or ()}


def frame_name(index: int) -> str:
    """Return the name of a frame: its number, six digits or more."""
    return f"{index:06d}"


def folders_of(storage: str) -> tuple[str, ...]:
    """Return the folders of a dataset's frames: in columns, a point's file holds all of it."""
    return FOLDERS if storage == "npy" else FOLDERS[:2]


def write_frame(
    folder: Path, index: int, frame: LabelledFrame, storage: str = "npy"
) -> dict[str, Any]:
    """Write the files of one frame and return what the dataset's tables say of it.

    Args:
        folder: the dataset's folder, which has every folder of `folders_of`.
        index: the frame's number.
        frame: what was recorded.
        storage: one of `frame_files.STORED`.

    Returns:
        What can stand in JSON: ``points`` (their number), ``bounds`` (least and greatest x, y, z,
        or ``None``), ``semantic`` (number of points by class number), ``boxes`` (their columns,
        see `box_columns`) and ``sha256`` (of each file, by its name in the dataset).
    """
    name = frame_name(index)
    lines = label_lines(frame.boxes).encode()
    (folder / "labels" / f"{name}.txt").write_bytes(lines)
    sums = {f"labels/{name}.txt": hashlib.sha256(lines).hexdigest()}

    labels = frame.instance.astype("<u4")
    labels <<= 16
    labels |= frame.semantic
    rays = np.empty(len(frame.points), RAY_TYPE)
    for field, attribute in _RAY_FIELDS.items():
        rays[field] = getattr(frame, attribute, 0)
    points = f"points/{name}{STORED[storage]}"
    if storage == "npy":
        sums[points] = _save(folder / points, frame.points)
        sums[f"semantic/{name}.label"] = _write(folder / f"semantic/{name}.label", b"", labels)
        sums[f"rays/{name}.npy"] = _save(folder / f"rays/{name}.npy", rays)
    else:
        packed = parquet_bytes if storage == "zstd" else laz_bytes
        content = packed(columns_of_frame(frame.points, labels, rays))
        sums[points] = _write(folder / points, content, np.zeros(0, np.uint8))

    counts = np.bincount(frame.semantic)
    return {
        "points": len(frame.points),
        "bounds": _bounds(frame.points),
        "semantic": {str(number): int(counts[number]) for number in np.flatnonzero(counts)},
        "boxes": box_columns(frame.boxes),
        "sha256": sums,
    }


def _save(path: Path, array: NDArray[Any]) -> str:
    """Write what ``np.save`` writes, and return the file's SHA-256."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
    return _write(path, header.getvalue(), array)


def _write(path: Path, header: bytes, array: NDArray[Any]) -> str:
    """Write a file through to the disk, give its memory back, and return the file's SHA-256.

    A frame that is marked as finished is then really there after a loss of power. And where the
    machine is a virtual one, the next frame finds memory that it has already: with fresh pages
    for every frame, writing takes five times as long.
    """
    body = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    digest = hashlib.sha256(header)
    digest.update(body)
    with path.open("wb", buffering=0) as stream, _named(path):
        for part in (header, body):
            _write_all(stream, part)
        os.fdatasync(stream.fileno())
        if hasattr(os, "posix_fadvise"):
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    return digest.hexdigest()


def _write_all(stream: io.RawIOBase, part: bytes | memoryview) -> None:
    """Write all of it: where a disk fills up or files are limited, the system writes a part."""
    while len(part):
        part = part[stream.write(part) or 0 :]


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Add the file's name to errors of the system."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def read_json_or_none(path: Path) -> Any:  # noqa: ANN401
    """Return what a JSON file holds, or ``None`` if it is missing, truncated or damaged."""
    try:
        return read_json_value(path, "what a frame holds")
    except InputError:
        return None


def _bounds(points: NDArray[np.float32]) -> list[float] | None:
    if not len(points):
        return None
    # A column at a time: far faster than along the short axis of an (N, 4) array.
    columns = [np.ascontiguousarray(points[:, axis]) for axis in range(3)]
    return [float(c.min()) for c in columns] + [float(c.max()) for c in columns]
