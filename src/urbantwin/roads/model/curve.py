"""Reference lines of roads: chains of lines, arcs and parametric cubics with continuous heading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from urbantwin.geometry import stations_of_points

__all__ = ["Curve", "Piece", "all_at", "all_turned", "aside", "filleted", "splined", "turned"]

#: Largest distance between a fillet and the corner that it rounds, metres.
FILLET_DEVIATION_M = 0.2
#: Changes of heading below this are not rounded, radians.
STRAIGHT = 1e-6
#: Smallest radius of the inner edge of the lanes in a bend, metres.
INNER_RADIUS_M = 1.0
#: Length of the parametric cubics that approximate a spline, metres.
CUBIC_M = 2.0
#: Precision of the stations that `Curve.locate` returns, metres.
LOCATED_M = 1e-7
#: Spacing of the samples that give `Curve.locate` its start values, metres.
SAMPLE_M = 0.5
#: Minimum number of cubics of a turn: enough that its curvature starts near zero.
TURN_CUBICS = 10
#: Candidate speeds at the ends of a turn, as multiples of its chord.
TURN_SPEEDS = np.linspace(0.4, 2.8, 13)
#: Nodes of Gauss-Legendre quadrature on [0, 1], for the length of a cubic.
_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = (_ROOTS + 1) / 2, _WEIGHTS / 2


def aside(pose: NDArray[np.float64], t: ArrayLike) -> NDArray[np.float64]:
    """Return points (N, 2) that lie ``t`` metres to the left of poses x, y, heading (N, 3)."""
    x, y, heading = pose.T
    t = np.asarray(t, np.float64)
    return np.column_stack([x - t * np.sin(heading), y + t * np.cos(heading)])


@dataclass(frozen=True)
class Piece:
    """One ``<geometry>`` of OpenDRIVE: a line, an arc (``curvature`` in 1/m) or a cubic.

    For a cubic, ``u`` and ``v`` (4,) are the coefficients of the position along and across the
    start heading, over a parameter from 0 to 1.
    """

    x: float
    y: float
    heading: float
    length: float
    curvature: float = 0.0
    u: tuple[float, ...] = ()
    v: tuple[float, ...] = ()

    def at(self, ds: float) -> tuple[float, float, float]:
        """Return x, y, heading at a distance ``ds`` (0 to ``length``, metres) from the start."""
        if self.u:
            p = ds / max(self.length, 1e-12)
            u, v = self.u, self.v
            along = u[0] + p * (u[1] + p * (u[2] + p * u[3]))
            across = v[0] + p * (v[1] + p * (v[2] + p * v[3]))
            turn = math.atan2(
                v[1] + p * (2 * v[2] + 3 * p * v[3]), u[1] + p * (2 * u[2] + 3 * p * u[3])
            )
        elif self.curvature:
            turn = self.curvature * ds
            chord = 2 * math.sin(turn / 2) / self.curvature
            along, across = chord * math.cos(turn / 2), chord * math.sin(turn / 2)
        else:
            along, across, turn = ds, 0.0, 0.0
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.x + along * c - across * s, self.y + along * s + across * c, self.heading + turn


@dataclass(frozen=True)
class Curve:
    """A chain of pieces; the station ``s`` runs from 0 to ``length``, metres."""

    pieces: tuple[Piece, ...]

    @cached_property
    def starts(self) -> NDArray[np.float64]:
        """Stations of the starts of the pieces, and of the end (K + 1,), metres."""
        return np.array([0.0, *accumulate(piece.length for piece in self.pieces)])

    @property
    def length(self) -> float:
        """Length in plan, metres."""
        return float(self.starts[-1])

    def at(self, s: ArrayLike) -> NDArray[np.float64]:
        """Return x, y, heading (N, 3) at stations ``s``."""
        piece, ds = self._within(s)
        return _posed_on(self._table[piece], self._cubic[piece], self._powers[piece], ds)

    def _within(self, s: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the index of the piece at each station, and the distance from its start."""
        stations = np.asarray(s, np.float64).reshape(-1)
        stations = np.minimum(np.maximum(stations, 0.0), self.length)
        piece = self.starts[1:-1].searchsorted(stations, side="right")
        return piece, stations - self.starts[piece]

    def pose(self, s: float) -> tuple[float, float, float]:
        """Return x, y, heading at one station."""
        s = min(max(s, 0.0), self.length)
        k = int(np.searchsorted(self.starts[1:-1], s, side="right"))
        return self.pieces[k].at(s - float(self.starts[k]))

    @cached_property
    def _table(self) -> NDArray[np.float64]:
        """Rows of x, y, heading, its cosine and sine, length, curvature; one row per piece."""
        return np.array(
            [
                (
                    *(p.x, p.y, p.heading, math.cos(p.heading), math.sin(p.heading)),
                    *(max(p.length, 1e-12), p.curvature),
                )
                for p in self.pieces
            ]
        )

    @cached_property
    def _powers(self) -> NDArray[np.complex128]:
        """Complex coefficients u + iv (K, 4) of the cubics; zero for other pieces."""
        none = (0.0,) * 4
        if not self._cubic.any():
            return np.zeros((len(self.pieces), 4), np.complex128)
        return np.array([p.u or none for p in self.pieces]) + 1j * np.array(
            [p.v or none for p in self.pieces]
        )

    @cached_property
    def _cubic(self) -> NDArray[np.bool_]:
        """Mask (K,) of the pieces that are cubics."""
        return np.array([bool(piece.u) for piece in self.pieces])

    def beside(self, s: ArrayLike, t: ArrayLike) -> NDArray[np.float64]:
        """Return points (N, 2) at stations ``s``, ``t`` metres to the left."""
        return aside(self.at(s), t)

    def locate(self, xy: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return station and offset to the left (N,), (N,) of points (N, 2).

        Points before the start or beyond the end are measured on the straight continuation: their
        stations are negative or exceed the length.
        """
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        tree, stations = self._samples
        s = stations[tree.query(points)[1]]
        t = np.zeros(len(points))
        for _ in range(6):
            pose = self.at(s)
            beyond_m = s - np.clip(s, 0.0, self.length)
            c, sn = np.cos(pose[:, 2]), np.sin(pose[:, 2])
            gap = points - pose[:, :2] - beyond_m[:, None] * np.column_stack([c, sn])
            t = gap[:, 1] * c - gap[:, 0] * sn
            step = gap[:, 0] * c + gap[:, 1] * sn
            s = s + step
            if np.abs(step).max(initial=0.0) < LOCATED_M:
                break
        return s, t

    @cached_property
    def _samples(self) -> tuple[cKDTree, NDArray[np.float64]]:
        stations = np.linspace(0.0, self.length, max(3, int(self.length / SAMPLE_M) + 2))
        return cKDTree(self.at(stations)[:, :2]), stations

    @cached_property
    def line(self) -> shapely.LineString:
        """The curve as a polyline with steps of about 0.5 m."""
        steps = max(3, int(self.length / 0.5) + 2)
        return shapely.LineString(self.at(np.linspace(0.0, self.length, steps))[:, :2])

    def between(self, first: float, last: float) -> Curve:
        """Return the part from station ``first`` to ``last``, metres; its stations start at 0."""
        pieces = []
        for piece, start in zip(self.pieces, self.starts, strict=False):
            a, b = max(first, start), min(last, start + piece.length)
            if a == start and b == start + piece.length:
                pieces.append(piece)
            elif b - a > 1e-6:
                x, y, heading = self.pose(float(a))
                length = float(b - a)
                if not piece.u:
                    pieces.append(Piece(x, y, heading, length, piece.curvature))
                else:
                    part = (float(a - start) / piece.length, float(b - start) / piece.length)
                    pieces.append(_part(piece, part, (x, y, heading), length))
        return Curve(tuple(pieces))


def all_at(curves: Sequence[Curve], s: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return x, y, heading (N, 3) at stations of several curves, concatenated in their order."""
    if not curves:
        return np.zeros((0, 3))
    within = [curve._within(stations) for curve, stations in zip(curves, s, strict=True)]
    first = accumulate((len(curve.pieces) for curve in curves), initial=0)
    piece = np.concatenate([k + start for (k, _), start in zip(within, first, strict=False)])
    table, cubic, powers = (
        np.concatenate([getattr(curve, name) for curve in curves])[piece]
        for name in ("_table", "_cubic", "_powers")
    )
    return _posed_on(table, cubic, powers, np.concatenate([ds for _, ds in within]))


def _posed_on(
    rows: NDArray[np.float64],
    cubic: NDArray[np.bool_],
    powers: NDArray[np.complex128],
    ds: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return poses (N, 3) at distances from the starts of pieces."""
    if cubic.all():
        return _on_cubics(rows, powers, ds)
    pose = _on_arcs(rows, ds)
    if cubic.any():
        pose[cubic] = _on_cubics(rows[cubic], powers[cubic], ds[cubic])
    return pose


def _on_arcs(rows: NDArray[np.float64], ds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (N, 3) at distances from the starts of lines and arcs."""
    curvature = rows[:, 6]
    half = curvature * ds / 2
    chord = np.divide(2 * np.sin(half), curvature, out=ds.copy(), where=curvature != 0.0)
    return _posed(rows, chord * np.cos(half), chord * np.sin(half), 2 * half)


def _on_cubics(
    rows: NDArray[np.float64], powers: NDArray[np.complex128], ds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return poses (N, 3) at distances from the starts of cubics."""
    a, b, c, d = powers.T
    p = ds / rows[:, 5]
    place = p * (b + p * (c + p * d)) + a
    ahead = b + p * (2 * c + 3 * p * d)
    return _posed(rows, place.real, place.imag, np.arctan2(ahead.imag, ahead.real))


def _posed(
    rows: NDArray[np.float64],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    turn: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return poses (N, 3) at offsets along and across the starts of pieces, turned by ``turn``."""
    x, y, heading, c, s, _, _ = rows.T
    pose = np.empty((len(rows), 3))
    pose[:, 0] = x + along * c - across * s
    pose[:, 1] = y + along * s + across * c
    pose[:, 2] = heading + turn
    return pose


def _part(
    piece: Piece, part: tuple[float, float], pose: tuple[float, float, float], length: float
) -> Piece:
    """Return the part of a cubic between two values of its parameter."""
    low, high = part
    polynomials = [np.polynomial.Polynomial(c) for c in (piece.u, piece.v)]
    within = np.polynomial.Polynomial([low, high - low])
    along, across = (
        np.pad(np.asarray(f(within).coef, np.float64), (0, 4))[:4] for f in polynomials
    )
    turn = piece.heading - pose[2]
    c, s = math.cos(turn), math.sin(turn)
    u, v = along * c - across * s, along * s + across * c
    # Set exactly: the part begins at its own origin, in the direction of its heading.
    u[0] = v[0] = v[1] = 0.0
    return Piece(*pose, length, u=tuple(map(float, u)), v=tuple(map(float, v)))


def filleted(points: NDArray[np.float64], *, left: float, right: float) -> Curve:
    """Return a polyline as lines joined by arcs.

    Each arc stays within ``FILLET_DEVIATION_M`` of its corner unless lanes on the inside would fold
    over. It never reaches beyond the middle of a segment.

    Args:
        points: (N, 2), N >= 2.
        left: extent of the lanes to the left of the line, metres.
        right: extent of the lanes to the right.
    """
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], step > 1e-3])]
    leg = np.diff(points, axis=0)
    length = np.linalg.norm(leg, axis=1)
    heading = np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))
    turn = np.diff(heading)
    # Two corners share each inner segment; the first and the last segment have one corner each.
    share = np.full(len(length), 0.5)
    share[[0, -1]] = 1.0
    room = np.minimum((share * length)[:-1], (share * length)[1:])
    half = np.abs(turn) / 2
    inner = np.where(turn > 0, left, right) + INNER_RADIUS_M
    sag = np.maximum(1 / np.cos(np.minimum(half, 1.5)) - 1, 1e-12)
    radius = np.maximum(FILLET_DEVIATION_M / sag, inner)
    tangent = np.minimum(radius * np.tan(half), 0.98 * room)
    tangent[half < STRAIGHT] = 0.0
    pieces: list[Piece] = []
    before = 0.0
    for k in range(len(leg)):
        after = float(tangent[k]) if k < len(tangent) else 0.0
        straight = float(length[k]) - before - after
        x, y = points[k] + leg[k] / length[k] * before
        if straight > 1e-9:
            pieces.append(Piece(float(x), float(y), float(heading[k]), straight))
        if after > 0:
            x, y = points[k + 1] - leg[k] / length[k] * after
            curvature = math.tan(float(turn[k]) / 2) / after
            arc = abs(float(turn[k]) / curvature)
            pieces.append(Piece(float(x), float(y), float(heading[k]), arc, curvature))
        before = after
    return Curve(tuple(pieces))


