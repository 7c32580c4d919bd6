"""Features of a frame: edges, curbs, marks, and posts."""

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

#: A post rises at least so far, through slices of this height, metres: people and bollards do not.
_HIGH_M, _SLICE_M = 1.2, 0.5
#: It is looked for up to here above the ground, and so far away, metres.
_UP_TO_M, _REACH_M = 6.0, 50.0
#: In a slice it is no wider than this, and so far around nothing else stands, metres: a third of
#: as many points as its own may be there.
_WIDE_M, _ALONE_M, _BESIDE = 0.5, 0.9, 0.3
#: Slices of one post lie over each other to this; it is thin in so many of those that it rises
#: through, at least, and in this share.
_UPRIGHT_M, _FEWEST, _THIN_SHARE = 0.2, 3, 0.5
_CELL_M = 0.08


class Posts(NamedTuple):
    """Posts that one frame shows.

    Attributes:
        axis: (K, 3) where they stand, in the middle of what is seen of their height, level frame.
        of: (N,) the post that each point is of; -1: none.
    """

    axis: NDArray[np.float64]
    of: NDArray[np.int64]


def posts_of(level: NDArray[np.float64], above: NDArray[np.float64]) -> Posts:
    """Find what is thin, upright and alone in most of the slices that it rises through.

    Cars and hedges hide the feet of posts and crowns their heads, so each slice is looked at by
    itself. The gap between two cars shows a strip of the wall behind, which is a post then: what
    posts say is never certain.

    Args:
        level: (N, 3) points, metres, z up, the sensor at the origin.
        above: (N,) how high they are above the ground.
    """
    none = np.full(len(level), -1)
    away = np.hypot(level[:, 0], level[:, 1])
    upright = np.flatnonzero((above > 0.3) & (above < _UP_TO_M) & (away < _REACH_M))
    kept = upright[thinned(level[upright], _CELL_M)]
    if len(kept) < _FEWEST:
        return Posts(np.zeros((0, 3)), none)
    layer = np.floor(above[kept] / _SLICE_M)
    # Slices lie apart in a third direction.
    place = np.column_stack([level[kept, :2], 2.0 * _REACH_M * layer])
    cell = np.floor(place / (_WIDE_M / 2)).astype(np.int64)
    _, first, number = np.unique(row_keys(cell), axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    many = np.bincount(number)
    middle = np.column_stack([np.bincount(number, column) / many for column in place.T])
    tree = cKDTree(place)
    # Twice, so that the middle is that of all that is near.
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
    """Return the axis (2,) of a round post by the points (N, 2) of the side that is seen.

    They are evenly strewn over its width, whose root mean square is a half of the radius's; their
    mean lies pi / 4 of the radius before the axis.
    """
    middle = points.mean(axis=0)
    ahead = middle / max(float(np.hypot(*middle)), 1e-9)
    aside = (points - middle) @ [-ahead[1], ahead[0]]
    radius = min(np.sqrt(3.0) * float(aside.std()), _WIDE_M / 2)
    return np.asarray(middle + np.pi / 4 * radius * ahead)


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
