"""Reference lines: smooth curves along polylines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from urbantwin.geometry import stations_of_points, wrapped
from urbantwin.roads.lanelet2.border import Border, Measured
from urbantwin.roads.model import Curve, Piece, splined

__all__ = ["Followed", "Pose", "curve_through", "smooth_curve", "trimmed"]

#: x, y, heading.
Pose = tuple[float, float, float]

#: Wavelengths below which bends are smoothed, metres; the first without folded lanes is used.
WAVELENGTHS_M = (10.0, 5.0, 14.0, 20.0, 28.0, 40.0)
STEP_M = 0.5
MOST_POINTS = 4000
#: Maximum deviation of a curve that is written as a line, metres and radians.
STRAIGHT_M, STRAIGHT_RAD = 1e-3, 5e-5
#: Minimum ratio of a border's length on the inside of a bend to that of the reference line.
LEAST_SHARE = 0.12


@dataclass(frozen=True)
class Followed:
    """A reference line and the borders beside it.

    Attributes:
        curve: the line.
        borders: the borders, measured from it.
        room: minimum ratio of their length to its length in bends; below ``LEAST_SHARE`` this is
            the best of the curves, all of which have folds.
    """

    curve: Curve
    borders: tuple[Measured, ...]
    room: float


def smooth_curve(
    line: NDArray[np.float64], beside: Sequence[Border], pins: tuple[Pose, Pose]
) -> Followed:
    """Return a smooth curve along a polyline without folds of the lanes beside it.

    Points every half metre minimise the squared distance to the polyline plus the weighted squared
    third derivative. The weight halves bends of a given wavelength (a smoothing spline: Reinsch
    1967). The bounds themselves are not smoothed: they are measured from this curve.

    Args:
        line: (N, 2) the polyline.
        beside: borders of lanes, which must not turn back along the curve.
        pins: exact poses of the start and the end.
    """
    best: Followed | None = None
    for wavelength in WAVELENGTHS_M:
        curve = curve_through(_fit(line, wavelength, pins), pins[0][2], pins[1][2])
        borders = tuple(border.along(curve) for border in beside)
        followed = Followed(curve, borders, min(border.room for border in borders))
        if best is None or followed.room > best.room:
            best = followed
        if followed.room >= LEAST_SHARE:
            break
    assert best is not None
    return best


def curve_through(points: NDArray[np.float64], first: float, last: float) -> Curve:
    """Return a curve through points with given end headings; a line if it is straight."""
    chord = points[-1] - points[0]
    length = float(np.hypot(*chord))
    heading = math.atan2(chord[1], chord[0])
    deviation_m = (points - points[0]) @ np.array([-chord[1], chord[0]]) / max(length, 1e-9)
    turn = max(abs(wrapped(h - heading)) for h in (first, last))
    if np.abs(deviation_m).max() < STRAIGHT_M and turn < STRAIGHT_RAD:
        return Curve((Piece(float(points[0, 0]), float(points[0, 1]), heading, length),))
    return splined(points, first, last)


def trimmed(curve: Curve, first: float, last: float) -> Curve:
    """Return the part of a curve between two stations, with the same poses at its ends."""
    count = max(4, math.ceil((last - first) / STEP_M) + 1)
    pose = curve.at(np.linspace(first, last, count))
    return curve_through(pose[:, :2], float(pose[0, 2]), float(pose[-1, 2]))


def _fit(
    line: NDArray[np.float64], wavelength: float, pins: tuple[Pose, Pose]
) -> NDArray[np.float64]:
    along = stations_of_points(line)
    length = float(along[-1])
    count = int(np.clip(math.ceil(length / STEP_M) + 1, 9, MOST_POINTS))
    step = length / (count - 1)
    grid_s = np.linspace(0.0, length, count)
    target = np.column_stack([np.interp(grid_s, along, line[:, k]) for k in (0, 1)])
    weight = np.ones(count)
    for pose, rows, sign in ((pins[0], [0, 1], step), (pins[1], [-1, -2], -step)):
        ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
        target[rows] = pose[:2], pose[:2] + sign * ahead
        weight[rows] = 1e6
    third = sp.diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(count - 3, count)) / step**3
    stiff = (wavelength / (2 * math.pi)) ** 6
    matrix = (sp.diags(weight) + stiff * third.T @ third).tocsc()
    points = np.asarray(spsolve(matrix, weight[:, None] * target))
    points[0], points[-1] = pins[0][:2], pins[1][:2]
    return points
