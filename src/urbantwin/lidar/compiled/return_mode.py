"""Return mode: which of a beam's echoes a sensor reports."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["choose"]


@per_block
def choose(start, strength, level, mode):
    """Return for each of M beams the echo that is reported and a second one; -1 for none.

    Strongest: that one. Last (first): the farthest (nearest) that may be noticed and, should
    it be missed, the strongest. Dual: the strongest and the farthest; where these are the same,
    the second strongest.

    Args:
        start: (M + 1,) int32, where the echoes of each beam begin, nearest first.
        strength: (E,) float32.
        level: (E,) int32, 0 of an echo that is never noticed.
        mode: 0 strongest, 1 last, 2 dual, 3 first.
    """
    count = len(start) - 1
    first, second = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    for beam in range(count):
        best, other, last, nearest = -1, -1, -1, -1
        for echo in range(start[beam], start[beam + 1]):
            if level[echo] <= 0:
                continue
            last = echo
            if nearest < 0:
                nearest = echo
            if best < 0 or strength[echo] > strength[best]:
                best, other = echo, best
            elif other < 0 or strength[echo] > strength[other]:
                other = echo
        if mode == 0:
            first[beam] = best
        elif mode in (1, 3):
            first[beam] = last if mode == 1 else nearest
            if best != first[beam]:
                second[beam] = best
        else:
            first[beam] = best
            second[beam] = last if last != best else other
    return first, second
