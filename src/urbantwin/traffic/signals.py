"""Signals: the states of each link of each program, and its stop lines."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import pyarrow as pa

from urbantwin.roads import SignalHead

__all__ = ["SIGNAL_SCHEMA", "signal_table"]

SIGNAL_SCHEMA = pa.schema(
    [
        ("time_s", pa.float64()),
        ("signal", pa.string()),
        ("link", pa.int32()),
        ("state", pa.string()),
        ("x", pa.float64()),
        ("y", pa.float64()),
    ]
)


def signal_table(
    shown: Sequence[tuple[int, str, str]],
    heads: Sequence[SignalHead],
    *,
    steps: int,
    step_s: float,
) -> pa.Table:
    """Return one row per link and change of state, sorted by time, program and link.

    A link that several lanes share has a row for each of their stop lines. The first rows, at time
    0, give the state of every link when the motion starts.

    Args:
        shown: (step, program, one letter per link) at each change of a program's state, in order;
            steps before 0 precede the motion.
        heads: stop line of each link. A link without a head is not in use.
        steps: number of steps of the motion.
        step_s: time between steps, seconds.
    """
    stop_lines: dict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
    for head in sorted(heads, key=lambda head: head.lane):
        for link in head.links:
            stop_lines[head.program, link].append((head.x, head.y))
    latest: dict[tuple[str, int], str] = {}
    rows: dict[tuple[int, str, int], str] = {}
    for step, program, state in sorted(shown, key=lambda item: item[0]):
        if step >= steps:
            break
        for link, letter in enumerate(state):
            key = (program, link)
            if key in stop_lines and latest.get(key) != letter:
                latest[key] = letter
                rows[max(step, 0), program, link] = letter
    columns: list[tuple[float, str, int, str, float, float]] = [
        (round(step * step_s, 9), program, link, state, x, y)
        for (step, program, link), state in sorted(rows.items())
        for x, y in stop_lines[program, link]
    ]
    return pa.table(
        [pa.array(values) for values in zip(*columns, strict=True)] or [[]] * len(SIGNAL_SCHEMA),
        schema=SIGNAL_SCHEMA,
    )
