"""The cells of the ground that a network looks at, from above."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIGHEST_M", "LOWEST_M", "Grid", "halvings"]

#: Points are told of between these heights above the ground, metres: crowns and wires are not.
LOWEST_M, HIGHEST_M = -1.0, 5.0
#: Finer pillars are merged to cells of about this edge, metres, before anything is looked for: with
#: pillars of 0.2 m a network that is as deep sees half as far around each, and told cars worse.
_MERGED_M = 0.4


def halvings(cell_m: float) -> int:
    """Return how often pillars of an edge are merged two by two."""
    return max(0, round(math.log2(_MERGED_M / cell_m)))


@dataclass(frozen=True)
class Grid:
    """A square grid; row 0 is in the south, column 0 in the west.

    Attributes:
        x: of its south-western corner, metres.
        y: of that corner.
        cell_m: edge of a cell.
        cells: along each side: a multiple of 8, as the network halves them three times, and of as
            many times 2 as pillars are merged.
    """

    x: float
    y: float
    cell_m: float
    cells: int

    @classmethod
    def around(cls, x: float, y: float, half_m: float, cell_m: float) -> Grid:
        """Return the grid about a place that reaches at least ``half_m`` each way."""
        step = 8 << halvings(cell_m)
        cells = step * int(np.ceil(2 * half_m / cell_m / step - 1e-9))
        return cls(x - cells * cell_m / 2, y - cells * cell_m / 2, cell_m, cells)

    @property
    def low(self) -> NDArray[np.float64]:
        """The south-western corner (2,), metres."""
        return np.array([self.x, self.y])

    def coarser(self, stride: int) -> Grid:
        """Return the same square in cells that are ``stride`` times as large."""
        return Grid(self.x, self.y, self.cell_m * stride, self.cells // stride)

    def middles(self, cell: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the middles (N, 2) of numbered cells (N,), metres."""
        row, column = np.divmod(cell, self.cells)
        return self.low + (np.column_stack([column, row]) + 0.5) * self.cell_m
