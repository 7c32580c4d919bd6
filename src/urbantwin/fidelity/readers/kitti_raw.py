"""Drives of KITTI's raw recordings: clouds, tracklets and poses of the vehicle.

Sources: Geiger et al. 2013, and the raw development kit: ``readme.txt`` (frames of the sensors),
``readTracklets.m`` (the tracklets' XML; boxes are in the LiDAR's frame, their origin on the ground)
and ``convertOxtsToPose.m`` (poses by the Mercator projection scaled at the first latitude).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.kitti import calibration_rows
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, track_of
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields
from urbantwin.io.poses import checked_pose
from urbantwin.io.trust import finite_numbers, laid_out, read_lines
from urbantwin.strict_xml import child_elements

__all__ = ["KITTI_RAW"]

_CLOUDS = "velodyne_points/data"
_TRACKLETS = "tracklet_labels.xml"
_EARTH_RADIUS_M = 6_378_137.0  # of the development kit's projection
#: Occlusion of a tracklet (visible, partly, fully) as shares; -1 is not set.
_OCCLUSION = {0: 0.0, 1: 0.4, 2: 0.8}


def _labels(path: Path, files: list[Path]) -> Labels:
    """Return the labels of ``tracklet_labels.xml``: per track a size and a pose per frame."""
    document = path / _TRACKLETS
    if not document.is_file():
        return Labels(lambda file, index, fields: {})
    frames: dict[int, list[LabelledBox]] = {}
    with laid_out(document, "tracklets of KITTI"), document.open("rb") as stream:
        tracks = next(child_elements(stream, ["tracklets"], document))
        for number, tracklet in enumerate(tracks.findall("item")):
            name = tracklet.findtext("objectType", "")
            length, width, height = finite_numbers(tracklet.findtext(k, "") for k in "lwh")
            first = int(tracklet.findtext("first_frame", ""))
            for offset, pose in enumerate(tracklet.findall("poses/item")):
                names = ("tx", "ty", "tz", "rz", "occlusion")
                x, y, z, yaw, occlusion = finite_numbers(pose.findtext(k, "") for k in names)
                box = (x, y, z + height / 2, length, width, height, yaw)
                labelled = LabelledBox(
                    box,
                    name,
                    track=track_of(f"{path.absolute().name} {number}"),
                    occlusion=_OCCLUSION.get(int(occlusion), math.nan),
                )
                frames.setdefault(first + offset, []).append(labelled)

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        return {"boxes": boxes_of(frames.get(_frame(file, index), []))}

    return Labels(read, ("Only objects that the camera saw are labelled.",))


def _poses(path: Path, files: list[Path]) -> Callable[[Path, int], Pose | None]:
    """Return a function of poses, from ``oxts``; the world's origin is the first position."""
    calibration = next(
        (file for folder in (path, path.absolute().parent)
         if (file := folder / "calib_imu_to_velo.txt").is_file()), None,
    )  # fmt: skip
    oxts = path / "oxts" / "data"
    if calibration is None or not oxts.is_dir():
        return lambda file, index: None
    with laid_out(calibration, "a calibration of KITTI"):
        rows = calibration_rows(calibration)
        lidar_SE3_vehicle = checked_pose(rows["R"].reshape(3, 3), rows["T"])
    first = _position(sorted(oxts.glob("*.txt"))[0]) if any(oxts.glob("*.txt")) else None

    def pose(file: Path, index: int) -> Pose | None:
        record = oxts / f"{file.stem}.txt"
        if first is None or not record.is_file():
            return None
        scale, origin = first
        vehicle = _vehicle(record, scale)
        world_SE3_vehicle = Pose(vehicle.rotation, vehicle.translation - origin)
        return world_SE3_vehicle @ lidar_SE3_vehicle.inverse()

    return pose


def _position(record: Path) -> tuple[float, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return the projection's scale at a record's latitude, and its position in metres."""
    with laid_out(record, "a record of KITTI's GPS and IMU"):
        latitude = finite_numbers(read_lines(record, "a record of KITTI")[0].split()[:1])[0]
        scale = math.cos(math.radians(latitude))
    return scale, _vehicle(record, scale).translation


def _vehicle(record: Path, scale: float) -> Pose:
    """Return the pose of the vehicle (x forward, y left, z up) in metres east, north and up."""
    with laid_out(record, "a record of KITTI's GPS and IMU"):
        words = read_lines(record, "a record of KITTI")[0].split()[:6]
        latitude, longitude, altitude, roll, pitch, yaw = finite_numbers(words)
        x = scale * _EARTH_RADIUS_M * math.radians(longitude)
        y = scale * _EARTH_RADIUS_M * math.log(math.tan(math.pi / 4 + math.radians(latitude) / 2))
        return Pose.from_ypr((x, y, altitude), yaw=yaw, pitch=pitch, roll=roll)


def _frame(file: Path, index: int) -> int:
    return int(file.stem) if file.stem.isdigit() else index


KITTI_RAW = FolderDataset(
    name="kitti-raw",
    title="a drive of KITTI's raw recordings",
    detect=lambda path: bool(clouds_in(path / _CLOUDS, ".bin", ".txt")),
    clouds=lambda path: clouds_in(path / _CLOUDS, ".bin", ".txt"),
    labels=_labels,
    pose=_poses,
    verified=False,
)
