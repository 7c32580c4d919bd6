"""Crowns of trees: clumps of leaves with gaps that let some beams through.

A crown is a cloud of triangles: several lobes inside an ellipsoid for broadleaved trees, whorls of
drooping branches inside a cone for conifers, fronds for palms. Returns come from inside the crown
as well as from its surface. 3 to 25 % of horizontal beams pass through the middle of a crown in
leaf. Konarska et al. 2014 (Theoretical and Applied Climatology 117) give 1 to 5 % of the direct
light for single street trees, whose beams are much finer than the gaps. Zheng and Moskal 2009 give
gap fractions up to 0.3. The share does not depend on the number of triangles: fewer triangles are
larger.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

__all__ = ["CLUMPS", "crown_clumps", "rounded"]

#: Number of triangles of a crown for which the sizes of clumps are given.
CLUMPS = 480
LOBES = 9
FRONDS, LEAFLETS = 18, 6
#: Grid for corners of leaves of assumed trees, metres: it halves the file size.
GRID_M = 1 / 32
#: Size of a clump over the cube root of (diameter^2 height), at ``CLUMPS`` triangles.
BROAD, NEEDLE = 0.068, 0.1


def crown_clumps(
    form: str, diameter: float, low: float, high: float, rng: Generator, count: int = CLUMPS
) -> NDArray[np.float64]:
    """Return the clumps (N, 3, 3) of a crown centred on the z axis.

    Args:
        form: round, ovoid, spreading, column, cone or palm.
        diameter: its width in both directions, metres.
        low: height of its underside, metres.
        high: height of its top, metres.
        rng: generator of the crown's random shape.
        count: approximate number of triangles.
    """
    if form == "palm":
        clumps = _palm(diameter, low, high, rng)
    elif form == "cone":
        clumps = _conical(diameter, low, high, rng, count)
    else:
        clumps = _broad(form, diameter, low, high, rng, count)
    return _fitted(clumps, diameter, low, high)


def rounded(clumps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return clumps (N, 3, 3) with their corners on a grid, which reduces file sizes."""
    return np.asarray(np.round(clumps / GRID_M) * GRID_M)


def _size(share: float, diameter: float, tall: float, count: int) -> float:
    """Return the size of clumps for which the visible share does not depend on their number.

    The leaf area along a horizontal beam is proportional to count * size^2 / (diameter * height).
    """
    slender = (tall / diameter) ** (1 / 6)
    even = (diameter * diameter * tall) ** (1 / 3)
    return float(share * even * slender * np.sqrt(CLUMPS / count))


def _broad(
    form: str, diameter: float, low: float, high: float, rng: Generator, count: int
) -> NDArray[np.float64]:
    turn = rng.uniform(0, 2 * np.pi) + np.arange(LOBES) * 2.399963  # the golden angle
    up = np.linspace(-0.55, 0.65, LOBES) + rng.uniform(-0.1, 0.1, LOBES)
    out = 0.55 * np.sqrt(np.maximum(1 - up**2, 0)) * rng.uniform(0.75, 1.0, LOBES)
    centre = np.column_stack([out * np.cos(turn), out * np.sin(turn), up])
    radius = rng.uniform(0.38, 0.5, LOBES)
    lobe = np.arange(count) % LOBES
    normal = _directions(count, rng)
    depth = 1 - 0.45 * rng.random(count) ** 2
    middle = centre[lobe] + normal * (radius[lobe] * depth)[:, None]
    middle[:, :2] *= _profile(form, middle[:, 2])[:, None]
    stretch = np.array([diameter / 2, diameter / 2, (high - low) / 2])
    size = _size(BROAD, diameter, high - low, count)
    return _clumps(middle * stretch, normal + 0.6 * _directions(count, rng), size, rng)


