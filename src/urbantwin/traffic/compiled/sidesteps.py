"""People who step aside for each other, step by step in time."""

import math

import numpy as np
from numba import njit

from urbantwin.traffic.compiled.waiting import depth

__all__ = ["sidesteps"]

#: Who walks on comes back to its way within so far, metres; nobody is farther from it, metres.
BACK_M, MOST_M = 2.5, 1.6
#: How fast one steps aside, and how much faster from step to step, m/s and m/s2.
ASIDE_MS, STARTS_MS2 = 1.2, 8.0
#: Nobody is faster for stepping aside than this, m/s.
FASTEST_MS = 2.2
#: How far one looks ahead, in so many looks, seconds; and how far one goes aside for that, metres.
LOOKS, AHEAD_S, ROOM_M = 8, 2.0, 1.0
#: Room that is left, metres; who stands gives way by so much of what one does who walks.
GAP_M, STANDING = 0.03, 0.15
ROUNDS = 12


@njit(cache=True, nogil=True)
def sidesteps(
    begins, rows, pair_begins, pairs, boxes, before, last, people, blocked, corner, step_s
):
    """Return how far people are beside their ways (N, 2), east and north.

    Args:
        begins: (S + 1,) int64, where the rows of each step begin.
        rows: (R,) int64, the rows of people, by step.
        pair_begins: (S + 1,) int64, where the pairs of each step begin.
        pairs: (P, 2) int64, rows that are near each other, by step.
        boxes: (N, 6) by actor and step, then those that stand at every step: x, y, cosine and sine
            of the heading, half the length, half the width.
        before: (M,) bool, whether the row before is the same actor's, a step earlier; M of N move.
        last: (M,) int64, the last row of the same actor that follows without a gap.
        people: (N,) bool, who may step aside.
        blocked: (Y, X) uint8, cells: 1 where something stands, 2 where nobody walks, else 0.
        corner: (3,) west and south of the cells, and their size.
        step_s: time between steps.
    """
    off = np.zeros((len(boxes), 2))
    most = ASIDE_MS * step_s
    for s in range(len(begins) - 1):
        mine, near = rows[begins[s] : begins[s + 1]], pairs[pair_begins[s] : pair_begins[s + 1]]
        for r in mine:
            if before[r]:
                went = math.hypot(boxes[r, 0] - boxes[r - 1, 0], boxes[r, 1] - boxes[r - 1, 1])
                off[r] = off[r - 1] * max(1.0 - went / BACK_M, 0.0)
        for i, j in near:
            _foresee(i, j, boxes, off, before, last, people, step_s)
        for _ in range(ROUNDS):
            parted = True
            for i, j in near:
                parted &= not _part(i, j, boxes, off, before, people, step_s)
            if parted:
                break
        for r in mine:
            _hold(r, boxes, off, before, blocked, corner, most, step_s)
    return off


@njit(cache=True, nogil=True)
def _gives(r, boxes, before, people, step_s):
    """Return how much somebody gives way."""
    if not people[r]:
        return 0.0
    if not before[r]:
        return STANDING
    went = math.hypot(boxes[r, 0] - boxes[r - 1, 0], boxes[r, 1] - boxes[r - 1, 1])
    return STANDING + (1 - STANDING) * min(went / step_s, 1.0)


@njit(cache=True, nogil=True)
def _moved(r, of, boxes, off):
    """Return the box of a row, as far beside its way as another row of the same actor is."""
    box = boxes[r].copy()
    box[0] += off[of, 0]
    box[1] += off[of, 1]
    return box


@njit(cache=True, nogil=True)
def _foresee(i, j, boxes, off, before, last, people, step_s):
    """Go a little to the side of somebody whom one would come into soon."""
    one, other = _moved(i, i, boxes, off), _moved(j, j, boxes, off)
    for look in range(1, LOOKS + 1):
        ahead = round(look * AHEAD_S / LOOKS / step_s)
        a, b = i + ahead, j
        if j < len(last):
            b = j + ahead
            if b > last[j]:
                return
        if ahead == 0 or a > last[i]:
            return
        there, theirs = _moved(a, i, boxes, off), _moved(b, j, boxes, off)
        if depth(there, theirs) + GAP_M <= 0:
            continue
        # Past each other on the side on which they come by.
        x = (there[0] - one[0]) - (theirs[0] - other[0])
        y = (there[1] - one[1]) - (theirs[1] - other[1])
        far = math.hypot(x, y)
        if far < 0.3 * ahead * step_s:
            return
        left_x, left_y = -y / far, x / far
        beside = (there[0] - theirs[0]) * left_x + (there[1] - theirs[1]) * left_y
        side = -1.0 if beside < 0.02 else 1.0
        reach = GAP_M - side * beside
        for box in (there, theirs):
            reach += abs(box[2] * left_x + box[3] * left_y) * box[4]
            reach += abs(box[2] * left_y - box[3] * left_x) * box[5]
        if reach > ROOM_M or reach <= 0:
            return
        mine = _gives(i, boxes, before, people, step_s)
        whole = mine + _gives(j, boxes, before, people, step_s)
        push = side * reach * 1.5 / (ahead + 1)
        off[i, 0] += push * left_x * mine / whole
        off[i, 1] += push * left_y * mine / whole
        off[j, 0] -= push * left_x * (1 - mine / whole)
        off[j, 1] -= push * left_y * (1 - mine / whole)
        return


