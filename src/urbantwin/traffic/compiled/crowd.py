"""People on their ways, step by step in time: who waits, and who steps aside."""

import math

import numpy as np
from numba import njit

from urbantwin.traffic.compiled import per_actor
from urbantwin.traffic.compiled.asides import (
    comes_near,
    foresee,
    lets_by,
    looks_ahead,
    near_whom,
    part,
    room_ahead,
    slip_by,
    what_is_at,
)
from urbantwin.traffic.compiled.kerbs import drives_by, to_kerb
from urbantwin.traffic.compiled.waiting import depth

__all__ = ["walked"]

#: Who walks on comes back to its way within so far, metres; nobody is farther from it, metres.
BACK_M, MOST_M = 2.5, 1.6
#: Who stands and was pushed farther than this from where it would stand comes back so far, metres.
STRAYS_M = 1.0
#: How fast one steps aside, m/s, and how much faster one becomes from step to step, m/s2.
ASIDE_MS, STARTS_MS2 = 1.2, 8.0
#: Nobody is faster for stepping aside or for being late than this, m/s, nor walks for being late
#: so much faster than it did near there, and need not be slower than the second, m/s; who is
#: farther behind than this, metres, runs.
FASTEST_MS, HURRIES, BRISK_MS, RUNS_M = 2.2, 1.3, 1.6, 4.0
#: Who is late and gets on no faster is held up, m/s.
SLOW_MS = 0.1
#: Who lies in somebody by less has touched it, metres.
TOUCH_M = 0.004
ROUNDS = 12
#: Who was held up for so long leaves the footway to get on, and steps back so fast: s, m/s.
PATIENCE_S, BACK_MS = 2.0, 0.5
#: So far beside its way one is on the edge of the footway, metres.
EDGE_M = 0.25
#: One of so many does for so long, in turn, seconds.
TURNS, BACK_S = 3, 1.5
#: Who comes in where somebody is begins beside it: within so many rings of so many metres.
RINGS, RING_M, PLACES = 8, 0.2, 12
#: Who turns faces where it goes within so long, seconds; slower than this nobody does but who is
#: held up and shifts, m/s.
TURNS_S, WALKS_MS, SHIFTS_MS = 0.3, 0.3, 0.02


