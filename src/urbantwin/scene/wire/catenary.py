"""The curve of a wire between two points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.scene.solids import Solid, rods

__all__ = ["WIRE_M", "catenaries", "parameter_of_sag", "wire_solid"]

#: Radius that wires are drawn with: 12 mm, the copper of trams and the conductors of power lines.
WIRE_M = 0.012
ROUNDS = 30


def parameter_of_sag(span: ArrayLike, sag: ArrayLike) -> NDArray[np.float64]:
    """Return the parameters c (N,) of catenaries y = c cosh(x / c), metres.

    sag = c (cosh(span / 2c) - 1), between ends of the same height; solved by Newton's method from
    the parabola's c = span^2 / (8 sag).
    """
    half = np.asarray(span, np.float64) / 2
    deep = np.asarray(sag, np.float64)
    c = half**2 / (2 * deep)
    for _ in range(ROUNDS):
        u = half / c
        value = c * (np.cosh(u) - 1) - deep
        slope = np.cosh(u) - 1 - u * np.sinh(u)
        c = np.maximum(c - value / slope, 0.05 * half)
    return np.asarray(c)


def catenaries(
    starts: ArrayLike, ends: ArrayLike, sags: ArrayLike, steps: int = 12
) -> NDArray[np.float64]:
    """Return points (N, steps + 1, 3) of wires between points (N, 3) and (N, 3).

    ``sags`` (N,), metres, are the sags of the wires between ends of equal height. For ends of
    different height the same catenary is shifted to pass through both.
    """
    a = np.asarray(starts, np.float64).reshape(-1, 3)
    b = np.asarray(ends, np.float64).reshape(-1, 3)
    span = np.linalg.norm((b - a)[:, :2], axis=1)
    c = parameter_of_sag(span, np.broadcast_to(np.asarray(sags, np.float64), span.shape))[:, None]
    rise = (b - a)[:, 2:]
    lowest = span[:, None] / 2 - c * np.arcsinh(rise / (2 * c * np.sinh(span[:, None] / (2 * c))))
    share = np.linspace(0, 1, steps + 1)
    x = share * span[:, None]
    z = a[:, 2:] + c * (np.cosh((x - lowest) / c) - np.cosh(lowest / c))
    plan = a[:, None, :2] + share[:, None] * (b - a)[:, None, :2]
    return np.concatenate([plan, z[..., None]], axis=2)


def wire_solid(points: NDArray[np.float64], radius: float = WIRE_M) -> Solid:
    """Return wires through points (N, P, 3) as thin three-sided rods."""
    starts, ends = points[:, :-1].reshape(-1, 3), points[:, 1:].reshape(-1, 3)
    keep = np.linalg.norm(ends - starts, axis=1) > 1e-3
    return rods(starts[keep], ends[keep], radius, radius, 3)
