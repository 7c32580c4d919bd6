"""Where the beams of a frame end if something stands in their way."""

import numpy as np
from numba import njit

__all__ = ["met"]


@njit(cache=True, nogil=True)
def met(points, start, middle, half, turn, is_round, depth, deep):
    """Return where the way from the sensor to each point ends, and at which obstacle.

    Args:
        points: (N, >= 3) metres.
        start: (N, 3) where the sensor of each stands.
        middle: (K, 3) of the obstacles.
        half: (K, 3) half their length, width and height.
        turn: (K,) their yaw, radians.
        is_round: (K,) an ellipsoid; else a box.
        depth: (K,) how deep a beam gets into it on average, metres; 0 for what is solid.
        deep: (N,) how much deeper than on average each beam gets.

    Returns:
        shares of the way (N,), 1 where nothing is met; numbers of obstacles (N,), -1 for none.
    """
    share = np.ones(len(points))
    which = np.full(len(points), -1, np.int64)
    c, s = np.cos(turn), np.sin(turn)
    reach = np.hypot(half[:, 0], half[:, 1])
    for i in range(len(points)):
        dx = points[i, 0] - start[i, 0]
        dy = points[i, 1] - start[i, 1]
        dz = points[i, 2] - start[i, 2]
        flat = np.hypot(dx, dy)
        length = np.hypot(flat, dz)
        if flat < 1e-6:
            continue
        for k in range(len(middle)):
            x = start[i, 0] - middle[k, 0]
            y = start[i, 1] - middle[k, 1]
            along = -(x * dx + y * dy) / flat
            if along < 0 or along > flat + reach[k] or abs(x * dy - y * dx) > reach[k] * flat:
                continue
            ox = (c[k] * x + s[k] * y) / half[k, 0]
            oy = (c[k] * y - s[k] * x) / half[k, 1]
            oz = (start[i, 2] - middle[k, 2]) / half[k, 2]
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
            ends = max(enters, 0.0) + depth[k] * deep[i] / length
            if ends < leaves and ends < share[i]:
                share[i] = ends
                which[i] = k
    return share, which
