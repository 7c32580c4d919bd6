"""ONCE: a sequence with ``lidar_roof/*.bin`` and one JSON of its frames.

Source: Mao et al. 2021, the documentation of its format, and the once_devkit (``once.py``:
``frame_concat``, ``project_boxes_to_image``, and its issues 20 and 21). In the sensor's frame x is
to the left, y to the back and z up. A pose is a quaternion x, y, z, w and a place, of the sensor in
the frame of the sequence's first sweep; some sweeps have none. Boxes are centre, length, width,
height and the turn about z. Two sweeps a second are there, part of them labelled.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import laid_out, read_json_document
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, pose_of_quaternion
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_once", "open_once"]

_EXPECTED = "a sequence of ONCE"
_CLOUDS = "lidar_roof"
_NOTE = "The sensor's frame has x to the left and y to the back."


def is_once(path: Path) -> bool:
    """Return whether a folder is a sequence."""
    return bool(clouds_in(path / _CLOUDS, ".bin"))


def open_once(path: Path) -> Recording:
    """Open a sequence; boxes and poses where its JSON, named as the folder, has them.

    Raises:
        InputError: the JSON is not right.
    """
    files = clouds_in(path / _CLOUDS, ".bin")
    told = path / f"{path.absolute().name}.json"
    others = sorted(path.glob("*.json"))
    if not told.is_file() and len(others) == 1:
        told = others[0]  # of a folder that was renamed
    frames = _frames(told) if told.is_file() else {}

    def read(index: int) -> Frame:
        file = files[index]
        one = frames.get(file.stem, {})
        with laid_out(told, _EXPECTED, place=f"frame {file.stem}"):
            boxes, world = _boxes(one.get("annos")), _pose(one.get("pose"))
        return frame_of(
            file,
            read_fields(file, 4),
            name=file.stem,
            boxes=boxes,
            world_SE3_frame=world,
        )

    missing = len(frames.keys() - {file.stem for file in files})
    notes = [_NOTE]
    if missing:
        notes.append(f"{missing} of {len(frames)} sweeps are not there.")
    return Recording(path, "once", tuple(file.stem for file in files), read, tuple(notes))


def _frames(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return what the JSON says of each sweep by its name."""
    found: dict[str, Mapping[str, Any]] = {}
    with laid_out(path, _EXPECTED):
        listed = read_json_document(path, _EXPECTED)["frames"]
        if not isinstance(listed, list):
            raise TypeError("frames are no list")
    for number, one in enumerate(listed):
        with laid_out(path, _EXPECTED, place=f"frames[{number}]"):
            name = str(one["frame_id"])
            if name in found:
                raise InputError(f"has frame {name} twice", file=path, place=f"frames[{number}]")
            found[name] = {"pose": one.get("pose"), "annos": one.get("annos")}
    return found


def _boxes(annotations: Mapping[str, Any] | None) -> Boxes | None:
    if annotations is None or "names" not in annotations:
        return None
    labelled = []
    for name, one in zip(annotations["names"], annotations["boxes_3d"], strict=True):
        x, y, z, length, width, height, yaw = (float(value) for value in one)
        labelled.append(LabelledBox((x, y, z, length, width, height, yaw), str(name)))
    return boxes_of(labelled)


def _pose(values: list[float] | None) -> Pose | None:
    """Return a pose, None where the sweep has none: nothing, or nothing but zeros."""
    numbers = np.asarray([] if values is None else values, np.float64)
    if not numbers.any():
        return None
    x, y, z, w, *place = numbers.tolist()
    return pose_of_quaternion(w, x, y, z, place)
