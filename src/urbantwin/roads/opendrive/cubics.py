"""Arithmetic of profiles: sums, minima, conversion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import Profile

__all__ = ["about", "added", "lowest", "stepped", "value"]


def about(profile: Profile, s: float) -> NDArray[np.float64]:
    """Return the coefficients (4,) of the cubic that begins at or before a station, about it."""
    k = max(0, int(np.searchsorted(profile.start, s + 1e-9, side="right")) - 1)
    a, b, c, d = profile.abcd[k]
    x = s - profile.start[k]
    return np.array([a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * d * x), c + 3 * d * x, d])


def added(terms: Sequence[tuple[float, Profile]], length: float) -> Profile:
    """Return the weighted sum of profiles over a length, metres."""
    knots = {0.0, *(float(s) for _, p in terms for s in p.start if 1e-9 < s < length - 1e-9)}
    starts = sorted(knots)
    rows = [sum((f * about(p, s) for f, p in terms), np.zeros(4)) for s in starts]
    return Profile(np.array(starts), np.array(rows))


def lowest(profile: Profile, length: float) -> tuple[float, float]:
    """Return the minimum of a profile from 0 to a length, and its station."""
    ends = np.append(profile.start[1:], np.inf)
    ends = np.minimum(ends, length)
    start = np.maximum(profile.start, 0.0)
    _, b, c, d = profile.abcd.T
    # Roots of the derivative b + 2 c x + 3 d x^2, if any.
    root = np.sqrt(np.maximum(c * c - 3 * b * d, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = [(-c + root) / (3 * d), (-c - root) / (3 * d), -b / (2 * c)]
    places = [start, ends - 1e-12, *(start + np.nan_to_num(x, posinf=0, neginf=0) for x in turns)]
    best = (np.inf, 0.0)
    inside = start <= ends
    for s in places:
        stations = np.clip(s, start, np.maximum(ends, start))[inside]
        x = stations - profile.start[inside]
        value = (profile.abcd[inside] * x[:, None] ** np.arange(4)).sum(axis=1)
        if len(value) and value.min() < best[0]:
            k = int(value.argmin())
            best = (float(value[k]), float(stations[k]))
    return best


def stepped(stations: Iterable[float], values: Iterable[float]) -> Profile:
    """Return a piecewise linear profile through values at ascending stations."""
    s, v = np.array(list(stations), np.float64), np.array(list(values), np.float64)
    slope = np.append(np.diff(v) / np.maximum(np.diff(s), 1e-9), 0.0)
    zero = np.zeros(len(s))
    return Profile(s, np.column_stack([v, slope, zero, zero]))


def value(profile: Profile, s: float) -> float:
    """Return the value of a profile at one station; faster than ``Profile.at``."""
    k = (
        max(0, int(profile.start.searchsorted(s, side="right")) - 1)
        if len(profile.start) > 1
        else 0
    )
    a, b, c, d = profile.abcd[k].tolist()
    x = s - float(profile.start[k])
    return float(a + x * (b + x * (c + x * d)))
