"""Turns across oncoming traffic that pass in front of each other, as drivers make them.

The gentlest way from stop line to exit leads past the middle of a wide junction on its far side, so
that those who turn from opposite sides would cross each other's way twice, and wait for each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urbantwin.geometry import wrapped
from urbantwin.roads.model.curve import Curve, splined

__all__ = ["passing_in_front"]

#: Turns by more than this across oncoming traffic, from sides this nearly opposite, radians.
TURN, OPPOSITE = np.radians(50.0), np.radians(45.0)
#: How far apart the middles of opposed turns pass, and the most that one is moved for it, metres.
APART_M, MOST_M = 3.4, 5.0


def passing_in_front(curves: Sequence[Curve], groups: Sequence[int], inner: float) -> list[Curve]:
    """Return curves of which opposed inner turns no longer cross.

    Args:
        curves: ways through one junction.
        groups: number of the street that each comes from and goes to: its lanes are moved alike.
        inner: 1 where turns to the left cross oncoming traffic (right-hand traffic), else -1.
    """
    ends = np.array([curve.at([0.0, curve.length]) for curve in curves]).reshape(-1, 2, 3)
    turn = inner * wrapped(ends[:, 1, 2] - ends[:, 0, 2])
    turning = [k for k in range(len(curves)) if turn[k] > TURN]
    middle = {k: curves[k].at([curves[k].length / 2])[0] for k in turning}
    moved: dict[int, float] = {}
    for k in turning:
        heading = middle[k][2]
        inwards = inner * np.array([-np.sin(heading), np.cos(heading)])
        for j in turning:
            opposed = abs(wrapped(ends[k, 0, 2] - ends[j, 0, 2] + np.pi)) < OPPOSITE
            if not opposed or curves[k].line.distance(curves[j].line) >= APART_M:
                continue
            apart = float((middle[k][:2] - middle[j][:2]) @ inwards)
            lacking = float(np.clip((APART_M - apart) / 2, 0.0, MOST_M))
            moved[groups[k]] = max(moved.get(groups[k], 0.0), lacking)
    found = list(curves)
    for k in turning:
        if by := moved.get(groups[k], 0.0):
            heading = middle[k][2]
            inwards = inner * np.array([-np.sin(heading), np.cos(heading)])
            points = np.array([ends[k, 0, :2], middle[k][:2] + by * inwards, ends[k, 1, :2]])
            found[k] = splined(points, float(ends[k, 0, 2]), float(ends[k, 1, 2]))
    return found
