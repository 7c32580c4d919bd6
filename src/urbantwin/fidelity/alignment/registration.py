"""Registration of a frame to the twin's points, with standard deviations of the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.fidelity.alignment.correspondences import (
    EDGES,
    GROUND,
    KINDS,
    LINES,
    POSTS,
    RAISED,
    Correspondences,
    Residuals,
)
from urbantwin.fidelity.alignment.frame_features import FrameFeatures
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.geometry import Pose

__all__ = ["Registered", "registered", "sandwich"]

#: Prior standard deviation of the offsets of surfaces and of edges, metres.
OFFSET_SIGMA_M = 0.3
#: Steps with which the curvature is measured: in plan the typical map error, in height and rotation
#: the scale of the ground's accuracy; metres and radians.
_MOVED_M, _LIFTED_M, _TURNED, _TIPPED = 0.1, 0.05, 0.1 / 12.0, 0.05 / 20.0
#: Minimum share of the curvature.
_LEAST_LEFT = 0.05
#: Error that is common to the whole scene, which cannot be measured: metres, and degrees.
_ALL_ALIKE_M, _ALL_ALIKE_DEG = 0.03, 0.1
#: Sectors that are left out in turn (jackknife).
_SECTORS = 8


def equations(
    residuals: Residuals, offsets: NDArray[np.float64], pivot: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobian (P, 8), normal matrix and gradient (8,) of rotation, position, offsets."""
    jacobian = np.column_stack(
        [
            np.cross(residuals.at - pivot, residuals.aim),
            residuals.aim,
            -1.0 * (residuals.kind == RAISED),
            -1.0 * (residuals.kind == EDGES),
        ]
    )
    weighted = jacobian * residuals.weight[:, None]
    matrix, gradient = weighted.T @ jacobian, weighted.T @ residuals.error
    matrix[[6, 7], [6, 7]] += OFFSET_SIGMA_M**-2
    gradient[6:] += offsets * OFFSET_SIGMA_M**-2
    return jacobian, matrix, gradient


def turned_and_moved(pose: Pose, step: NDArray[np.float64]) -> Pose:
    """Return a pose after rotations about the site's axes and a shift (6,)."""
    turned = Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation
    return Pose(turned, pose.translation + step[3:6])


def pose_deviation(
    correspondences: Correspondences,
    pose: Pose,
    offsets: NDArray[np.float64],
    wrong: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the standard deviations (6,) of rotations, radians, and position, metres.

    The larger of two estimates: from the measured errors of the scene, and from the dependence on
    single sectors of the surroundings (jackknife).

    Args:
        correspondences: correspondences of frame and scene.
        pose: ``site_SE3_frame``, the solution.
        offsets: (2,) offsets of surfaces and edges from the real ones, metres.
        wrong: (5,) error of the scene, by kind, metres.
        scale: (5,) distance at which a point's weight is a quarter, by kind, metres.
    """
    residuals = correspondences.residuals(pose, offsets, wrong, scale)
    jacobian, matrix, _ = equations(residuals, offsets, pose.translation)

    def pull(step: NDArray[np.float64]) -> NDArray[np.float64]:
        moved, other = turned_and_moved(pose, step), offsets + step[6:]
        found = correspondences.residuals(moved, other, wrong, scale)
        return equations(found, other, pose.translation)[2]

    lengths = np.array([_TIPPED, _TIPPED, _TURNED, _MOVED_M, _MOVED_M, _LIFTED_M, *[_MOVED_M] * 2])
    # Along decoupled axes. On a slope, a rotation about the vertical also tilts the ground, which
    # resists so stiffly that the other constraints would be lost.
    axes = np.linalg.eigh(matrix * np.outer(lengths, lengths))[1]
    steps = lengths[:, None] * axes
    change = np.column_stack([pull(one) - pull(-one) for one in steps.T]) / 2.0
    curvature = change @ axes.T / lengths
    sigma = np.sqrt(
        np.maximum(sandwich(matrix, curvature), _jackknife(residuals, jacobian, matrix, pose))
    )
    sigma[3:] = np.hypot(sigma[3:], _ALL_ALIKE_M)
    sigma[:3] = np.hypot(sigma[:3], np.radians(_ALL_ALIKE_DEG))
    return np.asarray(sigma)


def sandwich(matrix: NDArray[np.float64], curvature: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variances (6,) for a given normal matrix and measured curvature.

    With curvature H and matrix M the covariance is H^-1 M H^-1. In the directions in which both are
    diagonal, H is a share of M, at most 1, since the noise of a measured curvature must not reduce
    the variance.
    """
    lower = np.linalg.inv(np.linalg.cholesky(matrix))
    left, across = np.linalg.eigh(lower @ ((curvature + curvature.T) / 2.0) @ lower.T)
    spread = (lower.T @ across) / np.clip(left, _LEAST_LEFT, 1.0)
    return np.asarray((spread**2).sum(axis=1)[:6])


def _jackknife(
    residuals: Residuals,
    jacobian: NDArray[np.float64],
    matrix: NDArray[np.float64],
    pose: Pose,
) -> NDArray[np.float64]:
    """Return the variances (6,) of rotation and position by leaving out sectors in turn.

    One step from the solution with fixed correspondences.
    """
    x, y = (residuals.at - pose.translation)[:, :2].T
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi)) % 1.0 * _SECTORS)
    moved = []
    for number in np.unique(sector):
        mine = sector == number
        weighted = jacobian[mine] * residuals.weight[mine, None]
        rest = matrix - weighted.T @ jacobian[mine]
        if np.linalg.cond(rest) > 1e12:
            return np.full(6, np.inf)
        moved.append(np.linalg.solve(rest, weighted.T @ residuals.error[mine])[:6])
    places = np.array(moved)
    count = len(places)
    return np.asarray((count - 1) / count * ((places - places.mean(axis=0)) ** 2).sum(axis=0))


