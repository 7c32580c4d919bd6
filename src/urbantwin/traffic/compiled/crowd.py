"""Pedestrians on their paths, step by step: waiting and stepping aside."""

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

#: Walking distance within which a pedestrian returns to its path, and maximum distance from it,
#: metres.
BACK_M, MOST_M = 2.5, 1.6
#: Distance from its standing position beyond which a pushed pedestrian returns, metres.
STRAYS_M = 1.0
#: Lateral speed, m/s, and change of speed, m/s2, of stepping aside.
ASIDE_MS, STARTS_MS2 = 1.2, 8.0
#: Maximum speed when evading or delayed, m/s; factor on the original speed when delayed; speed that
#: is always allowed then, m/s; delay above which a pedestrian runs, metres.
FASTEST_MS, HURRIES, BRISK_MS, RUNS_M = 2.2, 1.3, 1.6, 4.0
#: Progress below which a delayed pedestrian is held up, m/s.
SLOW_MS = 0.1
#: Overlap up to which pedestrians only touch, metres.
TOUCH_M = 0.004
ROUNDS = 12
#: Time of being held up after which a pedestrian leaves the footway, s, and speed of stepping back,
#: m/s.
PATIENCE_S, BACK_MS = 2.0, 0.5
#: Lateral distance from the path that counts as the edge of the footway, metres.
EDGE_M = 0.25
#: One in this number of pedestrians steps back at a time, in turns of this duration, seconds.
TURNS, BACK_S = 3, 1.5
#: A pedestrian that appears on an occupied spot is moved to the nearest free point on concentric
#: circles: their number, spacing in metres, and points per circle.
RINGS, RING_M, PLACES = 8, 0.2, 12
#: Time constant of turning towards the motion, seconds; speed below which the heading stays, m/s,
#: unless held up and shifting faster than the last, m/s.
TURNS_S, WALKS_MS, SHIFTS_MS = 0.3, 0.3, 0.02


