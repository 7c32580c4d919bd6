"""Queue discharge: the times between vehicles that leave a queue at a signal, one after the other.

Their median is the saturation headway (Highway Capacity Manual 2016, chapter 31, measures it so);
here the first vehicles of a queue count too, since few queues of a short recording are long.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from urbantwin.traffic.calibration.passages import HEAVY, SETTLES_S, STANDS_MS, Passage

__all__ = ["discharge_headways", "first_of_queues"]

#: Who stood within so long before it passed was in the queue, seconds.
_QUEUED_S = 60.0
#: Who passes so much later does not leave the same queue, seconds.
_SAME_QUEUE_S = 8.0


def discharge_headways(
    passages: Sequence[Passage], begin_s: float, end_s: float
) -> dict[str, list[float]]:
    """Return by approach the times between two of a lane who left one queue, at its end, seconds.

    Trucks and buses, and those behind them, are left out: their length is in such times.

    Args:
        passages: of everybody.
        begin_s: the first moment at which the second of them passes.
        end_s: the last one.
    """
    by_lane: dict[str, list[Passage]] = defaultdict(list)
    for one in passages:
        if one.lane and begin_s <= one.passed_s < end_s:
            by_lane[one.lane].append(one)
    found: dict[str, list[float]] = defaultdict(list)
    for _, ones in sorted(by_lane.items()):
        ones.sort(key=lambda one: one.passed_s)
        for ahead, behind in pairwise(ones):
            headway = behind.passed_s - ahead.passed_s
            heavy = {ahead.seen.track.actor_class, behind.seen.track.actor_class} & set(HEAVY)
            # Who stood when the other had left long ago was held up by something else.
            last = _stood_last(behind)
            queued = _queued(ahead) and _queued(behind) and last < ahead.passed_s + _SAME_QUEUE_S
            if headway <= _SAME_QUEUE_S and queued and not heavy:
                found[behind.approach].append(headway)
    return dict(found)


def first_of_queues(passages: Sequence[Passage]) -> list[Passage]:
    """Return those who stood when whoever is ahead of them on their lane had passed its end."""
    found = []
    last: dict[str, float] = {}
    for one in sorted((x for x in passages if x.lane), key=lambda x: x.passed_s):
        if _queued(one) and last.get(one.lane, -np.inf) < _stood_last(one):
            found.append(one)
        last[one.lane] = one.passed_s
    return found


def _queued(one: Passage) -> bool:
    return one.passed_s - _stood_last(one) < _QUEUED_S


def _stood_last(one: Passage) -> float:
    """Return when a vehicle stood last before it passed, seconds; before all time if never."""
    seen = one.seen
    before = (seen.time_s >= seen.time_s[0] + SETTLES_S) & (seen.time_s < one.passed_s)
    stood = np.flatnonzero(before & (np.abs(seen.speed) < STANDS_MS))
    return float(seen.time_s[stood[-1]]) if len(stood) else -np.inf
