"""How far a registered pose may be off, from what it was registered to.

Normal equations take the surface that a point was matched to for the one that it is of. Much of a
street does not hold a pose as they say: in a tree's crown, along a hedge or between two edges a
point finds another surface, as near, when the pose moves. So the curvature is measured: how the
pull on the pose changes when it is moved and all points are matched and weighted anew. Where little
of it is left, the errors of the scene move the pose so much farther (the sandwich estimator).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.fidelity.alignment.correspondences import EDGES, RAISED, Correspondences, Residuals
from urbantwin.geometry import Pose

__all__ = ["OFFSET_SIGMA_M", "equations", "pose_deviation", "sandwich", "turned_and_moved"]

#: Belief that nothing stands proud, and that edges are where curbs are: standard deviation, metres.
OFFSET_SIGMA_M = 0.3
#: How far the pose is moved to measure: in plan about as far as maps are wrong, up and by turns as
#: far as the ground tells; metres and radians.
_MOVED_M, _LIFTED_M, _TURNED, _TIPPED = 0.1, 0.05, 0.1 / 12.0, 0.05 / 20.0
#: Less of the curvature than this is not told from none.
_LEAST_LEFT = 0.05
#: What is wrong in the scene everywhere alike nobody sees: metres, and degrees.
_ALL_ALIKE_M, _ALL_ALIKE_DEG = 0.03, 0.1
#: Parts of the surroundings that are left out in turn, to see what hangs on each.
_SECTORS = 8


def equations(
    residuals: Residuals, offsets: NDArray[np.float64], pivot: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobian (P, 8), normal matrix (8, 8) and gradient (8,): turns, place, offsets."""
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
    """Return a pose after turns about the site's axes and a move (6,)."""
    turned = Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation
    return Pose(turned, pose.translation + step[3:6])


def pose_deviation(
    correspondences: Correspondences,
    pose: Pose,
    offsets: NDArray[np.float64],
    wrong: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the standard deviations (6,) of turns, radians, and place, metres.

    The larger of two: what the errors of the scene that were measured make likely, and what hangs
    on one part of the surroundings (jackknife).

    Args:
        correspondences: the frame against the scene.
        pose: ``site_SE3_frame``, where it came to rest.
        offsets: (2,) how far surfaces and edges are before the real ones.
        wrong: (5,) how far the scene is wrong, by kind, metres.
        scale: (5,) the distance at which a point counts a quarter, by kind, metres.
    """
    residuals = correspondences.residuals(pose, offsets, wrong, scale)
    jacobian, matrix, _ = equations(residuals, offsets, pose.translation)

    def pull(step: NDArray[np.float64]) -> NDArray[np.float64]:
        moved, other = turned_and_moved(pose, step), offsets + step[6:]
        found = correspondences.residuals(moved, other, wrong, scale)
        return equations(found, other, pose.translation)[2]

    lengths = np.array([_TIPPED, _TIPPED, _TURNED, _MOVED_M, _MOVED_M, _LIFTED_M, *[_MOVED_M] * 2])
    # Along axes that are held apart from each other. On a slope a turn about the vertical also tips
    # the ground, which holds it so stiffly that nothing would be left of what else does.
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
    """Return the variances (6,) of errors that scatter as the matrix says under a curvature.

    With curvature H and matrix M the covariance is H^-1 M H^-1. In the directions in which both are
    diagonal, H is a share of M: never more than all of it, as the noise of a measured curvature
    makes nothing surer.
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
    """Return the variances (6,) of turns and place by leaving out sectors in turn.

    One step from the solution with the correspondences as they are.
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
