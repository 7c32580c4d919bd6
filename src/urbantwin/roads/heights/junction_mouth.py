"""Junction mouths: the ends of streets, and their road surface as seen from the junction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.heights.stations import SHARPEST, Stations
from urbantwin.roads.model import ModelRoad

__all__ = ["Mouths", "levels_at_ends", "mouths_of"]

#: Length of a street's end that is included, metres.
BACK_M = 1.0


@dataclass(frozen=True)
class Mouths:
    """Ends of streets (E), first all starts, then all ends, in the streets' order.

    Attributes:
        xy: (E, 2) end of the reference line.
        ahead: (E, 2) its direction, along increasing stations.
        out: (E,) 1 where stations increase out of the street, -1 where they decrease.
        right, left: (E,) offsets of the street's borders, metres.
        level: (E,) level of the adjoining junction, else of the street.
        height: (E, 3) height of the reference line, rise to the left, and fall to both sides.
        grade: (E, 3) derivatives of these along the reference line.
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
        on_level = self.level == level
        return Mouths(*(getattr(self, field.name)[on_level] for field in fields(self)))

    def seen_from(
        self, which: NDArray[np.int64], xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the distances of points (N, K, 2) out of and to the left of mouths (N, K)."""
        gap = xy - self.xy[which]
        ahead = self.ahead[which]
        along = (gap * ahead).sum(axis=-1)
        left = gap[..., 1] * ahead[..., 0] - gap[..., 0] * ahead[..., 1]
        return np.asarray(along * self.out[which]), np.asarray(left)

    def distance(
        self, which: NDArray[np.int64], u: NDArray[np.float64], t: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the distance to the end of the street, which extends slightly back into it."""
        beyond = np.maximum(np.maximum(u, -BACK_M - u), 0.0)
        beside = np.maximum(np.maximum(self.right[which] - t, t - self.left[which]), 0.0)
        return np.asarray(np.hypot(beyond, beside))

    def extended(
        self, which: NDArray[np.int64], u: NDArray[np.float64], t: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the height of the street's surface, extended straight out of its end."""
        return self.rise(which, t) + u * self.out[which] * self.slope(which, t)

    def rise(self, which: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of the street's surface at its end."""
        level, bank, crown = np.moveaxis(self.height[which], -1, 0)
        return np.asarray(level + t * bank - np.abs(t) * crown)

    def turn(self, which: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivative of the rise to the left along the street's lanes."""
        _, bank, crown = np.moveaxis(self.grade[which], -1, 0)
        bend = self.bend[which]
        change = bank - np.sign(t) * crown + bend * self.slope(which, t)
        return np.asarray(change / np.maximum(1.0 - t * bend, 0.2))

    def slope(self, which: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the slope of the surface along the street's lanes, along increasing stations."""
        level, bank, crown = np.moveaxis(self.grade[which], -1, 0)
        shorter = np.maximum(1.0 - t * self.bend[which], 0.2)
        return np.asarray((level + t * bank - np.abs(t) * crown) / shorter)


def levels_at_ends(streets: Sequence[ModelRoad], levels: Mapping[int, int]) -> NDArray[np.int64]:
    """Return the levels (2, R) of the junctions at streets' starts and ends, else their own.

    Args:
        streets: R streets.
        levels: id of a junction -> its level.
    """
    links = [(road.predecessor, road.successor) for road in streets]
    level_of_end = [
        [
            levels.get(link.id, road.level) if link and link.element == "junction" else road.level
            for link in pair
        ]
        for road, pair in zip(streets, links, strict=True)
    ]
    return np.array(level_of_end, np.int64).reshape(-1, 2).T


def mouths_of(streets: Sequence[ModelRoad], stations: Stations, level: NDArray[np.int64]) -> Mouths:
    """Return the mouths of streets.

    Args:
        streets: R streets, with their profiles.
        stations: stations of these streets.
        level: (2, R) levels of their ends.
    """
    height = np.zeros((2, len(streets), 3))
    grade = np.zeros((2, len(streets), 3))
    for k, road in enumerate(streets):
        ends = np.array([0.0, road.length])
        angle = road.bank.at(ends)
        c = np.cos(angle)
        level_there, crown = road.elevation.at(ends), road.crown.at(ends) / c
        height[:, k] = np.column_stack([level_there, np.tan(angle), crown])
        turn, bow = road.bank.slope(ends) / c**2, road.crown.slope(ends) / c
        grade[:, k] = np.column_stack([road.elevation.slope(ends), turn, bow])
    end_index = np.concatenate(stations.edges())
    heading = stations.pose[end_index, 2]
    return Mouths(
        stations.pose[end_index, :2],
        np.column_stack([np.cos(heading), np.sin(heading)]),
        np.repeat([-1.0, 1.0], len(streets)),
        stations.outer_right[end_index],
        stations.outer_left[end_index],
        level.ravel(),
        height.reshape(-1, 3),
        grade.reshape(-1, 3),
        np.clip(stations.bend, -SHARPEST, SHARPEST).ravel(),
    )
