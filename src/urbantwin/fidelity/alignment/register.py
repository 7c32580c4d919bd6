"""Registration of a frame to the scene: points to planes, curbs to edges, paint to lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.fidelity.alignment.sight import Sight
from urbantwin.geometry import Pose

__all__ = ["Registered", "registered"]

#: Points farther than this from every visible surface are of something that the scene has not:
#: at first, and in the end, metres.
_REACHES_M = (1.5, 0.7)
#: Distance at which a point counts a quarter: of planes; of edges and lines, at first and in the
#: end, metres.
_SCALES_M = ((0.2, 0.2, 0.5, 0.4), (0.2, 0.1, 0.25, 0.2))
#: Nearer to its plane, edge or line than this a point is explained, metres.
EXPLAINED_M, _EDGE_EXPLAINED_M = 0.15, 0.25
_STEPS = 40
#: Points this near to each other err alike, metres.
_ALIKE_M = 4.0
#: How far single points scatter, and how far the scene is wrong over `_ALIKE_M`: surfaces off
#: the ground, ground, edges, lines; metres. The latter are measured in the end.
_NOISE_M = (0.03, 0.03, 0.05, 0.05)
_WRONG_M = (0.05, 0.05, 0.10, 0.10)
_LEAST_WRONG_M = 0.01
_LEAST_POINTS = 50
#: Belief that nothing stands proud, and that edges are where curbs are: standard deviation, metres.
_OFFSET_SIGMA_M = 0.3
_RAISED, _GROUND, _EDGES, _LINES = range(4)
#: Parts of the surroundings that are left out in turn, to see what hangs on each.
_SECTORS = 12


@dataclass(frozen=True, eq=False)
class Registered:
    """Where a frame was found to lie.

    Attributes:
        pose: ``site_SE3_frame``.
        explained: share of the points off the ground that have a surface within 0.15 m.
        curbs_explained: share of the curbs that have an edge of carriageway within 0.25 m.
        marks_explained: share of the bright spots that have a line within 0.15 m.
        residual_m: median distance of points from the planes of their surfaces.
        surface_offset_m: how far real surfaces off the ground lie behind the scene's (negative)
            or before them, on average.
        edge_offset_m: how far real curbs lie outside (negative) or inside of the carriageway's.
        sigma_m: (3,) standard deviations of the place, metres.
        sigma_deg: (3,) of turns about the site's axes, degrees.
        points: how many points had a surface.
    """

    pose: Pose
    explained: float
    curbs_explained: float
    marks_explained: float
    residual_m: float
    surface_offset_m: float
    edge_offset_m: float
    sigma_m: NDArray[np.float64]
    sigma_deg: NDArray[np.float64]
    points: int

    @property
    def support(self) -> float:
        """How much of what holds a place is explained, to tell places apart."""
        return self.explained + self.curbs_explained + 0.3 * self.marks_explained


@dataclass(frozen=True, eq=False)
class _Pulls:
    """Points with a counterpart: where they are, along what they err and by how much."""

    at: NDArray[np.float64]
    aim: NDArray[np.float64]
    error: NDArray[np.float64]
    weight: NDArray[np.float64]
    kind: NDArray[np.int64]
    cluster: NDArray[np.int64]
    number: NDArray[np.int64]


class _Problem:
    """One frame against what of the scene can be seen from about where it is."""

    def __init__(self, scene: ScenePoints, sight: Sight, start: Pose, stage: int) -> None:
        self._sight = sight
        self._reach = _REACHES_M[stage]
        self._scales = np.array(_SCALES_M[stage])
        seen = scene.seen_from(start.translation)
        self.surface, normal = scene.points[seen], scene.normals[seen]
        facing = ((start.translation - self.surface) * normal).sum(axis=1)
        self._normal = normal * np.where(facing < 0, -1.0, 1.0)[:, None]
        self._ground = scene.is_ground[seen]
        self._edges, self._edge_normal = scene.edges, scene.edge_normal
        self._lines, self._line_normal = scene.lines, scene.line_normal
        self._trees = [
            cKDTree(places) if len(places) else None
            for places in (self.surface, self._edges[:, :2], self._lines[:, :2])
        ]
        self._clusters = [_clusters(places) for places in (sight.points, sight.curbs, sight.spots)]

    def pulls(self, pose: Pose, offsets: NDArray[np.float64], wrong: NDArray[np.float64]) -> _Pulls:
        """Return what pulls at the frame in a pose."""
        parts = [self._surfaces(pose), self._curbs(pose), self._spots(pose)]
        at, aim, error, weight, kind, cluster, number = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        error = error - offsets[0] * (kind == _RAISED) - offsets[1] * (kind == _EDGES)
        # Many points of one spot are no better than the scene is there.
        group = cluster * 4 + kind
        many = np.bincount(group, weight)[group] if len(group) else weight
        weight = weight / (many * wrong[kind] ** 2 + np.array(_NOISE_M)[kind] ** 2)
        weight = weight / (1.0 + (error / self._scales[kind]) ** 2) ** 2
        return _Pulls(at, aim, error, weight, kind, cluster, number)

    def _surfaces(self, pose: Pose) -> tuple[NDArray[np.generic], ...]:
        at = pose.apply(self._sight.points)
        tree = self._trees[0]
        assert tree is not None
        distance, nearest = tree.query(at, distance_upper_bound=self._reach)
        near = np.flatnonzero(np.isfinite(distance))
        # What rises from the ground is not the ground below it: cars, hedges, people.
        ground = self._ground[nearest[near]]
        near = near[~(ground & self._sight.raised[near])]
        nearest = nearest[near]
        aim = self._normal[nearest]
        error = ((at[near] - self.surface[nearest]) * aim).sum(axis=1)
        kind = np.where(self._ground[nearest], _GROUND, _RAISED)
        return at[near], aim, error, np.ones(len(near)), kind, self._clusters[0][near], near

    def _curbs(self, pose: Pose) -> tuple[NDArray[np.generic], ...]:
        at = pose.apply(self._sight.curbs)
        road = self._sight.curb_road @ pose.rotation.T
        found = self._beside(1, at, self._edges, self._edge_normal, _EDGES)
        # The road must be on the same side of both.
        fits = (road[found[-1]] * found[1]).sum(axis=1) > 0.0
        return tuple(column[fits] for column in found)

    def _spots(self, pose: Pose) -> tuple[NDArray[np.generic], ...]:
        at = pose.apply(self._sight.spots)
        found = self._beside(2, at, self._lines, self._line_normal, _LINES)
        return (*found[:3], self._sight.spot_weight[found[-1]], *found[4:])

    def _beside(
        self,
        which: int,
        at: NDArray[np.float64],
        places: NDArray[np.float64],
        normal: NDArray[np.float64],
        kind: int,
    ) -> tuple[NDArray[np.generic], ...]:
        """Match points to edges or lines in plan: heights say nothing about them."""
        tree = self._trees[which]
        if tree is None or not len(at):
            nothing = np.zeros(0, np.int64)
            return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), *[nothing] * 3
        distance, nearest = tree.query(at[:, :2], distance_upper_bound=self._reach)
        near = np.flatnonzero(np.isfinite(distance))
        near = near[np.abs(at[near, 2] - places[nearest[near], 2]) < 1.5]
        nearest = nearest[near]
        aim = normal[nearest]
        error = ((at[near] - places[nearest]) * aim).sum(axis=1)
        kinds = np.full(len(near), kind)
        return at[near], aim, error, np.ones(len(near)), kinds, self._clusters[which][near], near


def registered(scene: ScenePoints, sight: Sight, start: Pose) -> Registered | None:
    """Move a frame so that what it shows lies on what the scene has.

    Iterated closest points to planes (Chen and Medioni 1992) with the weights of Geman and
    McClure; the foot of curbs is drawn to the edges of carriageways and bright spots of the road
    to its lines in the same way, in plan. Three things differ from what registration libraries
    offer. The planes are the scene's own triangles, not fits to neighbouring points, which fail
    along the rings of a LiDAR. Points within 4 m weigh together no more than the scene is right
    there, which is measured: ten thousand points of a road whose heights are 5 cm off must not
    outvote twenty curbs. And beside the pose two more numbers are found: how far surfaces off
    the ground stand proud of the real ones on average, and how far edges lie from the curbs.
    Outlines of buildings include their eaves, and meshes of cars fill their boxes; without that
    number, such a scene pushes the sensor to the side where it is emptier.

    Standard deviations are the larger of two: of the delete-a-group jackknife over 12 sectors
    around the sensor (what hangs on one part of the surroundings, where the scene is wrong in one
    piece), and what the normal equations say with the errors measured.

    Args:
        scene: the static world as points.
        sight: thinned; the sensor is at its origin.
        start: the pose to begin with.

    Returns:
        ``None`` where too few points have a surface near, or too few directions are held.
    """
    pose, offsets = start, np.zeros(2)
    wrong = np.array(_WRONG_M)
    solved = None
    for stage in range(2):
        problem = _Problem(scene, sight, pose, stage)
        if len(problem.surface) < _LEAST_POINTS:
            return None
        for _ in range(2):
            solved = _solved(problem, pose, offsets, wrong, _STEPS)
            if solved is None:
                return None
            pose, offsets, pulls, jacobian, matrix = solved
            wrong = _wrong(pulls)
    spread = _jackknife(pulls, jacobian, matrix, pose)
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.inv(matrix))[:6], spread))
    sigma[3:] = np.hypot(sigma[3:], _LEAST_WRONG_M)  # what is wrong everywhere alike
    surfaces = pulls.kind <= _GROUND
    return Registered(
        pose=pose,
        explained=_explained(sight, pose, scene, pulls),
        curbs_explained=_share(pulls, _EDGES, _EDGE_EXPLAINED_M, len(sight.curbs)),
        marks_explained=_share(pulls, _LINES, EXPLAINED_M, len(sight.spots)),
        residual_m=float(np.median(np.abs(pulls.error[surfaces]))),
        surface_offset_m=float(offsets[0]),
        edge_offset_m=float(offsets[1]),
        sigma_m=sigma[3:6],
        sigma_deg=np.degrees(sigma[:3]),
        points=int(surfaces.sum()),
    )


_Solved = tuple[Pose, NDArray[np.float64], _Pulls, NDArray[np.float64], NDArray[np.float64]]


def _solved(
    problem: _Problem,
    pose: Pose,
    offsets: NDArray[np.float64],
    wrong: NDArray[np.float64],
    steps: int,
) -> _Solved | None:
    """Gauss and Newton's steps; None where a direction is not held."""
    for _ in range(steps):
        pulls = problem.pulls(pose, offsets, wrong)
        if len(pulls.at) < _LEAST_POINTS:
            return None
        jacobian = np.column_stack(
            [
                np.cross(pulls.at - pose.translation, pulls.aim),
                pulls.aim,
                -1.0 * (pulls.kind == _RAISED),
                -1.0 * (pulls.kind == _EDGES),
            ]
        )
        weighted = jacobian * pulls.weight[:, None]
        matrix, gradient = weighted.T @ jacobian, weighted.T @ pulls.error
        matrix[[6, 7], [6, 7]] += _OFFSET_SIGMA_M**-2
        gradient[6:] += offsets * _OFFSET_SIGMA_M**-2
        if np.linalg.cond(matrix) > 1e12:
            return None
        step = -np.linalg.solve(matrix, gradient)
        pose = Pose(
            Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation,
            pose.translation + step[3:6],
        )
        offsets = offsets + step[6:]
        if np.abs(step[3:6]).max() < 2e-4 and np.abs(step[:3]).max() < 2e-5:
            break
    return pose, offsets, pulls, jacobian, matrix


