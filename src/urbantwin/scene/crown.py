"""Crowns of trees: clumps of leaves that let some beams through, as foliage does.

A crown is a cloud of triangles: several lobes inside an ellipsoid for broadleaved trees, whorls of
drooping branches inside a cone for needleleaved ones. Returns come from within the crown as well
as from its surface, and about one level beam in ten passes through a broadleaved crown's middle.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

__all__ = ["BROADLEAVED_CLUMPS", "NEEDLELEAVED_CLUMPS", "broadleaved_crown", "needleleaved_crown"]

BROADLEAVED_CLUMPS = 480
NEEDLELEAVED_CLUMPS = 600
LOBES = 9


def broadleaved_crown(
    diameter: float, low: float, high: float, rng: Generator
) -> NDArray[np.float64]:
    """Return the clumps (N, 3, 3) of a broadleaved crown centred on the z axis.

    Its bounds are ``diameter`` across both ways and ``low`` to ``high`` in z, metres.
    """
    turn = rng.uniform(0, 2 * np.pi) + np.arange(LOBES) * 2.399963  # the golden angle
    up = np.linspace(-0.55, 0.65, LOBES) + rng.uniform(-0.1, 0.1, LOBES)
    out = 0.55 * np.sqrt(np.maximum(1 - up**2, 0)) * rng.uniform(0.75, 1.0, LOBES)
    centre = np.column_stack([out * np.cos(turn), out * np.sin(turn), up])
    radius = rng.uniform(0.38, 0.5, LOBES)
    lobe = np.arange(BROADLEAVED_CLUMPS) % LOBES
    normal = _directions(BROADLEAVED_CLUMPS, rng)
    depth = 1 - 0.45 * rng.random(BROADLEAVED_CLUMPS) ** 2
    middle = centre[lobe] + normal * (radius[lobe] * depth)[:, None]
    stretch = np.array([diameter / 2, diameter / 2, (high - low) / 2])
    size = 0.075 * (diameter * diameter * (high - low)) ** (1 / 3)
    clumps = _clumps(middle * stretch, normal + 0.6 * _directions(len(normal), rng), size, rng)
    return _fitted(clumps, diameter, low, high)


def needleleaved_crown(
    diameter: float, low: float, high: float, rng: Generator
) -> NDArray[np.float64]:
    """Return the clumps (N, 3, 3) of a conical crown; bounds as of a broadleaved one."""
    share = np.sqrt(rng.random(NEEDLELEAVED_CLUMPS))  # 0 at the top, 1 below: as many per area
    whorls = max(int((high - low) / 0.7), 4)
    share = (np.floor(share * whorls) + 0.35 + 0.3 * rng.random(len(share))) / whorls
    turn = rng.uniform(0, 2 * np.pi, len(share))
    out = share * (1 - 0.5 * rng.random(len(share)) ** 2)
    middle = np.column_stack(
        [
            out * np.cos(turn) * diameter / 2,
            out * np.sin(turn) * diameter / 2,
            high - share * (high - low) - 0.12 * out * diameter,
        ]
    )
    outward = np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), 1.6)])
    size = 0.07 * (diameter * diameter * (high - low)) ** (1 / 3)
    clumps = _clumps(middle, outward + 0.7 * _directions(len(share), rng), size, rng)
    return _fitted(clumps, diameter, low, high)


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
    """Stretch a crown to the bounds that it should have."""
    corners = clumps.reshape(-1, 3)
    least, most = corners.min(axis=0), corners.max(axis=0)
    want_least = np.array([-diameter / 2, -diameter / 2, low])
    want = np.array([diameter, diameter, high - low])
    return np.asarray((clumps - least) / (most - least) * want + want_least)
