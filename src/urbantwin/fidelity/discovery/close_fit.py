"""Fit of sensors to single points on their rings, ten times as accurate as to pieces of rings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.elevation_match import TableFit
from urbantwin.fidelity.discovery.point_rays import PointRays
from urbantwin.fidelity.discovery.unit_fit import Belief, Freedom, fit_unit

__all__ = ["closely_fitted"]

#: Maximum and minimum number of points per fitted sensor; tolerances from coarse to fine, degrees.
_ENOUGH, _FEWEST = 20_000, 500
_FINER_DEG = (0.1, 0.06, 0.03, 0.02, 0.012)
#: Neighbours on a ring with equal errors, which count as one independent observation.
_POINTS_PER_LOOK = 8.0
#: Prior of the elevations of a unit against its model's, and of its beam origin offsets.
_FREEDOM = Freedom(0.2, 0.05)
#: Minimum posterior probability that a fitted point is of the sensor.
_SURE = 0.8
#: Bounds of the standard deviation of elevations on a ring, degrees.
_LEAST_DEG, _MOST_DEG = 0.004, 0.03


def closely_fitted(
    fit: TableFit, number: int, frames: Sequence[NDArray[np.float64]], rays: Sequence[PointRays]
) -> tuple[TableFit, float]:
    """Return a sensor's fit to points on its rings, and their standard deviation, degrees.

    Elevations of single points of real sensors are constant along a ring to some thousandths of a
    degree. They determine position, tilt and every channel of the unit, with a weak prior from its
    model.

    Args:
        fit: fit to pieces of rings.
        number: index of the sensor in ``rays``.
        frames: (N, 3) points of each frame.
        rays: sensor and ring of the points of each frame.
    """
    mine = [(one.sensor == number) & (one.sure > _SURE) for one in rays]
    points = np.concatenate([p[rows] for p, rows in zip(frames, mine, strict=True)])
    if len(points) < _FEWEST:
        return fit, _MOST_DEG
    points = points[:: -(-len(points) // _ENOUGH)]
    weight = np.full(len(points), 1 / _POINTS_PER_LOOK)
    nothing = Belief(fit.seen_from, np.eye(5) * 1e-6)
    start = fit.seen_from, fit.unit
    seen_from, unit, covariance = fit_unit(points, weight, start, nothing, _FREEDOM, _FINER_DEG)
    off = np.abs(unit.sees(points, seen_from).off_deg)
    spread = float(np.clip(1.4826 * np.median(off), _LEAST_DEG, _MOST_DEG))
    return replace(fit, seen_from=seen_from, unit=unit, covariance=covariance), spread
