"""Tables of the Waymo Open Dataset, version 2: segments, boxes, semantic classes of points.

Sources: ``waymo_open_dataset/v2``: ``component.py`` (names of columns), ``perception/lidar.py``,
``context.py``, ``box.py``, ``pose.py``, ``segmentation.py``, ``column_types.py``;
``protos/segmentation.proto``. Rows have keys: time of the frame in microseconds, and laser. Boxes
are upright in the vehicle's frame, given by their centre. Speeds are over ground in the world's
axes (the kit's issue 39, and the numbers in its issue 137); here they are rotated into the
vehicle's.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import ParquetGroups, columns_of, read_parquet
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, track_of
from urbantwin.geometry import Pose
from urbantwin.io.trust import laid_out
from urbantwin.taxonomy import semantic_id

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "EXPECTED",
    "LASER",
    "TIME",
    "Columns",
    "ImageRows",
    "LabelledObjects",
    "check_segment",
    "classes_of",
    "image_of",
    "matrix_of",
    "read_component",
]

Columns = dict[str, NDArray[Any]]

EXPECTED = "a component of the Waymo Open Dataset, version 2"

SEGMENT, TIME, LASER = (
    f"key.{name}" for name in ("segment_context_name", "frame_timestamp_micros", "laser_name")
)
#: Row groups read in parallel: rows may be sorted by laser before time.
_MOST_OPEN = 8


class ImageRows:
    """The rows of a component with images, each decoded on request.

    In sequence, each row is decoded once. A row before the last one of its group requires decoding
    all rows that precede it in the group.

    Args:
        path: the file.
        columns: the columns to read.

    Attributes:
        segment: the recording that the file belongs to.
        lasers: time of a frame -> laser -> row, in the order of lasers.

    Raises:
        InputError: not such a table, or a duplicate row.
    """

    def __init__(self, path: Path, columns: tuple[str, ...]) -> None:
        self._path = path
        self._file = ParquetGroups(path, EXPECTED)
        here = self._file.column_names
        if columns[0] not in here:
            raise InputError("is missing", file=path, place=columns[0], expected=EXPECTED)
        self._columns = tuple(one for one in columns if one in here)
        keys = self._file.read([one for one in (SEGMENT, TIME, LASER) if one in here])
        found = columns_of(keys, {TIME: "whole", LASER: "whole"}, path, EXPECTED)
        self.segment = segment_of(keys, path)
        self.lasers: dict[int, dict[int, int]] = {}
        for row, (time, laser) in enumerate(
            zip(found[TIME].tolist(), found[LASER].tolist(), strict=True)
        ):
            mine = self.lasers.setdefault(time, {})
            if laser in mine:
                raise InputError(
                    f"has laser {laser} of {time} again", file=path, place=f"row {row}"
                )
            mine[laser] = row
        self._begin = np.concatenate([[0], np.cumsum(self._file.rows)])
        self._open: OrderedDict[int, tuple[int, Iterator[pa.RecordBatch]]] = OrderedDict()

    def row(self, number: int) -> dict[str, Any]:
        """Return a row's values by column: arrays, or None for an empty value.

        Raises:
            InputError: the row is damaged.
        """
        group = int(np.searchsorted(self._begin, number, "right")) - 1
        wanted = number - int(self._begin[group])
        begin, batches = self._open.pop(group, (wanted + 1, iter(())))
        if begin > wanted:
            begin, batches = 0, self._file.each_row(self._columns, group)
        for count, batch in enumerate(batches, begin):
            if count == wanted:
                self._open[group] = (count + 1, batches)
                while len(self._open) > _MOST_OPEN:
                    self._open.popitem(last=False)
                with laid_out(self._path, EXPECTED, place=f"row {number}"):
                    names = batch.schema.names
                    return {name: _value(batch.column(names.index(name))) for name in self._columns}
        raise InputError(f"ends before row {number}", file=self._path, expected=EXPECTED)


def _value(column: pa.Array) -> NDArray[Any] | None:
    """Return the numbers in the one row of a column, None if it is empty."""
    import pyarrow as pa

    kind = column.type
    if not (pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind)):
        raise TypeError(f"{kind} are no lists of numbers")
    if not column[0].is_valid:
        return None
    numbers: NDArray[Any] = column[0].values.to_numpy(zero_copy_only=False)
    return numbers


def image_of(
    row: Mapping[str, Any], name: str, channels: int, kind: str = "f"
) -> NDArray[Any] | None:
    """Return an image (H, W, channels) of a row, None if it is empty.

    Args:
        row: its values by column.
        name: name of the image.
        channels: number of values per pixel.
        kind: NumPy kind of the values: ``f`` or ``i``.

    Raises:
        ValueError: shape and number of values do not match.
    """
    values, shape = row.get(f"{name}.values"), row.get(f"{name}.shape")
    if values is None or shape is None or not len(values):
        return None
    if values.dtype.kind != kind or shape.dtype.kind not in "iu":
        raise TypeError(f"{name} holds {values.dtype} and {shape.dtype}")
    sides = [int(one) for one in shape]
    if len(sides) != 3 or min(sides) < 1 or sides[2] != channels:
        raise ValueError(f"an image of {' x '.join(map(str, sides))} values")
    if sides[0] * sides[1] * sides[2] != len(values):
        raise ValueError(f"{len(values)} values of {' x '.join(map(str, sides))}")
    image: NDArray[Any] = values.reshape(sides)
    return image


def matrix_of(values: Any) -> NDArray[np.float64]:  # noqa: ANN401 - of a column of lists
    """Return a matrix (4, 4) from 16 numbers.

    Raises:
        ValueError: there are not 16.
    """
    found = np.asarray(values, np.float64)
    if found.size != 16:
        raise ValueError(f"{found.size} numbers are not a matrix of 4 by 4")
    return found.reshape(4, 4)


def read_component(path: Path, columns: tuple[str, ...], segment: str) -> Columns | None:
    """Return the columns of a component with small rows, None if it is missing or empty.

    Args:
        path: the file.
        columns: the columns to read; missing ones are left out.
        segment: the recording that it must belong to.

    Raises:
        InputError: not such a table, or one of another recording.
    """
    if not path.is_file():
        return None
    table = read_parquet(path, EXPECTED, columns=(SEGMENT, *columns))
    mine = segment_of(table, path)
    if not table.num_rows:
        return None
    check_segment(mine, segment, path)
    with laid_out(path, EXPECTED):
        return {
            name: table[name].to_numpy(zero_copy_only=False)
            for name in table.column_names
            if name != SEGMENT
        }


def check_segment(found: str, wanted: str, path: Path) -> None:
    """Raise an error for a component of another recording.

    Raises:
        InputError: the segments differ.
    """
    if found != wanted:
        raise InputError(f"is of segment {found}", file=path, expected=f"segment {wanted}")


def segment_of(table: pa.Table, path: Path) -> str:
    """Return the recording that all rows of a table belong to.

    Raises:
        InputError: there are several.
    """
    if SEGMENT not in table.column_names or not table.num_rows:
        return path.stem
    with laid_out(path, EXPECTED, place=SEGMENT):
        found = sorted({str(one) for one in table[SEGMENT].to_pylist()})
    if len(found) > 1:
        names = ", ".join(map(str, found[:4]))
        raise InputError(f"is of {len(found)} segments ({names})", file=path, place=SEGMENT)
    return str(found[0])


_BOX = "[LiDARBoxComponent]."
_SIDES = tuple(f"{_BOX}box.{name}" for name in (
    "center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading"))  # fmt: skip
_SPEED = tuple(f"{_BOX}speed.{axis}" for axis in "xyz")
_OBJECT, _TYPE = "key.laser_object_id", f"{_BOX}type"
_INSIDE = f"{_BOX}num_lidar_points_in_box"
#: Names of types by number (``box.py``).
_TYPES = ("Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist")


class LabelledObjects:
    """The labelled objects of a segment by time; test segments have none."""

    def __init__(self, path: Path, segment: str) -> None:
        columns = (TIME, _OBJECT, *_SIDES, _TYPE, _INSIDE, *_SPEED)
        self._path = path
        self._table = read_component(path, columns, segment)
        with laid_out(path, EXPECTED):
            times = [] if self._table is None else self._table[TIME].astype(np.int64).tolist()
        self._rows: dict[int, list[int]] = {}
        for row, time in enumerate(times):
            self._rows.setdefault(time, []).append(row)

    def at(self, time: int, world_SE3_vehicle: Pose | None) -> Boxes | None:
        """Return the objects of a frame, possibly none; None if the segment has no labels."""
        table = self._table
        if table is None:
            return None
        labelled = []
        for row in self._rows.get(time, []):
            with laid_out(self._path, EXPECTED, place=f"row {row}"):
                labelled.append(_labelled(table, row, world_SE3_vehicle))
        return boxes_of(labelled)


def _labelled(table: Columns, row: int, world_SE3_vehicle: Pose | None) -> LabelledBox:
    x, y, z, length, width, height, yaw = (float(table[name][row]) for name in _SIDES)
    number = int(table[_TYPE][row])
    inside = int(table[_INSIDE][row]) if _INSIDE in table else -1
    return LabelledBox(
        (x, y, z, length, width, height, yaw),
        _TYPES[number] if 0 <= number < len(_TYPES) else _TYPES[0],
        track_of(str(table[_OBJECT][row])),
        _velocity(table, row, world_SE3_vehicle),
        num_points=inside,
        # as in the kit's metrics: these were labelled by other sensors, or between frames
        ignored="no points" if inside == 0 else "",
    )


def _velocity(
    table: Columns, row: int, world_SE3_vehicle: Pose | None
) -> tuple[float, float, float] | None:
    named: Sequence[str] = [name for name in _SPEED if name in table]
    if world_SE3_vehicle is None or len(named) < 2:
        return None
    told = [float(table[name][row]) for name in named if table[name][row] is not None]
    if len(told) < len(named) or not np.isfinite(told).all():
        return None
    over_ground = np.array([*told, 0.0][:3])
    x, y, z = over_ground @ world_SE3_vehicle.rotation
    return float(x), float(y), float(z)


#: Our class by number of Waymo's class: the same or the nearest, as our own streets are labelled
#: (kerbs, signal heads) and as SemanticKITTI's (parked bicycles, other vehicles).
_CLASSES = (
    "unlabelled", "car", "truck", "bus", "truck", "motorcyclist", "bicyclist", "pedestrian",
    "traffic-sign", "other-object", "pole", "other-object", "other-object", "motorcycle",
    "building", "vegetation", "trunk", "sidewalk", "road", "road", "other-ground", "terrain",
    "sidewalk",
)  # fmt: skip


def classes_of(labels: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return our class and the instance (0 for none) of labels (N, 2): instance, class.

    Unknown classes are unlabelled.
    """
    ours = np.array([semantic_id(name) for name in _CLASSES], np.int64)
    instance, number = labels.astype(np.int64).T
    known = (number >= 0) & (number < len(ours))
    return np.where(known, ours[np.where(known, number, 0)], 0), np.maximum(instance, 0)
