"""ASAM OpenLABEL beside clouds, in TUMTraf's layout: ``point_clouds``, ``labels_point_clouds``.

Source: ASAM OpenLABEL 1.0.0 (7.13.1: a cuboid is its centre, a quaternion x, y, z, w and its size
along its own axes), and the layout and names of the TUM Traffic dataset's dev-kit. Cuboids are in
the points' frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.exports.frames.pcd import point_record
from urbantwin.exports.frames.point_files import write_pcd_file
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.openlabel_document import openlabel_document, write_openlabel_file
from urbantwin.geometry import Pose
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import classes_in

__all__ = ["write_openlabel"]

CLOUDS, LABELS, SPLIT = "point_clouds", "labels_point_clouds", "data_split"
SITE = "site"
#: Occlusion levels with their largest hidden fraction; TUMTraf's annotators judge by eye, and the
#: limits are those of our difficulty levels.
_OCCLUSION = ((0.2, "NOT_OCCLUDED"), (0.6, "PARTIALLY_OCCLUDED"), (1.0, "MOSTLY_OCCLUDED"))


def write_openlabel(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write a PCD and a label file per frame, and lists of the split.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    sensors = [str(one["name"]) for one in source.sensors]
    cloud = sensors[0] if len(sensors) == 1 else _free("fused", sensors)
    for name in (CLOUDS, LABELS):
        (folder / name / cloud).mkdir(parents=True)
    for number in each(range(len(source)), tell, "frames"):
        frame = source[number]
        write_pcd_file(folder / CLOUDS / cloud / f"{frame.name}.pcd", point_record(frame))
        write_openlabel_file(
            folder / LABELS / cloud / f"{frame.name}.json", _document(frame, cloud, sensors)
        )
    for part, names in source.splits.items():
        for kind, ending in ((CLOUDS, "pcd"), (LABELS, "json")):
            file = folder / SPLIT / part / kind / cloud / "file_names.txt"
            file.parent.mkdir(parents=True)
            file.write_text("".join(f"{name}.{ending}\n" for name in names), encoding="utf-8")
    return [f"the points of {len(sensors)} sensors are in one cloud"] if len(sensors) > 1 else []


def _free(name: str, taken: Iterable[str]) -> str:
    while name in taken:
        name += "_"
    return name


def _document(frame: Frame, cloud: str, sensors: list[str]) -> dict[str, Any]:
    boxes = frame.objects
    theirs = classes_in("openlabel")
    named = {
        str(track): {"name": f"{theirs[kind]}_{track}", "type": theirs[kind]}
        for track, kind in zip(boxes.track.tolist(), boxes.class_name.tolist(), strict=True)
    }
    site = _free(SITE, [cloud, *sensors])
    here = {one: frame.site_SE3_sensors[one] for one in sensors}
    if cloud not in here or not _same(here[cloud], frame.site_SE3_dataset):
        # The points' frame differs from the sensor's: it is upright, shared by several sensors, or
        # the sensor has moved since the frame's time.
        points = _free("points", [site, *sensors]) if cloud in here else cloud
        here[points] = frame.site_SE3_dataset
    else:
        points = cloud
    systems = {
        site: {"type": "scene_cs", "parent": "", "children": list(here)},
        **{
            name: {
                "type": "sensor_cs" if name in sensors else "local_cs",
                "parent": site,
                "children": [],
                "pose_wrt_parent": _transform(pose),
            }
            for name, pose in here.items()
        },
    }
    moved = {
        f"{points}_to_{site}": {
            "src": points,
            "dst": site,
            "transform_src_to_dst": _transform(frame.site_SE3_dataset),
        }
    }
    data = dict(zip(named, _object_data(boxes, points), strict=True))
    return openlabel_document(
        frame.name,
        coordinate_systems=systems,
        streams={cloud: {"type": "lidar", "uri": f"{CLOUDS}/{cloud}"}},
        objects=named,
        frames={
            str(frame.number): {
                "frame_properties": {
                    "timestamp": frame.time_s,
                    "point_cloud_file_name": f"{frame.name}.pcd",
                    "transforms": moved,
                },
                "objects": {name: {"object_data": one} for name, one in data.items()},
            }
        },
    )


def _same(one: Pose, other: Pose) -> bool:
    return np.allclose(pose_matrix(one), pose_matrix(other), rtol=0, atol=1e-9)


def _transform(pose: Pose) -> dict[str, Any]:
    """Return a pose as 16 numbers, row by row."""
    return {"matrix4x4": [value for row in pose_matrix(pose) for value in row]}


def _object_data(boxes: LabelledObjects, system: str) -> list[dict[str, Any]]:
    """Return the cuboid of each box, with its attributes."""
    found = []
    for row, (x, y, z, length, width, height, yaw) in enumerate(boxes.box.tolist()):
        cuboid = {
            "name": "shape3D",
            "coordinate_system": system,
            "val": [x, y, z, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2), length, width, height],
            "attributes": _attributes(boxes, row),
        }
        found.append({"cuboid": [cuboid]})
    return found


def _attributes(boxes: LabelledObjects, row: int) -> dict[str, list[Mapping[str, Any]]]:
    numbers: dict[str, float] = {
        "num_points": int(boxes.num_points[row]),
        "num_points_alone": int(boxes.num_points_alone[row]),
        "occlusion": float(boxes.occlusion[row]),
        "truncation": float(boxes.truncation[row]),
        "observed_s": float(boxes.observed_s[row]),
    }
    if boxes.towed_by[row] >= 0:
        numbers["towed_by"] = int(boxes.towed_by[row])
    texts = {
        "occlusion_level": next(
            (name for most, name in _OCCLUSION if numbers["occlusion"] <= most), ""
        ),
        "difficulty": str(boxes.difficulty[row]),
        "ignored": str(boxes.ignored[row]),
    }
    return {
        "num": [
            {"name": name, "val": value} for name, value in numbers.items() if not math.isnan(value)
        ],
        "text": [{"name": name, "val": value} for name, value in texts.items() if value],
        "boolean": [{"name": "parked", "val": bool(boxes.parked[row])}],
        "vec": [{"name": "velocity", "val": boxes.velocity[row].tolist()}],
    }
