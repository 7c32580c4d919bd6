"""IPS300+: clouds of two roadside units, together or of the first; labels in JSON or text.

Source: Wang et al. 2022, and the IPS300+_dev_kit: ``split_data_generate_txtfile.py`` (JSON: centre,
size along the heading, turn counter-clockwise about z), ``IPS2coco.py`` (where numbers stand in the
text) and the reader of its viewer, which takes either. Labels are in the frame of the first unit's
sensor, and so are the joint clouds of ``PCD_COM_ROI`` (the viewer draws both with the pose of the
first unit's camera). What the kit makes cars of is called "Minibus".
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import (
    finite_numbers,
    laid_out,
    read_json_document,
    read_lines,
)
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["is_ips300", "open_ips300"]

_EXPECTED = "labels of IPS300+"
#: Folders of clouds in ``data``, and how names in them end: of both units, of the first.
_JOINT = "PCD_COM_ROI"
_ENDINGS = {_JOINT: "_COM_ROI", "IPU1_pcd": "_IPU1_LIDAR"}
#: Of a line: class, three of occlusion and angle, two rectangles of four, then height, width,
#: length, centre and turn.
_WORDS = 19
_NOTE = "Points of both units in the first one's frame: where the second stands is not told."


def _folder(path: Path) -> Path | None:
    """Return the folder of clouds: a path itself, or the joint ones of the set or its ``data``."""
    for one in (path.absolute(), path / _JOINT, path / "data" / _JOINT):
        if one.name in _ENDINGS and clouds_in(one, ".pcd"):
            return one
    return None


def is_ips300(path: Path) -> bool:
    """Return whether a folder is the set, its ``data``, or a folder of clouds in that."""
    return _folder(path) is not None


def open_ips300(path: Path) -> Recording:
    """Open clouds; boxes from ``label/json``, or from ``label/txt`` where that lacks a frame.

    Raises:
        InputError: there are no clouds.
    """
    folder = _folder(path)
    if folder is None:
        raise InputError("holds no clouds", file=path, expected=f"data/{_JOINT}/*.pcd")
    files = clouds_in(folder, ".pcd")
    labels = [one / "label" for one in folder.absolute().parents[:3]]

    def read(index: int) -> Frame:
        file = files[index]
        name = f"{file.stem.removesuffix(_ENDINGS[folder.name])}_LABEL"
        found = [
            one
            for kind, ending in (("json", ".json"), ("txt", ".txt"))
            for label in labels
            if (one := label / kind / f"{name}{ending}").is_file()
        ]
        boxes: Boxes | None = None
        if found:
            boxes = (_from_json if found[0].suffix == ".json" else _from_text)(found[0])
        return frame_of(file, read_fields(file), name=file.stem, boxes=boxes)

    notes = (_NOTE,) if folder.name == _JOINT else ()
    return Recording(path, "ips300", tuple(file.stem for file in files), read, notes)


def _from_json(path: Path) -> Boxes:
    with laid_out(path, _EXPECTED):
        objects = read_json_document(path, _EXPECTED)["objects"]
        if not isinstance(objects, list):
            raise TypeError("objects are no list")
    labelled = []
    for number, one in enumerate(objects):
        with laid_out(path, _EXPECTED, place=f"objects[{number}]"):
            labelled.append(_labelled(str(one["label"]), _box(one)))
    return boxes_of(labelled)


def _box(one: Mapping[str, Any]) -> tuple[float, float, float, float, float, float, float]:
    place, size = one["center"], one["dimensions"]
    return (
        float(place["x"]), float(place["y"]), float(place["z"]),
        float(size["length"]), float(size["width"]), float(size["height"]),
        float(one["rotation"]["z"]),
    )  # fmt: skip


def _from_text(path: Path) -> Boxes:
    labelled = []
    for number, line in enumerate(read_lines(path, _EXPECTED), 1):
        words = line.split()
        if not words or words[0] == "DontCare":
            continue
        try:
            if len(words) != _WORDS:
                raise ValueError(f"{len(words)} values")
            height, width, length, x, y, z, yaw = finite_numbers(words[12:])
        except ValueError as error:
            raise InputError(
                f"is no label ({error})",
                file=path,
                place=f"line {number}",
                expected=f"a class and {_WORDS - 1} numbers of IPS300+",
            ) from None
        labelled.append(_labelled(words[0], (x, y, z, length, width, height, yaw)))
    return boxes_of(labelled)


def _labelled(
    name: str, box: tuple[float, float, float, float, float, float, float]
) -> LabelledBox:
    return LabelledBox(box, name, class_name="car" if "minibus" in name.lower() else None)
