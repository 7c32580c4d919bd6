"""Pillars: the input of the network.

Lang et al. 2019, "PointPillars: Fast Encoders for Object Detection from Point Clouds", with
heights above the ground in place of heights above the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.compiled.gather import cells_of, filled_rows, gathered
from urbantwin.learn.grid import HIGHEST_M, LOWEST_M, Grid

__all__ = ["MOST_POINTS", "Pillars", "features_of", "pillars_of", "stacked", "told_of_point"]
__all__ += ["told_of_points"]

#: Largest number of points in a pillar.
MOST_POINTS = 16
#: Unit of heights in the features, metres.
_HEIGHT_M = 2.0


@dataclass(frozen=True, eq=False)
class Pillars:
    """The occupied cells of a grid.

    Attributes:
        features: (P, `MOST_POINTS`, `features_of`) float32; unused rows are 0.
        points: (P,) int64: number of points of each pillar.
        cell: (P,) int64: cell of each pillar.
    """

    features: NDArray[np.float32]
    points: NDArray[np.int64]
    cell: NDArray[np.int64]


def features_of(*, intensity: bool) -> int:
    """Return the number of features of a point in a pillar."""
    return 9 if intensity else 8


def told_of_point(features: int) -> int:
    """Return the number of features of a single point, given that of points in pillars."""
    return features - 5


def told_of_points(
    points: NDArray[np.float32], grid: Grid
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """Return the features of single points (K, 3+), their cells (K,) and row numbers (K,).

    Features are the offset from the centre of the cell (2, in cells), the height, and intensity if
    it is used.

    Args:
        points: (N, 3 or 4) as `pillars_of` takes them; those outside the grid are left out.
        grid: grid of the pillars.
    """
    cell = cells_of(points, grid.low, grid.cell_m, grid.cells, grid.cells, LOWEST_M, HIGHEST_M)
    inside = np.flatnonzero(cell >= 0)
    told = points[inside].copy()
    told[:, :2] = (points[inside, :2] - grid.middles(cell[inside])) / grid.cell_m
    told[:, 2] /= _HEIGHT_M
    return told, cell[inside], inside


def pillars_of(points: NDArray[np.float32], grid: Grid) -> Pillars:
    """Return the pillars of points.

    Args:
        points: (N, 3 or 4): x, y, height above the ground in metres, and intensity if it is used.
        grid: grid of the pillars.
    """
    low = grid.low
    cell = cells_of(points, low, grid.cell_m, grid.cells, grid.cells, LOWEST_M, HIGHEST_M)
    return Pillars(
        *gathered(points, cell, low, grid.cell_m, grid.cells, grid.cells, MOST_POINTS, _HEIGHT_M)
    )


def stacked(parts: Sequence[Pillars], cells: int) -> dict[str, NDArray[Any]]:
    """Concatenate the pillars of several grids into a training batch, by name.

    ``features`` (N, `features_of`) of all points, pillar by pillar; ``points`` (P,) int64: number
    of points of each pillar; ``cell`` (P,) int64: consecutive over the grids.

    Args:
        parts: pillars of each grid.
        cells: number of cells along the edge of a grid.
    """
    return {
        "features": np.concatenate([filled_rows(one.features, one.points) for one in parts]),
        "points": np.concatenate([one.points for one in parts]),
        "cell": np.concatenate([one.cell + number * cells**2 for number, one in enumerate(parts)]),
    }
