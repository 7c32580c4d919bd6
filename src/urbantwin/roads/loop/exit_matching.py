"""Matching the region's one-way exits to its one-way entries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["match_exits", "ring_distance"]


def ring_distance(
    start: NDArray[np.float64], end: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Return the distances (N, M) between places (N,) and (M,) the shorter way round a ring."""
    gap = np.abs(np.asarray(start)[:, None] - np.asarray(end)[None])
    return np.asarray(np.minimum(gap, length - gap))


def match_exits(
    exits: NDArray[np.float64], entries: NDArray[np.float64], length: float
) -> list[tuple[int, int]]:
    """Return pairs (exit, entry) so that each is in one pair at least and the roads are short.

    The cost of a pair is the square root of its way along the border. With a concave cost the
    cheapest pairs never cross each other, because uncrossing two of them always saves (McCann,
    "Exact solutions to the transportation problem on the line", Proceedings of the Royal Society
    A 455, 1999), so that roads outside the region can be drawn without crossings.

    Args:
        exits: (N,) places of the exits along the border, metres.
        entries: (M,) places of the entries.
        length: of the border.
    """
    if not len(exits) or not len(entries):
        return []
    cost = np.sqrt(ring_distance(exits, entries, length))
    swap = len(exits) < len(entries)
    if swap:
        cost = cost.T
    # The more numerous side has one pair each; what finds no partner of its own shares the
    # nearest.
    rows, columns = cost.shape
    padded = np.hstack([cost, np.repeat(cost.min(axis=1, keepdims=True), rows - columns, axis=1)])
    row, column = linear_sum_assignment(padded)
    pairs = [
        (int(r), int(c) if c < columns else int(cost[r].argmin()))
        for r, c in zip(row, column, strict=True)
    ]
    return sorted((c, r) if swap else (r, c) for r, c in pairs)