def _profile(form: str, up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ratio of a crown's width to an ellipsoid's at heights from -1 to 1."""
    if form == "ovoid":
        return np.asarray(1.0 - 0.3 * up)
    if form == "spreading":
        return np.asarray(1.0 + 0.35 * up)
    if form == "column":
        return np.asarray(1 / np.sqrt(np.clip(1 - 0.8 * up**2, 0.25, 1)))
    return np.ones_like(up)


def _conical(
    diameter: float, low: float, high: float, rng: Generator, count: int
) -> NDArray[np.float64]:
    share = np.sqrt(rng.random(count))  # 0 at the top, 1 below: uniform per area
    whorls = max(int((high - low) / 0.7), 4)
    share = (np.floor(share * whorls) + 0.35 + 0.3 * rng.random(count)) / whorls
    turn = rng.uniform(0, 2 * np.pi, count)
    out = share * (1 - 0.5 * rng.random(count) ** 2)
    middle = np.column_stack(
        [
            out * np.cos(turn) * diameter / 2,
            out * np.sin(turn) * diameter / 2,
            high - share * (high - low) - 0.12 * out * diameter,
        ]
    )
    outward = np.column_stack([np.cos(turn), np.sin(turn), np.full(count, 1.6)])
    size = _size(NEEDLE, diameter, high - low, count)
    return _clumps(middle, outward + 0.7 * _directions(count, rng), size, rng)


def _palm(diameter: float, low: float, high: float, rng: Generator) -> NDArray[np.float64]:
    """Fronds that rise from the top of the trunk and droop, each a folded strip of leaflets."""
    turn = np.arange(FRONDS) * 2.399963 + rng.uniform(-0.2, 0.2, FRONDS)
    rise = np.radians(rng.uniform(5, 75, FRONDS))[:, None]
    along = np.linspace(0.05, 1, LEAFLETS + 1)
    out = diameter / 2 * along * np.cos(rise * (1 - 0.5 * along))
    up = diameter / 2 * (np.sin(rise) * along - 0.75 * along**2)
    ahead = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(FRONDS)])[:, None]
    side = np.column_stack([-np.sin(turn), np.cos(turn), np.zeros(FRONDS)])[:, None]
    rib = ahead * out[..., None] + [0, 0, 1] * up[..., None]
    wide = 0.11 * diameter * np.sin(np.pi * np.clip(along, 0.1, 0.95)) + 0.02 * diameter
    strips = []
    for way in (1, -1):
        edge = rib + way * side * wide[:, None] - [0, 0, 0.06 * diameter]
        strips.append(np.stack([rib[:, :-1], rib[:, 1:], edge[:, 1:]], axis=2))
        strips.append(np.stack([rib[:, :-1], edge[:, 1:], edge[:, :-1]], axis=2))
    return np.concatenate(strips).reshape(-1, 3, 3) + [0, 0, (low + high) / 2]


def _directions(count: int, rng: Generator) -> NDArray[np.float64]:
    """Return random unit vectors (N, 3), even over the sphere."""
    z = rng.uniform(-1, 1, count)
    turn = rng.uniform(0, 2 * np.pi, count)
    flat = np.sqrt(1 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def _clumps(
    middle: NDArray[np.float64], normal: NDArray[np.float64], size: float, rng: Generator
) -> NDArray[np.float64]:
    """Return triangles (N, 3, 3) about their middles, facing their normals, uneven in size."""
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(helper, normal)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    turn = rng.uniform(0, 2 * np.pi, (len(middle), 1)) + np.array([0.0, 2.1, 4.2])
    reach = size * rng.uniform(0.7, 1.3, (len(middle), 3))
    along, across = (reach * np.cos(turn))[..., None], (reach * np.sin(turn))[..., None]
    return np.asarray(middle[:, None] + along * u[:, None] + across * v[:, None])


def _fitted(
    clumps: NDArray[np.float64], diameter: float, low: float, high: float
) -> NDArray[np.float64]:
    """Scale a crown to the given bounds."""
    corners = clumps.reshape(-1, 3)
    least, most = corners.min(axis=0), corners.max(axis=0)
    want_least = np.array([-diameter / 2, -diameter / 2, low])
    want = np.array([diameter, diameter, high - low])
    return np.asarray((clumps - least) / (most - least) * want + want_least)
