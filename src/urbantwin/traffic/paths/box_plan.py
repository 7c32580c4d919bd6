"""Boxes of actors in plan: who is near whom, and how deep two boxes lie in each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.compiled.near import close_pairs

__all__ = ["PlanBoxes", "meetings", "near_pairs", "shared_areas"]

#: Pairs that are compared at a time.
_PAIRS = 200_000


@dataclass(frozen=True, eq=False)
class PlanBoxes:
    """N boxes from above, site frame.

    Attributes:
        step: (N,) int, when.
        xy: (N, 2) middles, metres.
        yaw: (N,) headings, rad.
        half: (N, 2) half the length and half the width, metres.
    """

    step: NDArray[np.integer]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    half: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: Sequence[PlanBoxes]) -> PlanBoxes:
        """Return boxes one after the other."""
        return cls(
            np.concatenate([one.step for one in parts]),
            np.concatenate([one.xy for one in parts]),
            np.concatenate([one.yaw for one in parts]),
            np.concatenate([one.half for one in parts]),
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
    """Return the pairs (P, 2) whose circles about their boxes come nearer than this in a step.

    Args:
        boxes: in any order.
        within_m: metres, 0 for circles that touch.
        wanted: (N,) of which boxes one at least is in a pair; any, where not given.
    """
    count = max(len(boxes.step), 1)
    order = np.lexsort([boxes.xy[:, 0], boxes.step])
    (x, y), reach = boxes.xy[order].T.copy(), np.hypot(*boxes.half[order].T)
    chosen = np.ones(len(order), np.bool_) if wanted is None else wanted[order]
    step = boxes.step[order].astype(np.int64)
    low, high = np.sort(order[close_pairs(step, x, y, reach, chosen, within_m)], axis=1).T
    # As single numbers: an hour's pairs, sorted by two columns, would take gigabytes.
    keys = low * count + high
    keys.sort()
    return np.column_stack(np.divmod(keys, count))


def meetings(
    boxes: PlanBoxes, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how deep the boxes of pairs lie in each other (P,), and the way out (P, 2).

    By the theorem of separating axes (Gottschalk, Lin and Manocha, SIGGRAPH 1996): of the four
    directions of the sides, the one along which they overlap least. A negative depth is a gap.
    The way out is a unit vector along which the first moves away from the other.

    Args:
        boxes: of both.
        pairs: (P, 2) rows of boxes.
    """
    deep, out = np.empty(len(pairs)), np.empty((len(pairs), 2))
    for first in range(0, len(pairs), _PAIRS):
        part = slice(first, first + _PAIRS)
        deep[part], out[part] = _meetings(boxes, pairs[part])
    return deep, out


def _meetings(
    boxes: PlanBoxes, pairs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows, pairs = np.unique(pairs, return_inverse=True)
    boxes, (one, other) = boxes.take(rows), pairs.reshape(-1, 2).T
    axes, half = boxes.axes, boxes.half
    between = boxes.xy[one] - boxes.xy[other]
    tried = np.concatenate([axes[one], axes[other]], axis=1)
    along = np.einsum("pad,pd->pa", tried, between)
    radius = sum(
        np.abs(np.einsum("pad,pd->pa", tried, axes[side, k])) * half[side, k, None]
        for side in (one, other)
        for k in (0, 1)
    )
    deep = np.asarray(radius) - np.abs(along)
    least = deep.argmin(axis=1)
    row = np.arange(len(one))
    sign = np.where(along[row, least] < 0, -1.0, 1.0)
    return deep[row, least], tried[row, least] * sign[:, None]


def shared_areas(boxes: PlanBoxes, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the area that the boxes of each pair share (P,), square metres."""
    area = np.zeros(len(pairs))
    deep, _ = meetings(boxes, pairs)
    met = np.flatnonzero(deep > 0)
    one, other = (boxes.take(pairs[met, side]).polygons for side in (0, 1))
    area[met] = shapely.area(shapely.intersection(one, other))
    return area
