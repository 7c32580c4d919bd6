"""Files of one frame, in the layouts of OpenPCDet (custom dataset) and SemanticKITTI."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.box_columns import box_columns, label_lines
from urbantwin.dataset.frame_columns import columns_of_frame, parquet_bytes
from urbantwin.dataset.frame_las import laz_bytes
from urbantwin.dataset.frame_place import FolderPlace, FramePlace
from urbantwin.dataset.reading.frame_files import FOLDERS, RAY_TYPE, STORED
from urbantwin.lidar import LabelledFrame

__all__ = ["FOLDERS", "FrameTables", "folders_of", "frame_name", "write_frame"]

#: Fields of `lidar.LabelledFrame`, in the order of `compiled.tables.write_tables`.
_COLUMNS = ("points", "semantic", "instance", "sensor", "ring", "column", "time_s", "echo")


class FrameTables(NamedTuple):
    """Labels and rays of a frame of M points, and statistics of the points.

    Attributes:
        labels: (M,) uint32, class in the low 16 bits, track in the high.
        rays: (M,) `frame_files.RAY_TYPE`.
        points_of: (65536,) int64, number of points per class.
        bounds: (2, 3) float32, least and greatest x, y and z.
    """

    labels: NDArray[np.uint32]
    rays: NDArray[np.void]
    points_of: NDArray[np.int64]
    bounds: NDArray[np.float32]

    @classmethod
    def of(cls, frame: LabelledFrame) -> FrameTables:
        """Compute them for a frame."""
        from urbantwin.dataset.compiled.tables import write_tables

        count = len(frame.points)
        tables = cls(
            np.empty(count, "<u4"),
            np.empty(count, RAY_TYPE),
            np.zeros(1 << 16, np.int64),
            np.array([[np.inf] * 3, [-np.inf] * 3], np.float32),
        )
        columns = (np.ascontiguousarray(getattr(frame, name)) for name in _COLUMNS)
        write_tables(tuple(columns), tables)
        return tables


def frame_name(index: int) -> str:
    """Return the name of a frame: its number, six digits or more."""
    return f"{index:06d}"


def folders_of(storage: str) -> tuple[str, ...]:
    """Return the folders of the frames' files; column formats have all in ``points``."""
    return FOLDERS if storage == "npy" else FOLDERS[:2]


def write_frame(
    place: Path | FramePlace, index: int, frame: LabelledFrame, storage: str = "npy"
) -> dict[str, Any]:
    """Write the files of one frame and return its entry for the dataset's tables.

    Args:
        place: the place; a folder must have every folder of `folders_of`.
        index: number of the frame.
        frame: the recorded frame.
        storage: one of `frame_files.STORED`.

    Returns:
        JSON-compatible: ``points`` (number), ``bounds`` (least and greatest x, y, z, or ``None``),
        ``semantic`` (number of points by class id), ``boxes`` (columns, see `box_columns`) and
        ``sha256`` (of each file, by its name in the dataset).
    """
    name, tables = frame_name(index), FrameTables.of(frame)
    labels, rays = tables.labels, tables.rays
    files: dict[str, tuple[bytes | memoryview, ...]] = {
        f"labels/{name}.txt": (label_lines(frame.boxes).encode(),)
    }
    points = f"points/{name}{STORED[storage]}"
    if storage == "npy":
        files[points] = _npy(frame.points)
        files[f"semantic/{name}.label"] = (_bytes_of(labels),)
        files[f"rays/{name}.npy"] = _npy(rays)
    else:
        packed = parquet_bytes if storage == "zstd" else laz_bytes
        files[points] = (packed(columns_of_frame(frame.points, labels, rays)),)
    to = FolderPlace(place) if isinstance(place, Path) else place
    sums = {}
    for file, parts in files.items():
        to.write(file, *parts)
        digest = hashlib.sha256()
        for part in parts:
            digest.update(part)
        sums[file] = digest.hexdigest()

    return {
        "points": len(rays),
        "bounds": tables.bounds.ravel().tolist() if len(rays) else None,
        "semantic": {
            str(class_id): int(tables.points_of[class_id])
            for class_id in np.flatnonzero(tables.points_of)
        },
        "boxes": box_columns(frame.boxes),
        "sha256": sums,
    }


def _npy(array: NDArray[Any]) -> tuple[bytes, memoryview]:
    """Return the bytes of ``np.save``."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, np.lib.format.header_data_from_array_1_0(array))
    return header.getvalue(), _bytes_of(array)


def _bytes_of(array: NDArray[Any]) -> memoryview:
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
