"""Which rays of a turn can touch an actor: blocks of rings and columns.

The actor moves while the sensor turns, so where it is depends on when a ray fires, and when the
sensor looks at it depends on where it is. First the directions in which it lies at any time of
the turn give the columns that can see it; then the directions in which it lies while those
columns fire give the block. An actor that stands where the turn begins and ends is seen twice,
by a block at each end.
"""

import numpy as np

from urbantwin.geometry.compiled import per_block
from urbantwin.lidar.casting.tracer import Blocks
from urbantwin.lidar.compiled.bounds import bounds_of_box, widened
from urbantwin.lidar.compiled.pose import actor_from_sensor, set_pose

__all__ = ["find_blocks", "rays_within"]

#: Elevations are widened by this, radians: far above float32's rounding, far below a ring.
_ELEVATION_MARGIN = 1e-4
#: An actor goes no farther than this between two looks at where it is, metres, or than this share
#: of how far away it is, which puts an elevation off by less than the margin above.
_LOOK_M, _LOOK_SHARE = 0.15, 0.02
_MOST_LOOKS = 24
_TURN = 2 * np.pi


@per_block
def _set_relative_pose(time, column, actor, paths, firing, relative, place):
    """Write the sensor's pose as an actor sees it: rotation (3, 3) and place (3,)."""
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    set_pose(time, actor, paths, actor_rotation, actor_place)
    n = column if len(firing.translation) > 1 else 0
    actor_from_sensor(
        actor_rotation, actor_place, n, firing.rotation, firing.translation, relative, place
    )


@per_block
def _bounds_between(first, last, actor, low, high, paths, firing, first_column, ring_span):
    """Return the bounds of an actor while columns first..last (in firing order) fire."""
    column_time, sensor_place = firing.column_time_s, firing.translation
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    relative, place = np.empty((3, 3)), np.empty(3)
    knot_time, turn = paths.time_s, paths.turn
    count = len(column_time)
    moving = len(sensor_place) > 1

    begin = column_time[(first + first_column) % count]
    end = column_time[(last + first_column) % count] + ring_span
    k, m = 0, 0
    if moving:
        k, m = (first + first_column) % count, (last + first_column) % count
    set_pose(begin, actor, paths, actor_rotation, actor_place)
    x, y, z = actor_place[0], actor_place[1], actor_place[2]
    set_pose(end, actor, paths, actor_rotation, actor_place)
    # How far the actor goes past the sensor, how far its parts do as it turns, and how near it is.
    gone, away, size = 0.0, 0.0, 0.0
    for i in range(3):
        begins = (x if i == 0 else (y if i == 1 else z)) - sensor_place[k, i]
        ends = actor_place[i] - sensor_place[m, i]
        gone, away = gone + (ends - begins) ** 2, away + ends**2
        size += max(-low[i], high[i]) ** 2
    gone, size = np.sqrt(gone), np.sqrt(size)
    swung = 0.0
    for n in range(turn.shape[1]):
        angle = np.sqrt(turn[actor, n, 0] ** 2 + turn[actor, n, 1] ** 2 + turn[actor, n, 2] ** 2)
        rate = angle / (knot_time[actor, n + 1] - knot_time[actor, n])
        swung = max(swung, rate * (end - begin) * size)
    # A straight way is seen as it is from far away.
    straight = max(_LOOK_M, _LOOK_SHARE * (np.sqrt(away) - gone - size))
    looks = max(int(np.ceil(gone / straight + swung / _LOOK_M)), 1)
    if moving:
        looks = max(looks, 4)
    looks = min(looks, _MOST_LOOKS)
    bounds = (0.0, 0.0, 0.0, 0.0)
    for look in range(looks + 1):
        j = first + (last - first) * look // looks
        k = (j + first_column) % count
        time = begin + (end - begin) * look / looks
        _set_relative_pose(time, k, actor, paths, firing, relative, place)
        now = bounds_of_box(low, high, relative, place)
        bounds = now if look == 0 else widened(bounds, now)
        if gone == 0.0 and swung == 0.0 and not moving:
            break
    return bounds


@per_block
def _columns(start, width, azimuth, step, turn, pad):
    """Return the first column of a ring that points into an azimuth, and how many."""
    first = (azimuth - start - width) / step if turn < 0 else (start - azimuth) / step
    return int(np.floor(first)) - pad, int(np.ceil(width / step)) + 2 * pad + 1


