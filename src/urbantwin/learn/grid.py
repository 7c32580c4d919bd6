"""The bird's-eye-view grid of a network."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIGHEST_M", "LOWEST_M", "Grid", "halvings"]

#: Range of heights of the points in use, above the ground, metres: without crowns and wires.
LOWEST_M, HIGHEST_M = -1.0, 5.0
#: Finer pillars are merged to cells of about this size before the backbone, metres: with 0.2 m
#: cells the receptive field is half as large, and cars were detected worse.
_MERGED_M = 0.4


def halvings(cell_m: float) -> int:
    """Return how often pillars of this size are merged 2 x 2."""
    return max(0, round(math.log2(_MERGED_M / cell_m)))


@dataclass(frozen=True)
class Grid:
    """A square grid; row 0 is in the south, column 0 in the west.

    Attributes:
        x: x of its south-western corner, metres.
        y: y of its south-western corner, metres.
        cell_m: edge of a cell, metres.
        cells: number of cells along an edge: a multiple of 8 (three strided layers), times 2 for
            each merging of pillars.
    """

    x: float
    y: float
    cell_m: float
    cells: int

    @classmethod
    def around(cls, x: float, y: float, half_m: float, cell_m: float) -> Grid:
        """Return the grid about a place that extends at least ``half_m`` in each direction."""
        step = 8 << halvings(cell_m)
        cells = step * int(np.ceil(2 * half_m / cell_m / step - 1e-9))
        return cls(x - cells * cell_m / 2, y - cells * cell_m / 2, cell_m, cells)

    @property
    def low(self) -> NDArray[np.float64]:
        """The south-western corner (2,), metres."""
        return np.array([self.x, self.y])

    def coarser(self, stride: int) -> Grid:
        """Return the same square with cells ``stride`` times as large."""
        return Grid(self.x, self.y, self.cell_m * stride, self.cells // stride)

    def middles(self, cell: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centres (N, 2) of cells (N,), metres."""
        row, column = np.divmod(cell, self.cells)
        return self.low + (np.column_stack([column, row]) + 0.5) * self.cell_m