def splined(points: NDArray[np.float64], start: float, end: float) -> Curve:
    """Return a smooth curve of cubics through points, continuous in heading and curvature.

    Args:
        points: (N, 2), N >= 2.
        start: heading at the first point, radians.
        end: heading at the last.
    """
    chord = np.sqrt(np.linalg.norm(np.diff(points, axis=0), axis=1))
    # Centripetal spacing keeps the spline from looping where points lie close together.
    knots = np.concatenate([[0.0], np.cumsum(chord)])
    first, last = (
        np.array([math.cos(h), math.sin(h)]) * speed
        for h, speed in ((start, chord[0]), (end, chord[-1]))
    )
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(knots, points, bc_type=((1, first), (1, last)))
    fine = np.linspace(0.0, knots[-1], 40 * len(points) + 1)
    xy = spline(fine)
    along = stations_of_points(xy)
    count = max(1, math.ceil(along[-1] / CUBIC_M))
    params = np.interp(np.linspace(0.0, along[-1], count + 1), along, fine)
    tangent = spline(params, 1)
    tangent[0], tangent[-1] = first, last
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return _cubics(spline(params), heading, float(along[-1]) / count)


def turned(
    start: NDArray[np.float64], end: NDArray[np.float64], *, directness: float = 1.0
) -> Curve:
    """Return a smooth curve between two poses, straight at both ends and with low curvature.

    A quintic whose curvature is zero at both ends. The speeds at its ends minimise curvature,
    number of bends and length.

    Args:
        start: x, y, heading (3,) of the start.
        end: the same of the end.
        directness: weight of the length against curvature, both in units of the chord.
    """
    return all_turned(start[None], end[None], directness=directness)[0]