#: Maximum distance of points from visible surfaces, at first and in the end, metres: farther points
#: are of objects that the scene lacks.
_REACHES_M = (1.5, 1.0)
#: Distance at which a point's weight is a quarter, by kind, at first and in the end, metres; and
#: its minimum as a multiple of the kind's error, as otherwise one accurate house outweighs all
#: others.
_SCALES_M = np.array([[0.5, 0.2, 0.5, 0.4, 0.5], [0.2, 0.1, 0.25, 0.2, 0.2]])
_SCALE_OF_WRONG = 2.5
#: Maximum distance of an explained point from its plane, edge or line, and from a post, metres.
EXPLAINED_M, _EDGE_EXPLAINED_M, _POST_M = 0.15, 0.25, 0.5
#: Maximum number of steps, and the final step size, metres and radians, for a fine and for a rough
#: registration.
_STEPS, _LAST_M, _LAST_RAD = 40, (5e-4, 5e-3), (3e-5, 3e-4)
#: Prior error of objects, ground, edges, lines and posts as a whole, metres, and the weight of this
#: prior in clusters. Houses of OpenStreetMap are 0.5 to 1 m off, surveyed ones and meshes
#: centimetres.
_WRONG_M, _BELIEF = (0.25, 0.05, 0.15, 0.12, 0.25), 1.5
_LEAST_WRONG_M = 0.01
_LEAST_POINTS = 50


@dataclass(frozen=True, eq=False)
class Registered:
    """The registered pose of a frame.

    Attributes:
        pose: ``site_SE3_frame``.
        explained: share of the points off the ground with a surface within 0.15 m.
        curbs_explained: share of the curbs with an edge of the carriageway within 0.25 m.
        marks_explained: share of the bright spots with a line within 0.15 m.
        posts: number of posts within 0.5 m of a post of the scene.
        residual_m: median distance of points from the planes of their surfaces.
        surface_offset_m: mean offset of real surfaces off the ground behind the scene's (negative)
            or in front of them.
        edge_offset_m: offset of real curbs outside (negative) or inside of the carriageway.
        sigma_m: (3,) standard deviations of the position, metres.
        sigma_deg: (3,) standard deviations of rotations about the site's axes, degrees.
        points: number of points with a surface.
    """

    pose: Pose
    explained: float
    curbs_explained: float
    marks_explained: float
    posts: int
    residual_m: float
    surface_offset_m: float
    edge_offset_m: float
    sigma_m: NDArray[np.float64]
    sigma_deg: NDArray[np.float64]
    points: int