@njit(cache=True, nogil=True)
def walked(
    begins, rows, other_begins, others, boxes, whose, level, far, pace, joined, last, kerbs, green,
    patience, still, cells, within, blocked, corner, step_s, now, place, come, at, held, let,
):  # fmt: skip
    """Compute the positions of pedestrians, and their progress on their paths.

    A pedestrian's path is the sequence of its rows. It is at its row or behind, and beside it by
    evasion. In each step it moves on; looks two seconds ahead and evades predicted conflicts; is
    pushed out of contacts; and stays where it was if it would still overlap a pedestrian, a
    standing vehicle or a wall. Without overlaps in the previous step there are none afterwards.

    Args:
        begins: (S + 1,) int64, begin of the rows of pedestrians of each step.
        rows: (R,) int64, rows of pedestrians, by step.
        other_begins: (S + 1,) int64, begin of the rows of others of each step.
        others: (Q,) int64, rows of all others, by step.
        boxes: (N + B, 7) boxes of actors, by actor and step, then of static obstacles: x, y, cosine
            and sine of the heading, half the length, half the width, half the diagonal.
        whose: (N,) int64, index of the actor.
        level: (N,) int64, level of the road; static obstacles are on level 0.
        far: (N,) distance along the own path at each row.
        pace: (N,) walking speed around each row.
        joined: (N,) bool, whether the row before is the same actor's, a step earlier.
        last: (N,) int64, the last row of the same actor that follows without a gap.
        kerbs: (N, 4) int64, first row on the next crossing of the path, this one or later, -1 for
            none; for such a row the last one on it, its signal, -1 without, and the row of the
            waiting position.
        green: (K, S) uint8, whether a signal lets pedestrians start, by step.
        patience: (2,) number of steps of letting vehicles pass at a crossing without a signal, and
            at green.
        still: (C + 1,) int64, begin of the indices of obstacles for each cell, by row.
        cells: (K,) int64, these indices.
        within: (5,) west and south of these cells, their size, columns and rows.
        blocked: (Y, X) uint8, raster: 1 for an obstacle, 2 off the footway, else 0.
        corner: (3,) west and south of the raster, and its cell size.
        step_s: time between steps.
        now: (N + B, 7) current boxes, also of pedestrians. This and the following are output,
            computed step by step; for actors already present, their last two rows are given.
        place: (N, 3) x, y and the difference of the heading from that of the reached row.
        come: (N,) the reached row, fractional.
        at: (N,) position along the path.
        held: (N,) int64, number of steps held up.
        let: (N,) int64, number of steps of letting vehicles pass.
    """
    count, looks, room = len(far), looks_ahead(step_s), np.empty(4)
    for s in range(len(begins) - 1):
        walkers, cars = (
            rows[begins[s] : begins[s + 1]],
            others[other_begins[s] : other_begins[s + 1]],
        )
        if len(walkers) == 0:
            continue
        off, waits = np.zeros((len(walkers), 2)), np.zeros(len(walkers), np.bool_)
        queues = np.zeros(len(walkers), np.bool_)
        for a in range(len(walkers)):
            r = walkers[a]
            most = np.inf
            if joined[r] and at[r - 1] < far[r - 1]:
                most, queues[a] = to_kerb(
                    r, s, cars, boxes, level, far, last, kerbs, green, patience, come, at, let,
                    FASTEST_MS * step_s, step_s,
                )  # fmt: skip
            _go_on(r, off[a], most, boxes, now, far, pace, joined, place, come, at, step_s)
            if joined[r] and not queues[a]:
                _step_back(walkers[a], off[a], now, whose, place, come, at, held, step_s)
        pairs = near_whom(
            walkers, cars, now, off, level, still, cells, within, blocked, corner, count
        )  # fmt: skip
        for p in range(len(pairs)):
            a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            if b < 0 and j < count and not waits[a]:
                waits[a] = lets_by(walkers[a], j, off, a, looks, boxes, now, come, joined, last)
                if waits[a]:
                    _keep_position(walkers[a], off[a], now, place, come, at)
        whose_room = -1
        for p in range(len(pairs)):
            a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
            if j >= count and a != whose_room:
                room_ahead(walkers[a], looks, boxes, come, last, room)
                whose_room = a
            if j < count or comes_near(walkers[a], j, off, a, room, boxes):
                foresee(
                    walkers[a], j, off, a, b, looks, boxes, now, come, joined, last, step_s
                )  # fmt: skip
            slip_by(walkers[a], j, off, a, b, now, joined, held, step_s)
        for _ in range(ROUNDS):
            parted = True
            for p in range(len(pairs)):
                a, j, b = pairs[p, 0], pairs[p, 1], pairs[p, 2]
                if part(walkers[a], j, off, a, b, now, joined, step_s):
                    parted = False
            if parted:
                break
        for a in range(len(walkers)):
            _limit_motion(
                walkers[a], off[a], cars, level, last, boxes, now, far, joined, place, come, at,
                held, blocked, corner, step_s,
            )  # fmt: skip
        _undo_overlaps(walkers, pairs, queues, boxes, now, joined, place, come, at, held, step_s)
        for a in range(len(walkers)):
            if not joined[walkers[a]]:
                _come_in(walkers, a, pairs, boxes, now, joined, place, blocked, corner)


@per_actor
def _row_and_share(r, at, begin, far, boxes):
    """Return the row before position ``at`` on the path, and the share of the way to the next."""
    u = begin
    while u < r and far[u + 1] <= at:
        u += 1
    share = 0.0
    if u < r and far[u + 1] > far[u]:
        share = min(max((at - far[u]) / (far[u + 1] - far[u]), 0.0), 1.0)
    return u, share


@per_actor
def _go_on(r, off, most_far, boxes, now, far, pace, joined, place, come, at, step_s):
    """Move on along the path, up to a bound, and back towards it; ``now`` is the result."""
    turn = 0.0
    come[r], at[r] = r, far[r]
    if joined[r]:
        q = r - 1
        gap, own = far[r] - at[q], far[r] - far[q]
        goes = gap
        if gap > own + 1e-9:
            # Delayed pedestrians hurry a little.
            did = own
            if joined[q]:
                did = at[q] - at[q - 1]
            most = min(max(pace[r] * HURRIES, BRISK_MS), FASTEST_MS) * step_s
            if gap > RUNS_M:
                most = FASTEST_MS * step_s
            goes = min(gap, most, did + STARTS_MS2 / 2 * step_s * step_s)
        elif own > FASTEST_MS * step_s + 1e-6:
            goes = FASTEST_MS * step_s  # SUMO's pedestrians may jump
        goes = min(goes, max(most_far - at[q], 0.0))
        if goes < gap:
            at[r] = at[q] + goes
            u, share = _row_and_share(r, at[r], int(come[q]), far, boxes)
            come[r] = u + share
        beside_x, beside_y = _displacement(q, boxes, now, come)
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
    _rotate_box(r, boxes, now, come, turn)


