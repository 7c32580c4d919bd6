"""Recorded signals as those of a motion: the state shown at each stop line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pyarrow as pa

from urbantwin.traffic.calibration.passages import JunctionLinks, SeenTrack, passages_of
from urbantwin.traffic.calibration.signal_timing import groups_of_links
from urbantwin.traffic.recorded.track import RecordedSignals
from urbantwin.traffic.signals import SIGNAL_SCHEMA
from urbantwin.twin import Twin

__all__ = ["recorded_signal_table"]

Shown = Sequence[tuple[float, str]]
Row = tuple[float, str, int, str, float, float]


def recorded_signal_table(
    signals: RecordedSignals | None, twin: Twin, tracks: Sequence[SeenTrack], until_s: float
) -> tuple[pa.Table, list[str]]:
    """Return the table of recorded signal groups, and the groups whose place is unknown.

    A group with given stop lines is a link of the program ``recorded``. Any other is assigned to
    the links of the twin's own signals whose traffic passed while it was green. Groups that are
    always dark are left out.

    Args:
        signals: the recorded signals.
        twin: the twin, whose signals give the stop lines of the other groups.
        tracks: the recorded tracks.
        until_s: end of the motion, seconds.
    """
    if signals is None:
        return SIGNAL_SCHEMA.empty_table(), []
    lit = {
        group: shown
        for group, shown in signals.shown.items()
        if any(letter != "O" for _, letter in shown)
    }
    rows: list[Row] = []
    for number, (group, shown) in enumerate(lit.items()):
        link = int(group) if group.isdigit() else number
        rows += _rows("recorded", link, shown, signals.places.get(group, ()), until_s)
    placed = set(signals.places)
    if twin.roads.signals and set(lit) - placed:
        links = JunctionLinks.of(twin.net_path, twin.roads)
        passages = passages_of(tracks, twin.roads, links)
        group_of = groups_of_links(signals, passages, links, until_s)
        program = links.signals.program if links.signals else ""
        for head in twin.roads.signals:
            for link in head.links if head.program == program else ():
                group = group_of.get(link, "")
                if group and group not in signals.places:
                    placed.add(group)
                    rows += _rows(program, link, lit[group], [(head.x, head.y)], until_s)
    columns = list(zip(*sorted(rows), strict=True)) or [()] * len(SIGNAL_SCHEMA)
    arrays = [
        pa.array(list(values), field.type)
        for values, field in zip(columns, SIGNAL_SCHEMA, strict=True)
    ]
    return pa.table(arrays, schema=SIGNAL_SCHEMA), [group for group in lit if group not in placed]


def _rows(
    program: str,
    link: int,
    shown: Shown,
    places: Iterable[tuple[float, float]],
    until_s: float,
) -> list[Row]:
    """Return the rows of a link: its state at 0 s, and each change."""
    first = max((time_s for time_s, _ in shown if time_s <= 0), default=shown[0][0])
    return [
        (max(time_s, 0.0), program, link, letter, x, y)
        for time_s, letter in shown
        if first <= time_s < until_s
        for x, y in places
    ]
