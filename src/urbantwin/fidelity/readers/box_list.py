"""``boxes.csv`` beside plain clouds: boxes that somebody drew, frame by frame.

Columns, in any order: ``frame``, ``class``, ``x``, ``y``, ``z`` (centre), ``length``, ``width``,
``height``, ``yaw`` (radians, counter-clockwise from +x); and where they are known ``track`` (the
same object's in every frame), ``vx``, ``vy``, ``vz`` (over the ground, m/s), ``num_points``,
``occlusion`` (0..1) and ``ignore`` (1: neither to be found nor wrong to be found; ``ignored`` says
why). Frames that the list does not name are not labelled.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.documents import finite_numbers, read_lines
from urbantwin.fidelity.readers.labels import actor_class
from urbantwin.number_text import finite_number, whole_number

__all__ = ["BOX_LIST", "frame_number", "read_box_list"]

BOX_LIST = "boxes.csv"
_NEEDED = ("frame", "class", *BOX)
_EXPECTED = f"a table with {', '.join(_NEEDED)}"
_FARTHEST_M = 1e6


def frame_number(name: str) -> str:
    """Return what a frame is known by in a list: its number without zeros, else its name's stem."""
    stem = name.split(".", maxsplit=1)[0]
    last = re.search(r"\d+$", stem)
    return stem if last is None else str(int(last[0])) if len(last[0]) <= 18 else last[0]


def read_box_list(path: Path) -> dict[str, Boxes]:
    """Read boxes by `frame_number`.

    Raises:
        InputError: a column is missing or a value is wrong; the line is named.
    """
    try:
        rows = list(csv.DictReader(read_lines(path, _EXPECTED), strict=True))
    except csv.Error as error:
        raise InputError(f"is not a table ({error})", file=path, expected=_EXPECTED) from None
    missing = [name for name in _NEEDED if rows and name not in rows[0]]
    if missing or not rows:
        problem = f"lacks {missing[0]}" if missing else "has no rows"
        raise InputError(problem, file=path, expected=_EXPECTED)
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
            [[_or(finite_number(row[one]), np.nan) for one in VELOCITY] for row in rows]
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
