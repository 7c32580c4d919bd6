"""KITTI's object benchmark: ``velodyne``, ``label_2`` and ``calib``.

Source: Geiger et al. 2012, and the development kit's readme. Labels are in the rectified frame of
the camera (x right, y down, z forward): the middle of the box's floor, and the turn about y.
Only what the camera saw is labelled.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import finite_numbers, laid_out, read_lines
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, checked_pose
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_kitti", "open_kitti"]

_VALUES = 15  # a detection's line has its score as the sixteenth


def is_kitti(path: Path) -> bool:
    """Return whether a folder holds ``velodyne/*.bin`` beside labels, calibrations or images."""
    beside = ("label_2", "calib", "image_2")
    return bool(clouds_in(path / "velodyne", ".bin")) and any(
        (path / name).is_dir() for name in beside
    )


def open_kitti(path: Path, columns: int | None) -> Recording:
    """Open a folder of the benchmark; boxes where a frame has both label and calibration."""
    files = clouds_in(path / "velodyne", ".bin")

    def read(index: int) -> Frame:
        file = files[index]
        labels = path / "label_2" / f"{file.stem}.txt"
        calibration = path / "calib" / f"{file.stem}.txt"
        boxes: Boxes | None = None
        notes: tuple[str, ...] = ()
        if labels.is_file() and calibration.is_file():
            boxes = _read_boxes(labels, _camera_SE3_lidar(calibration))
            notes = ("Only objects that the camera saw are labelled.",)
        fields = read_fields(file, columns or 4)
        return frame_of(file, fields, name=file.stem, boxes=boxes, notes=notes)

    return Recording(path, "kitti", tuple(file.stem for file in files), read)


def _camera_SE3_lidar(path: Path) -> Pose:  # noqa: N802
    """Return the pose of the sensor in the rectified camera: R0_rect times Tr_velo_to_cam."""
    with laid_out(path, "a calibration of KITTI"):
        rows = {}
        for line in read_lines(path, "a calibration of KITTI"):
            name, colon, values = line.partition(":")
            if colon:
                rows[name.strip()] = np.array(finite_numbers(values.split()))
        rectify = rows["R0_rect" if "R0_rect" in rows else "R_rect"].reshape(3, 3)
        found = rows["Tr_velo_to_cam" if "Tr_velo_to_cam" in rows else "Tr_velo_cam"]
        matrix = rectify @ found.reshape(3, 4)
        return checked_pose(matrix[:, :3], matrix[:, 3])


def _read_boxes(path: Path, camera_SE3_lidar: Pose) -> Boxes:
    lidar_SE3_camera = camera_SE3_lidar.inverse()
    labelled = []
    for number, line in enumerate(read_lines(path, "labels of KITTI"), 1):
        words = line.split()
        if not words or words[0] == "DontCare":
            continue
        try:
            values = np.array(finite_numbers(words[1:]))
            if len(values) + 1 < _VALUES:
                raise ValueError
        except ValueError:
            raise InputError(
                "is not a KITTI label",
                file=path,
                place=f"line {number}",
                expected="15 values of KITTI",
            ) from None
        labelled.append(LabelledBox(_box(values, lidar_SE3_camera), words[0]))
    return boxes_of(labelled)


def _box(
    values: NDArray[np.float64], lidar_SE3_camera: Pose
) -> tuple[float, float, float, float, float, float, float]:
    height, width, length, x, y, z, turn = values[7:14]
    centre = lidar_SE3_camera.apply(np.array([[x, y - height / 2, z]]))[0]
    ahead = lidar_SE3_camera.rotation @ np.array([np.cos(turn), 0.0, -np.sin(turn)])
    yaw = np.arctan2(ahead[1], ahead[0])
    return (*centre.tolist(), float(length), float(width), float(height), float(yaw))