@njit(cache=True, nogil=True)
def walked(
    begins, rows, other_begins, others, boxes, whose, level, far, pace, joined, last, kerbs, green,
    patience, still, cells, within, blocked, corner, step_s, now, place, come, at, held, let,
):  # fmt: skip
    """Find where people are, and which of their rows they have come to.

    A person has a way, the places of its rows. It is as far on it as its row, or later, and beside
    it by as much as others make it. In each step everybody goes on; looks two seconds ahead and
    goes a little to the side of whom it would come into; is pushed apart from whom it touches; and
    stays where it was, if it would lie in somebody, in a vehicle that stands or in a wall even so.
    As nobody lay in anybody a step earlier, nobody does then.

    Args:
        begins: (S + 1,) int64, where the rows of people of each step begin.
        rows: (R,) int64, the rows of people, by step.
        other_begins: (S + 1,) int64, where the rows of others of each step begin.
        others: (Q,) int64, the rows of all others, by step.
        boxes: (N + B, 7) of actors, by actor and step, then of what stands at every step: x, y,
            cosine and sine of the heading, half the length, half the width, half the diagonal.
        whose: (N,) int64, the number of the actor.
        level: (N,) int64, of their roads; what stands is on level 0.
        far: (N,) how far each went on its own way by each row.
        pace: (N,) how fast people walk near there.
        joined: (N,) bool, whether the row before is the same actor's, a step earlier.
        last: (N,) int64, the last row of the same actor that follows without a gap.
        kerbs: (N, 4) int64, the row with which the next crossing on one's way begins, this one or
            later, -1 for none; of such a row the last one on it, its signal, -1 without, and the
            row at which one waits before it.
        green: (K, S) uint8, whether a signal lets people begin to cross, by step.
        patience: (2,) for how many steps one lets vehicles by that come over a crossing without a
            signal, and at green.
        still: (C + 1,) int64, where the numbers of what stands begin of each cell, by row.
        cells: (K,) int64, those numbers.
        within: (5,) west and south of those cells, their size, columns and rows.
        blocked: (Y, X) uint8, cells: 1 where something stands, 2 where nobody walks, else 0.
        corner: (3,) west and south of these cells, and their size.
        step_s: time between steps.
        now: (N + B, 7) boxes as they are, of people too; like what follows filled in here, step by
            step, and given of who was there before: its last two rows are done.
        place: (N, 3) x, y and by how much the heading differs from that of the row that one has
            come to.
        come: (N,) that row, not whole.
        at: (N,) how far one is on its way.
        held: (N,) int64, for how many steps one was held up.
        let: (N,) int64, for how many steps one let vehicles by.
    """
    count, looks, room = len(far), looks_ahead(step_s), np.empty(4)
    for s in range(len(begins) - 1):
        mine, cars = rows[begins[s] : begins[s + 1]], others[other_begins[s] : other_begins[s + 1]]
        if len(mine) == 0:
            continue
        off, waits = np.zeros((len(mine), 2)), np.zeros(len(mine), np.bool_)
        queues = np.zeros(len(mine), np.bool_)
        for a in range(len(mine)):
            r = mine[a]
            most = np.inf
            if joined[r] and at[r - 1] < far[r - 1]:
                most, queues[a] = to_kerb(
                    r, s, cars, boxes, level, far, last, kerbs, green, patience, come, at, let,
                    FASTEST_MS * step_s, step_s,
                )  # fmt: skip
            _go_on(r, off[a], most, boxes, now, far, pace, joined, place, come, at, step_s)
            if joined[r] and not queues[a]:
                _step_back(mine[a], off[a], now, whose, place, come, at, held, step_s)
        pairs = near_whom(
            mine, cars, now, off, level, still, cells, within, blocked, corner, count
        )  # fmt: skip
        for p in range(len(pairs)):
            a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            if b < 0 and j < count and not waits[a]:
                waits[a] = lets_by(mine[a], j, off, a, looks, boxes, now, come, joined, last)
                if waits[a]:
                    _keep(mine[a], off[a], now, place, come, at)
        whose_room = -1
        for p in range(len(pairs)):
            a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            if j >= count and a != whose_room:
                room_ahead(mine[a], looks, boxes, come, last, room)
                whose_room = a
            if j < count or comes_near(mine[a], j, off, a, room, boxes):
                foresee(
                    mine[a], j, off, a, b, looks, boxes, now, come, joined, last, step_s
                )  # fmt: skip
            slip_by(mine[a], j, off, a, b, now, joined, held, step_s)
        for _ in range(ROUNDS):
            parted = True
            for p in range(len(pairs)):
                a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
                if part(mine[a], j, off, a, b, now, joined, step_s):
                    parted = False
            if parted:
                break
        for a in range(len(mine)):
            _hold(
                mine[a], off[a], cars, level, last, boxes, now, far, joined, place, come, at, held,
                blocked, corner, step_s,
            )  # fmt: skip
        _stay(mine, pairs, queues, boxes, now, joined, place, come, at, held, step_s)
        for a in range(len(mine)):
            if not joined[mine[a]]:
                _come_in(mine, a, pairs, boxes, now, joined, place, blocked, corner)


@per_actor
def _point(r, at, begin, far, boxes):
    """Return from which row on, and by what share of the way to the next, one is ``at`` so far."""
    u = begin
    while u < r and far[u + 1] <= at:
        u += 1
    share = 0.0
    if u < r and far[u + 1] > far[u]:
        share = min(max((at - far[u]) / (far[u + 1] - far[u]), 0.0), 1.0)
    return u, share


