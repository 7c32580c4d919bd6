"""Road markings: bright spots of one frame, and the painted lines of the twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.alignment.curbs import above_lowest
from urbantwin.geometry import SurfaceMaterials
from urbantwin.geometry.surface_material import TILE
from urbantwin.taxonomy import material_id

__all__ = ["BrightSpots", "bright_spots_of", "mark_lines"]

#: Number of neighbours with which a point is compared, their maximum distance (metres), and their
#: minimum number.
_AROUND, _AROUND_M, _FEWEST = 40, 1.0, 15
#: Maximum height above the lowest point around, metres.
_MOST_M = 0.25
#: Excess brightness, in standard deviations of the surroundings, at which the weight rises from 0,
#: and reaches 1.
_FROM, _FULL = 2.0, 5.0
#: Maximum width and minimum length of a line, as standard deviations of a strip of 0.5 m. Stop
#: lines qualify, bars of a zebra crossing do not, as their positions are not surveyed.
_WIDTH_SIGMA_M, _LENGTH_SIGMA_M, _STRIP_M = 0.13, 0.2, 0.5
_EVERY_M = 0.2


@dataclass(frozen=True, eq=False)
class BrightSpots:
    """Ground points that are brighter than those around them.

    Attributes:
        points: (N, 3), in the frame of the points.
        weight: (N,) contrast, 0 to 1.
    """

    points: NDArray[np.float64]
    weight: NDArray[np.float64]


def bright_spots_of(
    points: NDArray[np.float64], level: NDArray[np.float64], intensity: NDArray[np.float64] | None
) -> BrightSpots:
    """Return ground points that are brighter than their surroundings, on any intensity scale.

    Args:
        points: (N, 3) points of one sensor.
        level: (N, 3) the same, z upward.
        intensity: (N,); without it, or with a constant one, there are no spots.
    """
    none = BrightSpots(np.zeros((0, 3)), np.zeros(0))
    if intensity is None:
        return none
    low = np.flatnonzero((above_lowest(level) < _MOST_M) & np.isfinite(intensity))
    if len(low) < _FEWEST:
        return none
    at, shine = points[low], np.asarray(intensity[low], np.float64)
    away, number = cKDTree(at).query(at, k=_AROUND, distance_upper_bound=_AROUND_M)
    near = np.isfinite(away)
    kept = near.sum(axis=1) >= _FEWEST
    away, number, near = away[kept], number[kept], near[kept]
    around = np.where(near, shine[np.minimum(number, len(shine) - 1)], np.nan)
    middle = np.nanmedian(around, axis=1)
    scatter = 1.4826 * np.nanmedian(np.abs(around - middle[:, None]), axis=1)
    # Integer intensities do not vary on dark roads: the deviation is at least 15 % of the level.
    excess = (shine[kept] - middle) / np.maximum(scatter + 0.15 * np.abs(middle), 1e-9)
    weight = np.clip((excess - _FROM) / (_FULL - _FROM), 0.0, 1.0)
    return BrightSpots(at[kept][weight > 0], weight[weight > 0])


def mark_lines(
    surface: SurfaceMaterials, middle: NDArray[np.float64], reach_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (N, 2) on the centres of painted lines, and unit normals (N, 2) of the lines.

    Args:
        surface: paint of the twin.
        middle: (2,) centre of the area to read, site frame.
        reach_m: half its size, metres.
    """
    cells = _painted(surface, middle, reach_m)
    if not len(cells):
        return np.zeros((0, 2)), np.zeros((0, 2))
    _, first = np.unique(np.floor(cells / _EVERY_M).astype(np.int64), axis=0, return_index=True)
    places = cells[np.sort(first)]
    tree = cKDTree(cells)
    away, number = tree.query(places, k=240, distance_upper_bound=_STRIP_M)
    near = np.isfinite(away)
    around = np.where(near[..., None], cells[np.minimum(number, len(cells) - 1)], 0.0)
    count = near.sum(axis=1)[:, None]
    mean = around.sum(axis=1) / count
    centred = np.where(near[..., None], around - mean[:, None], 0.0)
    spread = np.einsum("nki,nkj->nij", centred, centred) / count[..., None]
    value, vector = np.linalg.eigh(spread)
    line = (value[:, 0] < _WIDTH_SIGMA_M**2) & (value[:, 1] > _LENGTH_SIGMA_M**2)
    return mean[line], vector[line, :, 0]


def _painted(
    surface: SurfaceMaterials, middle: NDArray[np.float64], reach_m: float
) -> NDArray[np.float64]:
    """Return the centres (N, 2) of painted cells around a position."""
    found = [np.zeros((0, 2))]
    for layer in surface.layers:
        if layer.material != material_id("road-paint"):
            continue
        edge = layer.cell_m * TILE
        near = (np.abs((layer.tiles + 0.5) * edge - middle) < reach_m + edge).all(axis=1)
        tile, row, column = np.nonzero(np.unpackbits(layer.bits[near], axis=2))
        corner = layer.tiles[near][tile].astype(np.float64) * edge
        found.append(corner + (np.column_stack([column, row]) + 0.5) * layer.cell_m)
    return np.concatenate(found)
