"""How far somebody may be, and how far it is, who lets others go first."""

import math

import numpy as np
from numba import njit

from urbantwin.traffic.compiled import per_actor

__all__ = ["depth", "depth_of", "driven", "first_contacts"]


@njit(cache=True, nogil=True)
def driven(
    own, most, was, hard, allowed, since, until, ahead, step_s, grid_m, starts, brake, hardest, same
):  # fmt: skip
    """Return how far one is at each step (N,), and how hard it braked, m/s2.

    It plans to brake with ``brake``, and does with ``hardest`` at the most. It looks ahead only
    before what is hard: where nothing is in the way it goes as it went itself.

    Args:
        own: (N,) how far it went itself.
        most: (N,) farther than which it is not to be.
        was: (N,) how far it was so far.
        hard: (N,) bool, where it has to look ahead.
        allowed: (G,) the greatest speed every ``grid_m`` of the way.
        since: the first step that may be another.
        until: the step from which on it does as it did, once it is where it was.
        ahead: for so many steps it looks ahead.
        step_s: time between steps.
        grid_m: see ``allowed``.
        starts: how hard it speeds up.
        brake: how hard it plans to brake.
        hardest: how hard it brakes at the most.
        same: who is less behind than this, metres, is where it was.
    """
    count = len(most)
    at = was.copy()
    did, k = 0.0, max(since, 1)
    begun = at if k > 1 else own
    speed = (begun[max(k - 1, 1)] - begun[max(k - 2, 0)]) / step_s if count > 1 else 0.0
    following = k
    while k < count:
        # A tenth of a millimetre is no difference.
        back = k > until and abs(at[k - 1] - was[k - 1]) < 1e-4
        if back and abs(at[k - 1] - at[k - 2] - was[k - 1] + was[k - 2]) < 1e-4:
            # One at a time: numba compiles the assignment of a slice for seconds.
            for n in range(k, count):
                at[n] = was[n]
            break
        following = max(following, k)
        while following < count and not hard[following]:
            following += 1
        if own[k - 1] - at[k - 1] < same and (following == count or following - k > ahead):
            end = count if following == count else following - ahead
            if k < until:
                end = min(end, until)
            end = max(end, k + 1)
            for n in range(k, end):
                at[n] = own[n]
            k = end
            if k > 1:
                speed = (own[k - 1] - own[k - 2]) / step_s
            continue
        # Goes on for one step at a speed, then brakes: never beyond, whether it has come to a
        # standstill by then or not.
        safe = np.inf
        for n in range(min(ahead, count - k)):
            room, later = most[k + n] - at[k - 1], n * step_s
            goes = (room + brake * later * later / 2) / (later + step_s)
            if goes < brake * later:
                stops = max((brake * step_s) ** 2 + 2 * brake * room, 0.0)
                goes = math.sqrt(stops) - brake * step_s
            safe = min(safe, goes)
        here = allowed[min(int(at[k - 1] / grid_m), len(allowed) - 1)]
        wanted = min(safe, here, speed + starts * step_s)
        now = max(wanted, speed - hardest * step_s, 0.0)
        did = max(did, (speed - now) / step_s)
        if wanted < now:
            did = max(did, hardest * 2)
        speed = now
        at[k] = at[k - 1] + speed * step_s
        k += 1
    return at, did


@njit(cache=True, nogil=True)
def first_contacts(top, width, mine, theirs, beside):
    """Return which of some boxes on a way are the first to touch another box (W,), by their number.

    The number is not whole: where they begin to touch, between two boxes; infinite where none does.

    Args:
        top: (W,) int64, the box farthest on the way that is looked at in each case.
        width: so many boxes are looked at, up to it.
        mine: (G, 6) the boxes on the way: x, y, cosine and sine of the heading, half the length,
            half the width.
        theirs: (W, 6) the other box in each case.
        beside: room between them.
    """
    found = np.full(len(top), np.inf)
    for w in range(len(top)):
        for g in range(max(top[w] - width + 1, 0), top[w] + 1):
            deep = depth(mine[g], theirs[w]) + beside
            if deep <= 0:
                continue
            found[w] = g
            if g > max(top[w] - width + 1, 0):
                found[w] -= deep / max(deep - depth(mine[g - 1], theirs[w]) - beside, 1e-9)
            break
    return found


@per_actor
def depth(a, b):
    """Return how deep two boxes lie in each other, by the theorem of separating axes."""
    return depth_of(a[0] - b[0], a[1] - b[1], a, b)


@per_actor
def depth_of(x, y, a, b):
    """Return the same of boxes where the first's middle is so far from the other's."""
    cos, sin = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    return min(
        a[4] + cos * b[4] + sin * b[5] - abs(x * a[2] + y * a[3]),
        a[5] + sin * b[4] + cos * b[5] - abs(y * a[2] - x * a[3]),
        b[4] + cos * a[4] + sin * a[5] - abs(x * b[2] + y * b[3]),
        b[5] + sin * a[4] + cos * a[5] - abs(y * b[2] - x * b[3]),
    )