@njit(cache=True, nogil=True)
def _part(i, j, boxes, off, before, people, step_s):
    """Part two who are in each other, by the shortest way; return whether they were."""
    one, other = _moved(i, i, boxes, off), _moved(j, j, boxes, off)
    deep = depth(one, other) + GAP_M
    if deep <= 0:
        return False
    best, way_x, way_y = np.inf, 0.0, 0.0
    x, y = one[0] - other[0], one[1] - other[1]
    for box in (one, other):
        for ax, ay in ((box[2], box[3]), (-box[3], box[2])):
            reach = GAP_M - abs(x * ax + y * ay)
            for each in (one, other):
                reach += abs(each[2] * ax + each[3] * ay) * each[4]
                reach += abs(each[2] * ay - each[3] * ax) * each[5]
            if reach < best:
                side = -1.0 if x * ax + y * ay < 0 else 1.0
                best, way_x, way_y = reach, side * ax, side * ay
    mine = _gives(i, boxes, before, people, step_s)
    share = mine / (mine + _gives(j, boxes, before, people, step_s))
    off[i, 0] += best * way_x * share
    off[i, 1] += best * way_y * share
    off[j, 0] -= best * way_x * (1 - share)
    off[j, 1] -= best * way_y * (1 - share)
    return True


@njit(cache=True, nogil=True)
def _cell(x, y, blocked, corner):
    """Return what is at a place."""
    row, column = int((y - corner[1]) / corner[2]), int((x - corner[0]) / corner[2])
    if 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]:
        return blocked[row, column]
    return 0


@njit(cache=True, nogil=True)
def _hold(r, boxes, off, before, blocked, corner, most, step_s):
    """Keep what somebody steps aside to what people can, off walls and on the footway."""
    was_x, was_y, did = 0.0, 0.0, 0.0
    if before[r]:
        was_x, was_y = off[r - 1, 0], off[r - 1, 1]
        if before[r - 1]:
            did = math.hypot(was_x - off[r - 2, 0], was_y - off[r - 2, 1])
    x, y = off[r, 0] - was_x, off[r, 1] - was_y
    far = math.hypot(x, y)
    # Who walks may stop.
    if before[r]:
        most = max(most, math.hypot(boxes[r, 0] - boxes[r - 1, 0], boxes[r, 1] - boxes[r - 1, 1]))
    least = min(most, did + STARTS_MS2 * step_s * step_s)
    if far > least:
        x, y = x * least / far, y * least / far
    # Nobody walks backwards.
    walks_x = walks_y = 0.0
    if before[r]:
        walks_x, walks_y = boxes[r, 0] - boxes[r - 1, 0], boxes[r, 1] - boxes[r - 1, 1]
    back = min((walks_x + x) * boxes[r, 2] + (walks_y + y) * boxes[r, 3], 0.0)
    x, y = was_x + x - back * boxes[r, 2], was_y + y - back * boxes[r, 3]
    far = math.hypot(x, y)
    if far > MOST_M:
        x, y = x * MOST_M / far, y * MOST_M / far
    # Where it is anyway it may be, and nowhere worse.
    own = _cell(boxes[r, 0], boxes[r, 1], blocked, corner)
    there = _cell(boxes[r, 0] + x, boxes[r, 1] + y, blocked, corner)
    if there and there != own:
        x, y = was_x, was_y
        there = _cell(boxes[r, 0] + x, boxes[r, 1] + y, blocked, corner)
        far = math.hypot(x, y)
        if there and there != own and far > 0:
            share = max(1.0 - most / far, 0.0)
            x, y = x * share, y * share
    if before[r]:
        fastest = max(FASTEST_MS * step_s, math.hypot(walks_x, walks_y))
        for _ in range(8):
            if math.hypot(walks_x + x - was_x, walks_y + y - was_y) <= fastest:
                break
            x, y = was_x + 0.7 * (x - was_x), was_y + 0.7 * (y - was_y)
    off[r, 0], off[r, 1] = x, y
