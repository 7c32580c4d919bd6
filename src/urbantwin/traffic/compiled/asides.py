"""Evasion of pedestrians within a step: prediction of conflicts, and stepping aside."""

import math

import numpy as np
from numba import njit

from urbantwin.geometry.compiled.room import with_more_room
from urbantwin.traffic.compiled import per_actor
from urbantwin.traffic.compiled.waiting import depth_of

__all__ = ["comes_near", "foresee", "lets_by", "looks_ahead", "near_whom", "part"]
__all__ += ["room_ahead", "slip_by", "what_is_at"]

#: Number of look-aheads, their range, seconds, and maximum lateral evasion, metres.
LOOKS, AHEAD_S, ROOM_M = 8, 2.0, 1.0
#: Displacement within the look-ahead from which a vehicle is moving, metres.
DRIVES_M = 0.5
#: Distances in plan within which pedestrians, vehicles and static obstacles are considered, metres.
NEAR_M, DRIVEN_M, BESIDE_M = 4.0, 25.0, 1.5
#: Gap, metres; and share by which standing pedestrians give way relative to walking ones.
GAP_M, STANDING = 0.03, 0.15
#: Boxes farther apart than their radii times this have a gap along at least one side.
MAY_TOUCH = 1.4143
#: A pedestrian held up this long, s, by another nearer than this, m, slips past at this speed, m/s.
HELD_S, SLIPS_M, SLIPS_MS = 0.3, 0.25, 0.8
#: Time after which the other side is tried, seconds.
SWAPS_S = 3.0


@njit(cache=True, nogil=True)
def near_whom(mine, cars, now, off, level, still, cells, within, blocked, corner, count):
    """Return pairs: index of a pedestrian, row of the other, and its index, -1 for others."""
    pairs = np.empty((64, 3), np.int64)
    pair_count = 0
    for a in range(len(mine)):
        i = mine[a]
        x, y = now[i, 0] + off[a, 0], now[i, 1] + off[a, 1]
        for n in range(len(mine) + len(cars)):
            if n <= a:
                continue
            b = n if n < len(mine) else -1
            j = mine[n] if b >= 0 else cars[n - len(mine)]
            reach = (NEAR_M if b >= 0 else DRIVEN_M) + now[j, 4] + now[i, 4]
            far_x = now[j, 0] - x
            if abs(far_x) > reach or level[i] != level[j]:
                continue
            far_y = now[j, 1] - y
            if far_x * far_x + far_y * far_y > reach * reach:
                continue
            if pair_count == len(pairs):
                pairs = with_more_room(pairs)
            pairs[pair_count, 0], pairs[pair_count, 1], pairs[pair_count, 2] = a, j, b
            pair_count += 1
        column, row = int((x - within[0]) / within[2]), int((y - within[1]) / within[2])
        if level[i] != 0 or not (0 <= column < within[3] and 0 <= row < within[4]):
            continue
        if what_is_at(now[i, 0], now[i, 1], blocked, corner) == 1:
            continue  # its path leads through the obstacle: there is no way around
        cell = row * int(within[3]) + column
        for k in range(still[cell], still[cell + 1]):
            j = count + cells[k]
            if pair_count == len(pairs):
                pairs = with_more_room(pairs)
            pairs[pair_count, 0], pairs[pair_count, 1], pairs[pair_count, 2] = a, j, -1
            pair_count += 1
    return pairs[:pair_count]


@njit(cache=True, nogil=True)
def looks_ahead(step_s):
    """Return the look-aheads in steps (L,), nearest first."""
    looks = np.empty(LOOKS, np.int64)
    for k in range(LOOKS):
        looks[k] = round((k + 1) * AHEAD_S / LOOKS / step_s)
    return looks


@per_actor
def room_ahead(i, looks, boxes, come, last, room):
    """Write west, south, east and north of a pedestrian's look-ahead range to ``room``."""
    row = int(come[i])
    room[0], room[1] = boxes[row, 0], boxes[row, 1]
    room[2], room[3] = room[0], room[1]
    for ahead in looks:
        own = row + ahead
        if own > last[i]:
            break
        x, y = boxes[own, 0], boxes[own, 1]
        room[0], room[1] = min(room[0], x), min(room[1], y)
        room[2], room[3] = max(room[2], x), max(room[3], y)


