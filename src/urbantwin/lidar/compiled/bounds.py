"""Angular bounds of a box: the azimuths and elevations at which a sensor sees it."""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.lidar.compiled.pose import actor_from_sensor

__all__ = ["bounds_of_box", "in_field", "widened"]

#: Closer to the sensor's axis than this, metres, a corner has no azimuth.
_AXIS_MARGIN_M = 1e-3
_TURN = 2 * np.pi


@per_block
def bounds_of_box(low, high, rotation, place):
    """Return azimuth, width, lowest and highest elevation of a box, radians.

    Azimuth: the corners leave a widest gap. It is more than half a turn exactly when the sensor's
    axis passes outside the box; inside, the width is a whole turn. Elevation: along an edge
    ``p + t d`` it has one extreme, where ``t = (p_z p.d - d_z p.p) / (d_z p.d - p_z d.d)`` with
    horizontal dot products; inside a face it has none, because a plane that does not hold the
    sensor touches no cone about its axis.

    Args:
        low: (3,) lower corner of the box in its own frame.
        high: (3,) upper corner.
        rotation: (3, 3) of ``box_SE3_sensor``.
        place: (3,) the sensor in the box's frame.
    """
    corner = np.empty((8, 3))
    azimuth = np.empty(8)
    up, down = False, False
    for n in range(8):
        x = (high[0] if n & 1 else low[0]) - place[0]
        y = (high[1] if n & 2 else low[1]) - place[1]
        z = (high[2] if n & 4 else low[2]) - place[2]
        for i in range(3):
            corner[n, i] = rotation[0, i] * x + rotation[1, i] * y + rotation[2, i] * z
        azimuth[n] = np.arctan2(corner[n, 1], corner[n, 0])
        up, down = up or corner[n, 2] > 0, down or corner[n, 2] < 0
    for n in range(1, 8):  # a general sort takes several times as long for so few
        one, k = azimuth[n], n
        while k > 0 and azimuth[k - 1] > one:
            azimuth[k] = azimuth[k - 1]
            k -= 1
        azimuth[k] = one
    widest, gap = 7, azimuth[0] + _TURN - azimuth[7]
    for n in range(7):
        if azimuth[n + 1] - azimuth[n] > gap:
            widest, gap = n, azimuth[n + 1] - azimuth[n]
    # How far up, and level, the lowest and the highest place lie: an angle of each takes longer.
    low_z, low_level, high_z, high_level = 1.0, 0.0, -1.0, 0.0
    nearest = np.inf
    for n in range(8):
        z, level = corner[n, 2], np.sqrt(corner[n, 0] ** 2 + corner[n, 1] ** 2)
        nearest = min(nearest, level)
        if z * low_level < low_z * level:
            low_z, low_level = z, level
        if z * high_level > high_z * level:
            high_z, high_level = z, level
    for bit in (1, 2, 4):
        for n in range(8):
            if n & bit:
                continue
            m = n | bit
            x, y, z = corner[n, 0], corner[n, 1], corner[n, 2]
            dx, dy, dz = corner[m, 0] - x, corner[m, 1] - y, corner[m, 2] - z
            pp, pd, dd = x**2 + y**2, x * dx + y * dy, dx * dx + dy * dy
            slope = dz * pd - z * dd
            if slope == 0.0:
                continue
            share = (z * pd - dz * pp) / slope
            if 0.0 < share < 1.0:
                level = np.sqrt((x + share * dx) ** 2 + (y + share * dy) ** 2)
                z += share * dz
                nearest = min(nearest, level)
                if z * low_level < low_z * level:
                    low_z, low_level = z, level
                if z * high_level > high_z * level:
                    high_z, high_level = z, level
    lowest, highest = np.arctan2(low_z, low_level), np.arctan2(high_z, high_level)
    if gap <= np.pi + 1e-6 or nearest < _AXIS_MARGIN_M:
        if down:
            lowest = -np.pi / 2
        if up:
            highest = np.pi / 2
        return azimuth[0], _TURN, lowest, highest
    return azimuth[(widest + 1) % 8], _TURN - gap, lowest, highest


@per_ray
def widened(one, other):
    """Return bounds that hold two bounds, which are near each other."""
    start, width, lowest, highest = one
    start_2, width_2, lowest_2, highest_2 = other
    lowest, highest = min(lowest, lowest_2), max(highest, highest_2)
    if width >= _TURN or width_2 >= _TURN:
        return start, _TURN, lowest, highest
    middle = start + width / 2
    shift = np.rint((middle - (start_2 + width_2 / 2)) / _TURN) * _TURN
    first = min(start, start_2 + shift)
    last = max(start + width, start_2 + shift + width_2)
    return first, min(last - first, _TURN), lowest, highest


@per_block
def in_field(low, high, rotation, place, sensor_rotation, sensor_place, elevation, range_m):
    """Return which boxes (A,) lie wholly in a field of view, and which wholly farther away.

    Args:
        low: (A, 3) lower corners of the boxes, each in its own frame.
        high: (A, 3) upper corners.
        rotation: (A, 3, 3) of the boxes' poses.
        place: (A, 3).
        sensor_rotation: (1, 3, 3) of the sensor's pose.
        sensor_place: (1, 3).
        elevation: lowest and highest that is seen in every direction, radians.
        range_m: nearest and farthest that is measured.
    """
    whole, beyond = np.zeros(len(low), np.bool_), np.zeros(len(low), np.bool_)
    relative, eye = np.empty((3, 3)), np.empty(3)
    for a in range(len(low)):
        actor_from_sensor(rotation[a], place[a], 0, sensor_rotation, sensor_place, relative, eye)
        near, far = 0.0, 0.0
        for i in range(3):
            near += max(low[a, i] - eye[i], eye[i] - high[a, i], 0.0) ** 2
            far += max(abs(eye[i] - low[a, i]), abs(eye[i] - high[a, i])) ** 2
        near, far = np.sqrt(near), np.sqrt(far)
        beyond[a] = near > range_m[1]
        if near >= range_m[0] and far <= range_m[1]:
            _, _, lowest, highest = bounds_of_box(low[a], high[a], relative, eye)
            whole[a] = lowest >= elevation[0] and highest <= elevation[1]
    return whole, beyond