@per_actor
def _go_on(r, off, most_far, boxes, now, far, pace, joined, place, come, at, step_s):
    """Go on along the way, so far at most, and back to it; ``now`` is then where one would be."""
    turn = 0.0
    come[r], at[r] = r, far[r]
    if joined[r]:
        q = r - 1
        gap, own = far[r] - at[q], far[r] - far[q]
        goes = gap
        if gap > own + 1e-9:
            # Who is late hurries a little.
            did = own
            if joined[q]:
                did = at[q] - at[q - 1]
            most = min(max(pace[r] * HURRIES, BRISK_MS), FASTEST_MS) * step_s
            if gap > RUNS_M:
                most = FASTEST_MS * step_s
            goes = min(gap, most, did + STARTS_MS2 / 2 * step_s * step_s)
        elif own > FASTEST_MS * step_s + 1e-6:
            goes = FASTEST_MS * step_s  # SUMO lets people leap
        goes = min(goes, max(most_far - at[q], 0.0))
        if goes < gap:
            at[r] = at[q] + goes
            u, share = _point(r, at[r], int(come[q]), far, boxes)
            come[r] = u + share
        beside_x, beside_y = _beside(q, boxes, now, come)
        back = max(1.0 - goes / BACK_M, 0.0)
        strays = math.hypot(beside_x, beside_y)
        if goes == 0.0 and strays > STRAYS_M:
            back = max(strays - BACK_MS * step_s, STRAYS_M) / strays
        off[0], off[1] = beside_x * back, beside_y * back
        if off[0] * off[0] + off[1] * off[1] < 1e-8:
            off[0] = off[1] = 0.0
        turn = place[q, 2]
    u = int(come[r])
    share = come[r] - u
    now[r, 0], now[r, 1] = boxes[u, 0], boxes[u, 1]
    if share > 0:
        now[r, 0] += share * (boxes[u + 1, 0] - boxes[u, 0])
        now[r, 1] += share * (boxes[u + 1, 1] - boxes[u, 1])
    place[r, 2] = turn
    _face(r, boxes, now, come, turn)


@per_actor
def _step_back(r, off, now, whose, place, come, at, held, step_s):
    """Step back for a while in turn, where all are stuck, to begin anew."""
    q = r - 1
    stuck_s = held[q] * step_s - PATIENCE_S
    if stuck_s <= 0 or (int(stuck_s / BACK_S) + whose[r]) % TURNS:
        return
    _keep(r, off, now, place, come, at)
    off[0], off[1] = -BACK_MS * step_s * now[q, 2], -BACK_MS * step_s * now[q, 3]


@per_actor
def _keep(r, off, now, place, come, at):
    """Stay where one was a step earlier."""
    q = r - 1
    come[r], at[r] = come[q], at[q]
    now[r, 0], now[r, 1], now[r, 2], now[r, 3] = now[q, 0], now[q, 1], now[q, 2], now[q, 3]
    place[r, 2] = place[q, 2]
    off[0] = off[1] = 0.0


@per_actor
def _beside(q, boxes, now, come):
    """Return how far one is beside its way in a row that is done."""
    u = int(come[q])
    share = come[q] - u
    x, y = boxes[u, 0], boxes[u, 1]
    if share > 0:
        x += share * (boxes[u + 1, 0] - boxes[u, 0])
        y += share * (boxes[u + 1, 1] - boxes[u, 1])
    return now[q, 0] - x, now[q, 1] - y


@per_actor
def _face(r, boxes, now, come, turn):
    """Turn the box of a row by an angle from where its way leads."""
    u = int(come[r])
    c, s = math.cos(turn), math.sin(turn)
    now[r, 2] = boxes[u, 2] * c - boxes[u, 3] * s
    now[r, 3] = boxes[u, 3] * c + boxes[u, 2] * s