def _clusters(places: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cube (N,) that each place lies in."""
    cell = np.floor(places / _ALIKE_M).astype(np.int64)
    return np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _wrong(pulls: _Pulls) -> NDArray[np.float64]:
    """Return how far each kind is wrong over one cluster: the scatter of clusters' means."""
    found = np.array(_WRONG_M)
    for kind in range(4):
        mine = pulls.kind == kind
        cluster, weight = pulls.cluster[mine], pulls.weight[mine]
        total = np.bincount(cluster, weight)
        mean = np.bincount(cluster, weight * pulls.error[mine])
        held = np.bincount(cluster) >= (3 if kind <= _GROUND else 1)
        held = held & (total > 0)
        if held.sum() >= 6:
            off = mean[held] / total[held]
            found[kind] = max(_LEAST_WRONG_M, 1.4826 * float(np.median(np.abs(off))))
    return found


def _jackknife(
    pulls: _Pulls, jacobian: NDArray[np.float64], matrix: NDArray[np.float64], pose: Pose
) -> NDArray[np.float64]:
    """Return the variances (6,) of turns and place by leaving out sectors in turn.

    One step from the solution with the counterparts as they are.
    """
    x, y = (pulls.at - pose.translation)[:, :2].T
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi)) % 1.0 * _SECTORS)
    moved = []
    for number in np.unique(sector):
        mine = sector == number
        weighted = jacobian[mine] * pulls.weight[mine, None]
        rest = matrix - weighted.T @ jacobian[mine]
        if np.linalg.cond(rest) > 1e12:
            return np.full(6, np.inf)
        moved.append(np.linalg.solve(rest, weighted.T @ pulls.error[mine])[:6])
    places = np.array(moved)
    count = len(places)
    return np.asarray((count - 1) / count * ((places - places.mean(axis=0)) ** 2).sum(axis=0))


def _share(pulls: _Pulls, kind: int, within: float, of: int) -> float:
    near = (pulls.kind == kind) & (np.abs(pulls.error) < within)
    return float(near.sum() / max(of, 1))


def _explained(sight: Sight, pose: Pose, scene: ScenePoints, pulls: _Pulls) -> float:
    """Return the share of the points off the ground that lie on a surface off the ground."""
    at = pose.apply(sight.points)
    height = at[:, 2] - scene.ground_at(at[:, :2])
    off = ~(height < 0.3)  # where nobody knows the ground, too
    on = np.zeros(len(at), np.bool_)
    close = (pulls.kind == _RAISED) & (np.abs(pulls.error) < EXPLAINED_M)
    on[pulls.number[close]] = True
    return float((on & off).sum() / max(off.sum(), 1))