@per_actor
def _step_back(r, off, now, whose, place, come, at, held, step_s):
    """Step back for a while, in turns, where all are stuck."""
    q = r - 1
    stuck_s = held[q] * step_s - PATIENCE_S
    if stuck_s <= 0 or (int(stuck_s / BACK_S) + whose[r]) % TURNS:
        return
    _keep_position(r, off, now, place, come, at)
    off[0], off[1] = -BACK_MS * step_s * now[q, 2], -BACK_MS * step_s * now[q, 3]


@per_actor
def _keep_position(r, off, now, place, come, at):
    """Stay at the position of the previous step."""
    q = r - 1
    come[r], at[r] = come[q], at[q]
    now[r, 0], now[r, 1], now[r, 2], now[r, 3] = now[q, 0], now[q, 1], now[q, 2], now[q, 3]
    place[r, 2] = place[q, 2]
    off[0] = off[1] = 0.0


@per_actor
def _displacement(q, boxes, now, come):
    """Return the displacement from the path in a finished row."""
    u = int(come[q])
    share = come[q] - u
    x, y = boxes[u, 0], boxes[u, 1]
    if share > 0:
        x += share * (boxes[u + 1, 0] - boxes[u, 0])
        y += share * (boxes[u + 1, 1] - boxes[u, 1])
    return now[q, 0] - x, now[q, 1] - y


@per_actor
def _rotate_box(r, boxes, now, come, turn):
    """Rotate the box of a row by an angle relative to the path."""
    u = int(come[r])
    c, s = math.cos(turn), math.sin(turn)
    now[r, 2] = boxes[u, 2] * c - boxes[u, 3] * s
    now[r, 3] = boxes[u, 3] * c + boxes[u, 2] * s


@per_actor
def _limit_motion(
    r, off, cars, level, last, boxes, now, far, joined, place, come, at, held, blocked, corner,
    step_s,
):  # fmt: skip
    """Limit a pedestrian's motion, keep it off walls and on the footway, and turn it."""
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
            _rotate_box(r, boxes, now, come, place[r, 2])
        return
    q, u = r - 1, int(come[r])
    base_x, base_y = boxes[u, 0], boxes[u, 1]
    if come[r] > u:
        base_x += (come[r] - u) * (boxes[u + 1, 0] - boxes[u, 0])
        base_y += (come[r] - u) * (boxes[u + 1, 1] - boxes[u, 1])
    was_x, was_y = now[q, 0], now[q, 1]
    ahead_x, ahead_y = boxes[u, 2], boxes[u, 3]
    goes_x, goes_y = x - was_x, y - was_y
    # No backward motion, except a step for others when all are stuck; lateral motion is slow.
    on, lateral = goes_x * ahead_x + goes_y * ahead_y, goes_y * ahead_x - goes_x * ahead_y
    on = max(on, -BACK_MS * step_s if held[q] * step_s > PATIENCE_S else 0.0)
    path_step = math.hypot(base_x - boxes[max(u - 1, 0), 0], base_y - boxes[max(u - 1, 0), 1])
    if not joined[u]:
        path_step = 0.0
    most = max(ASIDE_MS * step_s, min(path_step, FASTEST_MS * step_s))
    lateral = min(max(lateral, -most), most)
    did_x, did_y = 0.0, 0.0
    if joined[q]:
        did_x, did_y = was_x - now[q - 1, 0], was_y - now[q - 1, 1]
    goes_x, goes_y = on * ahead_x - lateral * ahead_y, on * ahead_y + lateral * ahead_x
    more = math.hypot(goes_x - did_x, goes_y - did_y)
    least = STARTS_MS2 * step_s * step_s
    if more > least:
        goes_x = did_x + (goes_x - did_x) * least / more
        goes_y = did_y + (goes_y - did_y) * least / more
    long, most = math.hypot(goes_x, goes_y), FASTEST_MS * step_s
    if long > most:
        goes_x, goes_y = goes_x * most / long, goes_y * most / long
    x, y = was_x + goes_x, was_y + goes_y
    # Allowed are the cell types of the path and of the current position, and nothing worse.
    own = what_is_at(base_x, base_y, blocked, corner)
    was = what_is_at(was_x, was_y, blocked, corner)
    ground_type = what_is_at(x, y, blocked, corner)
    if ground_type == 2 and own != 2 and was != 2 and held[q] * step_s <= PATIENCE_S:
        # A path may lead along the edge of the footway.
        long = math.hypot(x - base_x, y - base_y)
        if long > EDGE_M:
            edge_x = base_x + (x - base_x) * EDGE_M / long
            edge_y = base_y + (y - base_y) * EDGE_M / long
            if math.hypot(edge_x - was_x, edge_y - was_y) <= FASTEST_MS * step_s:
                x, y = edge_x, edge_y
                ground_type = 0
        else:
            ground_type = 0
    elif (
        ground_type == 2
        and (was == 0 or (own == 2 and _strays(x, y, was_x, was_y, base_x, base_y)))
        and drives_by(r, x, y, cars, level, last, boxes, now, step_s)
    ):
        ground_type = 1  # stays on the footway, or on its path beside a road
    elif ground_type == 2:
        ground_type = 0
    if ground_type and ground_type != own:
        on = max(goes_x * ahead_x + goes_y * ahead_y, 0.0)
        x, y = was_x + on * ahead_x, was_y + on * ahead_y
        ground_type = what_is_at(x, y, blocked, corner)
        if ground_type and ground_type != own:
            x, y = was_x, was_y
    # A position behind that of the path is a delay.
    beside_x, beside_y = x - base_x, y - base_y
    lags = -(beside_x * ahead_x + beside_y * ahead_y)
    if lags > 0 and at[r] > at[q]:
        at[r] = max(at[r] - lags, at[q])
        begin = int(come[q])
        u, share = _row_and_share(r, at[r], begin, far, boxes)
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
        place[r, 2] *= max(1.0 - step_s / TURNS_S, 0.0)  # held up, and turns to its direction
    _rotate_box(r, boxes, now, come, place[r, 2])


