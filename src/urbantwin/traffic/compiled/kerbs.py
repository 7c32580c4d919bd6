"""Who waits at a kerb: until the signal lets it cross, and nothing comes."""

import numpy as np
from numba import njit

from urbantwin.traffic.compiled.asides import DRIVES_M
from urbantwin.traffic.compiled.waiting import depth_of

__all__ = ["to_kerb"]

#: Who is so near before a crossing that is closed stands in the queue for it, metres.
QUEUE_M = 5.0
#: Who crosses later than SUMO's walker does reckons with this speed, m/s; it looks whether anything
#: is then nearer than this, metres, at every so many seconds, the same time too early and too late.
CROSSES_MS, ROOM_M, LOOK_S = 1.6, 0.5, 0.5
#: Vehicles farther away than this at a look, beyond their own length, are not looked at, metres.
NEAR_M = 4.0


@njit(cache=True, nogil=True)
def to_kerb(
    r, s, cars, boxes, level, far, last, kerbs, green, patience, come, at, let, stride, step_s
):  # fmt: skip
    """Return how far somebody who is late may go, and whether it stands before a crossing.

    SUMO's walkers cross when they may. Who comes there later waits for its own green, and lets by
    whoever comes over the crossing then.

    Args:
        r: the row of its own whose step it is.
        s: the number of the step.
        cars: (C,) the rows of vehicles in this step.
        boxes: see ``crowd.walked``, like what follows.
        level: of roads.
        far: how far each went on its own way by each row.
        last: the last row that follows without a gap.
        kerbs: where crossings begin.
        green: when.
        patience: for how many steps one lets vehicles by.
        come: the row that one has come to.
        at: (N,) how far one is on its way.
        let: (N,) int64, for how many steps one let vehicles by so far, of rows that are done.
        stride: the farthest that one goes in a step, metres.
        step_s: time between steps.
    """
    q = r - 1
    begins = _next_kerb(int(come[q]), last, kerbs)
    if begins < 0 or begins >= r or at[q] > far[begins - 1]:
        return np.inf, False
    kerb, light = far[begins - 1], kerbs[begins, 2]
    near = kerb - at[q] <= stride
    if light >= 0 and not green[light, s]:
        closed = kerb - at[q] <= QUEUE_M
    elif near and let[q] < patience[1 if light >= 0 else 0]:
        closed = _something_comes(begins, r, cars, boxes, level, far, last, kerbs, step_s)
        let[r] = let[q] + closed
    else:
        closed = False
        let[r] = let[q] if near else 0
    return kerb if closed else np.inf, closed


@njit(cache=True, nogil=True)
def _next_kerb(u, last, kerbs):
    """Return the row with which the next crossing after a row begins, -1 for none."""
    begins = kerbs[u, 0]
    if begins == u:
        return kerbs[u + 1, 0] if u < last[u] else -1
    return begins


@njit(cache=True, nogil=True)
def _something_comes(begins, r, cars, boxes, level, far, last, kerbs, step_s):
    """Return whether a vehicle comes over the crossing while one who begins now is on it."""
    end, u = kerbs[begins, 1], begins - 1
    start = far[u]
    looks = int((far[end] - start) / CROSSES_MS / LOOK_S) + 2
    early = round(LOOK_S / step_s)
    for c in range(len(cars)):
        j = cars[c]
        if level[j] != level[r]:
            continue
        u = begins - 1
        for look in range(looks):
            while u < end and far[u + 1] <= start + look * LOOK_S * CROSSES_MS:
                u += 1
            middle = j + round(look * LOOK_S / step_s)
            for b in (middle - early, middle, middle + early):
                if b < j or b > last[j]:
                    continue
                x, y = boxes[u, 0] - boxes[b, 0], boxes[u, 1] - boxes[b, 1]
                if max(abs(x), abs(y)) > NEAR_M + boxes[b, 4]:
                    continue
                if depth_of(x, y, boxes[u], boxes[b]) + ROOM_M <= 0:
                    continue
                moved = abs(boxes[b, 0] - boxes[j, 0]) + abs(boxes[b, 1] - boxes[j, 1])
                if moved > DRIVES_M:
                    return True
    return False