@per_actor
def comes_near(i, j, off, a, room, boxes):
    """Return whether an obstacle may be nearer than a gap to a pedestrian's ``room``."""
    x, y = boxes[j, 0] - off[a, 0], boxes[j, 1] - off[a, 1]
    reach = boxes[i, 6] + boxes[j, 6] + GAP_M + 1e-6
    return room[0] - reach < x < room[2] + reach and room[1] - reach < y < room[3] + reach


@per_actor
def lets_by(i, j, off, a, looks, boxes, now, come, joined, last):
    """Return whether a pedestrian would walk into a moving vehicle, and would not if it waited."""
    if not joined[i]:
        return False
    into, drives = False, False
    for ahead in looks:
        own, other_row = int(come[i]) + ahead, j + ahead
        if other_row > last[j]:
            break
        x, y = now[i - 1, 0] - boxes[other_row, 0], now[i - 1, 1] - boxes[other_row, 1]
        reach = MAY_TOUCH * (now[i - 1, 6] + boxes[other_row, 6] + GAP_M)
        if close_to(x, y, reach) and depth_of(x, y, now[i - 1], boxes[other_row]) + GAP_M > 0:
            return False
        if not close_to(
            boxes[other_row, 0] - boxes[j, 0], boxes[other_row, 1] - boxes[j, 1], DRIVES_M
        ):
            drives = True
        if own <= last[i]:
            x = boxes[own, 0] + off[a, 0] - boxes[other_row, 0]
            y = boxes[own, 1] + off[a, 1] - boxes[other_row, 1]
            if close_to(x, y, reach) and depth_of(x, y, boxes[own], boxes[other_row]) + GAP_M > 0:
                into = True
    return into and drives


@per_actor
def foresee(i, j, off, a, b, looks, boxes, now, come, joined, last, step_s):
    """Evade to the side of an actor with which a conflict is predicted."""
    walks = b >= 0
    from_x, from_y = off[a, 0], off[a, 1]
    theirs_x, theirs_y = (off[b, 0], off[b, 1]) if walks else (0.0, 0.0)
    for ahead in looks:
        own, other_row = int(come[i]) + ahead, j
        if j < len(last):
            other_row = (int(come[j]) if walks else j) + ahead
            if other_row > last[j]:
                return
        if ahead == 0 or own > last[i]:
            return
        between_x = boxes[own, 0] + from_x - boxes[other_row, 0] - theirs_x
        between_y = boxes[own, 1] + from_y - boxes[other_row, 1] - theirs_y
        if not close_to(between_x, between_y, boxes[own, 6] + boxes[other_row, 6] + GAP_M):
            continue
        if depth_of(between_x, between_y, boxes[own], boxes[other_row]) + GAP_M <= 1e-6:
            continue
        # On the side on which they pass each other.
        x = between_x - (now[i, 0] + from_x - now[j, 0] - theirs_x)
        y = between_y - (now[i, 1] + from_y - now[j, 1] - theirs_y)
        far = math.hypot(x, y)
        if far < 0.3 * ahead * step_s:
            return
        left_x, left_y = -y / far, x / far
        beside = between_x * left_x + between_y * left_y
        side = -1.0 if beside < 0.02 else 1.0
        reach = GAP_M - side * beside
        reach += _extent_along(boxes[own], left_x, left_y) + _extent_along(
            boxes[other_row], left_x, left_y
        )
        if reach > ROOM_M or reach <= 0:
            return
        gives = _yielding_share(i, now, joined, step_s)
        share = gives / (gives + _yielding_share(j, now, joined, step_s)) if walks else 1.0
        push = side * reach * 1.5 / (ahead + 1)
        off[a, 0] += push * left_x * share
        off[a, 1] += push * left_y * share
        if walks:
            off[b, 0] -= push * left_x * (1 - share)
            off[b, 1] -= push * left_y * (1 - share)
        return


