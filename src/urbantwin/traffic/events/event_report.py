"""What is said of an event in ``motion.json``: who, where, when, and how near it was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from urbantwin.traffic.events.measures import Conflict, conflict
from urbantwin.traffic.events.scenario import Event
from urbantwin.traffic.events.surroundings import Surroundings

__all__ = ["conflict_with", "event_row"]

#: Others who come nearer than this to an event's actor are looked at, metres.
_NEAR_M = 30.0


def event_row(
    event: Event,
    others: Surroundings,
    *,
    staged: str,
    tracks: Sequence[int],
    from_s: float,
    until_s: float,
    with_track: int | None = None,
    told: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the row of an event.

    Args:
        event: what was asked for.
        others: everybody in the motion, with the event.
        staged: ``inserted`` or ``simulated``.
        tracks: the event's own actors, the main one first.
        from_s: when it begins.
        until_s: and ends.
        with_track: who it is about; whoever comes nearest where ``None``.
        told: what is to be said besides.
    """
    main = tracks[0] if tracks else None
    met, found = None, None
    if main is not None:
        ignoring = frozenset(tracks[1:]) - {with_track}
        met, found = conflict_with(others, main, with_track, from_s, until_s, ignoring)
    at = _place_of(others, main, from_s if found is None else found.gap_at_s)
    row: dict[str, Any] = {
        "event": event.event,
        "staged": staged,
        "asked": event.model_dump(exclude_unset=True, exclude_none=True),
        "from_s": round(from_s, 3),
        "until_s": round(until_s, 3),
        "tracks": [*tracks, *([with_track] if with_track not in (None, *tracks) else [])],
    }
    if at is not None:
        row["at"] = at
    if met is not None and found is not None:
        row["nearest"] = {"track": met, "class": _class_of(others, met), **found.told()}
    extra = dict(told or {})
    extra.pop("asked", None)
    return {**row, **extra}


def conflict_with(
    others: Surroundings,
    main: int,
    with_track: int | None,
    from_s: float,
    until_s: float,
    ignoring: frozenset[int] = frozenset(),
) -> tuple[int | None, Conflict | None]:
    """Return who came nearest to a track in a time, and how near."""
    own = others.passage(main).between(from_s, until_s)
    if not len(own.time_s):
        return None, None
    if with_track is None:
        nearest = others.nearest(own, ignoring | {main})
        if nearest is None or nearest.gap_m > _NEAR_M:
            return None, None
        with_track = nearest.track
    # The other may pass over the place before or after the event.
    other = others.passage(with_track).between(from_s - 10.0, until_s + 10.0)
    return with_track, conflict(own, other)


def _place_of(others: Surroundings, track: int | None, time_s: float) -> dict[str, float] | None:
    if track is None:
        return None
    rows = others.rows_of(track)
    if not len(rows):
        return None
    row = rows[int(np.argmin(np.abs(others.time_s[rows] - time_s)))]
    x, y = others.xy[row]
    return {"x": round(float(x), 3), "y": round(float(y), 3)}


def _class_of(others: Surroundings, track: int) -> str:
    return str(others.kind[others.rows_of(track)[0]])
