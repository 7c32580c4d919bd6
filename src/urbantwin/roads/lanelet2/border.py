"""Borders of lanes: mapped polylines, measured from a reference line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import Curve, Profile

__all__ = ["Border", "Measured", "profile_of", "stations_between"]

#: Tolerance of the fit of widths and offsets, metres; errors of adjacent lanes add up.
TOLERANCE_M = 5e-4
#: Minimum distance of stations, metres.
SAME_M = 1e-3
#: Spacing of the search for a corner's station, metres, and its range behind the previous corner
#: and ahead of the expected station.
SAMPLE_M, BACK_M, AHEAD_M = 0.25, 3.0, 10.0


@dataclass(frozen=True)
class Border:
    """A polyline (N, 3) along a road."""

    points: NDArray[np.float64]

    def along(self, curve: Curve) -> Measured:
        """Return the border in stations of a curve; points where it turns back are dropped."""
        s = _stations(curve, self.points[:, :2])
        keep = [0]
        for k in range(1, len(s)):
            if s[k] > s[keep[-1]] + 1e-6:
                keep.append(k)
        if len(keep) == 1:
            # It has no extent along the curve: a step of a millimetre replaces it.
            far = len(s) - 1
            return Measured(
                curve, self.points[[0, far]], np.array([s[0], s[0] + SAME_M]), len(s) - 2
            )
        return Measured(curve, self.points[keep], s[keep], len(s) - len(keep))


@dataclass(frozen=True)
class Measured:
    """A border measured from a curve.

    Attributes:
        curve: the reference line.
        points: (N, 3) its corners, site frame.
        s: (N,) stations of the corners, ascending, metres.
        dropped: number of corners dropped because the border turns back there.
    """

    curve: Curve
    points: NDArray[np.float64]
    s: NDArray[np.float64]
    dropped: int

    def at(self, s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return offset to the left and height (M,), (M,) at stations, metres.

        Before its start and beyond its end the border keeps its offset.
        """
        s = np.clip(s, self.s[0], self.s[-1])
        pose = self.curve.at(s)
        beyond_m = s - np.clip(s, 0.0, self.curve.length)
        c, sn = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        a, b = self.points[k], self.points[k + 1]
        leg, gap = b - a, a[:, :2] - pose[:, :2] - beyond_m[:, None] * np.column_stack([c, sn])
        forward = leg[:, 0] * c + leg[:, 1] * sn
        share = -(gap[:, 0] * c + gap[:, 1] * sn) / np.where(np.abs(forward) < 1e-9, 1e-9, forward)
        # Rounding of stations must not move a point far along a line across the road.
        place = a + np.clip(share, 0.0, 1.0)[:, None] * leg
        off = place[:, :2] - pose[:, :2]
        return off[:, 1] * c - off[:, 0] * sn, place[:, 2]

    @property
    def room(self) -> float:
        """Minimum ratio of the border's length to the curve's length in bends.

        Negative where the border would fold or turn back.
        """
        s = np.linspace(0.0, self.curve.length, max(8, int(self.curve.length / 0.5) + 2))
        turn = np.gradient(np.unwrap(self.curve.at(s)[:, 2]), s)
        return float(np.min(1.0 - turn * self.at(s)[0])) - 10.0 * self.dropped

    def window(self, first: float, last: float) -> Border:
        """Return the part between two stations, with one more corner on either side."""
        a = max(int(np.searchsorted(self.s, first)) - 1, 0)
        b = min(int(np.searchsorted(self.s, last, side="right")) + 1, len(self.s))
        a, b = min(a, len(self.s) - 2), max(b, min(a, len(self.s) - 2) + 2)
        return Border(self.points[a:b])

    def beyond(self, s: float) -> NDArray[np.float64]:
        """Return the corners (N, 3) beyond a station, the nearest first."""
        return self.points[self.s > s + SAME_M]

    def before(self, s: float) -> NDArray[np.float64]:
        """Return the corners (N, 3) before a station, the nearest first."""
        return self.points[self.s < s - SAME_M][::-1]


