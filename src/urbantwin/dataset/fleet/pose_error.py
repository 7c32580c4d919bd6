"""Errors of reported poses: a bias, a drift, noise and a random walk, along the node's own axes.

Positioning fails in these ways: an antenna that was measured wrongly or a map that is shifted
(bias), a gyroscope that runs away (drift), the noise of satellite fixes, and dead reckoning, which
integrates white noise to a random walk (Groves 2013, Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems, 2nd ed., ch. 4 and 14).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.fleet.draws import Purpose, normal_draws
from urbantwin.geometry import Pose
from urbantwin.site.nodes import PoseErrorSpec, PoseOffset, PoseSpread

__all__ = ["pose_errors", "reported_pose"]


def pose_errors(
    spec: PoseErrorSpec, seed: int, numbers: Sequence[int], rate_hz: float
) -> NDArray[np.float64]:
    """Return the errors (F, 6) of a node in frames: forward, left, up in metres, yaw, pitch, roll.

    Angles are in radians. A frame's error depends on its number, not on which others there are.

    Args:
        spec: how wrong the poses are.
        seed: of the node.
        numbers: of the frames, from 0; frame n is at ``n / rate_hz`` seconds.
        rate_hz: frames per second.
    """
    index = np.asarray(numbers, np.int64)
    time_s = index[:, None] / rate_hz
    error = _vector(spec.bias) + _vector(spec.drift) * time_s
    if not len(index):
        return error
    count = int(index.max()) + 1
    noise, walk = _vector(spec.noise), _vector(spec.walk)
    if noise.any():
        error = error + normal_draws(seed, Purpose.NOISE, count)[index, :6] * noise
    if walk.any():
        steps = normal_draws(seed, Purpose.WALK, count)[:, :6]
        steps[0] = 0.0  # it begins at the motion's start
        error = error + np.cumsum(steps, axis=0)[index] * walk / np.sqrt(rate_hz)
    return error


def reported_pose(site_SE3_node: Pose, error: NDArray[np.float64]) -> Pose:
    """Return the pose that a node reports.

    Args:
        site_SE3_node: where it is.
        error: (6,) a row of `pose_errors`.
    """
    yaw, pitch, roll = (float(one) for one in error[3:])
    return site_SE3_node @ Pose.from_ypr(error[:3], yaw, pitch, roll)


def _vector(spec: PoseOffset | PoseSpread) -> NDArray[np.float64]:
    angles = np.radians([spec.yaw_deg, spec.pitch_deg, spec.roll_deg])
    return np.array([spec.forward_m, spec.left_m, spec.up_m, *angles])
