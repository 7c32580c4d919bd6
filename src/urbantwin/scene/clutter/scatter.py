"""Points scattered over land: a jittered grid with an independent draw for each cell.

The draw of a cell depends only on its position and a seed, so that changes elsewhere have no
effect.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.site.extract import OsmFeature

__all__ = ["PLANTED_ID", "cell_draws", "planted", "scattered"]

#: First id of assumed plants: above those of the map and of plots.
PLANTED_ID = 1 << 41
_GAMMA, _MIX = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


def cell_draws(cells: NDArray[np.int64], seed: int, count: int) -> NDArray[np.float64]:
    """Return random numbers (N, count) in 0..1 for (N, 2) cells of a grid, from their indices.

    SplitMix64 (Steele, Lea and Flood 2014) over the indices of the cell, the seed and the draw.
    """
    given = np.asarray(cells, np.int64).astype(np.uint64)
    state = _mixed(given[:, 0] ^ _mixed(given[:, 1] ^ _mixed(np.array([seed], np.uint64))))
    steps = np.arange(1, count + 1, dtype=np.uint64) * _GAMMA
    bits = _mixed(state[:, None] + steps)
    return np.asarray((bits >> np.uint64(11)).astype(np.float64) / 2.0**53)


def scattered(
    land: shapely.Geometry, cell_m: float, seed: int, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (N, 2), at most one per cell of a grid, within the land; and their draws.

    Args:
        land: area of the points, site frame.
        cell_m: edge of the cells, metres.
        seed: seed of the draws.
        count: draws (N, count) in addition to the position within the cell, each 0..1.
    """
    if land.is_empty:
        return np.zeros((0, 2)), np.zeros((0, count))
    west, south, east, north = np.floor(np.array(land.bounds) / cell_m).astype(np.int64)
    i, j = np.meshgrid(np.arange(west, east + 1), np.arange(south, north + 1))
    cells = np.column_stack([i.ravel(), j.ravel()])
    draws = cell_draws(cells, seed, count + 2)
    xy = (cells + draws[:, :2]) * cell_m
    shapely.prepare(land)
    inside = shapely.contains_xy(land, xy[:, 0], xy[:, 1])
    return xy[inside], draws[inside, 2:]


def planted(tags: dict[str, str], xy: NDArray[np.float64]) -> OsmFeature:
    """Return a plant, tagged as in the map.

    Its id, which seeds its shape, is derived from its position.
    """
    x, y = np.round(xy * 100).astype(np.int64).tolist()
    number = PLANTED_ID + (x & 0xFFFFF) * (1 << 20) + (y & 0xFFFFF)
    return OsmFeature("node", number, tags, shapely.Point(xy))


def _mixed(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    with np.errstate(over="ignore"):
        value = (value ^ (value >> np.uint64(30))) * _MIX
        value = (value ^ (value >> np.uint64(27))) * _MIX_2
        return np.asarray(value ^ (value >> np.uint64(31)))
