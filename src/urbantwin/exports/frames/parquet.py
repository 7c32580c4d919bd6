"""Parquet: a row per frame, with points and their labels as lists, and boxes as structs.

``pyarrow.dataset``, DuckDB, polars and Hugging Face's ``datasets`` can read it directly. A row
group has few frames, so that streaming reads no more than needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.frame_columns import COLUMNS, DICTIONARY, ENCODINGS, LEVEL
from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.exports.frames.box_rows import box_rows
from urbantwin.exports.frames.shards import write_in_order
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress

__all__ = ["new_shard", "write_parquet"]

#: Frames of a row group.
_ROWS = 8

_number, _whole, _text = pa.float64(), pa.int64(), pa.string()
_BOXES = pa.struct(
    [
        ("track", _whole),
        ("class", _text),
        *((name, _number) for name in (*BOX, *VELOCITY)),
        ("num_points", _whole),
        ("num_points_alone", _whole),
        ("occlusion", _number),
        ("truncation", _number),
        ("difficulty", _text),
        ("ignored", _text),
        ("observed_s", _number),
        ("parked", pa.bool_()),
        ("towed_by", _whole),
    ]
)
_FRAME = (
    ("dataset", _text),
    ("frame", _text),
    ("time_s", _number),
    ("part", _text),
    ("site_SE3_frame", pa.list_(_number, 16)),
    (
        "site_SE3_sensors",
        pa.list_(pa.struct([("sensor", _text), ("site_SE3_sensor", pa.list_(_number, 16))])),
    ),
    ("boxes", pa.list_(_BOXES)),
)
_SCHEMA = pa.schema(
    [*_FRAME, *((name, pa.list_(pa.from_numpy_dtype(kind))) for name, kind in COLUMNS.items())]
)
#: Same options as for single frames in `frame_columns`.
_WRITTEN: dict[str, Any] = {
    **PARQUET,
    "compression_level": LEVEL,
    "use_dictionary": [f"{DICTIONARY}.list.element"],
    "column_encoding": {
        f"{name}.list.element": kind for name, kind in ENCODINGS.items() if name != DICTIONARY
    },
}


def write_parquet(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``PART-NNNNNN.parquet``, with a row per frame.

    Columns: ``dataset``, ``frame``, ``time_s``, ``part``, ``site_SE3_frame`` and those of sensors
    (4x4, row by row), ``boxes`` (see docs/reference/labels.md), a list for each value of a point,
    and for a campaign one per axis.
    """
    write_in_order(source, folder, "parquet", tell, dataset=source.folder.resolve().name)
    return []


class _Shard:
    """A Parquet file that rows are added to."""

    def __init__(self, stem: Path) -> None:
        self._sink = pa.OSFile(str(stem.with_name(f"{stem.name}.parquet")), "wb")
        self._writer: pq.ParquetWriter | None = None
        self._schema = _SCHEMA
        self._rows: list[dict[str, Any]] = []
        self._waiting = 0

    @property
    def size(self) -> int:
        return int(self._sink.tell()) + self._waiting

    def add(self, frame: Frame, dataset: str, part: str | None, levels: Mapping[str, Any]) -> None:
        """Add a row."""
        # The column `sensor` is that of points; the level is `sensor_name`.
        levels = {f"{axis}_name" if axis in COLUMNS else axis: one for axis, one in levels.items()}
        if self._writer is None:
            kinds = {axis: _whole if isinstance(x, int) else _text for axis, x in levels.items()}
            self._schema = pa.schema([*kinds.items(), *_SCHEMA])
            self._writer = pq.ParquetWriter(self._sink, self._schema, **_WRITTEN)
        rays = frame.rays.dtype.names or ()
        columns: dict[str, NDArray[Any]] = {
            **dict(zip("xyz", frame.xyz.T, strict=True)),
            "intensity": frame.intensity,
            "semantic": frame.semantic,
            "instance": frame.instance,
            **{name: frame.rays[name] for name in COLUMNS if name in rays},
        }
        self._rows.append(
            {
                "dataset": dataset,
                "frame": frame.name,
                "time_s": frame.time_s,
                "part": part,
                **levels,
                "site_SE3_frame": np.ravel(pose_matrix(frame.site_SE3_dataset)),
                "site_SE3_sensors": [
                    {"sensor": name, "site_SE3_sensor": np.ravel(pose_matrix(pose))}
                    for name, pose in frame.site_SE3_sensors.items()
                ],
                "boxes": list(box_rows(frame.objects)),
                **columns,
            }
        )
        # A guess, until they are written: compression leaves about a third.
        self._waiting += sum(one.nbytes for one in columns.values()) // 3
        if len(self._rows) == _ROWS:
            self._flush()

    def _flush(self) -> None:
        if self._rows and self._writer is not None:
            arrays = [
                pa.array([row.get(one.name) for row in self._rows], one.type)
                for one in self._schema
            ]
            self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self._rows, self._waiting = [], 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._flush()
        finally:
            if self._writer is not None:
                self._writer.close()
            self._sink.close()


def new_shard(stem: Path) -> _Shard:
    """Begin a shard ``STEM.parquet``."""
    return _Shard(stem)
