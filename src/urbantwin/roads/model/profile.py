"""Profiles along a road, such as its elevation: piecewise cubics, continuous in value and slope."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact.typed_document import Numbers, Quads

__all__ = ["Profile", "fitted"]

#: Candidate lengths of the cubics, from coarse to fine, metres.
STEPS_M = (1e9, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0)


@dataclass(frozen=True)
class Profile:
    """Piecewise cubic a + b ds + c ds^2 + d ds^3; ``start`` (K,) ascending, ``abcd`` (K, 4)."""

    start: Numbers
    abcd: Quads

    def at(self, s: ArrayLike) -> NDArray[np.float64]:
        """Return values (N,) at stations."""
        if self.constant_value is not None:
            return np.full(np.shape(s) or (1,), self.constant_value)
        ds, (a, b, c, d) = self._piece(s)
        return np.asarray(a + ds * (b + ds * (c + ds * d)))

    @cached_property
    def constant_value(self) -> float | None:
        """The value of a profile that is a single constant; else ``None``."""
        alone = len(self.start) == 1 and not self.abcd[0, 1:].any()
        return float(self.abcd[0, 0]) if alone else None

    def slope(self, s: ArrayLike) -> NDArray[np.float64]:
        """Return derivatives (N,) at stations."""
        ds, (_, b, c, d) = self._piece(s)
        return np.asarray(b + ds * (2 * c + 3 * ds * d))

    def _piece(self, s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        stations = np.atleast_1d(np.asarray(s, np.float64))
        if len(self.start) == 1:
            return stations - self.start[0], self.abcd[0]
        k = np.maximum(np.searchsorted(self.start, stations, side="right") - 1, 0)
        return stations - self.start[k], self.abcd[k].T

    @classmethod
    def constant(cls, value: float) -> Profile:
        """Return a constant profile."""
        return cls(np.zeros(1), np.array([[value, 0.0, 0.0, 0.0]]))

    @classmethod
    def ramp(cls, first: float, last: float, length: float) -> Profile:
        """Return a cubic from one value to another over ``length`` metres, level at both ends."""
        grow = (last - first) / max(length, 1e-9) ** 2
        return cls(np.zeros(1), np.array([[first, 0.0, 3 * grow, -2 * grow / max(length, 1e-9)]]))

    def between(self, first: float, last: float) -> Profile:
        """Return the profile from station ``first`` to ``last``, with stations that start at 0."""
        if len(self.start) == 1 and first == self.start[0] == 0.0:
            return self
        keep = [k for k, s in enumerate(self.start) if first + 1e-9 < s < last - 1e-9]
        k = max(int(np.searchsorted(self.start, first + 1e-9, side="right")) - 1, 0)
        h, (a, b, c, d) = first - float(self.start[k]), self.abcd[k]
        head = [a + h * (b + h * (c + h * d)), b + h * (2 * c + 3 * h * d), c + 3 * h * d, d]
        return Profile(
            np.concatenate([[0.0], self.start[keep] - first]), np.vstack([head, self.abcd[keep]])
        )

    @property
    def is_zero(self) -> bool:
        """Whether all coefficients are zero up to rounding."""
        return bool(np.abs(self.abcd).max(initial=0.0) < 1e-6)


def fitted(
    s: NDArray[np.float64],
    value: NDArray[np.float64],
    *,
    tolerance: float,
    slopes: tuple[float, float] | None = None,
) -> Profile:
    """Return the coarsest profile that stays within a tolerance of samples.

    Args:
        s: (N,) ascending stations, the first 0, metres.
        value: (N,) values there; the profile is exact at the first and the last.
        tolerance: largest difference at a sample.
        slopes: derivatives at the two ends; by default estimated from the samples.
    """
    length = float(s[-1])
    for step in STEPS_M:
        count = max(1, int(np.ceil(length / step)))
        knots = np.linspace(0.0, length, count + 1)
        reach = min(length / count / 2, 2.0)
        ahead, back = np.minimum(knots + reach, length), np.maximum(knots - reach, 0.0)
        slope = (np.interp(ahead, s, value) - np.interp(back, s, value)) / (ahead - back)
        if slopes is not None:
            slope[0], slope[-1] = slopes
        profile = _hermite(knots, np.interp(knots, s, value), slope)
        if np.abs(profile.at(s) - value).max() <= tolerance:
            break
    return profile


def _hermite(
    s: NDArray[np.float64], value: NDArray[np.float64], slope: NDArray[np.float64]
) -> Profile:
    """Return the piecewise cubic with given values and slopes (K,) at stations (K,)."""
    step = s[1:] - s[:-1]
    chord = (value[1:] - value[:-1]) / step
    bend = (slope[:-1] + slope[1:] - 2 * chord) / step
    rows = [value[:-1], slope[:-1], (chord - slope[:-1]) / step - bend, bend / step]
    return Profile(s[:-1], np.stack(rows, axis=1))
