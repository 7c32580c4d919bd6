"""Boxes fitted to the visible sides of objects: two for most of them, one for some.

X. Zhang, W. Xu, C. Dong, J. M. Dolan, "Efficient L-Shape Fitting for Vehicle Detection Using Laser
Scanners", IEEE Intelligent Vehicles Symposium, 2017: the heading at which the points lie nearest to
two perpendicular sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import points_in_box

__all__ = [
    "DETECTED",
    "LEAST_SCORE",
    "DetectedActor",
    "SeenObject",
    "beneath_gap",
    "extents",
    "fitted_yaw",
    "highest",
    "unseen_above",
    "with_points",
]

#: Classes taken from a detector, since they are unreliable by points alone.
DETECTED = ("pedestrian", "bicycle", "motorcycle")
#: Least score of a detection.
LEAST_SCORE = 0.4
#: Margin around a box within which points belong to it, metres; and least number of points.
BESIDE_M, LEAST_POINTS = 0.2, 5
#: Least share of the points in a box that are not another detection's, else both are the same
#: object.
OWN = 0.5


@dataclass(frozen=True, eq=False)
class DetectedActor:
    """A box of a detector.

    Attributes:
        actor_class: one of `DETECTED`.
        place: (2,) x, y of the centre, metres.
        yaw: radians.
        size: length, width, height, metres.
        score: confidence, 0..1.
    """

    actor_class: str
    place: NDArray[np.float64]
    yaw: float
    size: tuple[float, float, float]
    score: float


def with_points(
    actors: Sequence[DetectedActor], points: NDArray[np.float64]
) -> Iterator[tuple[DetectedActor, NDArray[np.intp]]]:
    """Yield actors, the most confident first, with the rows (M,) of their points.

    Args:
        actors: actors of one frame.
        points: (N, 3) points above the ground, metres.
    """
    free = np.ones(len(points), np.bool_)
    for actor in sorted(actors, key=lambda detection: (-detection.score, *detection.place)):
        length, width, _ = actor.size
        column = np.array([*actor.place, 0.0, length, width, np.inf, actor.yaw])
        inside = points_in_box(points, column, BESIDE_M)
        own = np.flatnonzero(inside & free)
        if len(own) < max(LEAST_POINTS, OWN * int(inside.sum())):
            continue
        free[own] = False
        yield actor, own


#: Step of the heading, radians; distances to a side below the second are equal, metres.
STEP, NEAR_M = np.radians(2.0), 0.05
#: Maximum number of points used for a fit.
MOST = 250
#: Maximum height that is added above the highest ring on a person, metres.
UNSEEN_M = 0.3
#: Least gap, metres, its least ratio to the gaps below, and least height, metres, above which
#: points belong to something that hangs above the object.
HANGS_M, HANGS_TIMES, LEAST_HIGH_M = 0.5, 3.0, 1.2


@dataclass(frozen=True, eq=False)
class SeenObject:
    """An object detected in one frame.

    Attributes:
        frame: number of the frame.
        points: (N, 2) points in plan, metres.
        top: height above the ground, metres; two percent of the points are higher.
        highest: height of the highest point, without outliers, metres above the ground.
        bottom: height of the lowest points, metres above the ground.
        sensor: (2,) position of the sensor with most of its points.
        moves: share of its points that move.
        yaw: heading of the fitted sides, radians, modulo a quarter turn.
        actor: the detector's actor; ``None`` without one.
        length: length of a vehicle with both ends visible (`seen_length`), metres.
        silhouette: class by its outline (`silhouette`); ``None`` if unknown.
    """

    frame: int
    points: NDArray[np.float64]
    top: float
    highest: float
    bottom: float
    sensor: NDArray[np.float64]
    moves: float
    yaw: float
    actor: DetectedActor | None = None
    silhouette: str | None = None
    length: float | None = None

    @property
    def detected_class(self) -> str | None:
        """The class given by the detector; ``None`` without one."""
        return self.actor.actor_class if self.actor else None

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the visible part, metres."""
        low, high = extents(self.points, self.yaw)
        return float(np.linalg.norm(high - low))

    @cached_property
    def long_way(self) -> float:
        """Direction of its longer side, radians, modulo half a turn."""
        low, high = extents(self.points, self.yaw)
        return self.yaw + (np.pi / 2 if (high - low)[1] > (high - low)[0] else 0.0)

    @cached_property
    def middle(self) -> NDArray[np.float64]:
        """Centre (2,) of the visible part, or of the detector's box."""
        if self.actor:
            return self.actor.place
        low, high = extents(self.points, self.yaw)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s], [s, c]]) @ ((low + high) / 2)


