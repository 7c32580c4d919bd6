"""Hermite profiles through values and slopes at the stations of many roads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.heights.stations import Stations
from urbantwin.roads.model import Profile

__all__ = ["hermite_profiles"]

#: Decimals of metres, and of metres per metre, that are kept.
DIGITS = 9
#: Pieces that bend less than this are straight, 1/m.
STRAIGHT = 1e-8


def hermite_profiles(
    stations: Stations, value: NDArray[np.float64], slope: NDArray[np.float64]
) -> list[Profile]:
    """Return a profile a road, with the values (M,) and slopes (M,) at its stations.

    Straight lines are one piece, however long.
    """
    # The solvers' rounding noise is removed.
    value, slope = np.round(value, DIGITS) + 0.0, np.round(slope, DIGITS) + 0.0
    inner = np.ones(len(value) - 1, bool)
    inner[stations.edges()[1][:-1]] = False
    step = np.where(inner, np.diff(stations.s), 1.0)
    rise = np.diff(value)
    c = (3.0 * rise - step * (2.0 * slope[:-1] + slope[1:])) / step**2
    d = (step * (slope[:-1] + slope[1:]) - 2.0 * rise) / step**3
    abcd = np.column_stack([value[:-1], slope[:-1], c, d])
    # A piece that only goes on with the straight line before it is left out.
    line = np.abs(abcd[:, 2:] * [1.0, 10.0]).max(axis=1) < STRAIGHT
    goes_on = np.zeros(len(abcd), bool)
    goes_on[1:] = line[1:] & line[:-1] & (np.abs(np.diff(abcd[:, 1])) < STRAIGHT)
    goes_on[stations.first[:-1]] = False
    found = []
    for k in range(len(stations.roads)):
        part = slice(int(stations.first[k]), int(stations.first[k + 1]) - 1)
        keep = ~goes_on[part]
        found.append(Profile(stations.s[part][keep], abcd[part][keep]))
    return found
