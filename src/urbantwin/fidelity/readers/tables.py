"""Tables of boxes and poses beside clouds: ``boxes.csv``, ``frames.csv``, and rows of our exports.

``boxes.csv`` has the columns, in any order, ``frame``, ``class``, ``x``, ``y``, ``z`` (centre),
``length``, ``width``, ``height``, ``yaw`` (radians, counter-clockwise from +x); optional are
``track`` (number of the object over all frames), ``vx``, ``vy``, ``vz`` (over ground, m/s),
``num_points``, ``occlusion`` (0..1) and ``ignore`` (1: neither to be detected nor wrong if
detected; ``ignored`` gives the reason). Frames that are not listed are not labelled.

``frames.csv`` is written by `urbantwin export`: a row for each frame and each of its sensors. Its
columns are ``frame``, ``time_s`` (seconds from the start of the motion), ``part`` (of the split),
``of`` (``frame`` or the sensor's name), ``x``, ``y``, ``z``, ``qw``, ``qx``, ``qy``, ``qz``
(pose of its points in the site).
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import json_value
from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.labels import actor_class
from urbantwin.geometry import Pose
from urbantwin.io.poses import pose_of_quaternion
from urbantwin.io.trust import finite_numbers, read_lines
from urbantwin.number_text import finite_number, whole_number
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = [
    "BOX_LIST",
    "FRAME_LIST",
    "LABELS",
    "ListedFrame",
    "boxes_of_rows",
    "frame_number",
    "labels_of_message",
    "poses_of_frame",
    "read_box_list",
    "read_frame_list",
]

BOX_LIST, FRAME_LIST = "boxes.csv", "frames.csv"
#: Type of the messages with the labels of a frame in our MCAP files.
LABELS = "urbantwin.Labels"
_BOX_COLUMNS = ("frame", "class", *BOX)
_FARTHEST_M = 1e6
_FRAME_NUMBERS = ("time_s", "qw", "qx", "qy", "qz", "x", "y", "z")
_FRAME_COLUMNS = ("frame", "of", *_FRAME_NUMBERS)


def _rows_of(path: Path, expected: str) -> list[dict[str, str]]:
    try:
        return list(csv.DictReader(read_lines(path, expected), strict=True))
    except csv.Error as error:
        raise InputError(f"is not a table ({error})", file=path, expected=expected) from None


def frame_number(name: str) -> str:
    """Return the key of a frame in a list: its number without leading zeros, or its name's stem."""
    stem = name.split(".", maxsplit=1)[0]
    last = re.search(r"\d+$", stem)
    return stem if last is None else str(int(last[0])) if len(last[0]) <= 18 else last[0]


def read_box_list(path: Path) -> dict[str, Boxes]:
    """Return boxes by `frame_number`.

    Raises:
        InputError: a column is missing or a value is invalid; the error gives the line.
    """
    expected = f"a table with {', '.join(_BOX_COLUMNS)}"
    rows = _rows_of(path, expected)
    missing = [name for name in _BOX_COLUMNS if rows and name not in rows[0]]
    if missing or not rows:
        problem = f"lacks {missing[0]}" if missing else "has no rows"
        raise InputError(problem, file=path, expected=expected)
    by_frame: dict[str, list[dict[str, str]]] = defaultdict(list)
    for line, row in enumerate(rows, 2):
        try:
            values = finite_numbers(row[name] or "" for name in BOX)
            if min(values[3:6]) <= 0 or max(map(abs, values)) > _FARTHEST_M:
                raise ValueError
            if not row["frame"] or not row["class"]:
                raise ValueError
        except ValueError:
            raise InputError(
                "has no box", file=path, place=f"line {line}", expected="numbers, sizes above 0"
            ) from None
        by_frame[frame_number(row["frame"])].append(row)
    known = set(rows[0])
    return {frame: _boxes(some, known) for frame, some in by_frame.items()}


def _boxes(rows: list[dict[str, str]], known: set[str]) -> Boxes:
    def whole(name: str) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        return np.array([_or(whole_number(row[name]), -1) for row in rows], np.int64)

    hidden = [_or(finite_number(row.get("occlusion")), np.nan) for row in rows]
    return Boxes(
        box=np.array([finite_numbers(row[name] for name in BOX) for row in rows], np.float64),
        class_names=tuple(actor_class(row["class"]) for row in rows),
        track=whole("track") if "track" in known else np.full(len(rows), -1, np.int64),
        source_names=tuple(row["class"] for row in rows),
        num_points=whole("num_points") if "num_points" in known else None,
        occlusion=np.array(hidden, np.float64) if "occlusion" in known else None,
        velocity=np.array(
            [[_or(finite_number(row[axis]), np.nan) for axis in VELOCITY] for row in rows]
        )
        if known.issuperset(VELOCITY)
        else None,
        ignored=tuple(
            (row.get("ignored") or "marked") if row["ignore"] not in ("0", "", None) else ""
            for row in rows
        )
        if "ignore" in known
        else None,
    )


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


