"""Detections as the challenge writes them: ``{frame: [{"box": [7], "score": s, "class": c}]}``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.document import read_json_value
from urbantwin.errors import InputError
from urbantwin.fidelity.challenge.average_precision import Box
from urbantwin.fidelity.challenge.protocol import CLASSES

__all__ = ["read_detections"]

_EXPECTED = (
    '{"FRAME": [{"box": [x, y, z, length, width, height, yaw], "score": 0.9, "class": "Car"}]}'
)
#: Neither a place nor a size is larger, metres.
_LARGEST = 1e6


def read_detections(path: Path) -> dict[str, list[Box]]:
    """Read a map of detections.

    Boxes are in the frame of the real points: metres, radians, yaw counter-clockwise from +x.

    Raises:
        InputError: it is not such a map; the place is named.
    """
    read = read_json_value(path, _EXPECTED)
    if not isinstance(read, dict):
        raise InputError("is not a JSON object of frames", file=path, expected=_EXPECTED)
    return {str(frame): _boxes(path, str(frame), rows) for frame, rows in read.items()}


def _boxes(path: Path, frame: str, rows: Any) -> list[Box]:  # noqa: ANN401
    if not isinstance(rows, list):
        raise InputError("is not a list", file=path, place=frame, expected=_EXPECTED)
    found = []
    for index, row in enumerate(rows):
        place = f"{frame}[{index}]"
        if not isinstance(row, dict) or not {"box", "score", "class"} <= set(row):
            raise InputError(
                "lacks box, score or class", file=path, place=place, expected=_EXPECTED
            )
        box, score, name = row["box"], row["score"], row["class"]
        if not isinstance(box, list) or len(box) != 7 or not all(_is_number(v) for v in box):
            raise InputError("has no box of 7 numbers", file=path, place=place, expected=_EXPECTED)
        if min(box[3:6]) <= 0:
            raise InputError("has a box without extent", file=path, place=place, expected=_EXPECTED)
        if not _is_number(score):
            raise InputError("has no finite score", file=path, place=place, expected=_EXPECTED)
        if not isinstance(name, str) or name not in CLASSES:
            raise InputError(
                f"class {name!r:.60} is unknown",
                file=path,
                place=place,
                expected=", ".join(CLASSES),
            )
        found.append(Box(np.array(box, np.float64), name, float(score)))
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
