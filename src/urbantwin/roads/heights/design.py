"""Design profiles of streets: smoothing splines through the ground, within design limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from urbantwin.roads.heights.cross_fall import Limits
from urbantwin.roads.heights.stations import Stations

__all__ = ["Pins", "design_profiles", "profile_slopes", "smoothed"]

#: Smoothing lengths, tried in order until the limits are met, metres.
SMOOTHING_LENGTHS_M = (6.0, 12.0, 25.0, 50.0)
#: Amount by which a street may be steeper than the steepest ground along it.
GRADE_TOLERANCE = 0.005
#: Weight of pinned values relative to a sample.
PINNED = 1e7


@dataclass(frozen=True)
class Pins:
    """Boundary conditions of roads at their starts (row 0) and ends (row 1).

    Attributes:
        pinned: (2, R) whether an end is pinned.
        value: (2, R) value there.
        slope: (2, R) derivative along the road.
    """

    pinned: NDArray[np.bool_]
    value: NDArray[np.float64]
    slope: NDArray[np.float64]


def smoothed(
    stations: Stations, value: NDArray[np.float64], pins: Pins, length: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the smoothing splines of samples (M,) along many roads.

    Each minimises sum (z - value)^2 + length^4 sum z''^2 (Whittaker 1923; Reinsch 1967) under its
    boundary conditions. Waves much shorter than ``2 pi length`` are removed.

    Args:
        stations: stations of the samples, evenly spaced on each road.
        value: (M,) samples.
        pins: boundary conditions.
        length: (R,) smoothing length of each road, metres.
    """
    count = len(value)
    ends = stations.edges()
    step = _steps(stations)[stations.road]
    stiff = (length[stations.road] / step) ** 4
    bands = np.zeros((3, count))  # upper form: row 2 the diagonal, row 0 two off it
    bands[2] = 1.0
    right = value.astype(np.float64).copy()
    inner = np.ones(count, bool)
    inner[ends[0]] = inner[ends[1]] = False
    k = np.flatnonzero(inner)
    weight = stiff[k]
    for shift, factor in ((-1, 1.0), (0, -2.0), (1, 1.0)):
        bands[2, k + shift] += weight * factor * factor
    bands[1, k] += weight * -2.0
    bands[1, k + 1] += weight * -2.0
    bands[0, k + 1] += weight
    for side, inwards in ((0, 1), (1, -1)):
        pinned = ends[side][pins.pinned[side]]
        bands[2, pinned] += PINNED
        right[pinned] += PINNED * pins.value[side][pins.pinned[side]]
        # The slope, by a mirrored neighbour beyond the end: (z1 - z0) = step x slope.
        rise = inwards * step[pinned] * pins.slope[side][pins.pinned[side]]
        weight = 2.0 * stiff[pinned]
        bands[2, pinned] += weight
        bands[2, pinned + inwards] += weight
        bands[1, np.maximum(pinned, pinned + inwards)] -= weight
        right[pinned] -= weight * rise
        right[pinned + inwards] += weight * rise
    z = np.asarray(solveh_banded(bands, right, check_finite=False))
    for side in (0, 1):
        z[ends[side][pins.pinned[side]]] = pins.value[side][pins.pinned[side]]
    return z


def design_profiles(
    stations: Stations,
    ground: NDArray[np.float64],
    pins: Pins,
    limits: list[Limits],
    earthwork: float,
) -> NDArray[np.float64]:
    """Return the heights (M,) of streets' profiles, metres.

    Each is that of the ground with as little smoothing as its class requires. The first of
    ``SMOOTHING_LENGTHS_M`` with grade and vertical curvature within the limits is used, else the
    one that exceeds them least. The distance from the ground stays below ``earthwork``, and no
    grade exceeds the steepest ground along the street by more than ``GRADE_TOLERANCE``.

    Args:
        stations: stations of the ground's samples.
        ground: (M,) heights of the ground along the streets, metres.
        pins: heights and grades at junctions.
        limits: limits of each street.
        earthwork: maximum cut or fill, metres.
    """
    step = _steps(stations)
    grade, crest, sag = (
        np.array([getattr(limit, name) for limit in limits]) for name in ("grade", "crest", "sag")
    )
    best = ground.astype(np.float64).copy()
    least = np.full(len(step), np.inf)
    for length in SMOOTHING_LENGTHS_M:
        z = smoothed(stations, ground, pins, np.full(len(step), length))
        rise, bend = _differences(stations, z)
        beyond = np.maximum.reduce(
            [
                _largest(stations, np.abs(rise)) / grade,
                _largest(stations, -bend) / crest,
                _largest(stations, bend) / sag,
            ]
        )
        # Only if it is a clear improvement: where the ground itself is too steep, smoothing does
        # not help.
        better = (least > 1.0) & (beyond < 0.98 * least)
        better &= _largest(stations, np.abs(z - ground)) < earthwork
        best = np.where(better[stations.road], z, best)
        least = np.where(better, beyond, least)
        if (least <= 1.0).all():
            break
    return _no_steeper(stations, best, ground)


def _no_steeper(
    stations: Stations, z: NDArray[np.float64], ground: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return profiles moved towards the ground until no grade exceeds that of the ground."""
    grade, base = _differences(stations, z)[0], _differences(stations, ground)[0]
    bound = _largest(stations, np.abs(base))[stations.road] + GRADE_TOLERANCE
    share = np.where(
        np.abs(grade) > bound, (bound - np.abs(base)) / np.maximum(np.abs(grade - base), 1e-12), 1.0
    )
    part = np.minimum.reduceat(share, stations.first[:-1]) if len(share) else share
    part = np.clip(part, 0.0, 1.0)[stations.road]
    return np.asarray(part * z + (1.0 - part) * ground)


def profile_slopes(stations: Stations, z: NDArray[np.float64], pins: Pins) -> NDArray[np.float64]:
    """Return derivatives (M,) of samples along roads; at ends, pinned or one-sided."""
    step = _steps(stations)[stations.road]
    slope = np.zeros(len(z))
    slope[1:-1] = z[2:] - z[:-2]
    slope /= 2.0 * step
    for side, inwards in ((0, 1), (1, -1)):
        end = stations.edges()[side]
        first, second = z[end + inwards], z[end + 2 * inwards]
        slope[end] = inwards * (-3.0 * z[end] + 4.0 * first - second) / (2.0 * step[end])
        held = pins.pinned[side]
        slope[end[held]] = pins.slope[side][held]
    return slope


def _steps(stations: Stations) -> NDArray[np.float64]:
    """Return the spacing (R,) of each road's stations, metres."""
    return np.asarray(stations.s[stations.first[:-1] + 1])


def _differences(
    stations: Stations, z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return grade (M,) to the next station and curvature (M,), 0 where undefined."""
    step = _steps(stations)[stations.road]
    rise, bend = np.zeros(len(z)), np.zeros(len(z))
    rise[:-1] = np.diff(z) / step[:-1]
    rise[stations.edges()[1]] = 0.0
    bend[1:-1] = (z[2:] - 2.0 * z[1:-1] + z[:-2]) / step[1:-1] ** 2
    for end in stations.edges():
        bend[end] = 0.0
    return rise, bend


def _largest(stations: Stations, value: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.maximum.reduceat(value, stations.first[:-1]))
