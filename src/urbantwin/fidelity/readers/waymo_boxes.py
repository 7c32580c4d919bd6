"""Labelled objects of a segment of the Waymo Open Dataset: boxes, tracks, speeds, counts of points.

Source: ``v2/perception/box.py`` and ``v2/column_types.py``: boxes are upright in the vehicle's
frame, by their middle. Speeds are over the ground in the world's axes (the kit's issue 39, and the
numbers in its issue 137); here they are turned into the vehicle's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.documents import laid_out
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, track_of
from urbantwin.fidelity.readers.waymo_tables import EXPECTED, TIME, Columns, read_component
from urbantwin.geometry import Pose

__all__ = ["LabelledObjects"]

_BOX = "[LiDARBoxComponent]."
_SIDES = tuple(f"{_BOX}box.{name}" for name in (
    "center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading"))  # fmt: skip
_SPEED = tuple(f"{_BOX}speed.{axis}" for axis in "xyz")
_OBJECT, _TYPE = "key.laser_object_id", f"{_BOX}type"
_INSIDE = f"{_BOX}num_lidar_points_in_box"
#: By number (``box.py``).
_TYPES = ("Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist")


class LabelledObjects:
    """The labelled objects of a segment by time; none in segments for tests."""

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
        """Return the objects of a frame; no rows are a street without any."""
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
        # As the kit's metrics have it: annotators drew these by other sensors, or between frames.
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
