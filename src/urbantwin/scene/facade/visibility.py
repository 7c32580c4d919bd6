"""Visibility of walls from a carriageway."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.geometry.rays import RayScene

__all__ = ["REACH_M", "seen_from"]

#: Beyond this range a window's reveal is smaller than a LiDAR's footprint and noise, metres.
REACH_M = 80.0
#: Directions in which a wall looks, degrees from square.
LOOKS_DEG = (-60, -40, -20, 0, 20, 40, 60)
#: Rays start this far before their wall, metres.
AHEAD_M = 0.05


def seen_from(
    points: NDArray[np.float64],
    outward: NDArray[np.float64],
    plans: Sequence[Geometry],
    carriageway: Geometry,
) -> NDArray[np.float64]:
    """Return how far (N,) the nearest carriageway is that walls see, metres; infinity for none.

    Rays run level from each wall; footprints stop them.

    Args:
        points: (N, 2) on walls, site frame.
        outward: (N, 2) unit vectors.
        plans: footprints of buildings.
        carriageway: what they may see.
    """
    if carriageway.is_empty or not len(points):
        return np.full(len(points), np.inf)
    footprints = _screens(shapely.boundary(np.array(plans, dtype=object)))
    roads = _screens([carriageway.boundary])
    corners = np.concatenate([footprints, roads]).reshape(-1, 3)
    scene = RayScene(corners, np.arange(len(corners)).reshape(-1, 3))
    turn = np.radians(LOOKS_DEG)
    x = outward[:, :1] * np.cos(turn) - outward[:, 1:] * np.sin(turn)
    y = outward[:, :1] * np.sin(turn) + outward[:, 1:] * np.cos(turn)
    rays = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
    start = np.zeros_like(rays)
    start[..., :2] = (points + outward * AHEAD_M)[:, None]
    hits = scene.cast_single(start.reshape(-1, 3), rays.reshape(-1, 3))
    is_road = hits.face >= len(footprints)
    distance = np.where(is_road & (hits.range_m <= REACH_M), hits.range_m, np.inf)
    return np.asarray(distance.reshape(len(points), -1).min(axis=1), np.float64)


def _screens(lines: Sequence[Geometry] | NDArray[np.object_]) -> NDArray[np.float64]:
    """Return upright triangles (F, 3, 3) along lines."""
    parts = shapely.get_parts(shapely.get_parts(lines))
    xy, owner = shapely.get_coordinates(parts, return_index=True)
    follows = owner[1:] == owner[:-1]
    a, b = xy[:-1][follows], xy[1:][follows]
    low, high = np.full((len(a), 1), -1.0), np.full((len(a), 1), 1.0)
    a0, a1, b0, b1 = (np.hstack(pair) for pair in ((a, low), (a, high), (b, low), (b, high)))
    return np.concatenate([np.stack([a0, b0, b1], axis=1), np.stack([a0, b1, a1], axis=1)])
