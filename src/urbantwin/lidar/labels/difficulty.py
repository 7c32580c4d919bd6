"""Detection difficulty of an object, in KITTI's three levels.

KITTI grades by occlusion (fully visible, partly, largely occluded), by truncation (at most 15, 30
and 50 %) and by the height of the box in the image (Geiger et al. 2012, CVPR; the benchmark's
page). A LiDAR measures the first two; in place of the image's pixels stands the number of points,
as with Waymo (more than 5 points: level 1, any: level 2; Sun et al. 2020, CVPR, section 4). The
borders of occlusion are those of nuScenes' best and two best bins of visibility (80 and 40 %;
Caesar et al. 2020, CVPR, appendix A). An actor that meets no level is to be ignored.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["LEVELS", "Level", "difficulty_of"]


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
