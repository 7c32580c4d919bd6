"""Labels of one frame: class and instance of every point, a box for every actor, its difficulty.

Visibility is measured: the share of the rays that would return from an actor without occlusion
which do return from it. The same random draw decides a ray's return in both cases, so the share
depends on geometry alone.

**Difficulty.** KITTI grades by occlusion (fully visible, partly, largely occluded), truncation (at
most 15, 30 and 50 %) and height of the box in the image (Geiger et al. 2012, CVPR; the benchmark's
page). A LiDAR measures the first two; in place of the height in pixels counts the number of points,
as in Waymo (more than 5 points: level 1, any: level 2; Sun et al. 2020, CVPR, section 4). The
limits of occlusion are those of nuScenes' best and two best bins of visibility (80 and 40 %; Caesar
et al. 2020, CVPR, appendix A). An actor that meets no level is ignored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVELS", "BoxLabel", "LabelledFrame", "Level", "Whereabouts", "difficulty_of"]


class Level(NamedTuple):
    """Requirements of a difficulty level.

    Attributes:
        name: name of the level.
        least_points: least number of points.
        most_occlusion: largest hidden share, 0..1.
        most_truncation: largest share outside the rig's field of view, 0..1.
    """

    name: str
    least_points: int
    most_occlusion: float
    most_truncation: float


#: Levels, easiest first; an actor has the first that it meets.
LEVELS = (
    Level("easy", 21, 0.2, 0.15),
    Level("moderate", 6, 0.6, 0.30),
    Level("hard", 1, 1.0, 0.50),
)


def difficulty_of(num_points: int, occlusion: float, truncation: float) -> str | None:
    """Return the easiest level that an actor meets; ``None`` if it meets none.

    Args:
        num_points: number of points.
        occlusion: 0..1; ``nan`` if unknown, which meets only the last level.
        truncation: 0..1.
    """
    for level in LEVELS:
        is_visible = occlusion <= level.most_occlusion or level.most_occlusion >= 1.0
        if num_points >= level.least_points and is_visible and truncation <= level.most_truncation:
            return level.name
    return None


#: Why an actor does not count: ``outside`` of the region, or ``far`` from every sensor.
Whereabouts = Literal["outside", "far"]


class BoxLabel(NamedTuple):
    """The label of one actor; boxes without points are kept.

    Attributes:
        track: track id.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        box: (7,) x, y, z, length, width, height, yaw; dataset frame.
        num_points: returns from the actor, of all sensors.
        num_points_alone: returns without occlusion, including those from behind its edges.
        velocity: (3,) metres per second, dataset frame.
        observed_s: time of the box relative to the frame's, seconds: the mean time at which beams
            hit the actor, or would have been fired at it.
        truncation: share of the actor outside the field of view of every sensor, 0..1 (`borders`).
        whereabouts: why it does not count by its position (`borders`); ``None`` if it does.
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

        ``nan`` for an actor without any return even unoccluded: out of range, so that occlusion
        cannot be measured.
        """
        if not self.num_points_alone:
            return float("nan")
        # Two returns of one beam count twice, and edges include returns from behind.
        return min(1.0, self.num_points / self.num_points_alone)

    @property
    def occlusion(self) -> float:
        """``1 - visibility``; ``nan`` where visibility is."""
        return 1.0 - self.visibility

    @property
    def difficulty(self) -> str | None:
        """Difficulty level (`LEVELS`); ``None`` if the actor is ignored."""
        if self.ignored is not None:
            return None
        return difficulty_of(self.num_points, self.occlusion, self.truncation)

    @property
    def ignored(self) -> str | None:
        """Why the actor is ignored; ``None`` if it counts.

        ``outside`` of the region, ``far`` from every sensor, ``truncated`` more than the hardest
        level allows, or ``unseen``: with fewer points than that requires.
        """
        if self.whereabouts is not None:
            return self.whereabouts
        if self.truncation > LEVELS[-1].most_truncation:
            return "truncated"
        return "unseen" if self.num_points < LEVELS[-1].least_points else None


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """N points, sorted by sensor, turn, ring and column, and the actors' boxes by track.

    Attributes:
        points: (N, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        semantic: (N,) uint16, ids of ``taxonomy.semantic_classes``.
        instance: (N,) uint16, track id; 0 for the static world.
        sensor: (N,) uint8, index of the sensor in the rig.
        ring: (N,) uint16, channel in the maker's numbering.
        column: (N,) uint16, firing within the turn.
        time_s: (N,) float32, firing time by the sensor's clock, seconds relative to the frame's.
        echo: (N,) uint8, 0 for the first reported return of a beam, 1 for the second.
        boxes: one per actor, including those without points.
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
