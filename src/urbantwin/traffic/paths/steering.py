"""Headings: vehicles roll without slipping to the side, people face where they go."""

from __future__ import annotations

from math import atan, exp, pi, tan

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

__all__ = ["faced", "steered"]

_FACING_S = 0.5  # people turn towards where they go within so long
_STANDING_MS = 0.02
_WALKING_MS = 0.5  # slower than this they do not turn


def steered(
    xy: NDArray[np.float64], yaw: NDArray[np.float64], rear_m: float
) -> NDArray[np.float64]:
    """Return the headings (N,) of a vehicle whose middle takes a path: its rear axle follows.

    The rear axle moves along the heading (the bicycle model; Rajamani, Vehicle Dynamics and
    Control, 2012, section 2.2), so the heading is the tractrix's of the path: on a straight piece
    tan(d / 2) falls off with exp(-s / rear_m), d being the angle from the heading to the path.
    Who stands keeps the heading. In a steady curve of radius R the heading is behind the middle's
    course by asin(rear_m / R).

    Args:
        xy: (N, 2) middle of the vehicle, m.
        yaw: (N,) heading, of which the first counts, rad.
        rear_m: how far behind the middle the rear axle is.
    """
    if rear_m <= 0 or len(yaw) < 2:
        return yaw.copy()
    moved = np.diff(xy, axis=0)
    way, course = np.hypot(*moved.T).tolist(), np.arctan2(moved[:, 1], moved[:, 0]).tolist()
    heading = [float(yaw[0])]
    for length, towards in zip(way, course, strict=True):
        off = (towards - heading[-1] + pi) % (2 * pi) - pi
        left = 2 * atan(tan(off / 2) * exp(-length / rear_m))
        heading.append(heading[-1] + off - left)
    return np.array(heading)


def faced(
    xy: NDArray[np.float64],
    before: NDArray[np.float64],
    yaw: NDArray[np.float64],
    speed: NDArray[np.float64],
    step_s: float,
) -> NDArray[np.float64]:
    """Return the headings (N,) of a person whose path was changed; who stands does not turn.

    Args:
        xy: (N, 2) the path, m.
        before: (N, 2) the path before, on which it faced where ``yaw`` says.
        yaw: (N,) rad.
        speed: (N,) m/s.
        step_s: time between samples.
    """
    if len(yaw) < 3 or not (xy != before).any():
        return yaw
    steps = max(round(_FACING_S / step_s), 1)
    velocity = [
        uniform_filter1d(np.gradient(path, step_s, axis=0), steps, axis=0, mode="nearest")
        for path in (xy, before)
    ]
    new, old = (one[:, 0] + 1j * one[:, 1] for one in velocity)
    sure = np.minimum(np.minimum(np.abs(new), np.abs(old)) / _WALKING_MS, 1.0) ** 2
    turn = sure * np.angle(new * np.conj(old))
    row = np.arange(len(turn))
    turn = turn[np.maximum.accumulate(np.where(speed > _STANDING_MS, row, 0))]
    return np.asarray(yaw + turn)