@per_actor
def _strays(x, y, was_x, was_y, base_x, base_y):
    """Return whether a step leads farther from the path than its edge."""
    away = math.hypot(x - base_x, y - base_y)
    return away > EDGE_M and away > math.hypot(was_x - base_x, was_y - base_y)


@njit(cache=True, nogil=True)
def _undo_overlaps(mine, pairs, queues, boxes, now, joined, place, come, at, held, step_s):
    """Restore the previous heading, then position, of pedestrians that would overlap."""
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
                    _undo_step(i, boxes, now, place, come, at, back[a])
                    back[a] += 1
                    again = True
                continue
            if not joined[j] or not joined[i]:
                continue  # an entering pedestrian finds a free place
            if depth(now[i - 1], now[j - 1]) >= deep - 1e-9:
                continue  # they are separating
            # Of two that can be restored, the one behind.
            x, y = now[j, 0] - now[i, 0], now[j, 1] - now[i, 1]
            first = x * now[i, 2] + y * now[i, 3] + x * now[j, 2] + y * now[j, 3] > 0
            if back[a] != back[b] and can and could:
                first = back[a] < back[b]
            if can and (first or not could):
                _undo_step(i, boxes, now, place, come, at, back[a])
                back[a] += 1
            else:
                _undo_step(j, boxes, now, place, come, at, back[b])
                back[b] += 1
            again = True
    for a in range(len(mine)):
        r = mine[a]
        if joined[r]:
            # A pedestrian that slips past counts as held up until it makes progress.
            on = at[r] - at[r - 1] > SLOW_MS * step_s
            late = int(come[r]) < r and not on and not queues[a]
            held[r] = held[r - 1] + 1 if late else 0


@per_actor
def _undo_step(r, boxes, now, place, come, at, place_too):
    """Restore the heading of the previous step, then also the position."""
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
    """Move a pedestrian that enters to a free place."""
    r = mine[a]
    own = what_is_at(boxes[r, 0], boxes[r, 1], blocked, corner)
    for ring in range(RINGS + 1):
        for k in range(PLACES if ring else 1):
            angle = 2 * math.pi * k / PLACES
            x = now[r, 0] + (ring * RING_M * math.cos(angle) if ring else 0.0)
            y = now[r, 1] + (ring * RING_M * math.sin(angle) if ring else 0.0)
            ground_type = what_is_at(x, y, blocked, corner)
            if ring and ground_type and ground_type != own:
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
