"""Common cycles and offsets of signals that are near each other.

For each pair of signals one after the other, the seconds in which the first lets traffic go that
then meets red at the second are counted over a cycle, each weighted by what flows and by how little
room there is to wait. Beginning with the signals that need the longest cycle, the nearest neighbour
is added each time with the offset that makes the sum over all its neighbours least. This is the
measure of arrivals on red (HCM 2016, 19, proportion of vehicles arriving on green), in the manner
of TRANSYT (Robertson, RRL report LR 253, 1969) without the dispersion of platoons, which is small
over such lengths.

Where queues are as long as what lies between two signals that says too little: from these offsets
on, one signal after the other is moved to where least traffic waits (``queue_model``), as TRANSYT
climbs hills.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.inner_links import Feed
from urbantwin.roads.signals.queue_model import QueueModel

__all__ = ["COORDINATED_M", "least_waiting", "neighbourhoods", "offsets"]

#: Signals this near each other share a cycle (MUTCD 2009, 4D.04 asks for it within 800 m; beyond a
#: few hundred metres lanes have the room), metres from stop line to stop line.
COORDINATED_M = 300.0
#: The first of a queue takes this long to set out, seconds.
START_S = 2.0
#: Offsets are tried in such steps, all over the cycle and then near the best, seconds, in so many
#: rounds at most.
COARSE_S, FINE_S, ROUNDS = 5, 2, 3
#: They are judged by what waits with such multiples of the traffic that comes; a vehicle that waits
#: is as bad as this share of what a lane does not carry.
BUSY, WAITS = (0.5, 0.8, 1.1), 0.002


def neighbourhoods(programs: Iterable[str], feeds: Iterable[Feed]) -> list[list[str]]:
    """Return the programs that share a cycle, sorted."""
    group = {name: {name} for name in sorted(programs)}
    for feed in feeds:
        if feed.program in group and feed.to_program in group:
            one, other = group[feed.program], group[feed.to_program]
            if one is not other:
                one |= other
                group.update(dict.fromkeys(other, one))
    return sorted({min(names): sorted(names) for names in group.values()}.values())


def offsets(
    programs: Mapping[str, Sequence[Phase]],
    feeds: Iterable[Feed],
    flow: Mapping[tuple[str, int], float],
    first: str,
) -> dict[str, float]:
    """Return program -> offset, seconds.

    Args:
        programs: programs of one cycle, in whole seconds.
        feeds: ways between them.
        flow: (program, link) -> flow ratio of what takes it.
        first: whose offset is 0.
    """
    shown = {name: _greens(phases) for name, phases in programs.items()}
    ways = [
        feed
        for feed in feeds
        if feed.program in programs
        and feed.to_program in programs
        and feed.program != feed.to_program
    ]
    found = {first: 0.0}
    while len(found) < len(programs):
        border = [way for way in ways if (way.program in found) != (way.to_program in found)]
        if not border:
            break
        nearest = min(border, key=lambda way: (way.length, way.program, way.to_program))
        name = nearest.to_program if nearest.program in found else nearest.program
        cycle = shown[name].shape[1]
        cost = np.zeros(cycle)
        for way in border:
            if name not in (way.program, way.to_program):
                continue
            go, wait = shown[way.program][way.index], ~shown[way.to_program][way.to_index]
            lag = round(way.seconds + START_S)
            weight = flow.get((way.program, way.index), 0.0) / way.room
            # Seconds of green at the first that meet red at the second, by how much later the
            # second is.
            red = [float((go & np.roll(wait, late - lag)).sum()) for late in range(cycle)]
            if name == way.to_program:
                late = (np.arange(cycle) - round(found[way.program])) % cycle
            else:
                late = (round(found[way.to_program]) - np.arange(cycle)) % cycle
            cost += weight * np.array(red)[late]
        found[name] = float(np.argmin(np.round(cost, 9)))
    return {name: found.get(name, 0.0) for name in programs}


def least_waiting(
    model: QueueModel, offsets: Mapping[str, float], cycle: int, first: str
) -> tuple[dict[str, float], float]:
    """Return offsets with which less traffic waits, or the same, and how bad that is.

    Args:
        model: the signals, their traffic and the room between them.
        offsets: program -> offset to begin with, seconds.
        cycle: of all of them, seconds.
        first: whose offset stays.
    """
    best = np.array([round(offsets[name]) for name in model.programs], np.int64)
    around = np.arange(-COARSE_S + FINE_S, COARSE_S, FINE_S)
    least = np.inf
    for _ in range(ROUNDS):
        before = best.copy()
        for k, name in enumerate(model.programs):
            if name == first:
                continue
            for steps in (np.arange(0, cycle, COARSE_S), around):
                tried = np.tile(best, (len(steps) + 1, 1))
                tried[1:, k] = (best[k] + steps) % cycle
                found = model.run(np.repeat(tried, len(BUSY), axis=0), np.tile(BUSY, len(tried)))
                cost = (found.worst + WAITS * found.waiting).reshape(len(tried), -1).sum(axis=1)
                least = float(np.round(cost, 6).min())
                best = tried[int(np.argmin(np.round(cost, 6)))]
        if (best == before).all():
            break
    return dict(zip(model.programs, best.astype(float).tolist(), strict=True)), least


def _greens(phases: Sequence[Phase]) -> NDArray[np.bool_]:
    """Return whether each link has green in each second of the cycle: (links, seconds)."""
    seconds = [round(length) for length, _ in phases]
    letters = np.array([list(state) for _, state in phases])
    return np.isin(np.repeat(letters, seconds, axis=0).T, ["G", "g"])
