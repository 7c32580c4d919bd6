"""Features of a frame: raised points, curbs, road markings, and posts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from urbantwin.fidelity.alignment.curbs import above_lowest, curbs_of
from urbantwin.fidelity.alignment.ground_plane import GroundPlane, leveling, thinned
from urbantwin.fidelity.alignment.lane_markings import bright_spots_of
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import row_keys

__all__ = ["RAISED_M", "FrameFeatures", "posts_of"]

#: Minimum height of a post, and height of the slices in which it is searched, metres: people and
#: bollards are lower.
_HIGH_M, _SLICE_M = 1.2, 0.5
#: Maximum height above the ground and maximum distance of the search for posts, metres.
_UP_TO_M, _REACH_M = 6.0, 50.0
#: Maximum width of a post in a slice, and radius around it that is free, metres. Up to this share
#: of the post's own points may lie there.
_WIDE_M, _ALONE_M, _BESIDE = 0.5, 0.9, 0.3
#: Horizontal tolerance of a post's slices, metres; minimum number of thin slices, and their minimum
#: share.
_UPRIGHT_M, _FEWEST, _THIN_SHARE = 0.2, 3, 0.5
_CELL_M = 0.08


class Posts(NamedTuple):
    """Posts in one frame.

    Attributes:
        axis: (K, 3) positions, at half of the visible height, level frame.
        of: (N,) post of each point; -1: none.
    """

    axis: NDArray[np.float64]
    of: NDArray[np.int64]


def posts_of(level: NDArray[np.float64], above: NDArray[np.float64]) -> Posts:
    """Return objects that are thin, upright and isolated in most slices of their height.

    Cars and hedges hide the feet of posts, and crowns their tops, so slices are examined
    separately. A strip of wall between two cars also counts as a post: evidence from posts is
    uncertain.

    Args:
        level: (N, 3) points, metres, z up, the sensor at the origin.
        above: (N,) heights above the ground.
    """
    none = np.full(len(level), -1)
    away = np.hypot(level[:, 0], level[:, 1])
    upright = np.flatnonzero((above > 0.3) & (above < _UP_TO_M) & (away < _REACH_M))
    kept = upright[thinned(level[upright], _CELL_M)]
    if len(kept) < _FEWEST:
        return Posts(np.zeros((0, 3)), none)
    layer = np.floor(above[kept] / _SLICE_M)
    # A third coordinate separates slices.
    place = np.column_stack([level[kept, :2], 2.0 * _REACH_M * layer])
    cell = np.floor(place / (_WIDE_M / 2)).astype(np.int64)
    _, first, number = np.unique(row_keys(cell), axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    many = np.bincount(number)
    middle = np.column_stack([np.bincount(number, column) / many for column in place.T])
    tree = cKDTree(place)
    # The second iteration centres on all nearby points.
    for _ in range(2):
        near = tree.query_ball_point(middle, _WIDE_M / 2)
        sizes = np.array([len(one) for one in near])
        some = np.concatenate(near).astype(np.int64)
        which = np.repeat(np.arange(len(near)), sizes)
        total = np.maximum(sizes, 1)[:, None]
        moved = np.column_stack([np.bincount(which, c, len(near)) for c in place[some].T]) / total
        middle = np.where(sizes[:, None] > 0, moved, middle)
    around = tree.query_ball_point(middle, _ALONE_M, return_length=True)
    thin = (sizes > 0) & (around - sizes <= _BESIDE * sizes)
    middle, slice_of = middle[thin], layer[first][thin]
    if not len(middle):
        return Posts(np.zeros((0, 3)), none)
    pairs = cKDTree(middle[:, :2]).query_pairs(_UPRIGHT_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(middle),) * 2)
    count, group = connected_components(graph, directed=False)
    axes: list[list[float]] = []
    of = none
    places = cKDTree(level[upright, :2])
    for one in range(count):
        mine = group == one
        slices = np.unique(slice_of[mine])
        rises = np.ptp(slices) + 1.0
        if len(slices) < _FEWEST or len(slices) < _THIN_SHARE * rises:
            continue
        axis = middle[mine, :2].mean(axis=0)
        points = upright[places.query_ball_point(axis, _WIDE_M / 2 + 0.05)]
        points = points[np.isin(np.floor(above[points] / _SLICE_M), slices)]
        high = np.ptp(above[points]) if len(points) else 0.0
        if high < _HIGH_M:
            continue
        of[points] = len(axes)
        axes.append([*_axis(level[points, :2]), level[points, 2].mean()])
    return Posts(np.array(axes).reshape(-1, 3), of)


def _axis(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axis (2,) of a round post from the points (N, 2) of its visible side.

    The points are spread evenly over the width, with a standard deviation of the radius over the
    root of 3; their mean lies pi / 4 of the radius in front of the axis.
    """
    middle = points.mean(axis=0)
    ahead = middle / max(float(np.hypot(*middle)), 1e-9)
    aside = (points - middle) @ [-ahead[1], ahead[0]]
    radius = min(np.sqrt(3.0) * float(aside.std()), _WIDE_M / 2)
    return np.asarray(middle + np.pi / 4 * radius * ahead)


#: Points higher than this above the lowest point around are off the ground, metres.
RAISED_M = 0.3


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """Features of one frame, with the origin in the centre of its sensors.

    Attributes:
        points: (N, 3), metres.
        above: (N,) heights above the lowest point around.
        posts: (K, 3) points on the axes of posts.
        post: (N,) post of each point; -1: none.
        curbs: (C, 3) points of rings at curbs.
        curb_road: (C, 3) unit vectors from there towards the road.
        spots: (B, 3) bright points of the ground.
        spot_weight: (B,) contrast of the bright points, 0 to 1.
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
        """Build from a frame; each sensor's points are processed separately, as their rings cross.

        Args:
            frame: frame with only the points to use.
            origin: (3,) origin of the features, in the frame of the points.
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
        """Mask (N,) of the points off the ground."""
        return self.above > RAISED_M

    def thinned(self, cell_m: float) -> FrameFeatures:
        """Return the features with one point per cell; curbs and spots are unchanged."""
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
