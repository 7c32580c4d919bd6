"""Labelled actors of a dataset or a fleet as arrays, one row per frame and box."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.dataset.reading.tables import rows_by_name
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["LabelledObjects"]

FILE = "boxes.parquet"
_EXPECTED = "boxes of urbantwin record"
_REQUIRED = {"frame": "text", "track": "whole", "class": "text", **dict.fromkeys(BOX, "number")}
#: Optional columns, with their default values.
_OPTIONAL: dict[str, Any] = {
    **dict.fromkeys(("time_s", "observed_s", *VELOCITY), 0.0),
    **dict.fromkeys(("num_points", "num_points_alone", "towed_by"), -1),
    **dict.fromkeys(("occlusion", "visibility", "truncation"), np.nan),
    **dict.fromkeys(("difficulty", "ignored"), ""),
    "parked": False,
}


@dataclass(frozen=True, eq=False)
class LabelledObjects:
    """Labelled actors; of a dataset in the frame of the points, of a fleet in the site.

    Attributes:
        frame: (B,) names of the frames.
        time_s: (B,) time of the frame, seconds from the start of the motion.
        track: (B,) track id, the same in every frame.
        class_name: (B,) names of ``taxonomy.ACTOR_CLASSES``.
        box: (B, 7) centre x, y, z, length, width, height in metres, yaw in radians.
        velocity: (B, 3) over ground, along the axes of the frame, metres per second.
        num_points: (B,) points on the actor; -1 where unknown.
        num_points_alone: (B,) points on the actor without occlusion; -1 where unknown.
        occlusion, visibility: (B,) 0..1; NaN for an actor that no ray reaches even without
            occlusion.
        truncation: (B,) 0..1.
        difficulty: (B,) ``easy``, ``moderate``, ``hard``; empty if the box does not count.
        ignored: (B,) why a box does not count (docs/reference/labels.md); empty if it does.
        observed_s: (B,) time of the box, seconds relative to the frame's.
        parked: (B,) whether the actor is a parked vehicle.
        towed_by: (B,) track of the towing actor, -1 for none.
        file: the table, for errors.
    """

    frame: NDArray[np.object_]
    time_s: NDArray[np.float64]
    track: NDArray[np.int64]
    class_name: NDArray[np.str_]
    box: NDArray[np.float64]
    velocity: NDArray[np.float64]
    num_points: NDArray[np.int64]
    num_points_alone: NDArray[np.int64]
    occlusion: NDArray[np.float64]
    visibility: NDArray[np.float64]
    truncation: NDArray[np.float64]
    difficulty: NDArray[np.str_]
    ignored: NDArray[np.str_]
    observed_s: NDArray[np.float64]
    parked: NDArray[np.bool_]
    towed_by: NDArray[np.int64]
    file: Path

    @staticmethod
    def is_in(folder: Path) -> bool:
        """Return whether a folder has a table of labels."""
        return (folder / FILE).is_file()

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Read the labels of a dataset or of a fleet.

        Raises:
            InputError: missing or damaged.
        """
        return cls.of_table(read_parquet(folder / FILE, _EXPECTED), folder)

    @classmethod
    def of_table(cls, table: pa.Table, folder: Path) -> Self:
        """Return the rows of a table of boxes.

        Args:
            table: `Dataset.boxes`, or `Fleet.boxes`.
            folder: folder of the dataset or fleet, for errors.

        Raises:
            InputError: a column is missing, of another type, or not finite.
        """
        file = folder / FILE
        columns = columns_of(table, _REQUIRED, file, _EXPECTED)
        columns |= {name: _filled(table, name, file) for name in _OPTIONAL}
        rows: dict[str, Any] = {field.name: columns.get(field.name) for field in fields(cls)}
        rows |= {"class_name": columns["class"].astype(str), "file": file}
        for name, parts in (("box", BOX), ("velocity", VELOCITY)):
            rows[name] = np.column_stack([columns[part] for part in parts]).reshape(-1, len(parts))
        return cls(**rows)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.track)

    def take(self, rows: Any) -> Self:  # noqa: ANN401 - whatever selects rows of an array
        """Return some rows: indices, a mask or a slice."""
        arrays: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        del arrays["file"]
        return replace(self, **{name: values[rows] for name, values in arrays.items()})

    def rows_of(self, frame: str) -> NDArray[np.int64]:
        """Return the row numbers of a frame."""
        return self._rows_of_frames.get(frame, np.zeros(0, np.int64))

    def of_frame(self, frame: str) -> Self:
        """Return the rows of a frame."""
        return self.take(self.rows_of(frame))

    @cached_property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames with boxes."""
        return tuple(self._rows_of_frames)

    @cached_property
    def _rows_of_frames(self) -> dict[str, NDArray[np.int64]]:
        return rows_by_name(self.frame)


def _filled(table: pa.Table, name: str, file: Path) -> NDArray[Any]:
    """Return a column, with the default of `_OPTIONAL` for missing values."""
    import pyarrow as pa
    import pyarrow.compute as pc

    default = _OPTIONAL[name]
    if name not in table.column_names:
        return np.full(table.num_rows, default)
    column = table[name]
    fits = {
        bool: pa.types.is_boolean,
        int: pa.types.is_integer,
        float: pa.types.is_floating,
        str: pa.types.is_string,
    }[type(default)]
    if not (fits(column.type) or pa.types.is_null(column.type)):
        raise InputError(f"holds {column.type}", file=file, place=name, expected=_EXPECTED)
    if pa.types.is_null(column.type):
        return np.full(table.num_rows, default)
    values = pc.fill_null(column, default).to_numpy(zero_copy_only=False)
    values = values.astype({int: np.int64, str: str}.get(type(default), values.dtype))
    if default == 0.0 and not np.isfinite(values).all():
        raise InputError("has a value that is not finite", file=file, place=name)
    return np.asarray(values)
