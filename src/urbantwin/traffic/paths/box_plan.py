"""Boxes of actors in plan: neighbouring pairs, and depths of overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.compiled.near import close_pairs

__all__ = ["PlanBoxes", "meetings", "near_pairs", "shared_areas"]

#: Number of pairs that are compared at a time.
_PAIRS_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class PlanBoxes:
    """N boxes in plan, site frame.

    Attributes:
        step: (N,) int, time step.
        xy: (N, 2) centres, metres.
        yaw: (N,) headings, rad.
        half: (N, 2) half the length and half the width, metres.
    """

    step: NDArray[np.integer]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    half: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: Sequence[PlanBoxes]) -> PlanBoxes:
        """Return boxes concatenated."""
        return cls(
            np.concatenate([part.step for part in parts]),
            np.concatenate([part.xy for part in parts]),
            np.concatenate([part.yaw for part in parts]),
            np.concatenate([part.half for part in parts]),
        )

    def take(self, rows: NDArray[np.integer]) -> PlanBoxes:
        """Return some of them."""
        return PlanBoxes(self.step[rows], self.xy[rows], self.yaw[rows], self.half[rows])

    @property
    def axes(self) -> NDArray[np.float64]:
        """Directions ahead and to the left (N, 2, 2), a unit vector in each row."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], axis=1)

    @property
    def polygons(self) -> NDArray[np.object_]:
        """Their outlines (N,), shapely polygons."""
        ahead, left = np.moveaxis(self.axes * self.half[..., None], 1, 0)
        corners = [a * ahead + b * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        return np.asarray(shapely.polygons(self.xy[:, None] + np.stack(corners, axis=1)))


def near_pairs(
    boxes: PlanBoxes, within_m: float, wanted: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """Return the pairs (P, 2) of boxes of a step whose circumscribed circles are near each other.

    Args:
        boxes: boxes in any order.
        within_m: distance, metres; 0 for circles that touch.
        wanted: (N,) mask of which at least one box of a pair must be part; ``None``: any.
    """
    count = max(len(boxes.step), 1)
    order = np.lexsort([boxes.xy[:, 0], boxes.step])
    (x, y), reach = boxes.xy[order].T.copy(), np.hypot(*boxes.half[order].T)
    chosen = np.ones(len(order), np.bool_) if wanted is None else wanted[order]
    step = boxes.step[order].astype(np.int64)
    low, high = np.sort(order[close_pairs(step, x, y, reach, chosen, within_m)], axis=1).T
    # Sorted as single numbers, to limit memory.
    keys = low * count + high
    keys.sort()
    return np.column_stack(np.divmod(keys, count))


def meetings(
    boxes: PlanBoxes, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the depths of overlap of pairs (P,), and the directions out (P, 2).

    By the separating axis theorem (Gottschalk, Lin and Manocha, SIGGRAPH 1996): of the four
    directions of the sides, the one with the least overlap. A negative depth is a gap. The
    direction is a unit vector along which the first moves away from the other.

    Args:
        boxes: the boxes.
        pairs: (P, 2) rows of boxes.
    """
    deep, out = np.empty(len(pairs)), np.empty((len(pairs), 2))
    for first in range(0, len(pairs), _PAIRS_AT_ONCE):
        part = slice(first, first + _PAIRS_AT_ONCE)
        deep[part], out[part] = _meetings(boxes, pairs[part])
    return deep, out


def _meetings(
    boxes: PlanBoxes, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, pairs = np.unique(pairs, return_inverse=True)
    boxes, (first, second) = boxes.take(rows), pairs.reshape(-1, 2).T
    axes, half = boxes.axes, boxes.half
    between = boxes.xy[first] - boxes.xy[second]
    tried = np.concatenate([axes[first], axes[second]], axis=1)
    along = np.einsum("pad,pd->pa", tried, between)
    radius = sum(
        np.abs(np.einsum("pad,pd->pa", tried, axes[side, k])) * half[side, k, None]
        for side in (first, second)
        for k in (0, 1)
    )
    deep = np.asarray(radius) - np.abs(along)
    least = deep.argmin(axis=1)
    row = np.arange(len(first))
    sign = np.where(along[row, least] < 0, -1.0, 1.0)
    return deep[row, least], tried[row, least] * sign[:, None]


def shared_areas(boxes: PlanBoxes, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the area of overlap of each pair of boxes (P,), square metres."""
    area = np.zeros(len(pairs))
    deep, _ = meetings(boxes, pairs)
    overlapping = np.flatnonzero(deep > 0)
    first, second = (boxes.take(pairs[overlapping, side]).polygons for side in (0, 1))
    area[overlapping] = shapely.area(shapely.intersection(first, second))
    return area
