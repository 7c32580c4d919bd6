"""Queues on the lanes before signals, second by second."""

import numpy as np
from numba import njit

__all__ = ["queues"]


@njit(cache=True, nogil=True)
def queues(
    offsets,
    scale,
    shown,
    cycle,
    others,
    fed,
    room,
    way_s,
    back_s,
    comes_from,
    into,
    share,
    whole_s,
    span_s,
):
    """Return the queues (K, L) of two spans, the last ones, summed over their seconds.

    Args:
        offsets: (K, L) int64, of the program at each lane, seconds.
        scale: (K,) traffic as a multiple of what comes.
        shown: (L, C) vehicles that each lane lets go in each second of its cycle.
        cycle: (L,) int64, its length, C or less.
        others: (L,) vehicles a second that come from elsewhere.
        fed: (L,) share of what leaves that came from other lanes here.
        room: (L,) vehicles that have room.
        way_s: (L,) int64, seconds from the stop line before.
        back_s: (L,) int64, seconds after which room is free again.
        comes_from: (E,) int64, lanes, not decreasing.
        into: (E,) int64, lanes that they lead to.
        share: (E,) of what leaves the one that goes there.
        whole_s: seconds in all.
        span_s: seconds of each span.
    """
    cases, lanes = offsets.shape
    before, after = np.zeros((cases, lanes)), np.zeros((cases, lanes))
    ring = max(way_s.max(), back_s.max()) + 1
    opens, until = np.empty((whole_s, lanes)), np.zeros((whole_s + 1, lanes))
    goes, enters, fits = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for case in range(cases):
        coming, freed = np.zeros((ring, lanes)), np.zeros((ring, lanes))
        queue, taken = np.zeros(lanes), np.zeros(lanes)
        for k in range(lanes):
            at = -offsets[case, k] % cycle[k]
            for second in range(whole_s):
                opens[second, k] = shown[k, at]
                until[second + 1, k] = until[second, k] + shown[k, at]
                at = 0 if at + 1 == cycle[k] else at + 1
        now = -1
        for second in range(whole_s):
            now = 0 if now + 1 == ring else now + 1
            for k in range(lanes):
                queue[k] += coming[now, k] + others[k] * scale[case]
                taken[k] -= freed[now, k]
                coming[now, k] = freed[now, k] = 0.0
                goes[k] = min(queue[k], opens[second, k])
                enters[k] = 0.0
            for e in range(len(into)):
                enters[into[e]] += goes[comes_from[e]] * share[e]
            for k in range(lanes):
                # Who goes on while others come makes room for them.
                leaving = until[min(second + way_s[k], whole_s), k] - until[second, k]
                free = room[k] - taken[k] + min(leaving, taken[k])
                fits[k] = min(max(free / max(enters[k], 1e-12), 0.0), 1.0)
                enters[k] = 0.0
            e = 0
            while e < len(into):
                lane, least, first = comes_from[e], 1.0, e
                while e < len(into) and comes_from[e] == lane:
                    least = min(least, fits[into[e]])
                    e += 1
                # Who has no room holds up all behind.
                goes[lane] *= least
                for one in range(first, e):
                    enters[into[one]] += goes[lane] * share[one]
            for k in range(lanes):
                queue[k] -= goes[k]
                taken[k] += enters[k]
                there, back = now + way_s[k], now + back_s[k]
                coming[there - ring if there >= ring else there, k] += enters[k]
                freed[back - ring if back >= ring else back, k] += goes[k] * fed[k]
                if second >= whole_s - span_s:
                    after[case, k] += queue[k]
                elif second >= whole_s - 2 * span_s:
                    before[case, k] += queue[k]
    return before, after
