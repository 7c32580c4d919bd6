"""Which rays of a turn can touch an actor: blocks of rings and columns.

The actor moves while the sensor turns, so where it is depends on when a ray fires, and when the
sensor looks at it depends on where it is. First the directions in which it lies at any time of
the turn give the columns that can see it; then the directions in which it lies while those
columns fire give the block. An actor that stands where the turn begins and ends is seen twice,
by a block at each end.
"""

import numpy as np
from numba import njit

from urbantwin.lidar.compiled.bounds import bounds_of_box, widened
from urbantwin.lidar.compiled.pose import actor_from_sensor, set_pose

__all__ = ["find_blocks"]

#: Elevations are widened by this, radians: far above float32's rounding, far below a ring.
_ELEVATION_MARGIN = 1e-4
#: An actor goes no farther than this between two looks at where it is, metres.
_LOOK_M = 0.15
_MOST_LOOKS = 24


@njit(cache=True, nogil=True)
def _bounds_between(
    first, last, actor, low, high, path, sensor_rotation, sensor_place, timing, room
):
    """Return the bounds of an actor while columns first..last (in firing order) fire."""
    knot_time, rotation, translation, turn = path
    column_time, ring_span, first_column = timing
    actor_rotation, actor_place, relative, place = room
    count = len(column_time)
    moving = len(sensor_place) > 1

    begin = column_time[(first + first_column) % count]
    end = column_time[(last + first_column) % count] + ring_span
    set_pose(
        begin, actor, knot_time, rotation, translation, turn,
        actor_rotation, actor_place,
    )  # fmt: skip
    x, y, z = actor_place[0], actor_place[1], actor_place[2]
    set_pose(
        end, actor, knot_time, rotation, translation, turn,
        actor_rotation, actor_place,
    )  # fmt: skip
    k, m = (first + first_column) % count if moving else 0, 0
    if moving:
        m = (last + first_column) % count
    x += sensor_place[m, 0] - sensor_place[k, 0]
    y += sensor_place[m, 1] - sensor_place[k, 1]
    z += sensor_place[m, 2] - sensor_place[k, 2]
    far = np.sqrt((actor_place[0] - x) ** 2 + (actor_place[1] - y) ** 2 + (actor_place[2] - z) ** 2)
    angle = 0.0
    for n in range(turn.shape[1]):
        angle += np.sqrt(turn[actor, n, 0] ** 2 + turn[actor, n, 1] ** 2 + turn[actor, n, 2] ** 2)
    size = np.sqrt(((high - low) ** 2).sum())
    looks = 1 + int(np.ceil((far + angle * size) / _LOOK_M))
    if moving:
        looks = max(looks, 4)
    looks = min(looks, _MOST_LOOKS)
    bounds = (0.0, 0.0, 0.0, 0.0)
    for look in range(looks + 1):
        j = first + (last - first) * look // looks
        k = (j + first_column) % count
        time = begin + (end - begin) * look / looks
        set_pose(
            time, actor, knot_time, rotation, translation, turn,
            actor_rotation, actor_place,
        )  # fmt: skip
        n = k if moving else 0
        actor_from_sensor(
            actor_rotation, actor_place, n, sensor_rotation, sensor_place, relative, place
        )
        now = bounds_of_box(low, high, relative, place)
        bounds = now if look == 0 else widened(bounds, now)
        if far == 0.0 and angle == 0.0 and not moving:
            break
    return bounds


@njit(cache=True, nogil=True)
def _columns(start, width, azimuth, step, turn, pad):
    """Return the first column of a ring that points into an azimuth, and how many."""
    first = (azimuth - start - width) / step if turn < 0 else (start - azimuth) / step
    return int(np.floor(first)) - pad, int(np.ceil(width / step)) + 2 * pad + 1


