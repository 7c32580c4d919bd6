"""The labels of one frame: a class and an instance for every point, a box for every actor.

Visibility is measured: of the rays that would return from an actor alone in the world, the share
that do return from it. The same random draw decides a ray's return in both worlds, so the share
tells of geometry and not of luck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoxLabel", "LabelledFrame"]


@dataclass(frozen=True, eq=False)
class BoxLabel:
    """The label of one actor; boxes without points are kept.

    Attributes:
        track: the actor's number.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        box: (7,) x, y, z, length, width, height, yaw; dataset frame.
        num_points: returns from the actor, of all sensors.
        num_points_alone: returns there would be with only that actor in the world.
        velocity: (3,) metres per second, dataset frame.
    """

    track: int
    actor_class: str
    box: NDArray[np.float64]
    num_points: int
    num_points_alone: int
    velocity: NDArray[np.float64]

    @property
    def visibility(self) -> float:
        """``num_points / num_points_alone``, 0..1.

        ``nan`` for an actor that would have no return even alone: it is out of reach, and the
        rays cannot tell whether anything stands before it.
        """
        return self.num_points / self.num_points_alone if self.num_points_alone else float("nan")

    @property
    def occlusion(self) -> float:
        """``1 - visibility``; ``nan`` where that is."""
        return 1.0 - self.visibility


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """One frame: N points, sorted by sensor, ring and column, and the actors' boxes by track.

    Attributes:
        points: (N, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        semantic: (N,) uint16, numbers of ``taxonomy.semantic_classes``.
        instance: (N,) uint16, the actor's track; 0 for the static world.
        sensor: (N,) uint8, number of the sensor in the rig.
        ring: (N,) uint16, channel, as the maker numbers them.
        column: (N,) uint16, firing within the turn.
        boxes: one per actor that was given, those without points too.
    """

    points: NDArray[np.float32]
    semantic: NDArray[np.uint16]
    instance: NDArray[np.uint16]
    sensor: NDArray[np.uint8]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    boxes: Sequence[BoxLabel]
