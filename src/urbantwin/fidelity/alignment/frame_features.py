"""Features of one frame that a twin has too: surfaces, posts, curbs and bright paint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.curbs import above_lowest, curbs_of
from urbantwin.fidelity.alignment.ground_plane import GroundPlane, leveling, thinned
from urbantwin.fidelity.alignment.lane_markings import bright_spots_of
from urbantwin.fidelity.alignment.posts import posts_of
from urbantwin.fidelity.frame import Frame

__all__ = ["RAISED_M", "FrameFeatures"]

#: Higher above the lowest point around, a point is not of the ground, metres.
RAISED_M = 0.3


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """One frame, its origin in the middle of its sensors.

    Attributes:
        points: (N, 3), metres.
        above: (N,) how high they are above the lowest point around.
        posts: (K, 3) axes of posts, somewhere along their height.
        post: (N,) the post that each point is of; -1: none.
        curbs: (C, 3) where rings meet curbs.
        curb_road: (C, 3) unit vectors from there towards the road.
        spots: (B, 3) bright points of the ground.
        spot_weight: (B,) how much they stand out, 0 to 1.
    """

    points: NDArray[np.float64]
    above: NDArray[np.float64]
    posts: NDArray[np.float64]
    post: NDArray[np.int64]
    curbs: NDArray[np.float64]
    curb_road: NDArray[np.float64]
    spots: NDArray[np.float64]
    spot_weight: NDArray[np.float64]

    @classmethod
    def of(cls, frame: Frame, origin: NDArray[np.float64], plane: GroundPlane) -> FrameFeatures:
        """Look at each sensor's points by themselves: their rings cross.

        Args:
            frame: with only the points that count.
            origin: (3,) of the features, in the frame of the points.
            plane: the ground, seen from that origin.
        """
        points = frame.points - origin
        level = points @ leveling(plane.normal).T
        number = np.zeros(len(points), np.int64) if frame.sensor is None else frame.sensor
        curbs, roads, spots, weights = [], [], [], []
        for sensor in np.unique(number):
            mine = number == sensor
            place = _place(frame, int(sensor)) - origin
            ring = None if frame.ring is None else frame.ring[mine]
            found = curbs_of(points[mine] - place, plane.normal, ring)
            curbs.append(found.points + place)
            roads.append(found.road)
            shine = None if frame.intensity is None else frame.intensity[mine]
            bright = bright_spots_of(points[mine], level[mine], shine)
            spots.append(bright.points)
            weights.append(bright.weight)
        above = above_lowest(level)
        posts = posts_of(level, above)
        return cls(
            points,
            above,
            posts.axis @ leveling(plane.normal),
            posts.of,
            np.concatenate(curbs),
            np.concatenate(roads),
            np.concatenate(spots),
            np.concatenate(weights),
        )

    @property
    def raised(self) -> NDArray[np.bool_]:
        """Which points (N,) lie off the ground."""
        return self.above > RAISED_M

    def thinned(self, cell_m: float) -> FrameFeatures:
        """Return it with one point a cell; curbs and spots stay as they are."""
        kept = thinned(self.points, cell_m)
        return FrameFeatures(
            self.points[kept],
            self.above[kept],
            self.posts,
            self.post[kept],
            self.curbs,
            self.curb_road,
            self.spots,
            self.spot_weight,
        )


def _place(frame: Frame, sensor: int) -> NDArray[np.float64]:
    places = frame.sensor_places
    return np.asarray(places[sensor] if 0 <= sensor < len(places) else places.mean(axis=0))