def all_turned(
    start: NDArray[np.float64], end: NDArray[np.float64], *, directness: float = 1.0
) -> list[Curve]:
    """Return curves between M pairs of poses; see ``turned``.

    Args:
        start: x, y, heading (M, 3) of the starts.
        end: the same of the ends.
        directness: weight of the length against curvature, both in units of the chord.
    """
    gap = end[:, :2] - start[:, :2]
    reach = np.maximum(np.linalg.norm(gap, axis=1), 1e-6)
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    x, y = gap[:, 0] * c + gap[:, 1] * s, gap[:, 1] * c - gap[:, 0] * s
    goal = np.column_stack([x / reach, y / reach, end[:, 2] - start[:, 2]])
    # Small batches stay in the processor's cache.
    parts = [_gentlest(goal[k : k + 16], directness) for k in range(0, len(goal), 16)]
    u, v = (np.concatenate(part) * reach[:, None] for part in zip(*parts, strict=True))
    fine = np.linspace(0.0, 1.0, 129)
    speed = np.hypot(_derivative(u, fine, 1), _derivative(v, fine, 1))
    along = np.cumsum((speed[:, 1:] + speed[:, :-1]) / 256, axis=1)
    along = np.column_stack([np.zeros(len(along)), along])
    count = np.maximum(TURN_CUBICS, np.ceil(along[:, -1] / CUBIC_M).astype(int))
    curves = []
    for k, pieces in enumerate(count.tolist()):
        params = np.interp(np.linspace(0.0, along[k, -1], pieces + 1), along[k], fine)
        power = params ** np.arange(6)[:, None]
        xy = np.stack([u[k], v[k]]) @ power
        du, dv = np.stack([u[k, 1:], v[k, 1:]]) * np.arange(1, 6) @ power[:5]
        heading = start[k, 2] + np.unwrap(np.arctan2(dv, du))
        heading[0] = start[k, 2]
        heading[-1] = end[k, 2] + 2 * np.pi * round((heading[-1] - end[k, 2]) / (2 * np.pi))
        place = np.empty((pieces + 1, 2))
        place[:, 0] = start[k, 0] + xy[0] * c[k] - xy[1] * s[k]
        place[:, 1] = start[k, 1] + xy[0] * s[k] + xy[1] * c[k]
        place[-1] = end[k, :2]
        curves.append(_cubics(place, heading, float(along[k, -1]) / pieces))
    return curves


