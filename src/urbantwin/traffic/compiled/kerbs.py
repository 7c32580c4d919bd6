"""Waiting of pedestrians at a kerb, for the signal and for vehicles."""

import numpy as np

from urbantwin.traffic.compiled import per_actor
from urbantwin.traffic.compiled.asides import DRIVES_M
from urbantwin.traffic.compiled.waiting import depth_of

__all__ = ["drives_by", "to_kerb"]

#: Distance before a closed crossing within which a pedestrian stands in its queue, metres.
QUEUE_M = 5.0
#: Distance beyond the kerb from which a pedestrian has started to cross, metres.
BEGUN_M = 0.3
#: Assumed crossing speed of delayed pedestrians, m/s; least gap to vehicles, metres; and time step,
#: seconds, of the check, which also covers this time earlier and later.
CROSSES_MS, ROOM_M, LOOK_S = 1.6, 0.5, 0.5
#: Time before a vehicle comes within which pedestrians do not leave the footway, seconds.
ASIDE_S = 5.0
#: Distance, beyond their own length, from which vehicles are ignored in a check, metres.
NEAR_M = 4.0


@per_actor
def to_kerb(
    r, s, cars, boxes, level, far, last, kerbs, green, patience, come, at, let, stride, step_s
):  # fmt: skip
    """Return the bound on a delayed pedestrian's position, and whether it waits before a crossing.

    SUMO's pedestrians cross when they may. A later one waits for its own green, and lets vehicles
    on the crossing pass.

    Args:
        r: its row in this step.
        s: index of the step.
        cars: (C,) rows of vehicles in this step.
        boxes: see ``crowd.walked``, like the following.
        level: levels of roads.
        far: distance along the own path at each row.
        last: the last row that follows without a gap.
        kerbs: crossings of the paths.
        green: whether pedestrians may start.
        patience: number of steps of letting vehicles pass.
        come: the reached row.
        at: (N,) position along the path.
        let: (N,) int64, number of steps of letting vehicles pass, of finished rows.
        stride: maximum distance in a step, metres.
        step_s: time between steps.
    """
    q = r - 1
    begins = _next_kerb(int(come[q]), last, kerbs)
    if begins < 0 or begins >= r:
        return np.inf, False
    kerb, light = far[kerbs[begins, 3]], kerbs[begins, 2]
    if at[q] > kerb + BEGUN_M:
        return np.inf, False
    is_near = kerb - at[q] <= stride
    if light >= 0 and not _is_green_for_crossing(light, s, far[begins] - kerb, green, step_s):
        closed = kerb - at[q] <= QUEUE_M
    elif is_near and let[q] < patience[1 if light >= 0 else 0]:
        closed = _is_vehicle_coming(begins, r, cars, boxes, level, far, last, kerbs, step_s)
        let[r] = let[q] + closed
    else:
        closed = False
        let[r] = let[q] if is_near else 0
    return kerb if closed else np.inf, closed


@per_actor
def _is_green_for_crossing(light, s, way, green, step_s):
    """Return whether a signal is green now, and when the crossing is reached."""
    comes = min(s + int(way / CROSSES_MS / step_s), green.shape[1] - 1)
    return green[light, s] and green[light, comes]


@per_actor
def _next_kerb(u, last, kerbs):
    """Return the first row on the next crossing after a row, -1 for none."""
    begins = kerbs[u, 0]
    if begins == u:
        return kerbs[u + 1, 0] if u < last[u] else -1
    return begins


@per_actor
def _drives_into(x, y, box, boxes, now, then):
    """Return whether a vehicle, now in row ``now``, reaches a box at x, y in row ``then``."""
    far_x, far_y = x - boxes[then, 0], y - boxes[then, 1]
    if max(abs(far_x), abs(far_y)) > NEAR_M + boxes[then, 4]:
        return False
    if depth_of(far_x, far_y, box, boxes[then]) + ROOM_M <= 0:
        return False
    return abs(boxes[then, 0] - boxes[now, 0]) + abs(boxes[then, 1] - boxes[now, 1]) > DRIVES_M


@per_actor
def _is_vehicle_coming(begins, r, cars, boxes, level, far, last, kerbs, step_s):
    """Return whether a vehicle comes over the crossing while the pedestrian is on it."""
    end, waiting_row = kerbs[begins, 1], kerbs[begins, 3]
    start = far[waiting_row]
    looks = int((far[end] - start) / CROSSES_MS / LOOK_S) + 2
    early = round(LOOK_S / step_s)
    for c in range(len(cars)):
        j = cars[c]
        if level[j] != level[r]:
            continue
        u = waiting_row
        for look in range(looks):
            while u < end and far[u + 1] <= start + look * LOOK_S * CROSSES_MS:
                u += 1
            middle = j + round(look * LOOK_S / step_s)
            for b in (middle - early, middle, middle + early):
                if b < j or b > last[j]:
                    continue
                if _drives_into(boxes[u, 0], boxes[u, 1], boxes[u], boxes, j, b):
                    return True
    return False


@per_actor
def drives_by(r, x, y, cars, level, last, boxes, now, step_s):
    """Return whether a vehicle soon passes a place too near for a pedestrian to step there."""
    for c in range(len(cars)):
        j = cars[c]
        if level[j] != level[r]:
            continue
        for look in range(int(ASIDE_S / LOOK_S) + 1):
            b = j + round(look * LOOK_S / step_s)
            if b > last[j]:
                break
            if _drives_into(x, y, now[r], boxes, j, b):
                return True
    return False
