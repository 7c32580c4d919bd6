"""Waymo Open Dataset, version 2: a segment in Parquet, with range images as points.

Sources: Sun et al. 2020, and the development kit (``waymo_open_dataset/v2``,
``docs/labeling_specifications.md``; ``range_image_utils.py``: ``compute_inclination``,
``compute_range_image_polar``, ``compute_range_image_cartesian``; ``lidar_utils.py``). Points, boxes
and the positions of the five sensors are in the vehicle's frame (x forward, y left, z up). Rows of
a range image are beams, the highest first. Columns are directions: from the last to the first,
counter-clockwise from straight back. Motion within a rotation is corrected by the vehicle's pose at
every pixel. The kit computes in 32 bits, this reader in 64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.waymo_tables import (
    EXPECTED,
    LASER,
    TIME,
    Columns,
    ImageRows,
    LabelledObjects,
    check_segment,
    classes_of,
    image_of,
    matrix_of,
    read_component,
)
from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.io.poses import checked_pose
from urbantwin.io.trust import laid_out

__all__ = ["RangeImageSensor", "is_waymo", "open_waymo", "returns_of"]

#: Maximum inclination of a beam, radians (with the rounding error of 32 bits).
_STEEPEST = np.pi / 2 + 1e-6


@dataclass(frozen=True, eq=False)
class RangeImageSensor:
    """Extrinsics and beam directions of a sensor.

    Attributes:
        vehicle_SE3_sensor: its extrinsics.
        inclination: (H,) radians above the sensor's x-y plane, the lowest first; None for evenly
            spaced beams.
        lowest, highest: bounds of evenly spaced inclinations, radians.
    """

    vehicle_SE3_sensor: Pose  # noqa: N815
    inclination: NDArray[np.float64] | None
    lowest: float
    highest: float

    def of_rows(self, height: int) -> NDArray[np.float64]:
        """Return the inclination of every row (height,) of an image, the highest first.

        Raises:
            ValueError: the sensor has another number of beams, or an invalid inclination.
        """
        found = self.inclination
        if found is None:
            step = (np.arange(height) + 0.5) / height
            found = self.lowest + step * (self.highest - self.lowest)
        if len(found) != height:
            raise ValueError(f"{height} rows for {len(found)} beams")
        if not (np.abs(found) <= _STEEPEST).all():
            raise ValueError("a beam without a direction")
        return found[::-1]


@dataclass(frozen=True, eq=False)
class Returns:
    """Returns of one image: points (N, 3) in the vehicle's frame, row and column (N,)."""

    points: NDArray[np.float64]
    row: NDArray[np.intp]
    column: NDArray[np.intp]


def returns_of(
    range_m: NDArray[np.floating],
    sensor: RangeImageSensor,
    pixel_pose: NDArray[np.floating] | None = None,
    world_SE3_vehicle: Pose | None = None,
) -> Returns:
    """Return the points of an image, row by row: pixels with a range above 0.

    Args:
        range_m: (H, W) ranges, metres.
        sensor: sensor of the image.
        pixel_pose: (H, W, 6) roll, pitch, yaw in radians and x, y, z in metres of the vehicle in
            the world at every pixel; requires ``world_SE3_vehicle``.
        world_SE3_vehicle: pose of the vehicle at the frame's time, the frame of the points.

    Raises:
        ValueError: the image does not match the sensor.
    """
    height, width = range_m.shape
    inclination = sensor.of_rows(height)
    row, column = np.nonzero(range_m > 0)
    turned = sensor.vehicle_SE3_sensor.rotation
    ahead = np.arctan2(turned[1, 0], turned[0, 0])
    azimuth = np.pi - (column + 0.5) * (2 * np.pi / width) - ahead
    away, up = range_m[row, column].astype(np.float64), inclination[row]
    flat = away * np.cos(up)
    seen = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), away * np.sin(up)])
    points = sensor.vehicle_SE3_sensor.apply(seen)
    if pixel_pose is not None and world_SE3_vehicle is not None:
        roll, pitch, yaw, *place = pixel_pose[row, column].astype(np.float64).T
        turn = rotation_from_ypr(yaw, pitch, roll)
        in_world = np.einsum("nij,nj->ni", turn, points) + np.column_stack(place)
        points = world_SE3_vehicle.inverse().apply(in_world)
    return Returns(points, row, column)


_RETURNS = tuple(f"[LiDARComponent].range_image_return{k}" for k in (1, 2))
_CLASSES = tuple(f"[LiDARSegmentationLabelComponent].range_image_return{k}" for k in (1, 2))
_PIXELS = "[LiDARPoseComponent].range_image_return1"
_EXTRINSIC = "[LiDARCalibrationComponent].extrinsic.transform"
_BEAMS = "[LiDARCalibrationComponent].beam_inclination."
_WORLD = "[VehiclePoseComponent].world_from_vehicle.transform"
#: Channels of a range image (range, intensity, elongation, no-label zone): number and indices.
_CHANNELS, _INTENSITY, _ZONE = 4, 1, 3
#: Values per pose, and the parts of a stored image: its values and its shape.
_POSE, _PARTS = 6, ("values", "shape")
_STILL = "Where the vehicle was at each pixel is not there: its motion within a turn stays in."


def is_waymo(path: Path) -> bool:
    """Return whether a path is a segment's range images, or a folder of components."""
    if path.suffix == ".parquet" and path.absolute().parent.name == "lidar":
        return path.is_file()
    return any((path / "lidar").glob("*.parquet"))