def _gentlest(
    goal: NDArray[np.float64], directness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the best quintics u, v (M, 6) from the origin along x to x, y, heading (M, 3)."""
    x, y, turn = goal.T
    tried = len(TURN_SPEEDS) ** 2
    first, last = (grid.ravel() for grid in np.meshgrid(TURN_SPEEDS, TURN_SPEEDS))
    first = np.tile(first, len(x))
    zero = np.zeros_like(first)
    u = _quintic(np.repeat(x, tried), first, zero, np.outer(np.cos(turn), last).ravel())
    v = _quintic(np.repeat(y, tried), zero, zero, np.outer(np.sin(turn), last).ravel())
    p = np.linspace(0.0, 1.0, 17)
    du, dv = _derivative(u, p, 1), _derivative(v, p, 1)
    speed = np.maximum(np.hypot(du, dv), 1e-9)
    bend = (du * _derivative(v, p, 2) - dv * _derivative(u, p, 2)) / speed**3
    # Half the total variation of the curvature: its maximum for one bend, more for several.
    swing = np.abs(np.diff(bend, axis=1)).sum(axis=1) / 2
    cost = np.round(swing + directness * speed.mean(axis=1), 9).reshape(len(x), tried)
    best = np.arange(len(x)) * tried + cost.argmin(axis=1)
    return u[best], v[best]


def _quintic(
    to: NDArray[np.float64],
    first: NDArray[np.float64],
    zero: NDArray[np.float64],
    last: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return coefficients (N, 6) of quintics from 0 to ``to``, unaccelerated at both ends."""
    remainder = to - first
    change = last - first
    return np.column_stack(
        [
            zero,
            first,
            zero,
            10 * remainder - 4 * change,
            -15 * remainder + 7 * change,
            6 * remainder - 3 * change,
        ]
    )


def _derivative(
    coefficients: NDArray[np.float64], p: NDArray[np.float64], order: int
) -> NDArray[np.float64]:
    """Return values (N, P) of the derivatives of quintics (N, 6) at parameters (P,)."""
    power = np.arange(order, 6)
    factor = np.array([math.perm(int(k), order) for k in power], np.float64)
    return np.asarray((coefficients[:, order:] * factor) @ p ** (power - order)[:, None])


def _cubics(xy: NDArray[np.float64], heading: NDArray[np.float64], reach: float) -> Curve:
    """Join points (N, 2) and headings (N,) by Hermite cubics of end speed ``reach`` metres."""
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    gap, turn = np.diff(xy, axis=0), np.diff(heading)
    du, dv = gap[:, 0] * c + gap[:, 1] * s, gap[:, 1] * c - gap[:, 0] * s
    eu, ev = reach * np.cos(turn), reach * np.sin(turn)
    zero = np.zeros_like(du)
    u = np.column_stack([zero, zero + reach, 3 * du - 2 * reach - eu, reach + eu - 2 * du])
    v = np.column_stack([zero, zero, 3 * dv - ev, ev - 2 * dv])
    return Curve(
        tuple(
            Piece(x, y, angle, length, u=tuple(along), v=tuple(across))
            for (x, y, angle), length, along, across in zip(
                np.column_stack([xy, heading])[:-1].tolist(),
                cubic_lengths(u, v).tolist(),
                u.tolist(),
                v.tolist(),
                strict=True,
            )
        )
    )


def cubic_lengths(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths (N,) of cubics with coefficients (N, 4) over parameters from 0 to 1."""
    powers = NODES ** np.arange(3)[:, None] * np.array([1, 2, 3])[:, None]
    return np.asarray(np.hypot(u[:, 1:] @ powers, v[:, 1:] @ powers) @ WEIGHTS)