def registered(
    scene: ScenePoints, features: FrameFeatures, start: Pose, *, rough: bool = False
) -> Registered | None:
    """Register a frame to the scene.

    Point-to-plane ICP (Chen and Medioni 1992) with the weights of Geman and McClure; the foot of
    curbs is matched to the edges of carriageways and bright spots to painted lines in the same way,
    in plan. Three things differ from registration libraries. The planes are the scene's triangles,
    not fits to neighbouring points, which fail along the rings of a LiDAR. The weight of all points
    of one object, or of one 12 m section, is limited by the measured accuracy of the scene: ten
    thousand points of a road whose heights are 5 cm off must not outweigh twenty curbs. And two
    offsets are estimated with the pose: the mean offset of surfaces off the ground, and of edges
    from the curbs. Outlines of buildings include their eaves, and meshes of cars fill their boxes;
    without the offset, such a scene pushes the sensor towards its emptier side.

    For the standard deviations see `pose_deviation`; a rough registration has none.

    Args:
        scene: the static world as points.
        features: thinned features; the sensor is at their origin.
        start: the initial pose.
        rough: only as accurate as needed to distinguish places.

    Returns:
        ``None`` if too few points are near a surface, or the pose is underdetermined.
    """
    pose, offsets = start, np.zeros(2)
    wrong, solved = np.array(_WRONG_M), None
    for reach, least in list(zip(_REACHES_M, _SCALES_M, strict=True))[: 1 if rough else 2]:
        correspondences = Correspondences(scene, features, pose, reach)
        if len(correspondences.surface) < _LEAST_POINTS:
            return None
        for _ in range(1 if rough else 2):
            scale = np.maximum(least, _SCALE_OF_WRONG * wrong)
            solved = _solved(correspondences, pose, offsets, wrong, scale, rough)
            if solved is None:
                return None
            pose, offsets, residuals = solved.pose, solved.offsets, solved.residuals
            weighed, wrong = wrong, _wrong(residuals)
    assert solved is not None
    sigma = np.full(6, np.nan)
    if not rough:
        sigma = pose_deviation(correspondences, pose, offsets, weighed, scale)
    surfaces = residuals.kind <= GROUND
    return Registered(
        pose=pose,
        explained=_explained(features, pose, scene, residuals),
        curbs_explained=_share(residuals, EDGES, _EDGE_EXPLAINED_M, len(features.curbs)),
        marks_explained=_share(residuals, LINES, EXPLAINED_M, len(features.spots)),
        posts=len(np.unique(residuals.number[_on_posts(residuals, _POST_M)])),
        residual_m=float(np.median(np.abs(residuals.error[surfaces]))),
        surface_offset_m=float(offsets[0]),
        edge_offset_m=float(offsets[1]),
        sigma_m=sigma[3:6],
        sigma_deg=np.degrees(sigma[:3]),
        points=int(surfaces.sum()),
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """A solution: pose, offsets, and residuals."""

    pose: Pose
    offsets: NDArray[np.float64]
    residuals: Residuals


def _solved(
    correspondences: Correspondences,
    pose: Pose,
    offsets: NDArray[np.float64],
    wrong: NDArray[np.float64],
    scale: NDArray[np.float64],
    rough: bool,
) -> _Solved | None:
    """Return the Gauss-Newton solution; None if a direction is undetermined."""
    for _ in range(_STEPS):
        residuals = correspondences.residuals(pose, offsets, wrong, scale)
        if len(residuals.at) < _LEAST_POINTS:
            return None
        _, matrix, gradient = equations(residuals, offsets, pose.translation)
        if np.linalg.cond(matrix) > 1e12:
            return None
        step = np.asarray(-np.linalg.solve(matrix, gradient), np.float64)
        pose = turned_and_moved(pose, step)
        offsets = offsets + step[6:]
        if np.abs(step[3:6]).max() < _LAST_M[rough] and np.abs(step[:3]).max() < _LAST_RAD[rough]:
            break
    return _Solved(pose, offsets, residuals)


def _wrong(residuals: Residuals) -> NDArray[np.float64]:
    """Return the error of each kind over one cluster, from the scatter of clusters' means.

    With few clusters the estimate is a mean of their scatter and the prior.
    """
    found = np.array(_WRONG_M)
    for kind in range(KINDS):
        mine = residuals.kind == kind
        cluster, weight = residuals.cluster[mine], residuals.weight[mine]
        total = np.bincount(cluster, weight)
        mean = np.bincount(cluster, weight * residuals.error[mine])
        held = np.bincount(cluster) >= (1 if kind in {EDGES, LINES, POSTS} else 3)
        held = held & (total > 0)
        count = int(held.sum())
        if count < 2:
            continue
        off = mean[held] / total[held]
        scatter = 1.4826 * float(np.median(np.abs(off)))
        # correct for the fitted pose
        scatter *= np.sqrt(count / max(count - 3.0, 1.0))
        pooled = (_BELIEF * found[kind] ** 2 + count * scatter**2) / (_BELIEF + count)
        found[kind] = max(_LEAST_WRONG_M, float(np.sqrt(pooled)))
    return found


def _share(residuals: Residuals, kind: int, within: float, of: int) -> float:
    near = (residuals.kind == kind) & (np.abs(residuals.error) < within)
    return float(near.sum() / max(of, 1))


def _on_posts(residuals: Residuals, within: float) -> NDArray[np.bool_]:
    """Return the mask of residuals of posts near a post of the scene in both coordinates."""
    upright = residuals.kind == POSTS
    far = residuals.number[upright & (np.abs(residuals.error) >= within)]
    return np.asarray(upright & ~np.isin(residuals.number, far))


def _explained(
    features: FrameFeatures, pose: Pose, scene: ScenePoints, residuals: Residuals
) -> float:
    """Return the share of the points off the ground that lie on a surface off the ground."""
    at = pose.apply(features.points)
    height = at[:, 2] - scene.ground_at(at[:, :2])
    off = ~(height < 0.3)  # also where the ground is unknown
    on = np.zeros(len(at), np.bool_)
    close = (residuals.kind == RAISED) & (np.abs(residuals.error) < EXPLAINED_M)
    on[residuals.number[close]] = True
    on |= np.isin(features.post, residuals.number[_on_posts(residuals, EXPLAINED_M)])
    return float((on & off).sum() / max(int(off.sum()), 1))
