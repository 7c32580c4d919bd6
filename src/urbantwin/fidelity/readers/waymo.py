"""Waymo Open Dataset, version 2: a segment in Parquet, its range images as points.

Source: Sun et al. 2020, and the sources of the development kit (``waymo_open_dataset/v2``,
``docs/labeling_specifications.md``). Points, boxes and the places of the five sensors are in the
vehicle's frame (x forward, y left, z up). Speeds are over the ground in the world's axes (the
kit's issue 39, and the numbers in its issue 137); here they are turned into the vehicle's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import laid_out
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, checked_pose, track_of
from urbantwin.fidelity.readers.range_image import RangeImageSensor, returns_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.waymo_tables import (
    LASER,
    TIME,
    Columns,
    ImageRows,
    check_segment,
    image_of,
    matrix_of,
    read_component,
)
from urbantwin.geometry import Pose

__all__ = ["is_waymo", "open_waymo"]

_EXPECTED = "a component of the Waymo Open Dataset, version 2"
_RETURNS = tuple(f"[LiDARComponent].range_image_return{k}" for k in (1, 2))
_PIXELS = "[LiDARPoseComponent].range_image_return1"
_EXTRINSIC = "[LiDARCalibrationComponent].extrinsic.transform"
_BEAMS = "[LiDARCalibrationComponent].beam_inclination."
_WORLD = "[VehiclePoseComponent].world_from_vehicle.transform"
_BOX = "[LiDARBoxComponent]."
_SIDES = tuple(f"{_BOX}box.{name}" for name in (
    "center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading"))  # fmt: skip
_SPEED = tuple(f"{_BOX}speed.{axis}" for axis in "xyz")
_OBJECT, _TYPE = "key.laser_object_id", f"{_BOX}type"
_INSIDE = f"{_BOX}num_lidar_points_in_box"
#: By number (``box.py``).
_TYPES = ("Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist")
#: Of a range image's channels: range, intensity, elongation, whether nothing is labelled there.
_CHANNELS, _INTENSITY, _ZONE = 4, 1, 3
#: Numbers of a pose, and how an image is written: all of its numbers, and its sides.
_POSE, _PARTS = 6, ("values", "shape")
_STILL = "Where the vehicle was at each pixel is not there: its motion within a turn stays in."


def is_waymo(path: Path) -> bool:
    """Return whether a path is a segment's range images, or a folder of components."""
    if path.suffix == ".parquet" and path.absolute().parent.name == "lidar":
        return path.is_file()
    return any((path / "lidar").glob("*.parquet"))


def open_waymo(path: Path) -> Recording:
    """Open a segment: its ``lidar/NAME.parquet``, or the folder of components that has only one.

    Raises:
        InputError: there are several segments, its calibration is missing, or a table of it is
            not right.
    """
    segment = _Segment(_file_of(path))
    names = tuple(map(str, segment.times))
    return Recording(path, "waymo2", names, segment.frame, segment.notes)


def _file_of(path: Path) -> Path:
    if path.is_file():
        return path
    found = sorted((path / "lidar").glob("*.parquet"))
    if len(found) != 1:
        names = ", ".join(one.name for one in found[:8])
        raise InputError(
            f"holds {len(found)} segments",
            file=path,
            expected=f"one of the files in lidar: {names}",
        )
    return found[0]