@per_actor
def _hold(
    r, off, cars, level, last, boxes, now, far, joined, place, come, at, held, blocked, corner,
    step_s,
):  # fmt: skip
    """Keep what somebody does to what people can, off walls and on the footway; turn it there."""
    x, y = now[r, 0] + off[0], now[r, 1] + off[1]
    free = off[0] == 0.0 and off[1] == 0.0 and at[r] == far[r]
    if free or not joined[r]:
        now[r, 0], now[r, 1] = x, y
        place[r, 0], place[r, 1] = x, y
        walks = free and joined[r]
        if walks:
            walks = math.hypot(x - now[r - 1, 0], y - now[r - 1, 1]) > WALKS_MS * step_s
        if walks and place[r, 2] != 0.0:
            place[r, 2] *= max(1.0 - step_s / TURNS_S, 0.0)
            if abs(place[r, 2]) < 1e-3:
                place[r, 2] = 0.0
            _face(r, boxes, now, come, place[r, 2])
        return
    q, u = r - 1, int(come[r])
    base_x, base_y = boxes[u, 0], boxes[u, 1]
    if come[r] > u:
        base_x += (come[r] - u) * (boxes[u + 1, 0] - boxes[u, 0])
        base_y += (come[r] - u) * (boxes[u + 1, 1] - boxes[u, 1])
    was_x, was_y = now[q, 0], now[q, 1]
    ahead_x, ahead_y = boxes[u, 2], boxes[u, 3]
    goes_x, goes_y = x - was_x, y - was_y
    # Nobody walks backwards, but a step for others when all are stuck, and aside goes slowly.
    on, aside = goes_x * ahead_x + goes_y * ahead_y, goes_y * ahead_x - goes_x * ahead_y
    on = max(on, -BACK_MS * step_s if held[q] * step_s > PATIENCE_S else 0.0)
    went = math.hypot(base_x - boxes[max(u - 1, 0), 0], base_y - boxes[max(u - 1, 0), 1])
    if not joined[u]:
        went = 0.0
    most = max(ASIDE_MS * step_s, min(went, FASTEST_MS * step_s))
    aside = min(max(aside, -most), most)
    did_x, did_y = 0.0, 0.0
    if joined[q]:
        did_x, did_y = was_x - now[q - 1, 0], was_y - now[q - 1, 1]
    goes_x, goes_y = on * ahead_x - aside * ahead_y, on * ahead_y + aside * ahead_x
    more = math.hypot(goes_x - did_x, goes_y - did_y)
    least = STARTS_MS2 * step_s * step_s
    if more > least:
        goes_x = did_x + (goes_x - did_x) * least / more
        goes_y = did_y + (goes_y - did_y) * least / more
    long, most = math.hypot(goes_x, goes_y), FASTEST_MS * step_s
    if long > most:
        goes_x, goes_y = goes_x * most / long, goes_y * most / long
    x, y = was_x + goes_x, was_y + goes_y
    # Where its way leads it may be, where it is, and nowhere worse.
    own = what_is_at(base_x, base_y, blocked, corner)
    was = what_is_at(was_x, was_y, blocked, corner)
    there = what_is_at(x, y, blocked, corner)
    if there == 2 and own != 2 and was != 2 and held[q] * step_s <= PATIENCE_S:
        # A way may lead along the edge of the footway.
        long = math.hypot(x - base_x, y - base_y)
        if long > EDGE_M:
            edge_x = base_x + (x - base_x) * EDGE_M / long
            edge_y = base_y + (y - base_y) * EDGE_M / long
            if math.hypot(edge_x - was_x, edge_y - was_y) <= FASTEST_MS * step_s:
                x, y = edge_x, edge_y
                there = 0
        else:
            there = 0
    elif (
        there == 2
        and (was == 0 or (own == 2 and _strays(x, y, was_x, was_y, base_x, base_y)))
        and drives_by(r, x, y, cars, level, last, boxes, now, step_s)
    ):
        there = 1  # it does not leave the footway now, nor its way beside a road
    elif there == 2:
        there = 0
    if there and there != own:
        on = max(goes_x * ahead_x + goes_y * ahead_y, 0.0)
        x, y = was_x + on * ahead_x, was_y + on * ahead_y
        there = what_is_at(x, y, blocked, corner)
        if there and there != own:
            x, y = was_x, was_y
    # Who is behind where its way has it by now is late.
    beside_x, beside_y = x - base_x, y - base_y
    lags = -(beside_x * ahead_x + beside_y * ahead_y)
    if lags > 0 and at[r] > at[q]:
        at[r] = max(at[r] - lags, at[q])
        begin = int(come[q])
        u, share = _point(r, at[r], begin, far, boxes)
        come[r] = u + share
        base_x, base_y = boxes[u, 0], boxes[u, 1]
        if share > 0:
            base_x += share * (boxes[u + 1, 0] - boxes[u, 0])
            base_y += share * (boxes[u + 1, 1] - boxes[u, 1])
        beside_x, beside_y = x - base_x, y - base_y
    long = math.hypot(beside_x, beside_y)
    if long > MOST_M:
        x, y = base_x + beside_x * MOST_M / long, base_y + beside_y * MOST_M / long
        goes_x, goes_y = x - was_x, y - was_y
        far_now = math.hypot(goes_x, goes_y)
        if far_now > FASTEST_MS * step_s:
            x = was_x + goes_x * FASTEST_MS * step_s / far_now
            y = was_y + goes_y * FASTEST_MS * step_s / far_now
    now[r, 0], now[r, 1], place[r, 0], place[r, 1] = x, y, x, y
    pace = math.hypot(x - was_x, y - was_y) / step_s
    u = int(come[r])
    if pace > WALKS_MS:
        course = math.atan2(y - was_y, x - was_x) - math.atan2(boxes[u, 3], boxes[u, 2])
        wanted = (course + math.pi) % (2 * math.pi) - math.pi
        turn = (wanted - place[r, 2] + math.pi) % (2 * math.pi) - math.pi
        place[r, 2] += turn * min(pace, 1.0) * step_s / (TURNS_S + step_s)
    elif come[r] < r and held[q] and pace > SHIFTS_MS:
        place[r, 2] *= max(1.0 - step_s / TURNS_S, 0.0)  # held up, and turns to where it goes
    _face(r, boxes, now, come, place[r, 2])


