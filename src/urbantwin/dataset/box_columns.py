"""Boxes of a frame as label lines and as table columns."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.geometry import wrapped
from urbantwin.lidar import BoxLabel

__all__ = ["UNKNOWN_IS_NAN", "box_columns", "box_rows", "label_line", "label_lines"]
__all__ += ["packed_columns"]

_WHOLE = ("track", "num_points", "num_points_alone")
_TEXT = ("class", "difficulty", "ignored")
#: Columns with unknown values.
UNKNOWN_IS_NAN = ("occlusion", "visibility")
_LINE = " ".join(["%.4f"] * len(BOX)) + " %s\n"


def label_lines(boxes: Sequence[BoxLabel]) -> str:
    """Return ``x y z dx dy dz heading class`` for every box, one line each.

    Metres and radians with four decimals (a tenth of a millimetre). OpenPCDet's reader takes the
    last token as the class and everything before it as the box, so a line holds nothing else.
    """
    rows = _normal(_stacked([box.box for box in boxes], 7)).tolist()
    return "".join(_line(row, box.actor_class) for row, box in zip(rows, boxes, strict=True))


def label_line(box: NDArray[np.float64], name: str) -> str:
    """Return the label line of a box (7,) of a class."""
    return _line(_normal(box[None])[0].tolist(), name)


def box_columns(boxes: Sequence[BoxLabel]) -> dict[str, list[Any]]:
    """Return the table columns of a frame's boxes, as JSON-compatible lists by name.

    Boxes and velocities are in the dataset's frame: metres, radians, metres per second. Unknown
    values are ``None``.
    """
    placed = _normal(_stacked([box.box for box in boxes], 7))
    moving = _stacked([box.velocity for box in boxes], 3)
    return {
        "track": [box.track for box in boxes],
        "class": [box.actor_class for box in boxes],
        **dict(zip(BOX, placed.T.tolist(), strict=True)),
        "num_points": [box.num_points for box in boxes],
        "num_points_alone": [box.num_points_alone for box in boxes],
        "occlusion": [box.occlusion if box.num_points_alone else None for box in boxes],
        "visibility": [box.visibility if box.num_points_alone else None for box in boxes],
        "truncation": [box.truncation for box in boxes],
        "difficulty": [box.difficulty for box in boxes],
        "ignored": [box.ignored for box in boxes],
        "observed_s": [box.observed_s for box in boxes],
        **dict(zip(VELOCITY, moving.T.tolist(), strict=True)),
    }


def packed_columns(columns: Mapping[str, Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, in a fifth of the memory; unknown numbers are ``nan``."""
    packed: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        if name in _TEXT:
            shared = [None if value is None else sys.intern(value) for value in values]
            packed[name] = np.array(shared, object)
        else:
            packed[name] = np.array(values, np.int32 if name in _WHOLE else np.float64)
    return packed


def box_rows(columns: Mapping[str, NDArray[Any]]) -> list[dict[str, Any]]:
    """Return packed columns as rows; unknown values are ``None``."""
    lists = {name: values.tolist() for name, values in columns.items()}
    for name in UNKNOWN_IS_NAN:
        lists[name] = [None if value != value else value for value in lists[name]]  # noqa: PLR0124 - nan
    return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]


def _stacked(rows: Sequence[NDArray[np.float64]], width: int) -> NDArray[np.float64]:
    return np.array(rows, np.float64).reshape(-1, width)


def _normal(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return boxes (N, 7) with their yaw in [-pi, pi)."""
    boxes = boxes.copy()
    boxes[:, 6] = wrapped(boxes[:, 6])
    return boxes


def _line(box: Sequence[float], name: str) -> str:
    # Rounding must not give a negative zero.
    return (_LINE % (*box, name)).replace("-0.0000 ", "0.0000 ")