@dataclass(frozen=True, eq=False)
class ListedFrame:
    """A frame's time, its pose in the site, and the sensor positions (S, 3) in the frame."""

    time_s: float
    site_SE3_frame: Pose  # noqa: N815
    sensor_places: NDArray[np.float64]


def read_frame_list(path: Path) -> dict[str, ListedFrame]:
    """Return the frames of a list by name.

    Raises:
        InputError: a column is missing or a value is invalid; the error gives the line.
    """
    expected = f"a table with {', '.join(_FRAME_COLUMNS)}"
    poses: dict[str, dict[str, tuple[float, Pose]]] = {}
    rows = _rows_of(path, expected)
    if not rows or any(name not in rows[0] for name in _FRAME_COLUMNS):
        raise InputError("lacks columns or rows", file=path, expected=expected)
    for line, row in enumerate(rows, 2):
        try:
            time_s, *numbers = finite_numbers(row[name] or "" for name in _FRAME_NUMBERS)
            w, x, y, z, *place = numbers
            pose = pose_of_quaternion(w, x, y, z, place)
        except ValueError:
            raise InputError(
                "has no pose", file=path, place=f"line {line}", expected="numbers, a quaternion"
            ) from None
        poses.setdefault(row["frame"], {})[row["of"]] = time_s, pose
    frames = {}
    for name, own in poses.items():
        if "frame" not in own:
            raise InputError(f"lacks the pose of frame {name[:40]}", file=path, expected=expected)
        time_s, site_SE3_frame = own.pop("frame")
        sensors = [pose.translation for _, pose in own.values()]
        places = site_SE3_frame.inverse().apply(np.array(sensors).reshape(-1, 3))
        frames[name] = ListedFrame(time_s, site_SE3_frame, places)
    return frames


def boxes_of_rows(rows: Sequence[Mapping[str, Any]]) -> Boxes:
    """Return the boxes of a frame from its rows, as ``exports.frames.box_rows`` writes them.

    Raises:
        ValueError, KeyError, TypeError: a value is missing or not a number.
    """
    box = np.array([[float(row[name]) for name in BOX] for row in rows], np.float64)
    box = box.reshape(-1, 7)
    velocity = np.array([[float(row[name]) for name in VELOCITY] for row in rows])
    if not np.isfinite(box).all() or not (box[:, 3:6] > 0).all():
        raise ValueError("a box without a size")
    occlusion = [np.nan if row["occlusion"] is None else float(row["occlusion"]) for row in rows]
    names = [str(row["class"]) for row in rows]
    return Boxes(
        box=box,
        class_names=tuple(name if name in ACTOR_CLASSES else "other" for name in names),
        track=np.array([int(row["track"]) for row in rows], np.int64),
        source_names=tuple(names),
        velocity=velocity.reshape(-1, 3),
        num_points=np.array([int(row["num_points"]) for row in rows], np.int64),
        occlusion=np.array(occlusion, np.float64),
        ignored=tuple(str(row["ignored"] or "") for row in rows),
    )


def poses_of_frame(record: Mapping[str, Any]) -> tuple[Pose, NDArray[np.float64]]:
    """Return site_SE3_frame, and the sensor positions in the frame of the points (S, 3).

    Raises:
        ValueError, KeyError, TypeError: a matrix is not a pose.
    """
    site_SE3_frame = pose_of_matrix(record["site_SE3_frame"])
    sensors = [pose_of_matrix(rows).translation for rows in record["site_SE3_sensors"].values()]
    places = np.array(sensors, np.float64).reshape(-1, 3)
    return site_SE3_frame, site_SE3_frame.inverse().apply(places)


def labels_of_message(data: bytes, file: Path, place: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a frame, and its boxes, pose and sensor positions as arguments of `Frame`.

    Raises:
        InputError: the message is not JSON.
        ValueError, KeyError, TypeError: the message has another layout.
    """
    told = json_value(data, file=f"{file}: {place}", expected="the labels of a frame")
    pose, places = poses_of_frame(told)
    boxes = boxes_of_rows(told["boxes"])
    return str(told["name"]), {
        "boxes": boxes,
        "world_SE3_frame": pose,
        "sensor_places": places,
    }
