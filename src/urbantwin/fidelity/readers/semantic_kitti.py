"""SemanticKITTI sequences: ``velodyne``, ``labels``, ``poses.txt``, ``calib.txt``.

Source: Behley et al. 2019, and semantic-kitti-api. A label is 32 bits: the class in the low 16,
the instance in the high 16. Poses are of the left camera; with Tr of ``calib.txt`` they become
the sensor's (the api's ``parse_poses``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.documents import finite_numbers, laid_out, read_lines
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.kitti import read_calibration
from urbantwin.fidelity.readers.labels import checked_pose
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose
from urbantwin.taxonomy import semantic_classes, semantic_id

__all__ = ["is_semantic_kitti", "open_semantic_kitti"]

#: Classes of theirs that we do not have -> the nearest of ours (semantic-kitti.yaml): bicycles
#: that stand and moving people and vehicles among them.
_NEAREST = {
    11: "other-object", 13: "bus", 20: "truck", 60: "road",
    252: "car", 253: "bicyclist", 254: "pedestrian", 255: "motorcyclist",
    256: "on-rails", 257: "bus", 258: "truck", 259: "truck",
}  # fmt: skip
_LARGEST = 1 << 16


def is_semantic_kitti(path: Path) -> bool:
    """Return whether a folder is a sequence: scans beside labels per point, or its poses."""
    if not clouds_in(path / "velodyne", ".bin"):
        return False
    return any((path / "labels").glob("*.label")) or (path / "poses.txt").is_file()


def open_semantic_kitti(path: Path, columns: int | None) -> Recording:
    """Open one sequence; labels and poses where they are there.

    Raises:
        InputError: poses or calibration are not right.
    """
    files = clouds_in(path / "velodyne", ".bin")
    poses = _poses(path)
    known = _our_classes()

    def read(index: int) -> Frame:
        file = files[index]
        given: dict[str, NDArray[Any]] = {}
        labels = path / "labels" / f"{file.stem}.label"
        if labels.is_file():
            expected = "a label of 4 bytes for every point"
            with laid_out(labels, expected):
                code = np.frombuffer(read_bytes(labels, expected), "<u4")
            given = {"semantic": known[code & 0xFFFF], "instance": code >> 16}
        number = int(file.stem) if file.stem.isdigit() else index
        return frame_of(
            file,
            read_fields(file, columns or 4),
            name=file.stem,
            given=given,
            world_SE3_frame=poses[number] if number < len(poses) else None,
        )

    return Recording(path, "semantic-kitti", tuple(file.stem for file in files), read)


def _our_classes() -> NDArray[np.int64]:
    """Return our class for each of theirs; 0, unlabelled, where there is none."""
    table = np.zeros(_LARGEST, np.int64)
    for name in semantic_classes():
        table[semantic_id(name)] = semantic_id(name)
    for number, name in _NEAREST.items():
        table[number] = semantic_id(name)
    return table


def _poses(path: Path) -> list[Pose]:
    """Return the sensor's pose in the first frame of each frame; none where the files miss."""
    file, calibration = path / "poses.txt", path / "calib.txt"
    if not (file.is_file() and calibration.is_file()):
        return []
    camera_SE3_lidar = read_calibration(calibration).camera_SE3_lidar
    with laid_out(file, "12 values a line"):
        cameras = [_pose(line) for line in read_lines(file, "12 values a line") if line.split()]
    lidar_SE3_camera = camera_SE3_lidar.inverse()
    return [lidar_SE3_camera @ camera @ camera_SE3_lidar for camera in cameras]


def _pose(line: str) -> Pose:
    matrix = np.array(finite_numbers(line.split())).reshape(3, 4)
    return checked_pose(matrix[:, :3], matrix[:, 3])
