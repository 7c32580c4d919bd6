"""Smoothing of a line drawn point by point, with as little bending as its points allow."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry.polyline import stations_of_points

__all__ = ["resampled", "smoothed", "tightest_bend"]

#: Weights of bending against distance, in ascending order (metres to the fourth).
WEIGHTS = 10.0 ** np.arange(-2.0, 5.1, 0.25)


def resampled(points: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Return points (M, 2), at least four, evenly spaced about ``step_m`` apart on a line."""
    along = stations_of_points(points)
    stations = np.linspace(0.0, along[-1], max(4, round(along[-1] / step_m) + 1))
    return np.column_stack([np.interp(stations, along, axis) for axis in points.T])


def smoothed(
    points: NDArray[np.float64],
    within_m: float,
    *,
    headings: tuple[float, float] | None = None,
    radius_m: float = np.inf,
    step_m: float = 1.0,
) -> NDArray[np.float64]:
    """Return a smooth line close to a drawn line, with the same ends.

    Candidates minimise the sum of squared distances from the drawn line and a multiple of the
    squared curvature (a discrete smoothing spline; Reinsch, "Smoothing by spline functions", 1967).
    The result is the closest candidate with a sufficient radius, otherwise the smoothest one that
    is close enough.

    Args:
        points: the drawn line (N, 2), N >= 2, without duplicate consecutive points.
        within_m: maximum distance from the drawn line; if no candidate is within it, the closest
            one is returned.
        headings: radians, at its start and at its end; free if not given.
        radius_m: the sufficient radius; without it the smoothest line is returned.
        step_m: approximate distance between its points.
    """
    line = shapely.LineString(points)
    drawn = resampled(points, step_m)
    count = len(drawn)
    step = float(line.length) / (count - 1)
    bending = np.diff(np.eye(count), 2, axis=0) / step**2
    bending = bending.T @ bending
    held, places = np.array([0, count - 1]), drawn[[0, -1]]
    if headings is not None and count > 4:
        ahead = np.column_stack([np.cos(headings), np.sin(headings)]) * step
        held = np.array([0, count - 1, 1, count - 2])
        places = np.vstack([places, places[0] + ahead[0], places[1] - ahead[1]])
    free = np.setdiff1d(np.arange(count), held)
    found: NDArray[np.float64] | None = None
    for weight in WEIGHTS:
        calm = drawn.copy()
        calm[held] = places
        matrix = np.eye(len(free)) + weight * bending[np.ix_(free, free)]
        calm[free] = np.linalg.solve(
            matrix, drawn[free] - weight * bending[np.ix_(free, held)] @ places
        )
        off = shapely.distance(line, shapely.points(calm[free])).max()
        if found is not None and off > within_m:
            break
        found = calm
        if tightest_bend(calm)[0] >= radius_m:
            break
    assert found is not None
    return found


def tightest_bend(points: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the smallest radius of a line of many points (N, 2), metres, and its point (2,)."""
    leg = np.diff(points, axis=0)
    length = np.linalg.norm(leg, axis=1)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))))
    radius = (length[1:] + length[:-1]) / 2 / np.maximum(turn, 1e-9)
    k = int(radius.argmin())
    return float(radius[k]), points[k + 1]
