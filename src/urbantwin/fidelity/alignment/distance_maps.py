"""Distance maps of a scene for the pose search: to surfaces, road edges, painted lines, posts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from urbantwin.fidelity.alignment.scene_points import ScenePoints

__all__ = ["FAR_M", "HIGHEST_M", "Plan", "Space"]

#: Maximum number of cells in space and in plan, and the minimum cell size, metres.
_MOST_CELLS, _MOST_PLAN_CELLS, _FINEST_M = 2_000_000, 2_000_000, 0.1
#: Distance from surfaces, edges and lines from which points do not contribute, metres.
FAR_M = 1.0
#: Surfaces higher than this above the lowest are left out, metres.
HIGHEST_M = 40.0


class Space(NamedTuple):
    """Proximity of the nearest surface above the ground.

    Attributes:
        gain: (X, Y, Z) 1 on a surface, 0 from `FAR_M` on.
        low: (3,) corner of the first cell.
        cell_m: size of a cell, metres.
    """

    gain: NDArray[np.float32]
    low: NDArray[np.float64]
    cell_m: float

    @classmethod
    def around(cls, places: NDArray[np.float64]) -> Space:
        """Build from surface points (N, 3); without points nothing is near."""
        if not len(places):
            return cls(np.zeros((1, 1, 1), np.float32), np.zeros(3), 1.0)
        places = places[places[:, 2] < places[:, 2].min() + HIGHEST_M]
        low = places.min(axis=0) - FAR_M
        extent = places.max(axis=0) + FAR_M - low
        cell = max(_FINEST_M, float((extent.prod() / _MOST_CELLS) ** (1 / 3)))
        free = np.ones(np.ceil(extent / cell).astype(int) + 1, np.bool_)
        free[*((places - low) / cell).astype(int).T] = False
        return cls(_nearness(free, cell), low, cell)


class Plan(NamedTuple):
    """Proximity of edges, lines and posts in plan, and the ground height.

    Attributes:
        gain: (3, X, Y) for edges, lines and posts: 1 on one, 0 from `FAR_M` on.
        height: (X, Y) ground height, nan if there is none.
        low: (2,) corner of the first cell.
        cell_m: size of a cell, metres.
        any_edges: whether there are edges of carriageways.
        any_lines: whether there are painted lines.
        any_posts: whether there are posts.
    """

    gain: NDArray[np.float32]
    height: NDArray[np.float32]
    low: NDArray[np.float64]
    cell_m: float
    any_edges: bool
    any_lines: bool
    any_posts: bool

    @classmethod
    def over(cls, scene: ScenePoints, low: NDArray[np.float64], high: NDArray[np.float64]) -> Plan:
        """Build for the part of a scene between two corners (2,)."""
        extent = high - low
        cell = max(_FINEST_M, float((extent.prod() / _MOST_PLAN_CELLS) ** 0.5))
        shape = np.ceil(extent / cell).astype(int) + 1
        gains = []
        for places in (scene.edges, scene.lines, scene.posts):
            free = np.ones(shape, np.bool_)
            at = ((places[:, :2] - low) / cell).astype(int)
            at = at[((at >= 0) & (at < shape)).all(axis=1)]
            free[*at.T] = False
            gains.append(np.zeros(shape, np.float32) if free.all() else _nearness(free, cell))
        height = np.full(shape, np.nan, np.float32)
        ground = scene.points[scene.is_ground]
        height[*((ground[:, :2] - low) / cell).astype(int).T] = ground[:, 2]
        empty = np.isnan(height)
        if not empty.all():  # empty cells take their neighbour's height
            away, nearest = distance_transform_edt(empty, sampling=cell, return_indices=True)
            height = np.where(away < FAR_M, height[tuple(nearest)], np.nan)
        return cls(np.stack(gains), height, low, cell, *(bool(gain.any()) for gain in gains))


def _nearness(free: NDArray[np.bool_], cell_m: float) -> NDArray[np.float32]:
    away = distance_transform_edt(free, sampling=cell_m)
    return np.asarray(np.maximum(0.0, 1.0 - away / FAR_M), np.float32)
