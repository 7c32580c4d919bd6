"""Nearest points of one tree to every point of another."""

import numpy as np
from numba import njit

from urbantwin.fidelity.compiled.box_tree import apart, run_of

__all__ = ["LEAF", "leaf_table", "nearest_points"]

#: Points per leaf, which are measured together.
LEAF = 16
#: Size of the stack of parts to visit: at most two per level.
_STACK = 128


@njit(cache=True, nogil=True)
def leaf_table(points, order, levels):
    """Return the points of each leaf as (leaves, 3, LEAF); the last point fills the remainder."""
    leaves = 1 << levels
    table = np.empty((leaves, 3, LEAF))
    for leaf in range(leaves):
        begin, end = run_of(leaf, leaves, len(order))
        for i in range(LEAF):
            row = order[min(begin + i, end - 1)]
            for k in range(3):
                table[leaf, k, i] = points[row, k]
    return table


# Without NaN and signed zeros the minimum of a leaf's distances is vectorised; sums keep their
# order, so every processor gives the same result.
@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"}, inline="always")
def _least(x, y, z, leaf):
    """Return the smallest squared distance of a position to the points (3, LEAF) of a leaf."""
    least = np.inf
    for i in range(LEAF):
        dx, dy, dz = leaf[0, i] - x, leaf[1, i] - y, leaf[2, i] - z
        least = min(least, dx * dx + dy * dy + dz * dz)
    return least


@njit(cache=True, nogil=True)
def _place(x, y, z, leaf, square):
    """Return the index of the point of a leaf at a squared distance."""
    for i in range(LEAF):
        dx, dy, dz = leaf[0, i] - x, leaf[1, i] - y, leaf[2, i] - z
        if dx * dx + dy * dy + dz * dz <= square:
            return i
    return 0


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def nearest_points(first, last, table, box, order, other, other_box, other_order, square, where):
    """Fill in squared distances and rows of the nearest points for the leaves first..last.

    The points of a leaf are close together and traverse the other tree together: a part is skipped
    if its box is farther from theirs than the largest of their distances so far. The search starts
    at the leaf in which the previous points found their nearest.

    Args:
        first: first leaf.
        last: end of the leaves, exclusive.
        table: (leaves, 3, LEAF) points of the leaves.
        box: boxes of the tree's parts.
        order: (N,) order of the points.
        other: as ``table``, of the other tree.
        other_box: boxes of the other tree's parts.
        other_order: order of its points.
        square: (N,) output: squared distances.
        where: (N,) output: rows of the other's points.
    """
    leaves, other_leaves = len(table), len(other)
    waiting = np.empty(_STACK, np.int64)
    away = np.empty(_STACK)
    best = np.empty(LEAF)
    held = np.empty(LEAF, np.int64)  # leaf of the best
    near = 0
    for leaf in range(first, last):
        mine, my_box = table[leaf], box[leaves - 1 + leaf]
        worst = 0.0
        for i in range(LEAF):
            best[i] = _least(mine[0, i], mine[1, i], mine[2, i], other[near])
            held[i] = near
            worst = max(worst, best[i])
        waiting[0], away[0], top = 0, 0.0, 1
        while top:
            top -= 1
            if away[top] >= worst:
                continue
            part = waiting[top]
            its = other_box[part]
            if part >= other_leaves - 1:
                worst = 0.0
                for i in range(LEAF):
                    x, y, z = mine[0, i], mine[1, i], mine[2, i]
                    dx = max(its[0] - x, x - its[3], 0.0)
                    dy = max(its[1] - y, y - its[4], 0.0)
                    dz = max(its[2] - z, z - its[5], 0.0)
                    if dx * dx + dy * dy + dz * dz < best[i]:
                        least = _least(x, y, z, other[part - other_leaves + 1])
                        if least < best[i]:
                            best[i] = least
                            held[i] = near = part - other_leaves + 1
                    worst = max(worst, best[i])
                continue
            closer, farther = 2 * part + 1, 2 * part + 2
            close, far = apart(my_box, other_box[closer]), apart(my_box, other_box[farther])
            if close > far:
                closer, farther, close, far = farther, closer, far, close
            if far < worst:
                waiting[top], away[top] = farther, far
                top += 1
            if close < worst:
                waiting[top], away[top] = closer, close
                top += 1
        begin, end = run_of(leaf, leaves, len(order))
        for i in range(begin, end):
            k = i - begin
            square[order[i]] = best[k]
            at = _place(mine[0, k], mine[1, k], mine[2, k], other[held[k]], best[k])
            its_begin, its_end = run_of(held[k], other_leaves, len(other_order))
            where[order[i]] = other_order[min(its_begin + at, its_end - 1)]