@njit(cache=True, nogil=True)
def find_blocks(
    low, high, path, sensor_rotation, sensor_place, timing, rings, range_max_m, room, found
):
    """Write the rays that can touch each of A actors and return how many blocks and rays.

    Args:
        low: (A, 3) lower corners of the actors, each in its own frame.
        high: (A, 3) upper corners.
        path: knots of all actors: times (A, T), rotations (A, T, 3, 3), translations (A, T, 3),
            turns (A, T - 1, 3).
        sensor_rotation: (K, 3, 3) of ``site_SE3_sensor`` when each column fires, or (1, 3, 3).
        sensor_place: (K, 3) or (1, 3).
        timing: column times (K,), the span of a column's firings, and the column that fires first.
        rings: order (C,) of channels by elevation, their elevations (C,), azimuths (C,) of column
            0, radians, the step between columns, +1 or -1 for the sense of the turn, and how far a
            beam reaches beside its axis.
        range_max_m: an actor wholly beyond it is left out.
        room: scratch: (3, 3), (3,), (3, 3), (3,).
        found: blocks (B, 4) int64 to write: actor, rows, columns, first ray's number in the second
            array, (R,) int32, rays in rows by elevation, -1 where a ray belongs to another block.

    Returns:
        Blocks and rays that were found; where either is more than there is room for, nothing
        beyond the room was written.
    """
    knot_time, rotation, translation, turns = path
    column_time, _, first_column = timing
    order, elevation, azimuth, step, turn, beside = rings
    blocks, rays = found
    actor_rotation, actor_place, relative, place = room
    count = len(column_time)
    # High up, a beam is as wide as everywhere, but azimuths lie closer.
    pad = 1 + int(np.ceil(1.7 * beside / step))
    margin = _ELEVATION_MARGIN + beside
    used, written = 0, 0
    for actor in range(len(low)):
        set_pose(
            column_time[first_column], actor, knot_time, rotation, translation, turns,
            actor_rotation, actor_place,
        )  # fmt: skip
        n = first_column if len(sensor_place) > 1 else 0
        actor_from_sensor(
            actor_rotation, actor_place, n, sensor_rotation, sensor_place, relative, place
        )
        away = 0.0
        for i in range(3):
            beyond = max(low[actor, i] - place[i], place[i] - high[actor, i], 0.0)
            away += beyond * beyond
        # A turn takes a fifth of a second at most, in which nothing goes farther than 20 m.
        if away > (range_max_m + 20.0) ** 2:
            continue
        whole = _bounds_between(
            0, count - 1, actor, low[actor], high[actor], path, sensor_rotation, sensor_place,
            timing, room,
        )  # fmt: skip
        earliest, latest = 1 << 60, -(1 << 60)
        for row in range(len(order)):
            if whole[2] - margin <= elevation[row] <= whole[3] + margin:
                first, width = _columns(whole[0], whole[1], azimuth[row], step, turn, pad)
                earliest, latest = min(earliest, first), max(latest, first + width - 1)
        if latest < earliest:
            continue
        begin = (earliest - first_column) % count
        length = latest - earliest + 1
        pieces = 1
        if length >= count:
            begin, length = 0, count
        elif begin + length > count:
            pieces = 2
        for piece in range(pieces):
            if piece == 0:
                one, last = begin, min(begin + length, count) - 1
            else:
                one, last = 0, begin + length - count - 1
            near = whole
            if length < count:
                near = _bounds_between(
                    one, last, actor, low[actor], high[actor], path, sensor_rotation,
                    sensor_place, timing, room,
                )  # fmt: skip
            bottom, top = len(order), -1
            widest = 0
            for row in range(len(order)):
                if near[2] - margin <= elevation[row] <= near[3] + margin:
                    bottom, top = min(bottom, row), row
                    _, width = _columns(near[0], near[1], azimuth[row], step, turn, pad)
                    widest = max(widest, width)
            if top < bottom:
                continue
            wide = min(widest, count)
            rows = top - bottom + 1
            if used < len(blocks) and written + rows * wide <= len(rays):
                blocks[used, 0], blocks[used, 1] = actor, rows
                blocks[used, 2], blocks[used, 3] = wide, written
                at = written
                for row in range(bottom, top + 1):
                    start, _ = _columns(near[0], near[1], azimuth[row], step, turn, pad)
                    for n in range(wide):
                        column = (start + n) % count
                        j = (column - first_column) % count
                        inside = one <= j <= last
                        rays[at] = order[row] * count + column if inside else -1
                        at += 1
            used += 1
            written += rows * wide
    return used, written
