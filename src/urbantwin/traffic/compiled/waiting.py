"""Positions of vehicles that yield to others."""

import math

import numpy as np
from numba import njit

from urbantwin.traffic.compiled import per_actor

__all__ = ["depth", "depth_of", "driven", "first_contacts"]


@njit(cache=True, nogil=True)
def driven(
    own, most, was, hard, allowed, since, until, ahead, step_s, grid_m, starts, brake, hardest, same
):  # fmt: skip
    """Return a vehicle's position at each step (N,), and its hardest braking, m/s2.

    It plans to brake with ``brake``, and brakes with ``hardest`` at most. It looks ahead only
    before hard steps: without constraints it follows the original.

    Args:
        own: (N,) original positions.
        most: (N,) maximum positions.
        was: (N,) current positions.
        hard: (N,) bool, steps that need a look ahead.
        allowed: (G,) maximum speed every ``grid_m`` of the path.
        since: first step that may change.
        until: step from which the current positions are kept, once they are reached.
        ahead: number of steps of the look-ahead.
        step_s: time between steps.
        grid_m: see ``allowed``.
        starts: maximum acceleration.
        brake: planned deceleration.
        hardest: maximum deceleration.
        same: delay below which it counts as on time, metres.
    """
    count = len(most)
    position = was.copy()
    did, k = 0.0, max(since, 1)
    begun = position if k > 1 else own
    speed = (begun[max(k - 1, 1)] - begun[max(k - 2, 0)]) / step_s if count > 1 else 0.0
    following = k
    while k < count:
        # Differences below a tenth of a millimetre are ignored.
        back = k > until and abs(position[k - 1] - was[k - 1]) < 1e-4
        if back and abs(position[k - 1] - position[k - 2] - was[k - 1] + was[k - 2]) < 1e-4:
            # In a loop, since numba takes seconds to compile the assignment of a slice.
            for n in range(k, count):
                position[n] = was[n]
            break
        following = max(following, k)
        while following < count and not hard[following]:
            following += 1
        if own[k - 1] - position[k - 1] < same and (following == count or following - k > ahead):
            end = count if following == count else following - ahead
            if k < until:
                end = min(end, until)
            end = max(end, k + 1)
            for n in range(k, end):
                position[n] = own[n]
            k = end
            if k > 1:
                speed = (own[k - 1] - own[k - 2]) / step_s
            continue
        # One step at a speed, then braking: never beyond the bound, whether it has stopped by then
        # or not.
        safe = np.inf
        for n in range(min(ahead, count - k)):
            room, later = most[k + n] - position[k - 1], n * step_s
            goes = (room + brake * later * later / 2) / (later + step_s)
            if goes < brake * later:
                stops = max((brake * step_s) ** 2 + 2 * brake * room, 0.0)
                goes = math.sqrt(stops) - brake * step_s
            safe = min(safe, goes)
        allowed_here = allowed[min(int(position[k - 1] / grid_m), len(allowed) - 1)]
        wanted = min(safe, allowed_here, speed + starts * step_s)
        now = max(wanted, speed - hardest * step_s, 0.0)
        did = max(did, (speed - now) / step_s)
        if wanted < now:
            did = max(did, hardest * 2)
        speed = now
        position[k] = position[k - 1] + speed * step_s
        k += 1
    return position, did


@njit(cache=True, nogil=True)
def first_contacts(top, width, mine, theirs, beside):
    """Return the first of some boxes on a path that touches another (W,), as a fractional index.

    It is interpolated between two boxes; infinite if none touches.

    Args:
        top: (W,) int64, the farthest box on the path to consider in each case.
        width: number of boxes to consider, up to it.
        mine: (G, 6) boxes on the path: x, y, cosine and sine of the heading, half the length, half
            the width.
        theirs: (W, 6) the other box in each case.
        beside: gap between them.
    """
    contacts = np.full(len(top), np.inf)
    for w in range(len(top)):
        for g in range(max(top[w] - width + 1, 0), top[w] + 1):
            deep = depth(mine[g], theirs[w]) + beside
            if deep <= 0:
                continue
            contacts[w] = g
            if g > max(top[w] - width + 1, 0):
                contacts[w] -= deep / max(deep - depth(mine[g - 1], theirs[w]) - beside, 1e-9)
            break
    return contacts


@per_actor
def depth(a, b):
    """Return the depth of overlap of two boxes, by the separating axis theorem."""
    return depth_of(a[0] - b[0], a[1] - b[1], a, b)


@per_actor
def depth_of(x, y, a, b):
    """Return the depth of overlap for an offset of the first's centre from the other's."""
    cos, sin = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    return min(
        a[4] + cos * b[4] + sin * b[5] - abs(x * a[2] + y * a[3]),
        a[5] + sin * b[4] + cos * b[5] - abs(y * a[2] - x * a[3]),
        b[4] + cos * a[4] + sin * a[5] - abs(x * b[2] + y * b[3]),
        b[5] + sin * a[4] + cos * a[5] - abs(y * b[2] - x * b[3]),
    )