@per_block
def find_blocks(low, high, paths, firing, rings, beside, range_max_m, found):
    """Write the rays that can touch each of A actors and return how many blocks and rays.

    Args:
        low: (A, 3) lower corners of the actors, each in its own frame.
        high: (A, 3) upper corners.
        paths: `actor_path.Paths`.
        firing: `tracer.Firing`.
        rings: `beams.Rings`.
        beside: how far a beam reaches beside its axis, radians.
        range_max_m: an actor wholly beyond it is left out.
        found: `tracer.Blocks` to write: rays in rows by elevation.

    Returns:
        Blocks and rays that were found; where either is more than there is room for, nothing
        beyond the room was written.
    """
    order, elevation, azimuth, step, turn = rings
    column_time = firing.column_time_s
    first_column, ring_span = np.argmin(column_time), firing.ring_time_s.max()
    relative, place = np.empty((3, 3)), np.empty(3)
    count = len(column_time)
    # High up, a beam is as wide as everywhere, but azimuths lie closer.
    pad = 1 + int(np.ceil(1.7 * beside / step))
    margin = _ELEVATION_MARGIN + beside
    used, written = 0, 0
    for actor in range(len(low)):
        _set_relative_pose(
            column_time[first_column], first_column, actor, paths, firing, relative, place
        )
        away = 0.0
        for i in range(3):
            beyond = max(low[actor, i] - place[i], place[i] - high[actor, i], 0.0)
            away += beyond * beyond
        # A turn takes a fifth of a second at most, in which nothing goes farther than 20 m.
        if away > (range_max_m + 20.0) ** 2:
            continue
        whole = _bounds_between(
            np.int64(0),  # a literal 0 would compile it once more
            count - 1, actor, low[actor], high[actor], paths, firing, first_column, ring_span,
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
                    one, last, actor, low[actor], high[actor], paths, firing, first_column,
                    ring_span,
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
            if used < len(found.actor) and written + rows * wide <= len(found.ray):
                found.actor[used], found.rows[used] = actor, rows
                found.wide[used], found.start[used] = wide, written
                at = written
                for row in range(bottom, top + 1):
                    start, _ = _columns(near[0], near[1], azimuth[row], step, turn, pad)
                    # A division for each ray would take as long as all the rest of it.
                    column = start % count
                    j = (column - first_column) % count
                    for _ in range(wide):
                        inside = one <= j <= last
                        found.ray[at] = order[row] * count + column if inside else -1
                        at += 1
                        column, j = column + 1, j + 1
                        column, j = column if column < count else 0, j if j < count else 0
            used += 1
            written += rows * wide
    return used, written


@per_block
def rays_within(low, high, paths, firing, beside, range_max_m):
    """Return the blocks that can touch actors, of beams that stand in no columns.

    As `find_blocks`, for directions in any order; a block is a row of beams.
    """
    column_time, beams = firing.column_time_s, firing.directions
    first_column, ring_span = np.argmin(column_time), firing.ring_time_s.max()
    relative, place = np.empty((3, 3)), np.empty(3)
    count = len(column_time)
    azimuth, elevation = np.empty(len(beams)), np.empty(len(beams))
    for n in range(len(beams)):
        azimuth[n] = np.arctan2(beams[n, 1], beams[n, 0])
        elevation[n] = np.arcsin(min(max(beams[n, 2], -1.0), 1.0))
    found_actor, found_rows = np.empty(len(low), np.int64), np.ones(len(low), np.int64)
    found_wide, found_start = np.empty(len(low), np.int64), np.empty(len(low), np.int64)
    rays = np.empty(1024, np.int32)
    used, written = 0, 0
    margin = _ELEVATION_MARGIN + beside
    looks = 8
    for actor in range(len(low)):
        bounds = (0.0, 0.0, 0.0, 0.0)
        near = np.inf
        for look in range(looks + 1):
            k = (first_column + (count - 1) * look // looks) % count
            time = column_time[k] + (ring_span if look == looks else 0.0)
            _set_relative_pose(time, k, actor, paths, firing, relative, place)
            now = bounds_of_box(low[actor], high[actor], relative, place)
            bounds = now if look == 0 else widened(bounds, now)
            away = 0.0
            for i in range(3):
                away += max(low[actor, i] - place[i], place[i] - high[actor, i], 0.0) ** 2
            near = min(near, np.sqrt(away))
        if near > range_max_m:
            continue
        # What an actor may pass between two looks, in a turn of a fifth of a second at most.
        extra = margin + 0.01
        start = written
        for n in range(len(beams)):
            past = (azimuth[n] - bounds[0] + extra) % _TURN
            level = bounds[2] - extra <= elevation[n] <= bounds[3] + extra
            if level and past <= bounds[1] + 2 * extra:
                if written == len(rays):
                    more = np.empty(2 * len(rays), np.int32)
                    more[:written] = rays
                    rays = more
                rays[written] = n
                written += 1
        if written > start:
            found_actor[used], found_wide[used], found_start[used] = actor, written - start, start
            used += 1
    return Blocks(
        found_actor[:used], found_rows[:used], found_wide[:used], found_start[:used], rays[:written]
    )