def _stations(curve: Curve, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the stations (N,) of a polyline's corners, determined one after the other.

    A curve may come back to the same place (a loop, a ring): each corner is searched ahead of the
    previous one, the first one as early as possible. Corners before the start or beyond the end are
    measured on the straight continuation.
    """
    grid = np.linspace(0.0, curve.length, max(3, int(curve.length / SAMPLE_M) + 2))
    poses = curve.at(grid)
    samples, bend = poses[:, :2], np.gradient(np.unwrap(poses[:, 2]), grid)
    s = np.empty(len(points))
    distance_m = np.linalg.norm(samples - points[0], axis=1)
    s[0] = grid[np.argmax(distance_m <= distance_m.min() + 0.5)]
    for k in range(1, len(points)):
        leap = float(np.linalg.norm(points[k] - points[k - 1]))
        a = np.searchsorted(grid, s[k - 1] - BACK_M)
        b = np.searchsorted(grid, s[k - 1] + 2.0 * leap + AHEAD_M)
        a = min(int(a), len(grid) - 2)
        window = np.linalg.norm(samples[a : max(int(b), a + 2)] - points[k], axis=1)
        s[k] = grid[a + int(np.argmin(window))]
    for _ in range(20):
        pose = curve.at(s)
        beyond_m = s - np.clip(s, 0.0, curve.length)
        c, sn = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        gap = points - pose[:, :2] - beyond_m[:, None] * np.column_stack([c, sn])
        t = gap[:, 1] * c - gap[:, 0] * sn
        turn = np.where(beyond_m == 0.0, np.interp(s, grid, bend), 0.0)
        step = (gap[:, 0] * c + gap[:, 1] * sn) / np.maximum(1.0 - turn * t, 0.3)
        s = s + step
        if np.abs(step).max() < 1e-7:
            break
    return s


def stations_between(first: float, last: float, borders: list[Measured]) -> NDArray[np.float64]:
    """Return stations at which cubics may begin and end: corners of borders, and every 2 m."""
    corners = np.concatenate([[first, last], *[border.s for border in borders]])
    grid = np.linspace(first, last, max(2, int((last - first) / 2.0) + 2))
    s = np.unique(np.concatenate([corners, grid]))
    s = s[(s > first + SAME_M) & (s < last - SAME_M)]
    if len(s):
        s = s[np.concatenate([[True], np.diff(s) > SAME_M])]
    return np.concatenate([[first], s, [last]])


def profile_of(
    knots: NDArray[np.float64], fine: NDArray[np.float64], value: NDArray[np.float64]
) -> Profile:
    """Return the longest continuous cubics that fit values within ``TOLERANCE_M``.

    Args:
        knots: (K,) stations at which cubics may begin and end.
        fine: (M,) stations of the values, including the knots, ascending.
        value: (M,) the values.
    """
    pos = np.searchsorted(fine, knots)
    start, rows = [], []
    k = 0
    while k < len(knots) - 1:
        end = k + 1
        best = _cubic(fine[pos[k] : pos[end] + 1], value[pos[k] : pos[end] + 1])[0]
        step = 1
        while end < len(knots) - 1:
            # Extend in growing steps, and in single ones after the first failure.
            reach = min(end + step, len(knots) - 1)
            row, error = _cubic(fine[pos[k] : pos[reach] + 1], value[pos[k] : pos[reach] + 1])
            if error <= TOLERANCE_M:
                best, end, step = row, reach, step * 2
            elif step == 1:
                break
            else:
                step = 1
        start.append(knots[k] - knots[0])
        rows.append(best)
        k = end
    return Profile(np.array(start), np.array(rows))


def _cubic(
    s: NDArray[np.float64], value: NDArray[np.float64]
) -> tuple[tuple[float, float, float, float], float]:
    """Return the least-squares cubic through the end values, and its maximum error."""
    length = s[-1] - s[0]
    x = (s - s[0]) / length
    rise = value[-1] - value[0]
    residual = value - value[0] - rise * x
    bow = x * (1 - x)
    p = q = 0.0
    if len(s) > 3:
        # Least squares over bow and bow x: two unknowns, solved by Cramer's rule.
        skew = bow * x
        aa, ab, bb = bow @ bow, bow @ skew, skew @ skew
        ra, rb = bow @ residual, skew @ residual
        determinant = aa * bb - ab * ab
        p, q = (ra * bb - rb * ab) / determinant, (rb * aa - ra * ab) / determinant
    error = float(np.abs(bow * (p + q * x) - residual).max())
    # value[0] + rise x + p (x - x^2) + q (x^2 - x^3)
    return (
        float(value[0]),
        float((rise + p) / length),
        float((q - p) / length**2),
        float(-q / length**3),
    ), error
