"""KITTI's benchmarks: calibrations and object labels, and SemanticKITTI's labels of points.

Sources: Geiger et al. 2012 and the development kit's readme; Behley et al. 2019 and
semantic-kitti-api. Object labels are in the frame of the rectified camera (x right, y down, z
forward): the centre of the box's floor, and the rotation about y. Only the camera's view is
labelled, unless there is a folder ``label_all``, as in our export and in MMDetection3D's converter
of Waymo. Clouds cropped to the camera's view (``velodyne_reduced``, OpenPCDet and MMDetection3D)
are read for frames that ``velodyne`` lacks.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.labels import Box, LabelledBox, boxes_of, track_of
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields
from urbantwin.io.poses import checked_pose
from urbantwin.io.trust import finite_numbers, laid_out, read_lines
from urbantwin.taxonomy import semantic_classes, semantic_id

__all__ = [
    "ALL_AROUND",
    "CAMERA_NOTE",
    "KITTI",
    "KITTI_TRACKING",
    "OCCLUSION",
    "SEMANTIC_KITTI",
    "Calibration",
    "box_of_values",
    "calibration_rows",
    "frame_index",
    "label_rows",
    "read_calibration",
    "read_regions",
]

#: Folder of labels on all sides of the sensor.
ALL_AROUND = "label_all"
_CALIBRATION = "a calibration of KITTI"
#: Names of the transform from the sensor to the camera, of the rectifying rotation, and of the left
#: colour camera's projection, in the benchmarks of objects, tracking, odometry and raw data.
_FROM_LIDAR = ("Tr_velo_to_cam", "Tr_velo_cam", "Tr_velo2cam", "Tr")
_RECTIFIED = ("R0_rect", "R_rect", "R_rect_00")
_PROJECTIONS = ("P2", "P_rect_02")
#: Files of a raw recording; its ``calib_imu_to_velo.txt`` is of another sensor.
_RAW = ("calib_velo_to_cam.txt", "calib_cam_to_cam.txt")
_LABEL_WORDS = 15  # a detection has its score as the sixteenth
CAMERA_NOTE = "Only objects that the camera saw are labelled."
#: Occlusion levels (none, partly, largely) as shares: the centres of the levels
#: (docs/reference/labels.md).
OCCLUSION = {0: 0.0, 1: 0.4, 2: 0.8}
#: SemanticKITTI's classes without a counterpart -> our nearest class (semantic-kitti.yaml): parked
#: bicycles, and moving people and vehicles.
_NEAREST = {
    11: "other-object", 13: "bus", 20: "truck", 60: "road",
    252: "car", 253: "bicyclist", 254: "pedestrian", 255: "motorcyclist",
    256: "on-rails", 257: "bus", 258: "truck", 259: "truck",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Calibration:
    """Pose of the sensor in the rectified camera, and the left colour camera's projection.

    Attributes:
        camera_SE3_lidar: from the sensor into the rectified camera.
        projection: (3, 4) P2, pixels; None if the file has none.
    """

    camera_SE3_lidar: Pose  # noqa: N815
    projection: NDArray[np.float64] | None


def _clouds(path: Path) -> list[Path]:
    parts = [clouds_in(path / name, ".bin") for name in ("velodyne_reduced", "velodyne")]
    return sorted({file.stem: file for part in parts for file in part}.values(), key=counting_order)


def _object_labels(path: Path, files: list[Path]) -> Labels:
    """Return the reader of boxes for frames with a label and a calibration."""
    around = (path / ALL_AROUND).is_dir()

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        labels = path / (ALL_AROUND if around else "label_2") / f"{file.stem}.txt"
        calibration = path / "calib" / f"{file.stem}.txt"
        if not (labels.is_file() and calibration.is_file()):
            return {}
        lidar_SE3_camera = read_calibration(calibration).camera_SE3_lidar.inverse()
        labelled = [
            LabelledBox(
                box_of_values(values[7:14], lidar_SE3_camera),
                name,
                occlusion=OCCLUSION.get(int(values[1]), math.nan),
            )
            for _, name, values in label_rows(labels, _LABEL_WORDS)
        ]
        return {"boxes": boxes_of(labelled), "notes": () if around else (CAMERA_NOTE,)}

    return Labels(read)


def frame_index(cloud: Path, index: int) -> int:
    """Return the frame of a cloud by its name, as some clouds are missing; else its index."""
    return int(cloud.stem) if cloud.stem.isdigit() else index


def read_calibration(path: Path) -> Calibration:
    """Return a calibration of any of KITTI's benchmarks.

    These are those of objects (``R0_rect:``, ``Tr_velo_to_cam:``), of tracking (``R_rect`` and
    ``Tr_velo_cam`` without colons), of odometry (``Tr:``, into the rectified camera) and of the raw
    recordings: ``calib_velo_to_cam.txt`` (``R:``, ``T:``) and ``calib_cam_to_cam.txt``
    (``R_rect_00:``, ``P_rect_02:``) beside each other, of which either may be given.

    Raises:
        InputError: missing, of another layout, or without the sensor's pose.
    """
    with laid_out(path, _CALIBRATION):
        rows = calibration_rows(path)
        if path.name in _RAW:
            for name in _RAW:
                if (path.parent / name).is_file():
                    rows = calibration_rows(path.parent / name) | rows
        if "R" in rows and "T" in rows and path.name in _RAW:
            rows["Tr_velo_to_cam"] = np.column_stack([rows["R"].reshape(3, 3), rows["T"]])
        placed = next((rows[name] for name in _FROM_LIDAR if name in rows), None)
        if placed is None:
            raise InputError(
                f"has no place of the sensor, but {', '.join(rows)[:80] or 'nothing'}",
                file=path,
                expected=f"one of {', '.join(_FROM_LIDAR)}, or {_RAW[0]} beside {_RAW[1]}",
            )
        rectified = next((rows[name] for name in _RECTIFIED if name in rows), np.eye(3))
        matrix = rectified.reshape(3, 3) @ placed.reshape(3, 4)
        projection = next((rows[name] for name in _PROJECTIONS if name in rows), None)
        return Calibration(
            checked_pose(matrix[:, :3], matrix[:, 3]),
            None if projection is None else projection.reshape(3, 4),
        )


def calibration_rows(path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the numbers of each line by its name, with or without a colon after it."""
    rows = {}
    for line in read_lines(path, _CALIBRATION):
        name, _, values = line.replace(":", " ", 1).strip().partition(" ")
        if name and name != "calib_time":
            rows[name] = np.array(finite_numbers(values.split()))
    return rows


