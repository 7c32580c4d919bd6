"""Headings: vehicles roll without slipping to the side."""

from __future__ import annotations

from math import atan, exp, pi, tan

import numpy as np
from numpy.typing import NDArray

__all__ = ["steered"]


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
