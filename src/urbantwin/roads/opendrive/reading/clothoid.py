"""Clothoids and ``poly3`` as parametric cubics within 0.1 mm."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import Piece

__all__ = ["arc_length", "polynomial_pieces", "spiral_pieces"]

#: Largest distance between a curve and the cubics that stand for it, at equal stations, metres.
TOLERANCE_M = 5e-5
#: Largest turn of a clothoid over one step of its quadrature, radians.
STEP_TURN = 0.4
#: Step of u in which the length of a cubic over u is added up, metres.
STEP_U_M = 0.25
#: The most such steps.
STEPS_U = 20_000
_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(10)
NODES, WEIGHTS = (_ROOTS + 1) / 2, _WEIGHTS / 2

_Place = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def spiral_pieces(
    start: tuple[float, float, float], length: float, first: float, last: float
) -> list[Piece]:
    """Return a clothoid (ASAM OpenDRIVE 1.8, 9.5) as cubics.

    Args:
        start: x, y and heading where it begins.
        length: its length, metres.
        first: curvature at its start, 1/m.
        last: curvature at its end.
    """
    rate = (last - first) / length

    def place(s: NDArray[np.float64]) -> NDArray[np.float64]:
        # Where the turn is small between stations, Gauss-Legendre quadrature is exact to rounding.
        total = (abs(first) + abs(last)) * length
        grid = np.linspace(0.0, length, 2 + int(total / STEP_TURN))
        stations = np.unique(np.concatenate([grid, s]))
        step = np.diff(stations)
        q = stations[:-1, None] + step[:, None] * NODES
        angle = first * q + rate * q * q / 2
        moves = [((f(angle) * WEIGHTS).sum(axis=1) * step) for f in (np.cos, np.sin)]
        xy = [np.concatenate([[0.0], np.cumsum(move)]) for move in moves]
        which = np.searchsorted(stations, s)
        return np.column_stack([xy[0][which], xy[1][which], first * s + rate * s * s / 2])

    return _pieces(start, length, place)


def polynomial_pieces(
    start: tuple[float, float, float], length: float, abcd: tuple[float, ...]
) -> list[Piece]:
    """Return a ``poly3`` (ASAM OpenDRIVE 1.4, 5.3.4.1.4), v over u, as cubics.

    Args:
        start: x, y and heading of its frame.
        length: its length along the curve, metres.
        abcd: coefficients of v.
    """
    a, b, c, d = abcd

    def speed(u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.hypot(1.0, b + u * (2 * c + 3 * d * u))

    # The curve is at least as long as u.
    grid = np.linspace(0.0, length, min(int(length / STEP_U_M) + 2, STEPS_U))
    step = np.diff(grid)
    cells = (speed(grid[:-1, None] + step[:, None] * NODES) * WEIGHTS).sum(axis=1) * step
    along = np.concatenate([[0.0], np.cumsum(cells)])

    def place(s: NDArray[np.float64]) -> NDArray[np.float64]:
        u = np.interp(s, along, grid)
        for _ in range(4):
            k = np.clip(np.searchsorted(grid, u, side="right") - 1, 0, len(grid) - 2)
            part = u - grid[k]
            inner = (speed(grid[k][:, None] + part[:, None] * NODES) * WEIGHTS).sum(axis=1) * part
            u = u - (along[k] + inner - s) / speed(u)
        v = a + u * (b + u * (c + u * d))
        return np.column_stack([u, v, np.arctan(b + u * (2 * c + 3 * d * u))])

    return _pieces(start, length, place)


def arc_length(u: Sequence[float], v: Sequence[float]) -> float:
    """Return the length of a parametric cubic over a parameter from 0 to 1, metres."""
    slope = NODES[:, None] ** np.arange(3) * [1, 2, 3]
    speed = np.hypot(slope @ np.asarray(u[1:]), slope @ np.asarray(v[1:]))
    return float(speed @ WEIGHTS)


def _pieces(start: tuple[float, float, float], length: float, place: _Place) -> list[Piece]:
    """Join places and headings by cubics, as many as the tolerance asks for."""
    count = 1
    probe = np.linspace(0.0, 1.0, 9)
    powers = probe[:, None] ** np.arange(4)
    while True:
        knots = np.linspace(0.0, length, count + 1)
        reach = length / count
        x, y, heading = place(knots).T
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        dx, dy = np.diff(x), np.diff(y)
        du, dv = dx * c + dy * s, dy * c - dx * s
        turn = np.diff(heading)
        eu, ev = reach * np.cos(turn), reach * np.sin(turn)
        zero = np.zeros(count)
        u = np.column_stack([zero, zero + reach, 3 * du - 2 * reach - eu, reach + eu - 2 * du])
        v = np.column_stack([zero, zero, 3 * dv - ev, ev - 2 * dv])
        inner = place((knots[:-1, None] + reach * probe).ravel())
        pu, pv = (cubic @ powers.T for cubic in (u, v))
        px = x[:-1, None] + pu * c[:, None] - pv * s[:, None]
        py = y[:-1, None] + pu * s[:, None] + pv * c[:, None]
        gap = np.hypot(px.ravel() - inner[:, 0], py.ravel() - inner[:, 1])
        if gap.max() < TOLERANCE_M or reach < 1e-3:
            break
        count *= 2
    x0, y0, h0 = start
    c0, s0 = np.cos(h0), np.sin(h0)
    return [
        Piece(
            float(x0 + x[k] * c0 - y[k] * s0),
            float(y0 + x[k] * s0 + y[k] * c0),
            float(h0 + heading[k]),
            float(reach),
            u=tuple(map(float, u[k])),
            v=tuple(map(float, v[k])),
        )
        for k in range(count)
    ]