def open_waymo(path: Path) -> Recording:
    """Open a segment: its ``lidar/NAME.parquet``, or the folder of components if it has only one.

    Raises:
        InputError: there are several segments, the calibration is missing, or a table is invalid.
    """
    segment = _Segment(_file_of(path))
    names = tuple(map(str, segment.times))
    return Recording(path, "waymo2", names, segment.frame, segment.notes)


def _file_of(path: Path) -> Path:
    if path.is_file():
        return path
    found = sorted((path / "lidar").glob("*.parquet"))
    if len(found) != 1:
        names = ", ".join(item.name for item in found[:8])
        raise InputError(
            f"holds {len(found)} segments",
            file=path,
            expected=f"one of the files in lidar: {names}",
        )
    return found[0]


class _Segment:
    """A segment: small components are read at once, images frame by frame."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._images = _rows_of(file, _RETURNS)
        if not self._images.lasers:
            raise InputError("has no rows", file=file, expected=EXPECTED)
        self.times = sorted(self._images.lasers)
        segment = self._images.segment
        self._calibration = self._component("lidar_calibration")
        self._sensors = _sensors(self._calibration, segment)
        self._poses = _poses(self._component("vehicle_pose"), segment)
        self._labels = LabelledObjects(self._component("lidar_box"), segment)
        self._pixel_file = self._component("lidar_pose")
        self._pixels = self._of_part(self._pixel_file, (_PIXELS,)) if self._poses else None
        self._class_file = self._component("lidar_segmentation")
        self._classes = self._of_part(self._class_file, _CLASSES)
        self.notes = () if self._pixels is not None else (_STILL,)

    def _component(self, name: str) -> Path:
        # A link to the file finds the components beside the link.
        return self._file.absolute().parent.parent / name / self._file.name

    def _of_part(self, file: Path, images: Sequence[str]) -> ImageRows | None:
        """Return the rows of an optional component."""
        if not file.is_file():
            return None
        rows = _rows_of(file, images)
        if rows.lasers:
            check_segment(rows.segment, self._images.segment, file)
        return rows

    def frame(self, index: int) -> Frame:
        """Return a frame: both returns of every laser, laser by laser."""
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
        names = ("sensor", "unlabelled", "semantic", "instance")
        given = {name: fields.pop(name) for name in names if name in fields}
        lost = self._pixels is not None and (world is None or time not in self._pixels.lasers)
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
        """Return the fields of a laser's returns, the first returns before the second."""
        sensor, values = self._sensors[laser], self._images.row(row)
        with laid_out(self._file, EXPECTED, place=f"row {row}"):
            told = [image_of(values, name, _CHANNELS) for name in _RETURNS]
            images = [one for one in told if one is not None]
            for one in images:
                sensor.of_rows(len(one))
        pose = None
        if self._pixels is not None and laser in self._pixels.lasers.get(time, {}):
            at = self._pixels.lasers[time][laser]
            values = self._pixels.row(at)
            with laid_out(self._pixel_file, EXPECTED, place=f"row {at}"):
                pose = image_of(values, _PIXELS, _POSE)
                if pose is not None and any(one.shape[:2] != pose.shape[:2] for one in images):
                    raise ValueError(f"poses of {pose.shape[:2]} for {images[0].shape[:2]} pixels")
        labels = self._labels_of(time, laser, told)
        found = []
        with laid_out(self._file, EXPECTED, place=f"row {row}"):
            for image, classes in zip(told, labels, strict=True):
                if image is None:
                    continue
                returns = returns_of(image[..., 0], sensor, pose, world)
                of_points = image[returns.row, returns.column]
                found.append(
                    {
                        **dict(zip("xyz", returns.points.T, strict=True)),
                        "intensity": of_points[:, _INTENSITY],
                        "ring": returns.row,
                        "column": returns.column,
                        "unlabelled": of_points[:, _ZONE] > 0,
                    }
                )
                if classes is not None:
                    semantic, instance = classes_of(classes[returns.row, returns.column])
                    found[-1] |= {"semantic": semantic, "instance": instance}
        return found

    def _labels_of(
        self, time: int, laser: int, images: Sequence[NDArray[np.floating] | None]
    ) -> list[NDArray[np.integer] | None]:
        """Return instance and class (H, W, 2) of images, zeros for images without labels.

        All are None for a frame without labels per pixel.
        """
        if self._classes is None or time not in self._classes.lasers:
            return [None for _ in images]
        told: list[NDArray[np.integer] | None] = [None for _ in images]
        if laser in self._classes.lasers[time]:
            at = self._classes.lasers[time][laser]
            values = self._classes.row(at)
            with laid_out(self._class_file, EXPECTED, place=f"row {at}"):
                told = [image_of(values, name, 2, "i") for name in _CLASSES]
                for image, labels in zip(images, told, strict=True):
                    if image is None or labels is None:
                        continue
                    if image.shape[:2] != labels.shape[:2]:
                        sides = f"{labels.shape[:2]} for {image.shape[:2]}"
                        raise ValueError(f"labels of {sides} pixels")
        return [
            np.zeros((*image.shape[:2], 2), np.int32)
            if labels is None and image is not None
            else labels
            for image, labels in zip(images, told, strict=True)
        ]


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
        with laid_out(path, EXPECTED, place=f"row {row}"):
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
    """Return the vehicle's pose at every time."""
    table = read_component(path, (TIME, _WORLD), segment)
    found = {}
    for row in range(0 if table is None else len(next(iter(table.values()), ()))):
        assert table is not None
        with laid_out(path, EXPECTED, place=f"row {row}"):
            matrix = matrix_of(table[_WORLD][row])
            found[int(table[TIME][row])] = checked_pose(matrix[:3, :3], matrix[:3, 3])
    return found
