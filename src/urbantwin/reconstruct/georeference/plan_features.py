"""Features of a model in plan that a map shows too: walls, tall objects and the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_erosion,
    distance_transform_edt,
    maximum_filter,
    median_filter,
    minimum_filter,
)

from urbantwin.reconstruct.georeference.ground_level import Samples

__all__ = ["PlanFeatures", "plan_features"]

#: What stands higher than this above the ground is a building or a tree, metres.
TALL_M = 2.5
#: A wall counts from this height above the ground on: below stand cars and hedges, metres.
_WALL_M = 2.0
#: The widest building under which the ground is still found, metres.
_WIDEST_M = 60.0
_MOST_CELLS = 2_000_000
_MOST_WALLS = 20_000
#: A triangle steeper than this is of a wall: sine of 10 degrees.
_STEEP = 0.17


@dataclass(frozen=True, eq=False)
class PlanFeatures:
    """A model in plan, z-up, in metres.

    Attributes:
        tall: (T, 2) middles of cells where something stands high.
        low: (L, 2) middles of cells that were seen and where nothing does.
        walls: (W, 2) points on steep surfaces that stand high.
        wall_normals: (W, 2) their unit normals; ``None`` where the model is points only.
        ground: (G, 3) points of the ground.
        cell_m: size of the cells.
    """

    tall: NDArray[np.float64]
    low: NDArray[np.float64]
    walls: NDArray[np.float64]
    wall_normals: NDArray[np.float64] | None
    ground: NDArray[np.float64]
    cell_m: float


def plan_features(samples: Samples) -> PlanFeatures:
    """Find what can be recognised in points all over a model (z-up, metres)."""
    points = samples.points
    corner = np.quantile(points[:, :2], 0.001, axis=0) - 5.0
    size = np.quantile(points[:, :2], 0.999, axis=0) + 5.0 - corner
    # As fine as most cells still hold a point.
    cell = max(1.0, float(np.sqrt(size[0] * size[1] / _MOST_CELLS)))
    cell = max(cell, 1.5 * float(np.sqrt(size[0] * size[1] / max(1, len(points)))))
    nx, ny = (int(n) for n in np.ceil(size / cell))
    column, row = np.floor((points[:, :2] - corner) / cell).astype(np.int64).T
    inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
    points, column, row = points[inside], column[inside], row[inside]
    lowest = np.full((ny, nx), np.inf)
    highest = np.full((ny, nx), -np.inf)
    np.minimum.at(lowest, (row, column), points[:, 2])
    np.maximum.at(highest, (row, column), points[:, 2])
    seen = np.isfinite(lowest)
    ground = _ground(lowest, seen, cell)
    tall = seen & (highest - ground > TALL_M)
    low = seen & ~tall
    on_ground = low & (lowest - ground < 0.5)
    above = points[:, 2] - ground[row, column]
    walls, normals = _walls(samples, inside, points, above, tall, corner, cell)
    return PlanFeatures(
        _middles(tall, corner, cell),
        _middles(low, corner, cell),
        walls,
        normals,
        np.column_stack([_middles(on_ground, corner, cell), lowest[on_ground]]),
        cell,
    )


def _ground(
    lowest: NDArray[np.float64], seen: NDArray[np.bool_], cell: float
) -> NDArray[np.float64]:
    """Return the ground under everything: an opening, which leaves an even slope as it is."""
    rows, columns = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    filled = median_filter(lowest[rows, columns], 3, mode="nearest")
    window = 2 * int(_WIDEST_M / cell / 2) + 1
    opened = minimum_filter(filled, window, mode="nearest")
    opened = maximum_filter(opened, window, mode="nearest")
    return np.asarray(np.minimum(opened, filled))


def _walls(
    samples: Samples,
    inside: NDArray[np.bool_],
    points: NDArray[np.float64],
    above: NDArray[np.float64],
    tall: NDArray[np.bool_],
    corner: NDArray[np.float64],
    cell: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    if samples.normals is not None:
        normals = samples.normals[inside]
        steep = (np.abs(normals[:, 2]) < _STEEP) & (above > _WALL_M)
        if steep.sum() >= 200:
            chosen = np.flatnonzero(steep)
            chosen = chosen[:: max(1, len(chosen) // _MOST_WALLS)]
            across = normals[chosen, :2]
            across = across / np.linalg.norm(across, axis=1, keepdims=True)
            return points[chosen, :2], across
    edge = tall & ~binary_erosion(tall)
    return _middles(edge, corner, cell), None


def _middles(
    mask: NDArray[np.bool_], corner: NDArray[np.float64], cell: float
) -> NDArray[np.float64]:
    row, column = np.nonzero(mask)
    return np.asarray(corner + (np.column_stack([column, row]) + 0.5) * cell)