def extents(
    points: NDArray[np.float64], yaw: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and greatest coordinates (2,) along a heading and to its left."""
    c, s = np.cos(yaw), np.sin(yaw)
    turned = points @ np.array([[c, -s], [s, c]])
    # Up to one percent of the points may be outliers: rain, edges.
    if len(points) > MOST:
        return np.quantile(turned, 0.005, axis=0), np.quantile(turned, 0.995, axis=0)
    return turned.min(axis=0), turned.max(axis=0)


def beneath_gap(above: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights (N,) of an object without what hangs above it: leaves, lamps, wires.

    It is separated by a gap far wider than the gaps between rings below.
    """
    order = np.sort(above)
    gaps = np.diff(order)
    widest_below = np.maximum.accumulate(np.concatenate([[0.0], gaps[:-1]]))
    hangs = (gaps > HANGS_M) & (gaps > HANGS_TIMES * widest_below) & (order[:-1] > LEAST_HIGH_M)
    first = np.flatnonzero(hangs)
    return order[: first[0] + 1] if len(first) else order


def highest(above: NDArray[np.float64]) -> float:
    """Return the greatest height (N,) of an object's points, without outliers as in `extents`."""
    return float(np.quantile(above, 0.995) if len(above) > MOST else above.max())


def unseen_above(
    above: NDArray[np.float64],
    sensor: NDArray[np.int64],
    ring: NDArray[np.int64],
    top: float,
) -> float:
    """Return the expected height of a person above the highest point, metres.

    The next ring passes above the head at an unknown height. Its spacing is that of the last two
    rings on the head; of several sensors the lowest such ring counts.

    Args:
        above: (N,) heights of the points, metres.
        sensor: (N,) indices of their sensors.
        ring: (N,) indices of their rings.
        top: greatest height that belongs to the person, metres.
    """
    passes = np.inf
    below_top = above <= top
    for number in np.unique(sensor[below_top]):
        from_sensor = below_top & (sensor == number)
        rings = np.unique(ring[from_sensor])
        tops = np.sort([above[from_sensor & (ring == each)].max() for each in rings])
        if len(tops) > 1 and (over := 2 * tops[-1] - tops[-2]) > top:
            passes = min(passes, over)
    return float(min(passes - top, UNSEEN_M) / 2) if np.isfinite(passes) else 0.0


def fitted_yaw(
    points: NDArray[np.float64], near: float | None = None, within: float = np.pi / 4
) -> float:
    """Return the heading at which points (N, 2) lie nearest to two perpendicular sides, radians.

    Args:
        points: points in plan, metres.
        near: centre of the headings searched; ``None``: all.
        within: half range of the search, radians.
    """
    if len(points) > MOST:
        points = points[:: len(points) // MOST + 1]
    yaws = np.arange(-within, within - 1e-9, STEP) + (np.pi / 4 if near is None else near)
    c, s = np.cos(yaws), np.sin(yaws)
    along = points[:, :1] * c + points[:, 1:] * s
    across = -points[:, :1] * s + points[:, 1:] * c
    gaps = []
    for each in (along, across):
        to_low, to_high = each - each.min(axis=0), each.max(axis=0) - each
        nearer = np.linalg.norm(to_low, axis=0) < np.linalg.norm(to_high, axis=0)
        gaps.append(np.where(nearer, to_low, to_high))
    score = (1.0 / np.maximum(np.minimum(*gaps), NEAR_M)).sum(axis=0)
    return float(yaws[int(score.argmax())])