@per_actor
def slip_by(i, j, off, a, b, now, joined, held, step_s):
    """Move sideways past an actor directly ahead that holds a pedestrian up."""
    walks = b >= 0
    slips = joined[i] and held[i - 1] * step_s > HELD_S
    slip = walks and joined[j] and held[j - 1] * step_s > HELD_S
    if not slips and not slip:
        return
    x, y = now[j, 0] - now[i, 0] - off[a, 0], now[j, 1] - now[i, 1] - off[a, 1]
    if walks:
        x, y = x + off[b, 0], y + off[b, 1]
    if depth_of(-x, -y, now[i], now[j]) < -SLIPS_M:
        return
    push = SLIPS_MS * step_s
    if slips and x * now[i, 2] + y * now[i, 3] > 0:
        side = -1.0 if y * now[i, 2] - x * now[i, 3] > -0.05 else 1.0
        side *= 1 - 2 * (int(held[i - 1] * step_s / SWAPS_S) % 2)
        off[a, 0] -= side * push * now[i, 3]
        off[a, 1] += side * push * now[i, 2]
    if slip and x * now[j, 2] + y * now[j, 3] < 0:
        side = -1.0 if x * now[j, 3] - y * now[j, 2] > -0.05 else 1.0
        side *= 1 - 2 * (int(held[j - 1] * step_s / SWAPS_S) % 2)
        off[b, 0] -= side * push * now[j, 3]
        off[b, 1] += side * push * now[j, 2]


@per_actor
def part(i, j, off, a, b, now, joined, step_s):
    """Separate two overlapping actors by the shortest way; return whether they overlapped."""
    walks = b >= 0
    x, y = now[i, 0] + off[a, 0] - now[j, 0], now[i, 1] + off[a, 1] - now[j, 1]
    if walks:
        x, y = x - off[b, 0], y - off[b, 1]
    if not close_to(x, y, now[i, 6] + now[j, 6] + GAP_M):
        return False
    if depth_of(x, y, now[i], now[j]) + GAP_M <= 1e-6:
        return False
    best, way_x, way_y = np.inf, 0.0, 0.0
    for k in range(4):
        box = now[i] if k < 2 else now[j]
        ax, ay = box[2], box[3]
        if k % 2:
            ax, ay = -box[3], box[2]
        reach = GAP_M - abs(x * ax + y * ay)
        reach += _extent_along(now[i], ax, ay) + _extent_along(now[j], ax, ay)
        if reach < best:
            side = -1.0 if x * ax + y * ay < 0 else 1.0
            best, way_x, way_y = reach, side * ax, side * ay
    own = _yielding_share(i, now, joined, step_s)
    share = own / (own + _yielding_share(j, now, joined, step_s)) if walks else 1.0
    off[a, 0] += best * way_x * share
    off[a, 1] += best * way_y * share
    if walks:
        off[b, 0] -= best * way_x * (1 - share)
        off[b, 1] -= best * way_y * (1 - share)
    return True


@per_actor
def _yielding_share(r, now, joined, step_s):
    """Return how far a pedestrian gives way, by its speed; standing ones hardly."""
    if not joined[r]:
        return STANDING
    travelled = math.hypot(now[r, 0] - now[r - 1, 0], now[r, 1] - now[r - 1, 1])
    return STANDING + (1 - STANDING) * min(travelled / step_s, 1.0)


@per_actor
def close_to(x, y, reach):
    """Return whether a displacement is shorter than ``reach``."""
    return x * x + y * y < reach * reach


@per_actor
def _extent_along(box, x, y):
    """Return the extent of a box from its centre along a direction."""
    along, across = abs(box[2] * x + box[3] * y), abs(box[2] * y - box[3] * x)
    return along * box[4] + across * box[5]


@per_actor
def what_is_at(x, y, blocked, corner):
    """Return the raster's value at a point."""
    row, column = int((y - corner[1]) / corner[2]), int((x - corner[0]) / corner[2])
    if 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]:
        return blocked[row, column]
    return 0