def label_rows(
    path: Path, fewest: int, leading: int = 0
) -> Iterator[tuple[int, str, NDArray[np.float64]]]:
    """Yield line, class and numbers of each object of a label file, without ``DontCare``.

    Args:
        path: the label file.
        fewest: minimum number of words per line.
        leading: number of words before the class: 2 in the tracking benchmark (frame, track). They
            are the first of the yielded numbers.

    Raises:
        InputError: a line has fewer words, or one that is not a number.
    """
    for number, line in enumerate(read_lines(path, "labels of KITTI"), 1):
        words = line.split()
        name = words[leading : leading + 1]
        if not words or name == ["DontCare"]:
            continue
        try:
            values = np.array(finite_numbers(words[:leading] + words[leading + 1 :]))
            if len(words) < fewest:
                raise ValueError
        except ValueError:
            raise InputError(
                "is not a KITTI label",
                file=path,
                place=f"line {number}",
                expected=f"{fewest} values of KITTI",
            ) from None
        yield number, name[0], values


def read_regions(path: Path) -> NDArray[np.float64]:
    """Return the ``DontCare`` regions of an image: left, top, right, bottom (R, 4), pixels.

    Raises:
        InputError: a line is not a region.
    """
    regions = []
    with laid_out(path, "labels of KITTI"):
        for line in read_lines(path, "labels of KITTI"):
            words = line.split()
            if words and words[0] == "DontCare":
                left, top, right, bottom = finite_numbers(words[4:8])
                regions.append((left, top, right, bottom))
    return np.array(regions, np.float64).reshape(-1, 4)


def box_of_values(values: NDArray[np.float64], lidar_SE3_camera: Pose) -> Box:
    """Return a box in the sensor's frame from (7,) height, width, length, x, y, z, rotation."""
    height, width, length, x, y, z, rotation = values
    centre = lidar_SE3_camera.apply(np.array([[x, y - height / 2, z]]))[0]
    ahead = lidar_SE3_camera.rotation @ np.array([np.cos(rotation), 0.0, -np.sin(rotation)])
    yaw = np.arctan2(ahead[1], ahead[0])
    return (*centre.tolist(), float(length), float(width), float(height), float(yaw))


KITTI = FolderDataset(
    name="kitti",
    title="KITTI",
    detect=lambda path: (
        bool(_clouds(path))
        and any((path / name).is_dir() for name in ("label_2", "calib", "image_2"))
    ),
    clouds=_clouds,
    labels=_object_labels,
    verified=True,
)


