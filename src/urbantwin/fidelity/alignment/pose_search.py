"""Exhaustive search for the position and heading at which a frame fits the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.distance_maps import FAR_M, HIGHEST_M, Plan, Space
from urbantwin.fidelity.alignment.frame_features import FrameFeatures
from urbantwin.fidelity.alignment.ground_plane import GroundPlane, leveling, thinned
from urbantwin.fidelity.alignment.post_pairs import poses_by_posts
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.fidelity.alignment.search_span import SearchSpan
from urbantwin.geometry import Pose, row_keys

__all__ = ["KINDS", "Found", "Likeness", "PoseSearch"]

#: Height difference to the twin's ground from which ground points do not contribute, metres.
_FAR_UP_M = 0.4
#: Weights of features by kind: ground, low objects, edges of carriageways, lines, posts, tall
#: objects. Ground is similar everywhere, and many bright spots are no lines.
_WEIGHTS = (0.03, 1.0, 1.0, 0.3, 1.0, 1.0)
#: Size of the cells whose points form one feature, metres.
_PIECE_M = 4.0
#: Maximum height of low objects (cars, hedges, fences), metres: maps have other shares of them than
#: of houses and trees.
_LOW_M = 2.2
_GROUND, _RAISED, _EDGES, _LINES, _POSTS, _TALL = range(6)
KINDS = 6
#: Maximum reach of a span from all of which much the same is visible, metres.
_SMALL_M = 10.0
_MOST_POINTS = 1500
#: Number of poses above which a first pass uses only every n-th point, and this n.
_MANY_POSES, _FIRST_LOOK = 5000, 6
#: Differences below which poses are the same.
_SAME_M, _SAME_RAD = 1.5, np.radians(8.0)


@dataclass(frozen=True, eq=False)
class Found:
    """A pose of the sensor and its score.

    Attributes:
        pose: ``site_SE3_frame``.
        score: log likelihood ratio of the frame's features against chance.
        yaw: its heading, radians.
    """

    pose: Pose
    score: float
    yaw: float


class Likeness(NamedTuple):
    """Model of the likelihood of a pose.

    Attributes:
        width_m: error of the scene; 0: the gain decreases linearly up to `FAR_M`, for a coarse
            search.
        shared: (6,) share of the features of a kind that are in the scene, too.
        chance: (6,) gain of features by chance.
    """

    width_m: float
    shared: NDArray[np.float64]
    chance: NDArray[np.float64]

    def without_ground(self) -> Likeness:
        """Return the model without ground heights."""
        return self._replace(shared=np.where(np.arange(KINDS) == _GROUND, 0.0, self.shared))


#: Prior model. Posts are few and seldom match by chance.
_FROM_AFAR = Likeness(
    0.0, np.array([0.5, 0.5, 0.5, 0.5, 0.3, 0.5]), np.array([0.25, 0.25, 0.25, 0.25, 0.02, 0.25])
)


class PoseSearch:
    """Tests poses at which the sensor has its height and tilt above the twin's ground.

    Args:
        scene: the static world as points.
        features: features of one frame.
        plane: the ground in that frame.
        span: possible poses.
    """

    def __init__(
        self, scene: ScenePoints, features: FrameFeatures, plane: GroundPlane, span: SearchSpan
    ) -> None:
        self._scene, self.plane = scene, plane
        self._level = leveling(plane.normal)
        raised = scene.points[scene.is_raised & ~scene.is_post & self._in_sight(span)]
        self._space = Space.around(raised)
        low, high = scene.points[:, :2].min(axis=0), scene.points[:, :2].max(axis=0)
        self._plan = Plan.over(scene, low - 2.0, high + 2.0)
        self._fields: dict[float, tuple[Space, Plan]] = {}
        self._points, self._kind, self._weight, self._piece, self._kinds = self._chosen(
            features, len(raised) > 0
        )

    def _in_sight(self, span: SearchSpan) -> NDArray[np.bool_]:
        """Return the mask of the scene's points visible from a small span; all for a large one."""
        seen = np.full(len(self._scene.points), span.reach_m > _SMALL_M)
        if not seen.all():
            corners = np.array([[0.0, 0.0], [-1, -1], [-1, 1], [1, -1], [1, 1]]) * 0.7
            for place in self._stands(span.middle + corners * span.reach_m)[1]:
                if np.isfinite(place).all():
                    seen |= self._scene.seen_from(place)
        return seen

    def _chosen(
        self, features: FrameFeatures, any_raised: bool
    ) -> tuple[
        NDArray[np.float64],
        NDArray[np.int64],
        NDArray[np.float64],
        NDArray[np.int64],
        NDArray[np.int64],
    ]:
        """Return level points, their kinds, weights and features, and the features' kinds."""
        kept = thinned(features.points, 0.5)
        level, raised = features.points[kept] @ self._level.T, features.raised[kept]
        above = level[:, 2] + self.plane.height_m
        near = above < HIGHEST_M
        # Without posts in the scene, the frame's posts are ordinary surfaces.
        any_posts = self._plan.any_posts
        surface = raised & near & ((features.post[kept] < 0) | (not any_posts))
        parts = [level[~raised & near], level[surface][: len(level) * any_raised]]
        parts.append((features.curbs @ self._level.T)[: len(features.curbs) * self._plan.any_edges])
        parts.append((features.spots @ self._level.T)[: len(features.spots) * self._plan.any_lines])
        parts.append((features.posts @ self._level.T)[: len(features.posts) * any_posts])
        generator = np.random.default_rng(len(level))
        points, kinds, weights = [], [], []
        for kind, part in enumerate(parts):
            chosen = generator.permutation(len(part))[: _MOST_POINTS // 3]
            share = features.spot_weight[chosen] if kind == _LINES else np.ones(len(chosen))
            points.append(part[chosen])
            kinds.append(np.full(len(chosen), kind))
            weights.append(share)
        # Kinds are mixed, so that every n-th point is a fair sample.
        order = generator.permutation(sum(len(part) for part in points))
        point, which = np.concatenate(points)[order], np.concatenate(kinds)[order]
        cell = np.column_stack([np.floor(point[:, :2] / _PIECE_M).astype(np.int64), which])
        posts = np.flatnonzero(which == _POSTS)  # each post is a feature
        cell[posts, :2] = np.column_stack([np.arange(len(posts))] * 2)
        _, first, piece = np.unique(row_keys(cell), axis=0, return_index=True, return_inverse=True)
        kinds_of = which[first]
        tall = set(map(tuple, np.floor(level[features.above[kept] > _LOW_M, :2] / _PIECE_M)))
        high = [tuple(place) in tall for place in np.floor(point[first, :2] / _PIECE_M)]
        kinds_of[(kinds_of == _RAISED) & np.array(high, bool)] = _TALL
        return point, which, np.concatenate(weights)[order], piece.reshape(-1), kinds_of

    def run(self, span: SearchSpan, most: int = 5) -> list[Found]:
        """Return the best poses, best first; empty if there is no ground in the span."""
        step = float(np.clip(span.reach_m / 6, 0.5, 2.0))
        turn = np.radians(1.5 if span.reach_rad < 0.5 else 4.0)
        offsets = np.arange(-np.floor(span.reach_m / step), span.reach_m / step + 0.5) * step
        xy = np.stack(np.meshgrid(*(span.middle[:, None] + offsets)), -1).reshape(-1, 2)
        yaws = self._yaws(span, turn)
        many = len(xy) * len(yaws) > _MANY_POSES
        found = self._best(xy, yaws, 8 * most, _FIRST_LOOK if many else 1)
        seen, posts = self._points[self._kind == _POSTS, :2], self._scene.posts[:, :2]
        for place, yaw in zip(*poses_by_posts(seen, posts, span, 8 * most), strict=True):
            found += self._best(place[None], np.array([yaw]), 1, 1)
        while step > 0.2:
            step, turn = step / 2, turn / 2
            near = np.stack(np.meshgrid([-step, 0, step], [-step, 0, step]), -1).reshape(-1, 2)
            refined = []
            for one in found:
                xy = one.pose.translation[:2] + near
                yaws = one.yaw + np.array([-turn, 0.0, turn])
                refined += self._best(*span.clipped(xy, yaws), 1, 1)
            refined.sort(key=lambda one: -one.score)
            at = np.array([one.pose.translation[:2] for one in refined]).reshape(-1, 2)
            kept = _distinct(at, np.array([one.yaw for one in refined]), 2 * most)
            found = [refined[n] for n in kept]
        return found[:most]

    @staticmethod
    def _yaws(span: SearchSpan, turn: float) -> NDArray[np.float64]:
        if span.reach_rad >= np.pi:
            count = int(np.ceil(2 * np.pi / turn))
            return span.yaw + 2 * np.pi * np.arange(count) / count
        steps = 2 * int(np.ceil(span.reach_rad / turn)) + 1
        return span.yaw + np.linspace(-span.reach_rad, span.reach_rad, steps)

    def standing(self, xy: NDArray[np.float64], yaw: float) -> Pose:
        """Return the pose of the frame at a position (2,) with a heading."""
        up, place = self._stands(xy[None])
        return self._pose(up[0], place[0], yaw)

    def _pose(self, up: NDArray[np.float64], place: NDArray[np.float64], yaw: float) -> Pose:
        turned = leveling(up).T @ Pose.from_ypr(np.zeros(3), yaw).rotation @ self._level
        return Pose(turned, place)

    def _stands(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground's normals (P, 3) around positions (P, 2), and the frame's origins."""
        around = np.array([[8.0 * np.cos(a), 8.0 * np.sin(a)] for a in np.arange(8) * np.pi / 4])
        heights = self._scene.ground_at((xy[:, None] + around).reshape(-1, 2)).reshape(-1, 8)
        middle = self._scene.ground_at(xy)
        known = np.isfinite(heights)
        rise = np.where(known, heights - middle[:, None], 0.0)
        count = np.maximum(known.sum(axis=1), 1)[:, None]
        slope = 2.0 * (rise @ around) / 64.0 / count
        slope[known.sum(axis=1) < 8] = 0.0
        up = np.column_stack([-slope, np.ones(len(xy))])
        up /= np.linalg.norm(up, axis=1)[:, None]
        ground = np.column_stack([xy, middle])
        return up, ground + self.plane.height_m * np.array([0.0, 0.0, 1.0])

    def fit(
        self,
        xy: NDArray[np.float64],
        yaws: NDArray[np.float64],
        like: Likeness = _FROM_AFAR,
        every: int = 1,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground's normals (P, 3), positions (P, 3), scores (P, Y) and gains (P, Y, 6).

        Scores are log likelihood ratios of the frame's features against chance, -inf without
        ground. Gains are the means over features by kind.
        """
        up, place = self._stands(xy)
        # Contiguous arrays: numba compiles a function again for each other layout.
        turned = np.ascontiguousarray([leveling(one).T for one in up])
        headings = np.stack([Pose.from_ypr(np.zeros(3), yaw).rotation for yaw in yaws])
        some = slice(None, None, every)
        weight, piece = self._weight[some], np.ascontiguousarray(self._piece[some])
        whole = np.bincount(piece, weight, len(self._kinds))
        scores, gains = _scores(
            np.ascontiguousarray(self._points[some]),
            np.ascontiguousarray(self._kind[some]),
            weight / np.maximum(whole, 1e-12)[piece],
            piece,
            np.where(whole > 0, self._kinds, -1),
            np.column_stack([np.array(_WEIGHTS), like.shared, like.chance]),
            turned,
            np.where(np.isfinite(place), place, 0.0),
            headings,
            *self._gaining(like.width_m),
        )
        scores[~np.isfinite(place[:, 2])] = -np.inf
        return up, place, scores, gains

    def _best(
        self, xy: NDArray[np.float64], yaws: NDArray[np.float64], most: int, every: int
    ) -> list[Found]:
        up, place, scores, _ = self.fit(xy, yaws, every=every)
        flat = scores.ravel()
        high = np.partition(flat, -min(50 * most, len(flat)))[-min(50 * most, len(flat))]
        order = np.flatnonzero((flat >= high) & np.isfinite(flat))
        order = order[np.argsort(-flat[order], kind="stable")][: 50 * most]
        k, m = np.unravel_index(order, scores.shape)
        kept = _distinct(place[k, :2], yaws[m], most)
        return [
            Found(self._pose(up[a], place[a], float(yaws[b])), float(scores[a, b]), float(yaws[b]))
            for a, b in zip(k[kept], m[kept], strict=True)
        ]

    def _gaining(self, width_m: float) -> tuple[Space, Plan]:
        """Return both fields with the gain of a point for a scene error."""
        if width_m not in self._fields:
            fields = self._space, self._plan
            if width_m > 0:
                near = (np.exp(-0.5 * ((1.0 - one.gain) * FAR_M / width_m) ** 2) for one in fields)
                fields = self._space._replace(gain=next(near)), self._plan._replace(gain=next(near))
            self._fields[width_m] = fields
        return self._fields[width_m]


def _distinct(places: NDArray[np.float64], yaws: NDArray[np.float64], most: int) -> list[int]:
    """Return the first index of each neighbourhood of positions (P, 2) and headings (P,)."""
    kept: list[int] = []
    left = np.arange(len(places))
    while len(left) and len(kept) < most:
        one = int(left[0])
        kept.append(one)
        apart = np.hypot(*(places[left] - places[one]).T)
        turn = np.abs(np.angle(np.exp(1j * (yaws[left] - yaws[one]))))
        left = left[(apart >= _SAME_M) | (turn >= _SAME_RAD)]
    return kept


@numba.njit(cache=True)
def _scores(  # noqa: PLR0912, PLR0913, PLR0917
    points: NDArray[np.float64],
    kind: NDArray[np.int64],
    weight: NDArray[np.float64],
    piece: NDArray[np.int64],
    kinds: NDArray[np.int64],
    model: NDArray[np.float64],
    turned: NDArray[np.float64],
    place: NDArray[np.float64],
    headings: NDArray[np.float64],
    space: Space,
    plan: Plan,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the log likelihood ratio of features for every pose, and the gains."""
    out = np.zeros((len(place), len(headings)))
    means = np.zeros((len(place), len(headings), KINDS))
    many = np.zeros(KINDS)
    for n in range(len(kinds)):
        if kinds[n] >= 0:
            many[kinds[n]] += 1.0
    gained = np.zeros(len(kinds))
    for k in range(len(place)):
        for m in range(len(headings)):
            r = np.ascontiguousarray(turned[k]) @ np.ascontiguousarray(headings[m])
            gained[:] = 0.0
            for n in range(len(points)):
                p = points[n]
                x = r[0, 0] * p[0] + r[0, 1] * p[1] + r[0, 2] * p[2] + place[k, 0]
                y = r[1, 0] * p[0] + r[1, 1] * p[1] + r[1, 2] * p[2] + place[k, 1]
                z = r[2, 0] * p[0] + r[2, 1] * p[1] + r[2, 2] * p[2] + place[k, 2]
                if kind[n] == _RAISED:
                    a = int(np.floor((x - space.low[0]) / space.cell_m))
                    b = int(np.floor((y - space.low[1]) / space.cell_m))
                    c = int(np.floor((z - space.low[2]) / space.cell_m))
                    inside = 0 <= a < space.gain.shape[0] and 0 <= b < space.gain.shape[1]
                    if inside and 0 <= c < space.gain.shape[2]:
                        gained[piece[n]] += weight[n] * space.gain[a, b, c]
                    continue
                i = int(np.floor((x - plan.low[0]) / plan.cell_m))
                j = int(np.floor((y - plan.low[1]) / plan.cell_m))
                if not (0 <= i < plan.height.shape[0] and 0 <= j < plan.height.shape[1]):
                    continue
                if kind[n] == _GROUND:
                    off = abs(z - plan.height[i, j]) / _FAR_UP_M
                    if off < 1.0:  # false where the ground is unknown
                        gained[piece[n]] += weight[n] * (1.0 - off)
                else:
                    near = plan.gain[kind[n] - _EDGES, i, j]
                    gained[piece[n]] += weight[n] * near
            total = 0.0
            for n in range(len(kinds)):
                which = kinds[n]
                if which >= 0:
                    counts, shared, chance = model[which]
                    total += counts * np.log(1.0 - shared + shared * gained[n] / chance)
                    means[k, m, which] += gained[n] / many[which]
            out[k, m] = total
    return out, means
