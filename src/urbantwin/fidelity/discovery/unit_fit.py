"""Fit of a sensor's pose and its unit's channels to the elevations of its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.standpoint import Standpoint, across
from urbantwin.fidelity.discovery.unit import Unit

__all__ = ["Belief", "Freedom", "fit_unit"]

#: Gauss-Newton steps with each tolerance.
_TIMES = 4


@dataclass(frozen=True, eq=False)
class Belief:
    """The prior of a pose: a normal distribution.

    Attributes:
        seen_from: its mean.
        information: (5, 5) inverse covariance of the steps of `Standpoint.moved` from there.
    """

    seen_from: Standpoint
    information: NDArray[np.float64]

    def slope(self, at: Standpoint) -> NDArray[np.float64]:
        """Return the gradient (5,) of the negative logarithm of the prior."""
        first, second = across(self.seen_from.axis)
        turned = at.axis - self.seen_from.axis
        moved = [*(at.place - self.seen_from.place), turned @ first, turned @ second]
        return np.asarray(self.information @ np.array(moved))


@dataclass(frozen=True)
class Freedom:
    """Prior standard deviations of a unit's differences from its table.

    Attributes:
        offset_deg: of a channel's elevation.
        origin_offset_m: of a beam origin offset; 0: all beams start at the sensor's position.
    """

    offset_deg: float
    origin_offset_m: float = 0.0


def fit_unit(
    points: NDArray[np.float64],
    weight: NDArray[np.float64],
    start: tuple[Standpoint, Unit],
    belief: Belief,
    freedom: Freedom,
    finer_deg: Sequence[float],
) -> tuple[Standpoint, Unit, NDArray[np.float64]]:
    """Return the pose and the unit with the smallest elevation residuals of points.

    Robust least squares with decreasing tolerance: larger residuals lose their weight.

    Args:
        points: (N, 3) metres.
        weight: (N,) weight of each point, in independent observations.
        start: start of the search.
        belief: the prior of the pose.
        freedom: the prior of the unit.
        finer_deg: tolerances, from coarse to fine.

    Returns:
        Pose, unit, and the covariance (5, 5) of the steps of `Standpoint.moved`.
    """
    seen_from, unit = start
    for spread in finer_deg:
        for _ in range(_TIMES):
            step, normal = _step(points, weight, seen_from, unit, belief, freedom, spread)
            count = len(unit.table_deg)
            seen_from = seen_from.moved(step[:5])
            aside = (
                unit.origin_offset_m + step[5 + count :]
                if freedom.origin_offset_m
                else unit.origin_offset_m
            )
            unit = replace(
                unit, offset_deg=unit.offset_deg + step[5 : 5 + count], origin_offset_m=aside
            )
    covariance = np.linalg.inv(normal)[:5, :5].astype(np.float64)
    return seen_from, unit, covariance


def _step(
    points: NDArray[np.float64],
    weight: NDArray[np.float64],
    seen_from: Standpoint,
    unit: Unit,
    belief: Belief,
    freedom: Freedom,
    spread: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a Gauss-Newton step of pose and both offsets (5 + C + C,), and its normal matrix."""
    on = unit.sees(points, seen_from)
    far = np.maximum(on.far, 0.1)
    sight = (points - seen_from.place) / far[:, None]
    sine = np.clip(sight @ seen_from.axis, -0.9999, 0.9999)
    first, second = across(seen_from.axis)
    by_place = -(seen_from.axis - sine[:, None] * sight) / far[:, None]
    jacobian = np.column_stack([by_place, sight @ first, sight @ second])
    jacobian = np.degrees(jacobian / np.sqrt(1 - sine**2)[:, None])
    each = weight * np.exp(-0.5 * (on.off_deg / spread) ** 2) / spread**2
    count = len(unit.table_deg)
    size = 5 + count * (2 if freedom.origin_offset_m else 1)
    normal, slope = np.zeros((size, size)), np.zeros(size)
    normal[:5, :5] = jacobian.T @ (jacobian * each[:, None]) + belief.information
    slope[:5] = jacobian.T @ (each * on.off_deg) + belief.slope(seen_from)
    # Derivatives by the channel's elevation, and by its beam origin offset.
    by_channel = [np.ones(len(points)), np.degrees(1 / far)]
    beliefs = [
        (unit.offset_deg, freedom.offset_deg),
        (unit.origin_offset_m, freedom.origin_offset_m),
    ]
    parts = range(2 if freedom.origin_offset_m else 1)
    for one in parts:
        rows = np.arange(5 + one * count, 5 + (one + 1) * count)
        value, known = beliefs[one]
        for column in range(5):
            mixed = each * jacobian[:, column] * by_channel[one]
            normal[rows, column] = -np.bincount(on.channel, mixed, minlength=count)
            normal[column, rows] = normal[rows, column]
        for other in parts:
            both = each * by_channel[one] * by_channel[other]
            columns = np.arange(5 + other * count, 5 + (other + 1) * count)
            normal[rows, columns] = np.bincount(on.channel, both, minlength=count)
        normal[rows, rows] += known**-2
        pulled = each * on.off_deg * by_channel[one]
        slope[rows] = -np.bincount(on.channel, pulled, minlength=count) + value / known**2
    step = -np.linalg.solve(normal, slope)
    return step.astype(np.float64), normal
