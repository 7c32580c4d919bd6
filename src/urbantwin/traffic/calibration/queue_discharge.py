"""Queue discharge: headways of consecutive vehicles that leave a queue at a signal.

Their median is the saturation headway (measured in this way by the Highway Capacity Manual 2016,
chapter 31). Here the first vehicles of a queue count, too, since short recordings have few long
queues.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from urbantwin.traffic.calibration.passages import HEAVY, SETTLES_S, STANDS_MS, Passage

__all__ = ["discharge_headways", "first_of_queues"]

#: A vehicle was in the queue if it stood within this time before it passed, seconds.
_QUEUED_S = 60.0
#: Longest headway within the same queue, seconds.
_SAME_QUEUE_S = 8.0


def discharge_headways(
    passages: Sequence[Passage], begin_s: float, end_s: float
) -> dict[str, list[float]]:
    """Return, by approach, the headways of pairs on a lane that left the same queue, seconds.

    Trucks, buses and their followers are excluded, since headways include their length.

    Args:
        passages: all passages.
        begin_s: first time at which the second vehicle passes.
        end_s: last time at which the second vehicle passes.
    """
    by_lane: dict[str, list[Passage]] = defaultdict(list)
    for passage in passages:
        if passage.lane and begin_s <= passage.passed_s < end_s:
            by_lane[passage.lane].append(passage)
    headways: dict[str, list[float]] = defaultdict(list)
    for _, in_order in sorted(by_lane.items()):
        in_order.sort(key=lambda passage: passage.passed_s)
        for leader, follower in pairwise(in_order):
            headway = follower.passed_s - leader.passed_s
            heavy = {leader.seen.track.actor_class, follower.seen.track.actor_class} & set(HEAVY)
            # A vehicle that stood long after the leader had left was held up by something else.
            last = _stood_last(follower)
            queued = (
                _queued(leader) and _queued(follower) and last < leader.passed_s + _SAME_QUEUE_S
            )
            if headway <= _SAME_QUEUE_S and queued and not heavy:
                headways[follower.approach].append(headway)
    return dict(headways)


def first_of_queues(passages: Sequence[Passage]) -> list[Passage]:
    """Return the vehicles that still stood after the one ahead had passed the lane's end."""
    firsts = []
    last: dict[str, float] = {}
    for passage in sorted((x for x in passages if x.lane), key=lambda x: x.passed_s):
        if _queued(passage) and last.get(passage.lane, -np.inf) < _stood_last(passage):
            firsts.append(passage)
        last[passage.lane] = passage.passed_s
    return firsts


def _queued(one: Passage) -> bool:
    return one.passed_s - _stood_last(one) < _QUEUED_S


def _stood_last(one: Passage) -> float:
    """Return when a vehicle last stood before it passed, seconds; -inf if never."""
    seen = one.seen
    before = (seen.time_s >= seen.time_s[0] + SETTLES_S) & (seen.time_s < one.passed_s)
    stood = np.flatnonzero(before & (np.abs(seen.speed) < STANDS_MS))
    return float(seen.time_s[stood[-1]]) if len(stood) else -np.inf
