"""KITTI's object benchmark: ``velodyne``, ``label_2`` and ``calib``.

Source: Geiger et al. 2012, and the development kit's readme. Labels are in the rectified frame of
the camera (x right, y down, z forward): the middle of the box's floor, and the turn about y.
Only what the camera saw is labelled, unless a folder ``label_all`` has what is on all sides, as our
export and MMDetection3D's converter of Waymo write it. Clouds that are cropped to what the camera
saw have a folder of their own (``velodyne_reduced``), as OpenPCDet and MMDetection3D write it: it
is read for frames that ``velodyne`` lacks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import finite_numbers, laid_out, read_lines
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, checked_pose
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = [
    "ALL_AROUND",
    "Calibration",
    "box_of_values",
    "is_kitti",
    "label_rows",
    "open_kitti",
    "read_calibration",
    "read_regions",
]

#: Folder of labels of what is on all sides.
ALL_AROUND = "label_all"
_CALIBRATION = "a calibration of KITTI"
#: Names of the transform from the sensor to the camera, of the turn that rectifies, and of the
#: left colour camera's projection, in the benchmarks of objects, tracking, odometry and raw data.
_FROM_LIDAR = ("Tr_velo_to_cam", "Tr_velo_cam", "Tr_velo2cam", "Tr")
_RECTIFIED = ("R0_rect", "R_rect", "R_rect_00")
_PROJECTIONS = ("P2", "P_rect_02")
#: Files of a raw recording; its ``calib_imu_to_velo.txt`` is of another sensor.
_RAW = ("calib_velo_to_cam.txt", "calib_cam_to_cam.txt")
_VALUES = 15  # a detection's line has its score as the sixteenth
_NOTE = "Only objects that the camera saw are labelled."
#: Levels of occlusion (none, partly, largely) as shares: the middle of each level's span
#: (docs/reference/labels.md).
_HIDDEN = {0: 0.0, 1: 0.4, 2: 0.8}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Where the sensor is in the rectified camera, and how the left colour camera sees.

    Attributes:
        camera_SE3_lidar: from the sensor into the rectified camera.
        projection: (3, 4) P2, pixels; None where the file has none.
    """

    camera_SE3_lidar: Pose  # noqa: N815
    projection: NDArray[np.float64] | None


def is_kitti(path: Path) -> bool:
    """Return whether a folder holds ``velodyne/*.bin`` beside labels, calibrations or images."""
    beside = ("label_2", "calib", "image_2")
    return bool(_clouds(path)) and any((path / name).is_dir() for name in beside)


def _clouds(path: Path) -> list[Path]:
    """Return the clouds as people count, those all around before the cropped ones."""
    parts = [clouds_in(path / name, ".bin") for name in ("velodyne_reduced", "velodyne")]
    return sorted({one.stem: one for part in parts for one in part}.values(), key=counting_order)


