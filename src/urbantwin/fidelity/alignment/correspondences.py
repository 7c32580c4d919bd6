"""Correspondences of a frame's points in the scene: planes, road edges, painted lines, posts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.alignment.frame_features import FrameFeatures
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.geometry import Pose, row_keys

__all__ = [
    "ALIKE_M",
    "EDGES",
    "GROUND",
    "KINDS",
    "LINES",
    "NOISE_M",
    "POSTS",
    "RAISED",
    "Correspondences",
    "Residuals",
]

RAISED, GROUND, EDGES, LINES, POSTS = range(5)
KINDS = 5
#: Size of regions in which errors of the scene are equal, unless they are separate objects, metres.
ALIKE_M = 12.0
#: Noise of single points by kind, metres.
NOISE_M = (0.03, 0.03, 0.05, 0.05, 0.05)
#: Edges and lines farther above or below a point are of another street level, metres.
_STOREY_M = 1.5

#: The columns of `Residuals`.
_Part = tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of the points that have a correspondence.

    Attributes:
        at: (P, 3) positions, site frame.
        aim: (P, 3) unit vectors along which the error is measured.
        error: (P,) errors, metres.
        weight: (P,) weights per square metre.
        kind: (P,) kind of the surface: `RAISED`, `GROUND`, `EDGES`, `LINES` or `POSTS`.
        cluster: (P,) group of points with a common error: one object or region.
        number: (P,) index of the point, curb, spot or post in its features.
    """

    at: NDArray[np.float64]
    aim: NDArray[np.float64]
    error: NDArray[np.float64]
    weight: NDArray[np.float64]
    kind: NDArray[np.int64]
    cluster: NDArray[np.int64]
    number: NDArray[np.int64]


