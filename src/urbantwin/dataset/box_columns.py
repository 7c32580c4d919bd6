"""The boxes of a frame as text and as columns: what label files, marks and tables say of them."""

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
#: Columns in which a number may be unknown.
UNKNOWN_IS_NAN = ("occlusion", "visibility")
_LINE = " ".join(["%.4f"] * len(BOX)) + " %s\n"


def label_lines(boxes: Sequence[BoxLabel]) -> str:
    """Return ``x y z dx dy dz heading class`` for every box, a line each.

    Metres and radians with four decimals (a tenth of a millimetre). OpenPCDet's reader takes the
    last token as the class and all before it as the box, so nothing else may stand there.
    """
    rows = _normal(_stacked([one.box for one in boxes], 7)).tolist()
    return "".join(_line(row, one.actor_class) for row, one in zip(rows, boxes, strict=True))


def label_line(box: NDArray[np.float64], name: str) -> str:
    """Return the line of `label_lines` for a box (7,) of a class."""
    return _line(_normal(box[None])[0].tolist(), name)


def box_columns(boxes: Sequence[BoxLabel]) -> dict[str, list[Any]]:
    """Return what the tables say of the boxes of a frame, as can stand in JSON: lists by name.

    Boxes and velocities are in the dataset's frame: metres, radians, metres per second. What is
    unknown is ``None``.
    """
    placed = _normal(_stacked([one.box for one in boxes], 7))
    moving = _stacked([one.velocity for one in boxes], 3)
    return {
        "track": [one.track for one in boxes],
        "class": [one.actor_class for one in boxes],
        **dict(zip(BOX, placed.T.tolist(), strict=True)),
        "num_points": [one.num_points for one in boxes],
        "num_points_alone": [one.num_points_alone for one in boxes],
        "occlusion": [one.occlusion if one.num_points_alone else None for one in boxes],
        "visibility": [one.visibility if one.num_points_alone else None for one in boxes],
        "truncation": [one.truncation for one in boxes],
        "difficulty": [one.difficulty for one in boxes],
        "ignored": [one.ignored for one in boxes],
        "observed_s": [one.observed_s for one in boxes],
        **dict(zip(VELOCITY, moving.T.tolist(), strict=True)),
    }


def packed_columns(columns: Mapping[str, Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """Return columns as arrays, a fifth of the memory: numbers that are unknown are ``nan``."""
    packed: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        if name in _TEXT:
            shared = [None if one is None else sys.intern(one) for one in values]
            packed[name] = np.array(shared, object)
        else:
            packed[name] = np.array(values, np.int32 if name in _WHOLE else np.float64)
    return packed


def box_rows(columns: Mapping[str, NDArray[Any]]) -> list[dict[str, Any]]:
    """Return packed columns as rows, in which what is unknown is ``None``."""
    lists = {name: values.tolist() for name, values in columns.items()}
    for name in UNKNOWN_IS_NAN:
        lists[name] = [None if one != one else one for one in lists[name]]  # noqa: PLR0124 - nan
    return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]


def _stacked(rows: Sequence[NDArray[np.float64]], width: int) -> NDArray[np.float64]:
    return np.array(rows, np.float64).reshape(-1, width)


def _normal(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return boxes (N, 7) with their yaw in [-pi, pi)."""
    boxes = boxes.copy()
    boxes[:, 6] = wrapped(boxes[:, 6])
    return boxes


def _line(box: Sequence[float], name: str) -> str:
    # At this precision there is no negative zero.
    return (_LINE % (*box, name)).replace("-0.0000 ", "0.0000 ")