def open_kitti(path: Path, columns: int | None) -> Recording:
    """Open a folder of the benchmark; boxes where a frame has both label and calibration."""
    files = _clouds(path)
    around = (path / ALL_AROUND).is_dir()

    def read(index: int) -> Frame:
        file = files[index]
        labels = path / (ALL_AROUND if around else "label_2") / f"{file.stem}.txt"
        calibration = path / "calib" / f"{file.stem}.txt"
        boxes: Boxes | None = None
        notes: tuple[str, ...] = ()
        if labels.is_file() and calibration.is_file():
            boxes = _read_boxes(labels, read_calibration(calibration).camera_SE3_lidar)
            notes = () if around else (_NOTE,)
        fields = read_fields(file, columns or 4)
        return frame_of(file, fields, name=file.stem, boxes=boxes, notes=notes)

    return Recording(path, "kitti", tuple(file.stem for file in files), read)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration of any of KITTI's benchmarks.

    These are those of objects (``R0_rect:``, ``Tr_velo_to_cam:``), of tracking (``R_rect`` and
    ``Tr_velo_cam`` without colons), of odometry (``Tr:``, into the rectified camera) and of the raw
    recordings: ``calib_velo_to_cam.txt`` (``R:``, ``T:``) and ``calib_cam_to_cam.txt``
    (``R_rect_00:``, ``P_rect_02:``) beside each other, of which either may be named.

    Raises:
        InputError: missing, not laid out as KITTI's, or without the sensor's place.
    """
    with laid_out(path, _CALIBRATION):
        rows = _calibration_rows(path)
        if path.name in _RAW:
            for name in _RAW:
                if (path.parent / name).is_file():
                    rows = _calibration_rows(path.parent / name) | rows
        if "R" in rows and "T" in rows and path.name in _RAW:
            rows["Tr_velo_to_cam"] = np.column_stack([rows["R"].reshape(3, 3), rows["T"]])
        placed = next((rows[name] for name in _FROM_LIDAR if name in rows), None)
        if placed is None:
            raise InputError(
                f"has no place of the sensor, but {', '.join(rows)[:80] or 'nothing'}",
                file=path,
                expected=f"one of {', '.join(_FROM_LIDAR)}, or {_RAW[0]} beside {_RAW[1]}",
            )
        turned = next((rows[name] for name in _RECTIFIED if name in rows), np.eye(3))
        matrix = turned.reshape(3, 3) @ placed.reshape(3, 4)
        seen = next((rows[name] for name in _PROJECTIONS if name in rows), None)
        projection = None if seen is None else seen.reshape(3, 4)
        return Calibration(checked_pose(matrix[:, :3], matrix[:, 3]), projection)


def _calibration_rows(path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the numbers of each line by its name, with or without a colon after it."""
    rows = {}
    for line in read_lines(path, _CALIBRATION):
        name, _, values = line.replace(":", " ", 1).strip().partition(" ")
        if name and name != "calib_time":
            rows[name] = np.array(finite_numbers(values.split()))
    return rows


def _read_boxes(path: Path, camera_SE3_lidar: Pose) -> Boxes:
    lidar_SE3_camera = camera_SE3_lidar.inverse()
    labelled = []
    for _, name, values in label_rows(path, _VALUES):
        box = box_of_values(values[7:14], lidar_SE3_camera)
        hidden = _HIDDEN.get(int(values[1]), math.nan)
        labelled.append(LabelledBox(box, name, occlusion=hidden))
    return boxes_of(labelled)


def label_rows(path: Path, fewest: int) -> Iterator[tuple[int, str, NDArray[np.float64]]]:
    """Yield the line, the class and the numbers of each object of a text, without ``DontCare``.

    Args:
        path: of the text.
        fewest: words that a line has at least.

    Raises:
        InputError: a line has fewer, or one that is no number.
    """
    for number, line in enumerate(read_lines(path, "labels of KITTI"), 1):
        words = line.split()
        if not words or words[0] == "DontCare":
            continue
        try:
            values = np.array(finite_numbers(words[1:]))
            if len(words) < fewest:
                raise ValueError
        except ValueError:
            raise InputError(
                "is not a KITTI label",
                file=path,
                place=f"line {number}",
                expected=f"{fewest} values of KITTI",
            ) from None
        yield number, words[0], values


def read_regions(path: Path) -> NDArray[np.float64]:
    """Return the ``DontCare`` regions of an image: left, top, right, bottom (R, 4), pixels.

    Raises:
        InputError: a line is not a region.
    """
    found = []
    with laid_out(path, "labels of KITTI"):
        for line in read_lines(path, "labels of KITTI"):
            words = line.split()
            if words and words[0] == "DontCare":
                left, top, right, bottom = finite_numbers(words[4:8])
                found.append((left, top, right, bottom))
    return np.array(found, np.float64).reshape(-1, 4)


def box_of_values(
    values: NDArray[np.float64], lidar_SE3_camera: Pose
) -> tuple[float, float, float, float, float, float, float]:
    """Return a box in the sensor's frame from (7,) height, width, length, x, y, z, turn."""
    height, width, length, x, y, z, turn = values
    centre = lidar_SE3_camera.apply(np.array([[x, y - height / 2, z]]))[0]
    ahead = lidar_SE3_camera.rotation @ np.array([np.cos(turn), 0.0, -np.sin(turn)])
    yaw = np.arctan2(ahead[1], ahead[0])
    return (*centre.tolist(), float(length), float(width), float(height), float(yaw))
