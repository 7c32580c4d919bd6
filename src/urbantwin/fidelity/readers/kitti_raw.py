"""Drives of KITTI's raw recordings: clouds, tracklets and poses of the vehicle.

Sources: Geiger et al. 2013, and the raw development kit: ``readme.txt`` (frames of the sensors),
``readTracklets.m`` (the tracklets' XML; boxes are in the LiDAR's frame, their origin on the ground)
and ``convertOxtsToPose.m`` (poses by the Mercator projection scaled at the first latitude).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.kitti import (
    CAMERA_NOTE,
    OCCLUSION,
    calibration_rows,
    frame_index,
)
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
_RECORD = "a record of KITTI's GPS and IMU"


def _labels(path: Path, files: list[Path]) -> Labels:
    """Return the labels of ``tracklet_labels.xml``: per track a size and a pose per frame."""
    document = path / _TRACKLETS
    if not document.is_file():
        return Labels(lambda file, index, fields: {})
    frames: dict[int, list[LabelledBox]] = defaultdict(list)
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
                    occlusion=OCCLUSION.get(int(occlusion), math.nan),
                )
                frames[first + offset].append(labelled)

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        return {"boxes": boxes_of(frames.get(frame_index(file, index), []))}

    return Labels(read, (CAMERA_NOTE,))


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
    records = sorted(oxts.glob("*.txt"))
    if not records:
        return lambda file, index: None
    scale = math.cos(math.radians(_measured(records[0])[0]))
    origin = _vehicle(records[0], scale).translation

    def pose(file: Path, index: int) -> Pose | None:
        record = oxts / f"{file.stem}.txt"
        if not record.is_file():
            return None
        vehicle = _vehicle(record, scale)
        world_SE3_vehicle = Pose(vehicle.rotation, vehicle.translation - origin)
        return world_SE3_vehicle @ lidar_SE3_vehicle.inverse()

    return pose


def _measured(record: Path) -> list[float]:
    """Return latitude and longitude (degrees), altitude (m), roll, pitch and yaw (rad)."""
    with laid_out(record, _RECORD):
        latitude, *others = finite_numbers(read_lines(record, _RECORD)[0].split()[:6])
        if len(others) != 5 or not abs(latitude) < 90.0:
            raise ValueError
        return [latitude, *others]


def _vehicle(record: Path, scale: float) -> Pose:
    """Return the pose of the vehicle (x forward, y left, z up) in metres east, north and up."""
    latitude, longitude, altitude, roll, pitch, yaw = _measured(record)
    x = scale * _EARTH_RADIUS_M * math.radians(longitude)
    y = scale * _EARTH_RADIUS_M * math.log(math.tan(math.pi / 4 + math.radians(latitude) / 2))
    return Pose.from_ypr((x, y, altitude), yaw=yaw, pitch=pitch, roll=roll)


KITTI_RAW = FolderDataset(
    name="kitti-raw",
    title="a drive of KITTI's raw recordings",
    detect=lambda path: bool(clouds_in(path / _CLOUDS, ".bin", ".txt")),
    clouds=lambda path: clouds_in(path / _CLOUDS, ".bin", ".txt"),
    labels=_labels,
    pose=_poses,
    verified=False,
)
