"""Neighbouring pairs in a step."""

import numpy as np
from numba import njit

from urbantwin.geometry.compiled.room import with_more_room

__all__ = ["close_pairs"]


@njit(cache=True, nogil=True)
def close_pairs(step, x, y, reach, wanted, within):
    """Return the pairs (P, 2) of circles of one step that are nearer to each other than a distance.

    Args:
        step: (N,) int64, time step; not decreasing.
        x: (N,) x of their centres; not decreasing within a step.
        y: (N,) y of their centres.
        reach: (N,) their radii.
        wanted: (N,) bool, at least one of both must be wanted.
        within: distance, metres.
    """
    count = len(step)
    pairs = np.empty((1024, 2), np.int64)
    count_found = first = 0
    while first < count:
        last, widest = first, 0.0
        while last < count and step[last] == step[first]:
            widest = max(widest, reach[last])
            last += 1
        for i in range(first, last):
            for j in range(i + 1, last):
                far = x[j] - x[i]
                if far >= reach[i] + widest + within:
                    break
                limit = reach[i] + reach[j] + within
                if not (wanted[i] or wanted[j]) or far * far + (y[j] - y[i]) ** 2 >= limit * limit:
                    continue
                if count_found == len(pairs):
                    pairs = with_more_room(pairs)
                pairs[count_found, 0], pairs[count_found, 1] = i, j
                count_found += 1
        first = last
    return pairs[:count_found]
