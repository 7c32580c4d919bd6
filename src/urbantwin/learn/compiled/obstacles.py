"""Intersection of rays with obstacles."""

import numpy as np
from numba import njit

__all__ = ["met"]


#: Number of azimuth sectors by which obstacles are indexed.
_SECTORS = 720


@njit(cache=True, nogil=True)
def met(points, whose, sensors, middle, half, turn, is_round, depth, deep):
    """Return where the ray from the sensor to each point ends, and at which obstacle.

    Args:
        points: (N, >= 3) metres.
        whose: (N,) index of each point's sensor.
        sensors: (S, 3) positions, metres.
        middle: (K, 3) centres of the obstacles, metres.
        half: (K, 3) half of length, width and height, metres.
        turn: (K,) yaw, radians.
        is_round: (K,) true for ellipsoids, false for boxes.
        depth: (K,) mean penetration depth, metres; 0: solid.
        deep: (N,) penetration of each ray in units of the mean.

    Returns:
        share of the ray (N,), 1 without an intersection; index of the obstacle (N,), -1 for none.
    """
    share = np.ones(len(points))
    which = np.full(len(points), -1, np.int64)
    c, s = np.cos(turn), np.sin(turn)
    reach = np.hypot(half[:, 0], half[:, 1])
    first, obstacles = _by_sector(sensors, middle, reach)
    for i in range(len(points)):
        start = sensors[whose[i]]
        dx = points[i, 0] - start[0]
        dy = points[i, 1] - start[1]
        if dx == 0 and dy == 0:
            continue
        sector = whose[i] * _SECTORS + _sector(dx, dy)
        if first[sector] == first[sector + 1]:
            continue
        dz = points[i, 2] - start[2]
        flat = np.sqrt(dx * dx + dy * dy)
        for at in range(first[sector], first[sector + 1]):
            k = obstacles[at]
            x = start[0] - middle[k, 0]
            y = start[1] - middle[k, 1]
            along = -(x * dx + y * dy) / flat
            if along < 0 or along > flat + reach[k] or abs(x * dy - y * dx) > reach[k] * flat:
                continue
            ox = (c[k] * x + s[k] * y) / half[k, 0]
            oy = (c[k] * y - s[k] * x) / half[k, 1]
            oz = (start[2] - middle[k, 2]) / half[k, 2]
            ux = (c[k] * dx + s[k] * dy) / half[k, 0]
            uy = (c[k] * dy - s[k] * dx) / half[k, 1]
            uz = dz / half[k, 2]
            if is_round[k]:
                a = ux * ux + uy * uy + uz * uz
                b = ox * ux + oy * uy + oz * uz
                under = b * b - a * (ox * ox + oy * oy + oz * oz - 1)
                if under <= 0:
                    continue
                enters, leaves = (-b - np.sqrt(under)) / a, (-b + np.sqrt(under)) / a
            else:
                enters, leaves = -np.inf, np.inf
                for o, u in ((ox, ux), (oy, uy), (oz, uz)):
                    if abs(u) < 1e-12:
                        if abs(o) > 1:
                            leaves = -np.inf
                        continue
                    near, far = (-1 - o) / u, (1 - o) / u
                    enters, leaves = max(enters, min(near, far)), min(leaves, max(near, far))
            length = np.sqrt(flat * flat + dz * dz)
            ends = max(enters, 0.0) + depth[k] * deep[i] / length
            if ends < leaves and ends < share[i]:
                share[i] = ends
                which[i] = k
    return share, which


@njit(cache=True, nogil=True)
def _sector(x, y):
    """Return the sector of a direction by its diamond angle.

    It increases with the angle from -pi to pi and needs no arc tangent.
    """
    up = y / (abs(x) + abs(y))
    if x < 0:
        up = 2 - up if y >= 0 else -2 - up
    return min(int((up / 4 + 0.5) * _SECTORS), _SECTORS - 1)


@njit(cache=True, nogil=True)
def _by_sector(sensors, middle, reach):
    """Return the obstacles in each sector about each sensor.

    Returns:
        first (S * `_SECTORS` + 1,) and indices of obstacles, ascending: those of a sector are
        ``[first[sector] : first[sector + 1]]``.
    """
    low = np.zeros((len(sensors), len(middle)), np.int64)
    wide = np.zeros((len(sensors), len(middle)), np.int64)
    first = np.zeros(len(sensors) * _SECTORS + 1, np.int64)
    for s in range(len(sensors)):
        for k in range(len(middle)):
            x, y = middle[k, 0] - sensors[s, 0], middle[k, 1] - sensors[s, 1]
            away = np.hypot(x, y)
            wide[s, k] = _SECTORS
            if away > reach[k]:
                aside = np.arcsin(reach[k] / away) + 1e-6
                c, d = np.cos(aside), np.sin(aside)
                low[s, k] = _sector(c * x + d * y, c * y - d * x)
                high = _sector(c * x - d * y, c * y + d * x)
                wide[s, k] = (high - low[s, k]) % _SECTORS + 1
            for sector in range(low[s, k], low[s, k] + wide[s, k]):
                first[s * _SECTORS + sector % _SECTORS + 1] += 1
    first = np.cumsum(first)
    filled = first.copy()
    obstacles = np.empty(first[-1], np.int64)
    for s in range(len(sensors)):
        for k in range(len(middle)):
            for sector in range(low[s, k], low[s, k] + wide[s, k]):
                at = s * _SECTORS + sector % _SECTORS
                obstacles[filled[at]] = k
                filled[at] += 1
    return first, obstacles
