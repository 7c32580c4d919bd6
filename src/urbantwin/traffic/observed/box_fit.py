"""Boxes around what sensors saw of objects: two sides of most of them, one of some.

X. Zhang, W. Xu, C. Dong, J. M. Dolan, "Efficient L-Shape Fitting for Vehicle Detection Using Laser
Scanners", IEEE Intelligent Vehicles Symposium, 2017: of all headings the one at which points lie
nearest to two sides that are square to each other.
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

#: Classes that are taken from detections: by their points alone they are too easily mistaken.
DETECTED = ("pedestrian", "bicycle", "motorcycle")
#: What is less likely is not taken.
LEAST_SCORE = 0.4
#: Points so far beside a box, metres, are of who is in it; of fewer nothing can be said.
BESIDE_M, LEAST_POINTS = 0.2, 5
#: Who has less of the points in its box than this, the rest being another's, is that other.
OWN = 0.5


@dataclass(frozen=True, eq=False)
class DetectedActor:
    """A box in a frame.

    Attributes:
        actor_class: one of `DETECTED`.
        place: (2,) x, y of the middle, metres.
        yaw: radians.
        size: length, width, height, metres.
        score: how sure the detector is, 0..1.
    """

    actor_class: str
    place: NDArray[np.float64]
    yaw: float
    size: tuple[float, float, float]
    score: float


def with_points(
    actors: Sequence[DetectedActor], points: NDArray[np.float64]
) -> Iterator[tuple[DetectedActor, NDArray[np.intp]]]:
    """Yield actors, the likeliest first, and the rows (M,) of the points that are theirs.

    Args:
        actors: of one frame.
        points: (N, 3) of what rises from the ground, metres.
    """
    free = np.ones(len(points), np.bool_)
    for actor in sorted(actors, key=lambda one: (-one.score, *one.place)):
        length, width, _ = actor.size
        column = np.array([*actor.place, 0.0, length, width, np.inf, actor.yaw])
        inside = points_in_box(points, column, BESIDE_M)
        own = np.flatnonzero(inside & free)
        if len(own) < max(LEAST_POINTS, OWN * int(inside.sum())):
            continue
        free[own] = False
        yield actor, own


#: Steps of the heading, radians; points nearer to a side than this count the same, metres.
STEP, NEAR_M = np.radians(2.0), 0.05
#: So many points say it as well as all.
MOST = 250
#: No ring passes over people farther above the one that met them, metres.
UNSEEN_M = 0.3
#: What hangs above a gap of so many metres, so many times as wide as those below it, and above so
#: many metres of what stands, is something else.
HANGS_M, HANGS_TIMES, LEAST_HIGH_M = 0.5, 3.0, 1.2


@dataclass(frozen=True, eq=False)
class SeenObject:
    """What was seen of an object in one frame.

    Attributes:
        frame: number of the frame.
        points: (N, 2) from above, metres.
        top: metres above the ground; two points in a hundred are higher.
        highest: metres above the ground, of all but points that may be off.
        bottom: metres above the ground.
        sensor: (2,) the place of the sensor that saw most of it.
        moves: share of its points that move.
        yaw: of the fitted sides, radians, within a quarter of a turn.
        actor: who a detector says it is; ``None`` where none does.
        length: of a vehicle of which nothing hides an end (`seen_length`), metres.
        silhouette: who it is by its outline (`silhouette`); ``None`` where that does not tell.
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
        """Which class a detector says it is of."""
        return self.actor.actor_class if self.actor else None

    @cached_property
    def diagonal(self) -> float:
        """From corner to corner of what was seen, metres."""
        low, high = extents(self.points, self.yaw)
        return float(np.linalg.norm(high - low))

    @cached_property
    def long_way(self) -> float:
        """The way of its longer side, radians, within half a turn."""
        low, high = extents(self.points, self.yaw)
        return self.yaw + (np.pi / 2 if (high - low)[1] > (high - low)[0] else 0.0)

    @cached_property
    def middle(self) -> NDArray[np.float64]:
        """The middle (2,) of what was seen, or of a detector's box."""
        if self.actor:
            return self.actor.place
        low, high = extents(self.points, self.yaw)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s], [s, c]]) @ ((low + high) / 2)


def extents(
    points: NDArray[np.float64], yaw: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and greatest place (2,) along a heading and to its left."""
    c, s = np.cos(yaw), np.sin(yaw)
    turned = points @ np.array([[c, -s], [s, c]])
    # A point in a hundred may be off: rain, edges.
    if len(points) > MOST:
        return np.quantile(turned, 0.005, axis=0), np.quantile(turned, 0.995, axis=0)
    return turned.min(axis=0), turned.max(axis=0)


def beneath_gap(above: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights (N,) of what stands, without what hangs above it: leaves, lamps, wires.

    It hangs where the gap to it is far wider than the gaps between rings below.
    """
    order = np.sort(above)
    gaps = np.diff(order)
    widest_below = np.maximum.accumulate(np.concatenate([[0.0], gaps[:-1]]))
    hangs = (gaps > HANGS_M) & (gaps > HANGS_TIMES * widest_below) & (order[:-1] > LEAST_HIGH_M)
    first = np.flatnonzero(hangs)
    return order[: first[0] + 1] if len(first) else order


def highest(above: NDArray[np.float64]) -> float:
    """Return the greatest height (N,) of an object's points, as `extents` its sides."""
    return float(np.quantile(above, 0.995) if len(above) > MOST else above.max())


def unseen_above(
    above: NDArray[np.float64],
    sensor: NDArray[np.int64],
    ring: NDArray[np.int64],
    top: float,
) -> float:
    """Return how much of somebody is above the highest point on the average, metres.

    The next ring passes over the head, at a height that is any between. It is as far above the
    last one that met the head as that above the one before; of several sensors the lowest of them
    tells.

    Args:
        above: (N,) heights of the points, metres.
        sensor: (N,) numbers of their sensors.
        ring: (N,) of their rings.
        top: the greatest height that is somebody's, metres.
    """
    passes = np.inf
    here = above <= top
    for one in np.unique(sensor[here]):
        mine = here & (sensor == one)
        rings = np.unique(ring[mine])
        tops = np.sort([above[mine & (ring == each)].max() for each in rings])
        if len(tops) > 1 and (over := 2 * tops[-1] - tops[-2]) > top:
            passes = min(passes, over)
    return float(min(passes - top, UNSEEN_M) / 2) if np.isfinite(passes) else 0.0


def fitted_yaw(
    points: NDArray[np.float64], near: float | None = None, within: float = np.pi / 4
) -> float:
    """Return the heading at which points (N, 2) lie nearest to two sides, radians.

    Args:
        points: from above, metres.
        near: only headings about this one.
        within: by so much, radians.
    """
    if len(points) > MOST:
        points = points[:: len(points) // MOST + 1]
    yaws = np.arange(-within, within - 1e-9, STEP) + (np.pi / 4 if near is None else near)
    c, s = np.cos(yaws), np.sin(yaws)
    along = points[:, :1] * c + points[:, 1:] * s
    aside = -points[:, :1] * s + points[:, 1:] * c
    gaps = []
    for each in (along, aside):
        to_low, to_high = each - each.min(axis=0), each.max(axis=0) - each
        nearer = np.linalg.norm(to_low, axis=0) < np.linalg.norm(to_high, axis=0)
        gaps.append(np.where(nearer, to_low, to_high))
    score = (1.0 / np.maximum(np.minimum(*gaps), NEAR_M)).sum(axis=0)
    return float(yaws[int(score.argmax())])
