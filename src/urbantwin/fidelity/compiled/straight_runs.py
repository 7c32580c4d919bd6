"""The straightest run of points through a point, among its neighbours."""

import numpy as np
from numba import njit

__all__ = ["straight_runs"]


@njit(cache=True, nogil=True)
def straight_runs(points, seeds, near, aside, fewest):
    """Find for each seed the line through it that most of its neighbours lie on.

    Args:
        points: (N, 3), metres.
        seeds: (S,) rows of points.
        near: (S, K) rows of the neighbours of each seed, the seed itself first.
        aside: maximum distance of a point from the line, metres.
        fewest: minimum number of points of a run, including the seed.

    Returns:
        (S,) number of points of the run, 0 without one; (S, 3) their mean; (S, 3) unit direction of
        the best line through them; (S,) root mean square distance from the line, metres; (S,) root
        mean square position along it.
    """
    count = len(seeds)
    wide = near.shape[1]
    size = np.zeros(count, np.int64)
    middle = np.zeros((count, 3))
    along = np.zeros((count, 3))
    off = np.zeros(count)
    spread = np.zeros(count)
    taken = np.zeros(wide, np.bool_)
    delta = np.empty((wide, 3))
    for s in range(count):
        origin = points[seeds[s]]
        for k in range(wide):
            for c in range(3):
                delta[k, c] = points[near[s, k], c] - origin[c]
        reach = 0.0
        for k in range(wide):
            reach = max(reach, np.sqrt((delta[k] ** 2).sum()))
        best, chosen = 0, -1
        for k in range(1, wide):
            length = np.sqrt((delta[k] ** 2).sum())
            if length < 0.35 * reach:
                continue
            u = delta[k] / length
            hit = 0
            for j in range(wide):
                t = delta[j] @ u
                if ((delta[j] - t * u) ** 2).sum() < aside * aside:
                    hit += 1
            if hit > best:
                best, chosen = hit, k
        if best < fewest:
            continue
        u = delta[chosen] / np.sqrt((delta[chosen] ** 2).sum())
        # The second iteration removes the tilt due to the seed's own error.
        centre = np.zeros(3)
        for _ in range(2):
            n = 0
            mean = np.zeros(3)
            for j in range(wide):
                d = delta[j] - centre
                t = d @ u
                taken[j] = ((d - t * u) ** 2).sum() < aside * aside
                if taken[j]:
                    n += 1
                    mean += delta[j]
            if n < fewest:
                break
            mean /= n
            moment = np.zeros((3, 3))
            for j in range(wide):
                if taken[j]:
                    d = delta[j] - mean
                    for a in range(3):
                        for b in range(3):
                            moment[a, b] += d[a] * d[b] / n
            value, vector = np.linalg.eigh(moment)
            u = np.ascontiguousarray(vector[:, 2])
            centre = mean
        if n < fewest:
            continue
        size[s] = n
        middle[s] = origin + centre
        along[s] = u
        off[s] = np.sqrt(max(0.0, value[0] + value[1]))
        spread[s] = np.sqrt(max(0.0, value[2]))
    return size, middle, along, off, spread
