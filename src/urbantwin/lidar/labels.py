"""The labels of one frame: a class and an instance for every point, a box for every actor.

Visibility is measured: of the rays that would return from an actor alone in the world, the share
that do return from it. The same random draw decides a ray's return in both worlds, so the share
depends on geometry and not on chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVELS", "BoxLabel", "LabelledFrame", "Level", "Whereabouts", "difficulty_of"]


class Level(NamedTuple):
    """What an actor must meet.

    Attributes:
        name: of the level.
        least_points: least number of points on it.
        most_occlusion: largest hidden share, 0..1.
        most_truncation: largest share outside of what the rig sees, 0..1.
    """

    name: str
    least_points: int
    most_occlusion: float
    most_truncation: float


#: From the easiest on; an actor has the first that it meets.
LEVELS = (
    Level("easy", 21, 0.2, 0.15),
    Level("moderate", 6, 0.6, 0.30),
    Level("hard", 1, 1.0, 0.50),
)


def difficulty_of(num_points: int, occlusion: float, truncation: float) -> str | None:
    """Return the name of the easiest level that an actor meets; ``None`` where it meets none.

    Args:
        num_points: points on it.
        occlusion: 0..1; ``nan`` where it is not known, which meets no level but the last.
        truncation: 0..1.
    """
    for level in LEVELS:
        known = occlusion <= level.most_occlusion or level.most_occlusion >= 1.0
        if num_points >= level.least_points and known and truncation <= level.most_truncation:
            return level.name
    return None


#: Where an actor is that does not count: ``outside`` of the region, ``far`` from every sensor.
Whereabouts = Literal["outside", "far"]


class BoxLabel(NamedTuple):
    """The label of one actor; boxes without points are kept.

    Attributes:
        track: the actor's number.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        box: (7,) x, y, z, length, width, height, yaw; dataset frame.
        num_points: returns from the actor, of all sensors.
        num_points_alone: returns there would be with only that actor in the world, and what is
            behind it: of beams along its edges that may be what returns.
        velocity: (3,) metres per second, dataset frame.
        observed_s: when the actor stood in its box, seconds from the frame's time: the mean of
            the times at which beams hit it, or would have been fired at it.
        truncation: 0..1, how much of it lies outside of what every sensor sees (`truncation`).
        whereabouts: where it is that it does not count (`borders`); ``None``: it does.
    """

    track: int
    actor_class: str
    box: NDArray[np.float64]
    num_points: int
    num_points_alone: int
    velocity: NDArray[np.float64]
    observed_s: float = 0.0
    truncation: float = 0.0
    whereabouts: Whereabouts | None = None

    @property
    def visibility(self) -> float:
        """``num_points / num_points_alone``, 0..1.

        ``nan`` for an actor that would have no return even alone: it is out of reach, and the
        rays cannot tell whether anything stands before it.
        """
        if not self.num_points_alone:
            return float("nan")
        # Two echoes of one beam count twice, and what is behind adds to an edge's.
        return min(1.0, self.num_points / self.num_points_alone)

    @property
    def occlusion(self) -> float:
        """``1 - visibility``; ``nan`` where that is."""
        return 1.0 - self.visibility

    @property
    def difficulty(self) -> str | None:
        """How hard it is to find (`difficulty.LEVELS`); ``None`` where it is to be ignored."""
        if self.ignored is not None:
            return None
        return difficulty_of(self.num_points, self.occlusion, self.truncation)

    @property
    def ignored(self) -> str | None:
        """Why it is not to be counted; ``None`` where it is.

        ``outside`` of the region, ``far`` from every sensor, ``truncated`` by more than the
        hardest level allows, ``unseen``: with fewer points than that asks for.
        """
        if self.whereabouts is not None:
            return self.whereabouts
        if self.truncation > LEVELS[-1].most_truncation:
            return "truncated"
        return "unseen" if self.num_points < LEVELS[-1].least_points else None


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """One frame: N points, sorted by sensor, turn, ring and column, and the actors' boxes by track.

    Attributes:
        points: (N, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        semantic: (N,) uint16, numbers of ``taxonomy.semantic_classes``.
        instance: (N,) uint16, the actor's track; 0 for the static world.
        sensor: (N,) uint8, number of the sensor in the rig.
        ring: (N,) uint16, channel, as the maker numbers them.
        column: (N,) uint16, firing within the turn.
        time_s: (N,) float32, when the point was measured by the sensor's clock, seconds from the
            frame's time.
        echo: (N,) uint8, 0 for a beam's first reported echo, 1 for its second.
        boxes: one per actor that was given, those without points too.
    """

    points: NDArray[np.float32]
    semantic: NDArray[np.uint16]
    instance: NDArray[np.uint16]
    sensor: NDArray[np.uint8]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    time_s: NDArray[np.float32]
    echo: NDArray[np.uint8]
    boxes: Sequence[BoxLabel]
