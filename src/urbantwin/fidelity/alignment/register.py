"""Registration of a frame to the scene: points to the planes of surfaces that can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.geometry import Pose

__all__ = ["Registered", "registered"]

#: Points farther than this from every visible surface are of something that the scene has not:
#: at first, and in the end, metres.
_REACHES_M = (1.5, 0.7)
#: Distance from the plane at which a point counts a quarter, metres.
_SCALE_M = 0.2
#: Nearer to its plane than this a point is explained, metres.
EXPLAINED_M = 0.15
_STEPS = 60
#: Points this near to each other err alike, metres.
_ALIKE_M = 4.0
_LEAST_POINTS = 50


@dataclass(frozen=True, eq=False)
class Registered:
    """Where a frame was found to lie.

    Attributes:
        pose: ``site_SE3_frame``.
        explained: share of the points off the ground that have a surface within 0.15 m.
        residual_m: median distance of points from the planes of their surfaces.
        surface_offset_m: how far real surfaces off the ground lie behind the scene's (negative)
            or before them, on average.
        sigma_m: (3,) standard deviations of the place, metres.
        sigma_deg: (3,) of turns about the site's axes, degrees.
        points: how many points had a surface.
    """

    pose: Pose
    explained: float
    residual_m: float
    surface_offset_m: float
    sigma_m: NDArray[np.float64]
    sigma_deg: NDArray[np.float64]
    points: int


def registered(scene: ScenePoints, points: NDArray[np.float64], start: Pose) -> Registered | None:
    """Move a frame so that its points lie on the planes of the surfaces next to them.

    Iterated closest points to planes (Chen and Medioni 1992) with the weights of Geman and McClure.
    Two things differ from what registration libraries offer. The planes are the scene's own
    triangles, not fits to neighbouring points, which fail along the rings of a LiDAR. And beside
    the pose one more number is found: how far surfaces off the ground stand proud of the real
    ones on average. Outlines of buildings include their eaves, and meshes of cars fill their
    boxes; without that number, such a scene pushes the sensor to the side where it is emptier.

    Standard deviations are the sandwich estimate with points within 4 m of each other as one
    cluster (Cameron and Miller 2015): neighbours err alike.

    Args:
        scene: the static world as points.
        points: (N, 3), thinned; the sensor is at their origin.
        start: the pose to begin with.

    Returns:
        ``None`` where too few points have a surface near, or too few directions are held.
    """
    pose, offset = start, 0.0
    for reach in _REACHES_M:
        seen = scene.seen_from(pose.translation)
        surface, ground = scene.points[seen], scene.is_ground[seen]
        if len(surface) < _LEAST_POINTS:
            return None
        normal = scene.normals[seen]
        facing = ((pose.translation - surface) * normal).sum(axis=1)
        normal = normal * np.where(facing < 0, -1.0, 1.0)[:, None]
        tree = cKDTree(surface)
        for _ in range(_STEPS):
            at = pose.apply(points)
            distance, nearest = tree.query(at, distance_upper_bound=reach)
            near = np.isfinite(distance)
            if near.sum() < _LEAST_POINTS:
                return None
            at, nearest = at[near], nearest[near]
            aim, raised = normal[nearest], ~ground[nearest]
            error = ((at - surface[nearest]) * aim).sum(axis=1) - offset * raised
            weight = 1.0 / (1.0 + (error / _SCALE_M) ** 2) ** 2
            arm = at - pose.translation
            jacobian = np.column_stack([np.cross(arm, aim), aim, -1.0 * raised])
            # One point's worth of belief in no offset: without anything raised it stays 0.
            normal_matrix = (jacobian * weight[:, None]).T @ jacobian
            normal_matrix[6, 6] += 1.0
            gradient = (jacobian * weight[:, None]).T @ error
            gradient[6] += offset
            if np.linalg.cond(normal_matrix) > 1e12:
                return None
            step = -np.linalg.solve(normal_matrix, gradient)
            pose = Pose(
                Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation,
                pose.translation + step[3:6],
            )
            offset += float(step[6])
            if np.abs(step[3:]).max() < 1e-4 and np.abs(step[:3]).max() < 1e-5:
                break
    pull = jacobian * (weight * error)[:, None]
    _, cluster = np.unique(np.floor(at / _ALIKE_M).astype(int), axis=0, return_inverse=True)
    together = np.zeros((cluster.max() + 1, 7))
    np.add.at(together, cluster.reshape(-1), pull)
    inverse = np.linalg.inv(normal_matrix)
    sigma = np.sqrt(np.diag(inverse @ (together.T @ together) @ inverse))
    return Registered(
        pose=pose,
        explained=_explained(points, pose, scene, near, raised, error),
        residual_m=float(np.median(np.abs(error))),
        surface_offset_m=offset,
        sigma_m=sigma[3:6],
        sigma_deg=np.degrees(sigma[:3]),
        points=int(near.sum()),
    )


def _explained(
    points: NDArray[np.float64],
    pose: Pose,
    scene: ScenePoints,
    near: NDArray[np.bool_],
    raised: NDArray[np.bool_],
    error: NDArray[np.float64],
) -> float:
    """Return the share of the points off the ground that lie on a surface off the ground."""
    at = pose.apply(points)
    height = at[:, 2] - scene.ground_at(at[:, :2])
    off = ~(height < 0.3)  # where nobody knows the ground, too
    on = np.zeros(len(points), np.bool_)
    on[near] = raised & (np.abs(error) < EXPLAINED_M)
    return float((on & off).sum() / max(off.sum(), 1))
