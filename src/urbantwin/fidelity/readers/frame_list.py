"""``frames.csv`` beside clouds that `urbantwin export` wrote: where frames are, and when.

A row for each frame, and for each of its sensors: ``frame``, ``time_s`` (seconds from the start of
the motion), ``part`` (of the split), ``of`` (``frame`` or the sensor's name), ``x``, ``y``, ``z``,
``qw``, ``qx``, ``qy``, ``qz`` (the pose that takes its points to the site).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.documents import finite_numbers, read_lines
from urbantwin.fidelity.readers.labels import pose_of_quaternion
from urbantwin.geometry import Pose

__all__ = ["FRAME_LIST", "ListedFrame", "read_frame_list"]

FRAME_LIST = "frames.csv"
_NUMBERS = ("time_s", "qw", "qx", "qy", "qz", "x", "y", "z")
_NEEDED = ("frame", "of", *_NUMBERS)
_EXPECTED = f"a table with {', '.join(_NEEDED)}"


@dataclass(frozen=True, eq=False)
class ListedFrame:
    """What is told of a frame: its time, its place, and (S, 3) where its sensors are in it."""

    time_s: float
    site_SE3_frame: Pose  # noqa: N815
    sensor_places: NDArray[np.float64]


def read_frame_list(path: Path) -> dict[str, ListedFrame]:
    """Read what is told of frames, by their names.

    Raises:
        InputError: a column is missing or a value is wrong; the line is named.
    """
    poses: dict[str, dict[str, tuple[float, Pose]]] = {}
    try:
        rows = list(csv.DictReader(read_lines(path, _EXPECTED), strict=True))
    except csv.Error as error:
        raise InputError(f"is not a table ({error})", file=path, expected=_EXPECTED) from None
    if not rows or any(name not in rows[0] for name in _NEEDED):
        raise InputError("lacks columns or rows", file=path, expected=_EXPECTED)
    for line, row in enumerate(rows, 2):
        try:
            time_s, *numbers = finite_numbers(row[name] or "" for name in _NUMBERS)
            w, x, y, z, *place = numbers
            pose = pose_of_quaternion(w, x, y, z, place)
        except ValueError:
            raise InputError(
                "has no pose", file=path, place=f"line {line}", expected="numbers, a quaternion"
            ) from None
        poses.setdefault(row["frame"], {})[row["of"]] = time_s, pose
    found = {}
    for name, own in poses.items():
        if "frame" not in own:
            raise InputError(f"lacks the pose of frame {name[:40]}", file=path, expected=_EXPECTED)
        time_s, site_SE3_frame = own.pop("frame")
        sensors = [pose.translation for _, pose in own.values()]
        places = site_SE3_frame.inverse().apply(np.array(sensors).reshape(-1, 3))
        found[name] = ListedFrame(time_s, site_SE3_frame, places)
    return found