@per_actor
def _strays(x, y, was_x, was_y, base_x, base_y):
    """Return whether a step leads farther away from one's way than its edge."""
    away = math.hypot(x - base_x, y - base_y)
    return away > EDGE_M and away > math.hypot(was_x - base_x, was_y - base_y)


@njit(cache=True, nogil=True)
def _stay(mine, pairs, queues, boxes, now, joined, place, come, at, held, step_s):
    """Leave who would lie in somebody how it faced, else where it was, until nobody does."""
    back = np.zeros(len(mine), np.int64)
    for a in range(len(mine)):
        if not joined[mine[a]]:
            back[a] = 2
    again = True
    while again:
        again = False
        for p in range(len(pairs)):
            a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            i = mine[a]
            can, could = back[a] < 2, b >= 0 and back[b] < 2
            if not can and not could:
                continue
            deep = depth(now[i], now[j])
            if deep <= TOUCH_M:
                continue
            if b < 0:
                if depth(now[i - 1], now[j]) < deep - 1e-9:
                    _back(i, boxes, now, place, come, at, back[a])
                    back[a] += 1
                    again = True
                continue
            if not joined[j] or not joined[i]:
                continue  # who comes in finds a place among the others
            if depth(now[i - 1], now[j - 1]) >= deep - 1e-9:
                continue  # they come out of each other
            # Of two who can, the one that is behind.
            x, y = now[j, 0] - now[i, 0], now[j, 1] - now[i, 1]
            first = x * now[i, 2] + y * now[i, 3] + x * now[j, 2] + y * now[j, 3] > 0
            if back[a] != back[b] and can and could:
                first = back[a] < back[b]
            if can and (first or not could):
                _back(i, boxes, now, place, come, at, back[a])
                back[a] += 1
            else:
                _back(j, boxes, now, place, come, at, back[b])
                back[b] += 1
            again = True
    for a in range(len(mine)):
        r = mine[a]
        if joined[r]:
            # Who slips by is held up until it gets on.
            on = at[r] - at[r - 1] > SLOW_MS * step_s
            late = int(come[r]) < r and not on and not queues[a]
            held[r] = held[r - 1] + 1 if late else 0


@per_actor
def _back(r, boxes, now, place, come, at, place_too):
    """Let somebody face as it did a step earlier, then be where it was, too."""
    q = r - 1
    now[r, 2], now[r, 3] = now[q, 2], now[q, 3]
    if place_too:
        now[r, 0], now[r, 1] = now[q, 0], now[q, 1]
        place[r, 0], place[r, 1], place[r, 2] = now[q, 0], now[q, 1], place[q, 2]
        come[r], at[r] = come[q], at[q]
    else:
        u = int(come[r])
        along = now[q, 2] * boxes[u, 2] + now[q, 3] * boxes[u, 3]
        place[r, 2] = math.atan2(now[q, 3] * boxes[u, 2] - now[q, 2] * boxes[u, 3], along)


@njit(cache=True, nogil=True)
def _come_in(mine, a, pairs, boxes, now, joined, place, blocked, corner):
    """Put who was not there a step earlier to where nobody is."""
    r = mine[a]
    own = what_is_at(boxes[r, 0], boxes[r, 1], blocked, corner)
    for ring in range(RINGS + 1):
        for k in range(PLACES if ring else 1):
            angle = 2 * math.pi * k / PLACES
            x = now[r, 0] + (ring * RING_M * math.cos(angle) if ring else 0.0)
            y = now[r, 1] + (ring * RING_M * math.sin(angle) if ring else 0.0)
            there = what_is_at(x, y, blocked, corner)
            if ring and there and there != own:
                continue
            box = now[r].copy()
            box[0], box[1] = x, y
            free = True
            for p in range(len(pairs)):
                c, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
                if b == a:
                    j = mine[c]
                    c, b = b, c
                if c != a or (b > a and not joined[j]):
                    continue
                if depth(box, now[j]) > TOUCH_M:
                    free = False
                    break
            if free:
                now[r, 0], now[r, 1], place[r, 0], place[r, 1] = x, y, x, y
                return
