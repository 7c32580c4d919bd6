"""Mouths: the ends of streets, and the surface there as a junction sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import ModelRoad

__all__ = ["Mouths", "curvature_at", "levels_at_ends", "mouths_of"]

#: A street's end counts this far back into the street, metres.
BACK_M = 1.0


@dataclass(frozen=True)
class Mouths:
    """Ends of streets (E), the starts first, in the streets' order.

    Attributes:
        xy: (E, 2) end of the reference line.
        ahead: (E, 2) its direction, along increasing stations.
        out: (E,) 1 where stations increase out of the street, -1 where they decrease.
        right, left: (E,) offsets between which the street lies.
        level: (E,) level of what the street leads to there.
        height: (E, 3) height of the reference line, rise to the left, and fall to both sides.
        grade: (E, 3) how these change along the reference line.
        bend: (E,) curvature of the reference line, 1/m.
    """

    xy: NDArray[np.float64]
    ahead: NDArray[np.float64]
    out: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    level: NDArray[np.int64]
    height: NDArray[np.float64]
    grade: NDArray[np.float64]
    bend: NDArray[np.float64]

    def of(self, level: int) -> Mouths:
        """Return the mouths at one level."""
        here = self.level == level
        return Mouths(*(getattr(self, field.name)[here] for field in fields(self)))

    def seen_from(
        self, which: NDArray[np.int64], xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far points (N, K, 2) lie out of mouths (N, K), and to the left of them."""
        gap = xy - self.xy[which]
        ahead = self.ahead[which]
        along = (gap * ahead).sum(axis=-1)
        left = gap[..., 1] * ahead[..., 0] - gap[..., 0] * ahead[..., 1]
        return np.asarray(along * self.out[which]), np.asarray(left)

    def distance(
        self, which: NDArray[np.int64], u: NDArray[np.float64], t: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the distance to the end of the street, which reaches a little back into it."""
        beyond = np.maximum(np.maximum(u, -BACK_M - u), 0.0)
        beside = np.maximum(np.maximum(self.right[which] - t, t - self.left[which]), 0.0)
        return np.asarray(np.hypot(beyond, beside))

    def extended(
        self, which: NDArray[np.int64], u: NDArray[np.float64], t: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the height of the street's surface, drawn straight on out of its end."""
        return self.rise(which, t) + u * self.out[which] * self.slope(which, t)

    def rise(self, which: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of the street's surface at its end."""
        level, bank, crown = np.moveaxis(self.height[which], -1, 0)
        return np.asarray(level + t * bank - np.abs(t) * crown)

    def slope(self, which: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slope of the surface along the street's lanes, along increasing stations."""
        level, bank, crown = np.moveaxis(self.grade[which], -1, 0)
        shorter = np.maximum(1.0 - t * self.bend[which], 0.2)
        return np.asarray((level + t * bank - np.abs(t) * crown) / shorter)


def levels_at_ends(streets: Sequence[ModelRoad], levels: Mapping[int, int]) -> NDArray[np.int64]:
    """Return the levels (2, R) of what streets lead to at their starts and ends, else their own.

    Args:
        streets: R streets.
        levels: id of a junction -> its level.
    """
    links = [(road.predecessor, road.successor) for road in streets]
    found = [
        [
            levels.get(link.id, road.level) if link and link.element == "junction" else road.level
            for link in pair
        ]
        for road, pair in zip(streets, links, strict=True)
    ]
    return np.array(found, np.int64).reshape(-1, 2).T


def mouths_of(
    streets: Sequence[ModelRoad],
    right: NDArray[np.float64],
    left: NDArray[np.float64],
    level: NDArray[np.int64],
) -> Mouths:
    """Return the mouths of streets.

    Args:
        streets: R streets, with their profiles.
        right: (2, R) offset of their right border at their starts and ends, metres to the left.
        left: (2, R) the same of their left border.
        level: (2, R) levels of what they lead to.
    """
    pose, height, grade, bend = [], [], [], []
    for side in (0, 1):
        for road in streets:
            s = road.length * side
            pose.append(road.curve.at(s)[0])
            angle, turn = float(road.bank.at(s)[0]), float(road.bank.slope(s)[0])
            crown, bow = float(road.crown.at(s)[0]), float(road.crown.slope(s)[0])
            c = np.cos(angle)
            height.append((float(road.elevation.at(s)[0]), np.tan(angle), crown / c))
            grade.append((float(road.elevation.slope(s)[0]), turn / c**2, bow / c))
            bend.append(curvature_at(road, s))
    place = np.array(pose, np.float64).reshape(-1, 3)
    return Mouths(
        place[:, :2],
        np.column_stack([np.cos(place[:, 2]), np.sin(place[:, 2])]),
        np.repeat([-1.0, 1.0], len(streets)),
        right.ravel(),
        left.ravel(),
        level.ravel(),
        np.array(height, np.float64).reshape(-1, 3),
        np.array(grade, np.float64).reshape(-1, 3),
        np.array(bend, np.float64),
    )


def curvature_at(road: ModelRoad, s: float) -> float:
    """Return the curvature of a road's reference line at one of its ends, 1/m."""
    inner = min(0.02, road.length / 50)
    a, b = sorted((s, s + inner if s < road.length / 2 else s - inner))
    first, last = road.curve.at([a, b])[:, 2]
    return float((last - first + np.pi) % (2 * np.pi) - np.pi) / (b - a)
