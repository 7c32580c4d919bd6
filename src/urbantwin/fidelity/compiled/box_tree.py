"""A balanced tree of bounding boxes of points or triangles.

Level k splits the items into 2^k runs of one order, as even as possible. The parts of all levels
are numbered consecutively from the root: the halves of part p are 2 p + 1 and 2 p + 2.
"""

import numpy as np
from numba import njit

__all__ = ["apart", "arranged", "boxed", "run_of"]


@njit(cache=True, nogil=True)
def run_of(part, parts, count):
    """Return begin and end of the ``part``-th of ``parts`` runs of ``count`` items."""
    return part * count // parts, (part + 1) * count // parts


@njit(cache=True, nogil=True)
def apart(a, b):
    """Return the squared distance of two boxes (6,): lower corner, upper corner."""
    x = max(a[0] - b[3], b[0] - a[3], 0.0)
    y = max(a[1] - b[4], b[1] - a[4], 0.0)
    z = max(a[2] - b[5], b[2] - a[5], 0.0)
    return x * x + y * y + z * z


@njit(cache=True, nogil=True)
def arranged(places, most):
    """Return an order of (N, 3) positions by leaves, and the number of levels of the tree.

    Every run is split at the median along its longest axis, until no run has more than ``most``.
    """
    count = len(places)
    levels = 0
    while count > most << levels:
        levels += 1
    order = np.arange(count)
    moved = np.empty((3, count))  # positions in that order, for locality in memory
    for i in range(count):
        for k in range(3):
            moved[k, i] = places[i, k]
    level, part = np.empty(levels + 2, np.int64), np.empty(levels + 2, np.int64)
    level[0], part[0], top = 0, 0, 1
    while top:
        top -= 1
        here, run = level[top], part[top]
        if here == levels:
            continue
        low, high = run_of(run, 1 << here, count)
        axis, widest = 0, -1.0
        for k in range(3):
            width = _width(moved[k, low:high])
            if width > widest:
                axis, widest = k, width
        middle = run_of(2 * run, 2 << here, count)[1]
        _halve(moved[axis], moved[axis - 1], moved[axis - 2], order, low, high, middle)
        for half in range(2):
            level[top], part[top] = here + 1, 2 * run + half
            top += 1
    return order, levels


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _width(values):
    """Return the difference of the largest and the smallest value."""
    least = greatest = values[0]
    for value in values:
        least = min(least, value)
        greatest = max(greatest, value)
    return greatest - least


@njit(cache=True, nogil=True)
def _halve(value, second, third, order, low, high, middle):
    """Move the lower values of low..high before ``middle`` (Hoare 1961, "Algorithm 65: find")."""
    first, last = low, high - 1
    while first < last:
        pivot = value[(first + last) // 2]
        i, j = first, last
        while i <= j:
            while value[i] < pivot:
                i += 1
            while value[j] > pivot:
                j -= 1
            if i <= j:
                value[i], value[j] = value[j], value[i]
                second[i], second[j] = second[j], second[i]
                third[i], third[j] = third[j], third[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@njit(cache=True, nogil=True)
def boxed(low, high, order, levels):
    """Return the boxes (2^(levels + 1) - 1, 6) of all parts.

    Args:
        low: (N, 3) lower corner of each item's box.
        high: (N, 3) upper corner.
        order: (N,) order of the items.
        levels: levels of the tree.
    """
    leaves = 1 << levels
    box = np.empty((2 * leaves - 1, 6))
    for leaf in range(leaves):
        node = leaves - 1 + leaf
        begin, end = run_of(leaf, leaves, len(order))
        for k in range(3):
            least, greatest = np.inf, -np.inf
            for i in range(begin, end):
                least = min(least, low[order[i], k])
                greatest = max(greatest, high[order[i], k])
            box[node, k], box[node, k + 3] = least, greatest
    for node in range(leaves - 2, -1, -1):
        for k in range(3):
            box[node, k] = min(box[2 * node + 1, k], box[2 * node + 2, k])
            box[node, k + 3] = max(box[2 * node + 1, k + 3], box[2 * node + 2, k + 3])
    return box