class _Segment:
    """A segment whose small components are read, and whose images are read frame by frame."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._images = _rows_of(file, _RETURNS)
        if not self._images.lasers:
            raise InputError("has no rows", file=file, expected=_EXPECTED)
        self.times = sorted(self._images.lasers)
        segment = self._images.segment
        self._calibration = self._component("lidar_calibration")
        self._sensors = _sensors(self._calibration, segment)
        self._poses = _poses(self._component("vehicle_pose"), segment)
        self._labels = _Labels(self._component("lidar_box"), segment)
        self._pixel_file = self._component("lidar_pose")
        self._pixels = None
        if self._poses and self._pixel_file.is_file():
            self._pixels = _rows_of(self._pixel_file, (_PIXELS,))
            check_segment(self._pixels.segment, segment, self._pixel_file)
        self.notes = () if self._pixels is not None else (_STILL,)

    def _component(self, name: str) -> Path:
        # A link to the file alone leaves the other components where the link is.
        return self._file.absolute().parent.parent / name / self._file.name

    def frame(self, index: int) -> Frame:
        """Return the frame of a number: both returns of every laser, laser by laser."""
        time = self.times[index]
        world = self._poses.get(time)
        lasers = sorted(self._sensors)
        parts = []
        for laser, row in sorted(self._images.lasers[time].items()):
            if laser not in self._sensors:
                expected = "every laser that has images"
                raise InputError(f"lacks laser {laser}", file=self._calibration, expected=expected)
            for part in self._returns(time, laser, row, world):
                part["sensor"] = np.full(len(part["x"]), lasers.index(laser))
                parts.append(part)
        if not parts:
            raise InputError(f"has no image of {time}", file=self._file, expected="a first return")
        fields = {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}
        given = {name: fields.pop(name) for name in ("sensor", "unlabelled")}
        lost = self._pixels is not None and time not in self._pixels.lasers
        return frame_of(
            self._file,
            fields,
            name=str(time),
            given=given,
            boxes=self._labels.at(time, world),
            world_SE3_frame=world,
            sensor_places=np.array(
                [self._sensors[one].vehicle_SE3_sensor.translation for one in lasers]
            ),
            notes=(_STILL,) if lost else (),
        )

    def _returns(self, time: int, laser: int, row: int, world: Pose | None) -> list[Columns]:
        """Return the fields of what came back to one laser, the first returns before the second."""
        sensor, values = self._sensors[laser], self._images.row(row)
        with laid_out(self._file, _EXPECTED, place=f"row {row}"):
            told = [image_of(values, name, _CHANNELS) for name in _RETURNS]
            images = [one for one in told if one is not None]
            for one in images:
                sensor.of_rows(len(one))
        pose = None
        if self._pixels is not None and laser in self._pixels.lasers.get(time, {}):
            at = self._pixels.lasers[time][laser]
            values = self._pixels.row(at)
            with laid_out(self._pixel_file, _EXPECTED, place=f"row {at}"):
                pose = image_of(values, _PIXELS, _POSE)
                if pose is not None and any(one.shape[:2] != pose.shape[:2] for one in images):
                    raise ValueError(f"poses of {pose.shape[:2]} for {images[0].shape[:2]} pixels")
        found = []
        with laid_out(self._file, _EXPECTED, place=f"row {row}"):
            for one in images:
                returns = returns_of(one[..., 0], sensor, pose, world)
                of_points = one[returns.row, returns.column]
                found.append(
                    {
                        **dict(zip("xyz", returns.points.T, strict=True)),
                        "intensity": of_points[:, _INTENSITY],
                        "ring": returns.row,
                        "column": returns.column,
                        "unlabelled": of_points[:, _ZONE] > 0,
                    }
                )
        return found


def _rows_of(path: Path, images: Sequence[str]) -> ImageRows:
    return ImageRows(path, tuple(f"{name}.{part}" for name in images for part in _PARTS))


def _sensors(path: Path, segment: str) -> dict[int, RangeImageSensor]:
    """Return the calibration of every laser by its number."""
    columns = (LASER, _EXTRINSIC, *(f"{_BEAMS}{name}" for name in ("min", "max", "values")))
    table = read_component(path, columns, segment)
    if table is None:
        raise InputError("not found, or empty", file=path, expected="the sensors' calibration")
    found = {}
    for row in range(len(next(iter(table.values()), ()))):
        with laid_out(path, _EXPECTED, place=f"row {row}"):
            matrix = matrix_of(table[_EXTRINSIC][row])
            values = table[f"{_BEAMS}values"][row] if f"{_BEAMS}values" in table else None
            given = values is not None and len(np.atleast_1d(values)) > 0
            found[int(table[LASER][row])] = RangeImageSensor(
                checked_pose(matrix[:3, :3], matrix[:3, 3]),
                np.asarray(values, np.float64) if given else None,
                *(np.nan if given else float(table[f"{_BEAMS}{n}"][row]) for n in ("min", "max")),
            )
    return found


def _poses(path: Path, segment: str) -> dict[int, Pose]:
    """Return where the vehicle was at every time."""
    table = read_component(path, (TIME, _WORLD), segment)
    found = {}
    for row in range(0 if table is None else len(next(iter(table.values()), ()))):
        assert table is not None
        with laid_out(path, _EXPECTED, place=f"row {row}"):
            matrix = matrix_of(table[_WORLD][row])
            found[int(table[TIME][row])] = checked_pose(matrix[:3, :3], matrix[:3, 3])
    return found


class _Labels:
    """The labelled objects of a segment by time; none in segments for tests."""

    def __init__(self, path: Path, segment: str) -> None:
        columns = (TIME, _OBJECT, *_SIDES, _TYPE, _INSIDE, *_SPEED)
        self._path = path
        self._table = read_component(path, columns, segment)
        with laid_out(path, _EXPECTED):
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
            with laid_out(self._path, _EXPECTED, place=f"row {row}"):
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
