"""Tables of counts: by approach and turn, or by origin and destination, in intervals of time."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.recorded.csv_rows import numbers_of, read_csv, texts_of

__all__ = ["read_counts"]

_EXPECTED = "a table of counts: approach, turn, begin, count, and class if there are several"
_NAMES = {
    "approach": ("approach", "origin", "from"),
    "turn": ("turn", "destination", "to", "exit"),
    "class": ("class", "type", "vehicle"),
    "begin": ("begin", "start", "time"),
    "count": ("count", "vehicles", "number"),
}
_QUARTER_S, _DAY_S = 900, 86400
#: Lengths of intervals, seconds: parts of a quarter of an hour, or several quarters.
_SHORTEST_S = 60


def read_counts(path: Path) -> list[dict[str, Any]]:
    """Return ``traffic.counts`` of a CSV table; the motion begins with its first interval.

    Columns are approach and turn (or origin and destination), begin (``07:15``, or seconds), count,
    and class. Intervals are all of one length: that between the two nearest beginnings, an hour
    where there is one only.

    Raises:
        InputError: the table is missing or wrong; the line is named.
    """
    table = read_csv(path, _EXPECTED)
    plain = {name.strip().lower(): name for name in table.column_names}
    column = {
        what: next((plain[one] for one in names if one in plain), None)
        for what, names in _NAMES.items()
    }
    for what in ("approach", "turn", "count"):
        if column[what] is None:
            raise InputError(f"has no column {what}", file=path, place="line 1", expected=_EXPECTED)
    count = numbers_of(table, str(column["count"]), path)
    if (count < 0).any():
        place = f"line {int(np.argmax(count < 0)) + 2}"
        raise InputError("counts less than none", file=path, place=place, expected="0 or more")
    nothing = np.full(len(count), "", object)
    texts = {
        what: nothing if (name := column[what]) is None else texts_of(table, name)
        for what in ("approach", "turn", "class", "begin")
    }
    begin = np.array([_seconds(one, path, k + 2) for k, one in enumerate(texts["begin"])])
    begins = np.unique(begin)
    length = int(np.diff(begins).min()) if len(begins) > 1 else 4 * _QUARTER_S
    fits = length % _QUARTER_S == 0 or (length >= _SHORTEST_S and _QUARTER_S % length == 0)
    if not fits or ((begins - begins[0]) % length).any():
        raise InputError(
            f"has intervals of {length} s, and not all of them",
            file=path,
            place=column["begin"],
            expected="quarters of an hour, parts or multiples of them, all of one length",
        )
    slots = int((begins[-1] - begins[0]) // length) + 1
    rows: dict[tuple[str, str, str], np.ndarray[Any, Any]] = defaultdict(lambda: np.zeros(slots))
    first: dict[tuple[str, str, str], int] = {}
    for k in range(len(count)):
        kind = str(texts["class"][k])
        if kind and kind not in ACTOR_CLASSES:
            raise InputError(
                f"unknown class {kind[:40]!r}",
                file=path,
                place=f"line {k + 2}",
                expected=f"one of {', '.join(ACTOR_CLASSES)}",
            )
        key = (str(texts["approach"][k]), str(texts["turn"][k]), kind)
        if not key[0] or not key[1]:
            raise InputError(
                "names no approach or turn", file=path, place=f"line {k + 2}", expected=_EXPECTED
            )
        rows[key][int((begin[k] - begins[0]) // length)] += count[k]
        first.setdefault(key, k + 2)
    return [
        {
            "approach": approach,
            "turn": turn,
            "actor_class": kind or None,
            "per_hour": None,
            "per_quarter": _quarters(found, length),
            "row": f"{path.name} line {first[approach, turn, kind]}",
        }
        for (approach, turn, kind), found in rows.items()
    ]


def _quarters(counts: np.ndarray[Any, Any], length_s: int) -> list[float]:
    """Return counts by quarters of an hour."""
    if length_s >= _QUARTER_S:
        times = length_s // _QUARTER_S
        return [float(one) for one in np.repeat(counts / times, times)]
    parts = _QUARTER_S // length_s
    padded = np.pad(counts, (0, -len(counts) % parts))
    return [float(one) for one in padded.reshape(-1, parts).sum(axis=1)]


def _seconds(text: object, path: Path, line: int) -> int:
    """Return a time of day in seconds; nothing is midnight."""
    said = str(text)
    if not said:
        return 0
    found = re.fullmatch(r"(\d{1,2}):(\d{2})(?::(\d{2}))?", said)
    if found:
        hours, minutes, seconds = (int(one or 0) for one in found.groups())
        whole = 3600 * hours + 60 * minutes + seconds
    elif re.fullmatch(r"\d{1,6}(\.0*)?", said):
        whole = int(float(said))
    else:
        whole = -1
    if not 0 <= whole <= _DAY_S:
        raise InputError(
            f"begins at {said[:40]!r}",
            file=path,
            place=f"line {line}",
            expected="07:15, or seconds",
        )
    return whole
