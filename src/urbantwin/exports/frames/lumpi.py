"""LUMPI: measurements of PLY clouds, ten per second, ``Label.csv``, and a common ``meta.json``.

Source: Busch et al. 2022, and the readme and ``LumpiParser`` of the LUMPI SDK: clouds are read in
the order of their names, and the labels of a cloud are those whose time, in tenths of a second, is
its index. So a measurement consists of frames without a gap, and a new one begins after a gap.
Everything is in the site frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import write_json
from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.errors import InputError
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.point_files import record_of, write_ply_file
from urbantwin.exports.frames.scenes import scenes_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import classes_in

__all__ = ["CLASSES", "losses_lumpi", "write_lumpi"]

#: Class names by number, from the SDK's readme.
CLASSES = ("person", "car", "bicycle", "motorcycle", "bus", "truck", "unknown")
#: The SDK leaves the first line, of names, and the last column, of shapes, out.
COLUMNS = (
    "time",
    "object_id",
    "rectangle_x",
    "rectangle_y",
    "rectangle_width",
    "rectangle_height",
    "score",
    "class_id",
    "visibility",
    "x",
    "y",
    "z",
    "length",
    "width",
    "height",
    "heading",
    "shape",
)
_STEP_S, _JITTER_S = 0.1, 1e-3
#: Mark of labels checked by a person.
_CORRECTED = 4
_INTENSITY = 255


def losses_lumpi(source: FrameSource) -> list[str]:
    """Check the frame rate of ten per second, and return notes on lost precision.

    Raises:
        InputError: the dataset has another rate.
    """
    if abs(source.rate_hz * _STEP_S - 1) > _JITTER_S:
        raise InputError(
            f"has {source.rate_hz:g} frames a second",
            file=source.folder / "dataset.json",
            place="rig: rate_hz",
            expected="10, by which LUMPI numbers clouds (rate_hz: 10 in the rig)",
        )
    told = ["of points: time in whole microseconds"]
    if source.manifest["frame"] == "sensor" and source.labelled_classes:
        told.append("of boxes: only the heading, where the frame of the points is tilted")
    return told


def write_lumpi(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``MeasurementK/lidar/*.ply``, ``MeasurementK/Label.csv`` and ``meta.json``.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    scenes = scenes_of(source, 1.5 * _STEP_S)
    place = {number: (k, scene.numbers[0]) for k, scene in enumerate(scenes)
             for number in scene.numbers}  # fmt: skip
    lines: list[list[str]] = [[",".join(COLUMNS)] for _ in scenes]
    for k in range(len(scenes)):
        (folder / f"Measurement{k}" / "lidar").mkdir(parents=True)
    for number in each(range(len(source)), tell, "frames"):
        measurement, first = place[number]
        frame = source[number]
        start_s = float(source.times_s[first])
        file = folder / f"Measurement{measurement}" / "lidar" / f"{number - first:06d}.ply"
        write_ply_file(file, record_of(_columns(source, frame, measurement, start_s)))
        lines[measurement] += _labels(frame, (number - first) * _STEP_S)
    for k, text in enumerate(lines):
        (folder / f"Measurement{k}" / "Label.csv").write_text(
            "\n".join(text) + "\n", encoding="utf-8"
        )
    places = source[scenes[0].numbers[0]].site_SE3_sensors
    sessions = {}
    for k, scene in enumerate(scenes):
        for at, one in enumerate(source.sensors):
            sessions[str(_session(source, k, at))] = {
                "experimentId": k,
                "type": "lidar",
                "deviceId": at + 1,
                "name": one["name"],
                "model": one["model"],
                "extrinsic": pose_matrix(places[one["name"]]),
                "start_s": float(source.times_s[scene.numbers[0]]),
                "part": scene.part or "",
            }
    write_json(folder / "meta.json", {"session": sessions})
    parts = ", ".join(f"Measurement{k} {scene.part or 'no part'}" for k, scene in enumerate(scenes))
    return [f"of the split: {parts}"]


def _session(source: FrameSource, measurement: int, sensor: int) -> int:
    """Return the number of a sensor's session in a measurement."""
    return 1 + measurement * len(source.sensors) + sensor


def _columns(
    source: FrameSource, frame: Frame, measurement: int, start_s: float
) -> dict[str, NDArray[Any]]:
    """Return the columns of a LUMPI cloud."""
    names = frame.rays.dtype.names or ()
    none = np.zeros(len(frame.points))
    sensor = frame.rays["sensor"] if "sensor" in names else none.astype(np.uint8)
    ring = frame.rays["ring"] if "ring" in names else none.astype(np.uint16)
    time_s = frame.rays["time"].astype(np.float64) if "time" in names else none
    site = frame.site_SE3_dataset.apply(frame.xyz)
    azimuth, distance = none.copy(), none.copy()
    for number, one in enumerate(source.sensors):
        mine = sensor == number
        seen = frame.site_SE3_sensors[one["name"]].inverse().apply(site[mine])
        azimuth[mine] = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) % 360
        distance[mine] = np.linalg.norm(seen, axis=1)
    return {
        **{axis: site[:, k].astype(np.float32) for k, axis in enumerate("xyz")},
        "intensity": frame.intensity * np.float32(_INTENSITY),
        "time": np.round((frame.time_s - start_s + time_s) * 1e6),
        "id": sensor.astype(np.uint32) + np.uint32(_session(source, measurement, 0)),
        "ray": ring.astype(np.uint16),
        "azimuth": azimuth.astype(np.float32),
        "distance": distance.astype(np.float32),
    }


def _labels(frame: Frame, time_s: float) -> list[str]:
    boxes = frame.objects
    theirs = classes_in("lumpi")
    middles, rotations = site_boxes(frame)
    heading = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    along = np.abs(np.cos(heading)), np.abs(np.sin(heading))
    length, width, height = boxes.box[:, 3:6].T
    spans = length * along[0] + width * along[1], length * along[1] + width * along[0]
    found = []
    for row, kind in enumerate(boxes.class_name.tolist()):
        name = theirs[kind]
        if name is None:
            continue
        x, y, z = middles[row].tolist()
        wide, high = float(spans[0][row]), float(spans[1][row])
        values = (
            round(time_s, 6),
            int(boxes.track[row]),
            *(x - wide / 2, y + high / 2, wide, high),
            _CORRECTED,
            CLASSES.index(name),
            int(boxes.num_points[row]),
            *(x, y, z, float(length[row]), float(width[row]), float(height[row])),
            float(heading[row]),
        )
        found.append(",".join(map(repr, values)) + ",")
    return found