class Correspondences:
    """Correspondences of one frame with the part of the scene that is visible from its pose.

    Args:
        scene: the static world as points.
        features: features of the frame.
        start: approximate pose.
        reach_m: maximum distance of a correspondence.
    """

    def __init__(
        self, scene: ScenePoints, features: FrameFeatures, start: Pose, reach_m: float
    ) -> None:
        self._features = features
        self._reach = reach_m
        seen = scene.seen_from(start.translation)
        self.surface, normal = scene.points[seen], scene.normals[seen]
        facing = ((start.translation - self.surface) * normal).sum(axis=1)
        normal = normal * np.where(facing < 0, -1.0, 1.0)[:, None]
        ground = scene.is_ground[seen]
        cluster = _clusters(self.surface, scene.object[seen])
        post = scene.is_post[seen]
        self._posts = scene.posts
        surface = features.raised & ((features.post < 0) | (len(scene.posts) == 0))
        self._targets = []
        for mine, theirs in (
            (~features.raised, ~post),
            (surface, scene.is_raised[seen] & ~post),
        ):
            places = self.surface[theirs]
            tree = cKDTree(places) if len(places) else None
            chosen = np.flatnonzero(mine)
            of = (normal[theirs], ground[theirs], cluster[theirs])
            self._targets.append((chosen, places, *of, tree))
        self._edges, self._edge_normal = scene.edges, scene.edge_normal
        self._lines, self._line_normal = scene.lines, scene.line_normal
        self._trees = [
            cKDTree(places) if len(places) else None
            for places in (self._edges[:, :2], self._lines[:, :2])
        ]
        self._clusters = [_clusters(places) for places in (self._edges, self._lines)]

    def residuals(
        self,
        pose: Pose,
        offsets: NDArray[np.float64],
        wrong: NDArray[np.float64],
        scale: NDArray[np.float64],
    ) -> Residuals:
        """Return the residuals of the frame in a pose.

        Args:
            pose: ``site_SE3_frame``.
            offsets: (2,) offsets of raised surfaces, and of edges, from the real ones, metres.
            wrong: (5,) error of the scene over `ALIKE_M`, by kind, metres.
            scale: (5,) distance at which a point's weight is a quarter, by kind, metres.
        """
        parts = [*self._surfaces(pose), self._curbs(pose), self._spots(pose), *self._uprights(pose)]
        at, aim, error, weight, kind, cluster, number = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        error = error - offsets[0] * (kind == RAISED) - offsets[1] * (kind == EDGES)
        # Many points in one region are no more accurate than the scene is there.
        group = cluster * KINDS + kind
        many = np.bincount(group, weight)[group] if len(group) else weight
        weight = weight / (many * wrong[kind] ** 2 + np.array(NOISE_M)[kind] ** 2)
        weight = weight / (1.0 + (error / scale[kind]) ** 2) ** 2
        return Residuals(at, aim, error, weight, kind, cluster, number)

    def _surfaces(self, pose: Pose) -> list[_Part]:
        """Match ground points to any surface, and raised points to raised surfaces.

        Raised points (cars, hedges, people) do not match the ground below, nor posts unless they
        are thin.
        """
        found = []
        for chosen, places, normal, ground, cluster, tree in self._targets:
            if tree is None or not len(chosen):
                continue
            at = pose.apply(self._features.points[chosen])
            distance, nearest = tree.query(at, distance_upper_bound=self._reach)
            near = np.flatnonzero(np.isfinite(distance))
            nearest, at, mine = nearest[near], at[near], chosen[near]
            error = ((at - places[nearest]) * normal[nearest]).sum(axis=1)
            kind = np.where(ground[nearest], GROUND, RAISED)
            weight = np.ones(len(near))
            found.append((at, normal[nearest], error, weight, kind, cluster[nearest], mine))
        return found

    def _uprights(self, pose: Pose) -> list[_Part]:
        """Match axes of posts in plan, east and north: they are too thin for planes."""
        at = pose.apply(self._features.posts)
        if not len(at) or not len(self._posts):
            return []
        distance, nearest = cKDTree(self._posts[:, :2]).query(
            at[:, :2], distance_upper_bound=self._reach
        )
        near = np.flatnonzero(np.isfinite(distance))
        nearest, at = nearest[near], at[near]
        found: list[_Part] = []
        for axis in range(2):
            aim = np.tile(np.eye(3)[axis], (len(near), 1))
            error = at[:, axis] - self._posts[nearest, axis]
            kind = np.full(len(near), POSTS)
            found.append((at, aim, error, np.ones(len(near)), kind, 2 * nearest + axis, near))
        return found

    def _curbs(self, pose: Pose) -> _Part:
        at = pose.apply(self._features.curbs)
        road = self._features.curb_road @ pose.rotation.T
        found = self._beside(0, at, self._edges, self._edge_normal, EDGES)
        # The road must be on the same side of both.
        fits = (road[found[-1]] * found[1]).sum(axis=1) > 0.0
        return tuple(column[fits] for column in found)

    def _spots(self, pose: Pose) -> _Part:
        at = pose.apply(self._features.spots)
        found = self._beside(1, at, self._lines, self._line_normal, LINES)
        return (*found[:3], self._features.spot_weight[found[-1]], *found[4:])

    def _beside(
        self,
        which: int,
        at: NDArray[np.float64],
        places: NDArray[np.float64],
        normal: NDArray[np.float64],
        kind: int,
    ) -> _Part:
        """Match points to edges or lines in plan, without heights."""
        tree = self._trees[which]
        if tree is None or not len(at):
            nothing = np.zeros(0, np.int64)
            return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), *[nothing] * 3
        distance, nearest = tree.query(at[:, :2], distance_upper_bound=self._reach)
        near = np.flatnonzero(np.isfinite(distance))
        near = near[np.abs(at[near, 2] - places[nearest[near], 2]) < _STOREY_M]
        nearest = nearest[near]
        aim = normal[nearest]
        error = ((at[near] - places[nearest]) * aim).sum(axis=1)
        kinds = np.full(len(near), kind)
        return (
            at[near],
            aim,
            error,
            np.ones(len(near)),
            kinds,
            self._clusters[which][nearest],
            near,
        )


def _clusters(
    places: NDArray[np.float64], of: NDArray[np.int64] | None = None
) -> NDArray[np.int64]:
    """Return the object (N,) of each position, or the cube that contains it."""
    cell = np.floor(places / ALIKE_M).astype(np.int64)
    if of is not None:
        cell = np.column_stack([np.where(of[:, None] > 0, 0, cell), of])
    number = np.unique(row_keys(cell), axis=0, return_inverse=True)[1]
    return np.asarray(number.ravel(), np.int64)
