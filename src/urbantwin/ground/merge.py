"""One elevation grid from several sources: everywhere the finest one that has data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from urbantwin.errors import InputError
from urbantwin.ground.elevation import Elevation
from urbantwin.ground.patch import ElevationPatch
from urbantwin.site import grid_step_m

__all__ = ["merged_elevation"]

#: Over this distance from its border a finer source takes over from a coarser one, metres: a step
#: between two surveys would become a cliff.
BLEND_M = 4.0
#: Nodes beyond the region that bilinear interpolation may need.
PAD = 2


def merged_elevation(
    patches: Sequence[ElevationPatch], region: shapely.Polygon
) -> tuple[Elevation, dict[str, float]]:
    """Merge the bare earth of several sources into one grid that covers a region.

    Where two sources overlap, the finer one counts, blended into the coarser one within ``BLEND_M``
    of its border. Holes that no source covers (the ground under buildings) are filled from their
    rims (GDAL's inverse-distance fill), and what lies beyond all sources takes the nearest height.

    Args:
        patches: at least one; heights above the anchor's ground.
        region: what must be covered, site frame, metres.

    Returns:
        the elevation, and each source's share of the region in its order of use.

    Raises:
        InputError: no source has a height within the region.
    """
    low, high = np.reshape(region.bounds, (2, 2))
    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    step = grid_step_m(min(p.detail_m for p in patches), (*low, *high))
    first = np.floor(low / step).astype(int) - PAD
    columns, rows = np.ceil(high / step).astype(int) + PAD - first + 1
    x, y = np.meshgrid((first[0] + np.arange(columns)) * step, (first[1] + np.arange(rows)) * step)
    heights = np.full(x.shape, np.nan)
    inside = shapely.contains_xy(region, x, y)
    shares: dict[str, float] = {}
    for patch in sorted(patches, key=lambda p: -p.detail_m):
        own = _resampled(patch, x, y)
        known = np.isfinite(own)
        if not known[inside].any():
            continue
        weight = np.clip(
            distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1] * step / BLEND_M, 0, 1
        )
        weight = np.where(np.isnan(heights), 1.0, weight)
        heights = np.where(known, weight * np.nan_to_num(own), 0.0) + np.where(
            known, (1 - weight) * np.nan_to_num(heights), heights
        )
        shares[patch.name] = round(float(known[inside].mean()), 4)
    if not shares:
        names = ", ".join(p.name for p in patches)
        raise InputError(f"{names}: no height of the ground within the region")
    detail = min(p.detail_m for p in patches if p.name in shares)
    west, south = first * step
    return Elevation(float(west), float(south), step, _filled(heights), detail), shares


def _resampled(
    patch: ElevationPatch, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights of a patch at points, bilinear; nan where one of the four nodes has none."""
    where = [(y - patch.south) / patch.step, (x - patch.west) / patch.step]
    rows, columns = patch.heights.shape
    slack = 1e-9
    beyond = (where[0] < -slack) | (where[0] > rows - 1 + slack)
    beyond |= (where[1] < -slack) | (where[1] > columns - 1 + slack)
    known = np.isfinite(patch.heights)
    share = map_coordinates(known.astype(np.float64), where, order=1, mode="nearest")
    value = map_coordinates(np.where(known, patch.heights, 0.0), where, order=1, mode="nearest")
    return np.where(beyond | (share < 1 - 1e-6), np.nan, value)


def _filled(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the grid without nan."""
    known = np.isfinite(heights)
    if known.all():
        return heights
    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    nearest = heights[rows, columns]
    # GDAL computes in single precision: centred, so that heights keep their millimetres.
    middle = float(np.mean(heights[known]))
    from rasterio.fill import fillnodata

    smooth = fillnodata(
        (nearest - middle).astype(np.float32),
        mask=known.astype(np.uint8),
        max_search_distance=float(max(heights.shape)),
        smoothing_iterations=2,
    )
    return np.where(known, heights, smooth.astype(np.float64) + middle)
