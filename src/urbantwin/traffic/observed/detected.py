"""People and riders whom a detector found in a frame, and the points that are theirs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import points_in_box

__all__ = ["DETECTED", "LEAST_SCORE", "DetectedActor", "with_points"]

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
