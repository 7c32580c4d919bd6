"""Bare earth of a survey as a height grid."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, label

from urbantwin.ground import ElevationPatch
from urbantwin.reconstruct.airborne.raster import Raster
from urbantwin.reconstruct.airborne.tin import tin_heights

__all__ = ["GRID_M", "bare_earth", "levelled_water"]

#: Spacing of the grid, metres.
GRID_M = 0.5
#: Maximum distance from ground points with known height, metres: half a block.
_REACH_M = 40.0
#: Margin around the region, metres.
_MARGIN_M = 25.0


def levelled_water(points: NDArray[np.float64], water: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the points with each body of water at one height: the median of its points.

    Points of water within 6 m are connected, as few pulses return from water.
    """
    if not water.any():
        return points
    flat = points.copy()
    wet = points[water]
    grid = Raster.over(wet.min(axis=0), wet.max(axis=0), 2.0, pad=3)
    sheets, count = label(binary_dilation(grid.count(wet[:, :2]) > 0, np.ones((3, 3))))
    sheet = sheets.ravel()[grid.cells(wet[:, :2])]
    level = np.array([np.median(wet[sheet == k, 2]) for k in range(1, count + 1)])
    flat[water, 2] = level[sheet - 1]
    return flat


def bare_earth(
    ground: NDArray[np.float64], region: shapely.Polygon, *, name: str, detail_m: float | None
) -> ElevationPatch:
    """Return the heights of triangulated ground points at the nodes of a grid.

    Points are first averaged over cells of the grid's size, which preserves planes and halves the
    noise. Gaps (under buildings, cars, trees) are bridged by triangles: heights are linear between
    the ground on their sides. Beyond the hull of the points, and more than 40 m from any, heights
    are nan.

    Args:
        ground: (N, 3) points of the bare earth, site frame.
        region: area that the grid must cover.
        name: name of the source.
        detail_m: size of the smallest detail; ``None``: the spacing of the points.
    """
    west, south, east, north = region.buffer(_MARGIN_M).bounds
    near = (
        (ground[:, 0] > west - _REACH_M)
        & (ground[:, 0] < east + _REACH_M)
        & (ground[:, 1] > south - _REACH_M)
        & (ground[:, 1] < north + _REACH_M)
    )
    points = ground[near]
    if len(points) < 3:
        raise ValueError("fewer than three ground points in the region")
    low = np.maximum(points[:, :2].min(axis=0), [west, south])
    high = np.minimum(points[:, :2].max(axis=0), [east, north])
    grid = Raster.over(low, np.maximum(high, low), GRID_M, pad=0)
    middle = _averaged(points, GRID_M)
    heights = tin_heights(middle, grid.west, grid.south, GRID_M, grid.shape)
    away = distance_transform_edt(grid.count(points[:, :2]) == 0) * GRID_M
    heights[away > _REACH_M] = np.nan
    spacing = _spacing(points) if detail_m is None else detail_m
    return ElevationPatch(grid.west, grid.south, GRID_M, heights, spacing, name)


def _averaged(points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the mean point of each cell."""
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / size).astype(np.int64)
    _, number, count = np.unique(
        cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1], return_inverse=True, return_counts=True
    )
    number = number.ravel()
    sums = [np.bincount(number, weights=points[:, axis]) for axis in range(3)]
    mean: NDArray[np.float64] = np.column_stack(sums) / count[:, None]
    return mean


def _spacing(points: NDArray[np.float64]) -> float:
    """Return the mean point spacing in occupied cells, metres."""
    grid = Raster.over(points.min(axis=0), points.max(axis=0), 2.0)
    count = grid.count(points[:, :2])
    return float(round(2.0 / np.sqrt(np.median(count[count > 0])), 3))
