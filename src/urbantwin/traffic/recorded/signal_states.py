"""States of signal groups from a table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.traffic.recorded.csv_rows import (
    SECONDS,
    numbers_of,
    read_csv,
    texts_of,
    time_unit_of,
)
from urbantwin.traffic.recorded.description import SignalsSpec

__all__ = ["states_of"]

_EXPECTED = "a table of the states of signal groups"

#: States of SAE J2735 (MovementPhaseState; spellings of 2009 and 2016), and colours, as SUMO's
#: letters. SUMO's letters stand for themselves.
_STATES = {
    "unavailable": "O",
    "dark": "O",
    "off": "O",
    "stop-then-proceed": "o",
    "flashing-red": "o",
    "stop-and-remain": "r",
    "red": "r",
    "pre-movement": "u",
    "red-yellow": "u",
    "red-amber": "u",
    "permissive-movement-allowed": "g",
    "protected-movement-allowed": "G",
    "green": "G",
    "permissive-clearance": "y",
    "protected-clearance": "y",
    "yellow": "y",
    "amber": "y",
    "caution-conflicting-traffic": "o",
}


def states_of(
    path: Path, spec: SignalsSpec, begins_s: float
) -> Mapping[str, tuple[tuple[float, str], ...]]:
    """Return group -> (seconds since ``begins_s``, SUMO's letter) at each change of its state.

    Raises:
        InputError: the file or a column is missing, or a state is unknown; the message names the
            line.
    """
    table = read_csv(path, _EXPECTED)
    for field in ("group", "time", "state"):
        if getattr(spec, field) not in table.column_names:
            raise InputError(
                f"has no column {getattr(spec, field)!r} for {field}",
                file=path,
                place="line 1",
                expected=f"one of {', '.join(table.column_names)}",
            )
    seconds = numbers_of(table, spec.time, path) * SECONDS[spec.unit or time_unit_of(spec.time)]
    group, state = texts_of(table, spec.group), texts_of(table, spec.state)
    letters = {}
    for name in np.unique(state.astype(str)):
        plain = name.lower().replace("_", "-").replace(" ", "-")
        letter = spec.states.get(name) or _STATES.get(plain)
        letters[name] = letter or (name if name in set("GgyuroO") else "")
        if not letters[name]:
            row = int(np.argmax(state == name))
            raise InputError(
                f"{spec.state} is {name[:40]!r}",
                file=path,
                place=f"line {row + 2}",
                expected=f"one of {', '.join(_STATES)}, or its letter under signals.states",
            )
    shown: dict[str, tuple[tuple[float, str], ...]] = {}
    for name in sorted(
        np.unique(group.astype(str)), key=lambda group_name: (len(group_name), group_name)
    ):
        rows = np.flatnonzero(group == name)
        if (back := np.flatnonzero(np.diff(seconds[rows]) < 0)).size:
            row = int(rows[back[0] + 1])
            problem = f"time goes back for group {name}"
            raise InputError(problem, file=path, place=f"line {row + 2}", expected="rows in order")
        changes: list[tuple[float, str]] = []
        for time_s, name_of_state in zip(seconds[rows], state[rows], strict=True):
            letter = letters[name_of_state]
            if not changes or changes[-1][1] != letter:
                changes.append((round(float(time_s) - begins_s, 6), letter))
        shown[name] = tuple(changes)
    return shown