def _sequences(path: Path) -> list[Path]:
    """Return the folders of clouds: a sequence itself, or those of a split of the benchmark."""
    folder = path.absolute()
    folders = [folder]
    if (folder / "velodyne").is_dir():
        folders = sorted(sub for sub in (folder / "velodyne").iterdir() if sub.is_dir())
    return [
        sequence
        for sequence in folders
        if sequence.parent.name == "velodyne"
        and (sequence.parent.parent / "calib" / f"{sequence.name}.txt").is_file()
        and clouds_in(sequence, ".bin")
    ]


def _tracking_labels(path: Path, files: list[Path]) -> Labels:
    """Return the labels of a sequence, whose lines begin with the frame and the track."""
    (sequence,) = _sequences(path)
    split, name = sequence.parent.parent, sequence.name
    labels = split / "label_02" / f"{name}.txt"
    if not labels.is_file():
        return Labels(lambda file, index, fields: {})
    calibration = read_calibration(split / "calib" / f"{name}.txt")
    lidar_SE3_camera = calibration.camera_SE3_lidar.inverse()
    frames: dict[int, list[LabelledBox]] = defaultdict(list)
    for _, source_name, values in label_rows(labels, _LABEL_WORDS + 2, leading=2):
        frame, track, _, occluded = map(int, values[:4])
        frames[frame].append(
            LabelledBox(
                box_of_values(values[9:16], lidar_SE3_camera),
                source_name,
                track=track_of(f"{name} {track}"),
                occlusion=OCCLUSION.get(occluded, math.nan),
            )
        )

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        return {"boxes": boxes_of(frames.get(frame_index(file, index), []))}

    return Labels(read, (CAMERA_NOTE,))


KITTI_TRACKING = FolderDataset(
    name="kitti-tracking",
    title="KITTI tracking",
    detect=lambda path: len(_sequences(path)) == 1,
    clouds=lambda path: clouds_in(_sequences(path)[0], ".bin"),
    labels=_tracking_labels,
    verified=False,
)


def _point_labels(path: Path, files: list[Path]) -> Labels:
    """Return the reader of class (low 16 bits) and instance (high 16 bits) of every point."""
    ours = np.zeros(1 << 16, np.int64)
    for name in semantic_classes():
        ours[semantic_id(name)] = semantic_id(name)
    for number, name in _NEAREST.items():
        ours[number] = semantic_id(name)

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        labels = path / "labels" / f"{file.stem}.label"
        if not labels.is_file():
            return {}
        expected = "a label of 4 bytes for every point"
        with laid_out(labels, expected):
            code = np.frombuffer(read_bytes(labels, expected), "<u4")
        return {"given": {"semantic": ours[code & 0xFFFF], "instance": code >> 16}}

    return Labels(read)


def _sequence_poses(path: Path, files: list[Path]) -> Callable[[Path, int], Pose | None]:
    """Return the reader of sensor poses from ``poses.txt`` (left camera) and Tr of ``calib.txt``.

    Source: ``parse_poses`` of semantic-kitti-api.
    """
    file, calibration = path / "poses.txt", path / "calib.txt"
    poses: list[Pose] = []
    if file.is_file() and calibration.is_file():
        camera_SE3_lidar = read_calibration(calibration).camera_SE3_lidar
        lidar_SE3_camera = camera_SE3_lidar.inverse()
        cameras = []
        with laid_out(file, "12 values a line"):
            for line in read_lines(file, "12 values a line"):
                if line.split():
                    matrix = np.array(finite_numbers(line.split())).reshape(3, 4)
                    cameras.append(checked_pose(matrix[:, :3], matrix[:, 3]))
        poses = [lidar_SE3_camera @ camera @ camera_SE3_lidar for camera in cameras]

    def pose(cloud: Path, index: int) -> Pose | None:
        number = frame_index(cloud, index)
        return poses[number] if number < len(poses) else None

    return pose


SEMANTIC_KITTI = FolderDataset(
    name="semantic-kitti",
    title="SemanticKITTI",
    detect=lambda path: (
        bool(clouds_in(path / "velodyne", ".bin"))
        and (any((path / "labels").glob("*.label")) or (path / "poses.txt").is_file())
    ),
    clouds=lambda path: clouds_in(path / "velodyne", ".bin"),
    labels=_point_labels,
    pose=_sequence_poses,
    verified=False,
)
