"""Features of a model in plan that a map also shows: walls, tall objects and the ground."""

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

#: Minimum height of buildings and trees above the ground, metres.
TALL_M = 2.5
#: Minimum height above the ground of wall points, above cars and hedges, metres.
_WALL_M = 2.0
#: Maximum width of buildings under which the ground is found, metres.
_WIDEST_M = 60.0
_MOST_CELLS = 2_000_000
_MOST_WALLS = 20_000
#: Maximum vertical component of a wall's normal: sine of 10 degrees.
_STEEP = 0.17


@dataclass(frozen=True, eq=False)
class PlanFeatures:
    """A model in plan, z-up, in metres.

    Attributes:
        tall: (T, 2) centres of cells with tall objects.
        low: (L, 2) centres of visible cells without.
        walls: (W, 2) points on tall steep surfaces.
        wall_normals: (W, 2) their unit normals; ``None`` for point clouds.
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
    """Return the features of points of a whole model (z-up, metres)."""
    points = samples.points
    corner = np.quantile(points[:, :2], 0.001, axis=0) - 5.0
    size = np.quantile(points[:, :2], 0.999, axis=0) + 5.0 - corner
    # the finest size at which most cells have a point
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
    """Return the ground under all objects by an opening, which preserves even slopes."""
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
