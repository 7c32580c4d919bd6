"""Where people walk, cell by cell: what stands there, and what is no footway."""

from __future__ import annotations

import numpy as np
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import rasterize
from scipy.ndimage import distance_transform_edt, uniform_filter1d

from urbantwin.traffic.compiled.ways_round import shortest_way

__all__ = ["AROUND_M", "OFF", "SOLID", "WalkedCells"]

#: What is in a cell: nothing, something that stands there, no footway.
SOLID, OFF = 1, 2
#: Size of the cells, metres.
_CELL_M = 0.2
#: A metre off the footway counts as so many on it.
_OFF_COSTS = 4.0
#: Ways round are looked for so far around their ends, metres; one that is longer than this is none:
#: there is a way through that the scene lacks.
AROUND_M, _LONGEST_M = 10.0, 30.0
#: Steps from cell to cell are levelled over so many.
_LEVELLED = 5


class WalkedCells:
    """The cells about people's ways.

    Args:
        points: (N, 2) where people walk, site frame.
        solids: outlines of what stands in the way.
        footway: where people rather are.
        margin_m: so far about the points.
    """

    def __init__(
        self,
        points: NDArray[np.float64],
        solids: NDArray[np.object_],
        footway: shapely.Geometry,
        margin_m: float,
    ) -> None:
        ends = points if len(points) else np.zeros((1, 2))
        low, high = ends.min(axis=0) - margin_m, ends.max(axis=0) + margin_m
        shape = tuple(int(n) for n in np.ceil((high - low) / _CELL_M)[::-1])
        # Rows go from the south to the north here: the raster's are turned.
        grid = Affine(_CELL_M, 0.0, low[0], 0.0, -_CELL_M, low[1] + shape[0] * _CELL_M)
        cells = np.full(shape, OFF, np.uint8)
        if not footway.is_empty:
            cells = rasterize([(footway, 0)], shape, fill=OFF, transform=grid, dtype=np.uint8)
        outlines = [(one, SOLID) for one in solids if not one.is_empty]
        if outlines:
            rasterize(outlines, out=cells, transform=grid)
        self.cells = np.ascontiguousarray(cells[::-1])
        self.corner = np.array([*low, _CELL_M])

    def _of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        cell = ((points - self.corner[:2]) / _CELL_M).astype(np.int64)[..., ::-1]
        return np.asarray(np.clip(cell, 0, np.array(self.cells.shape) - 1))

    def at(self, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return what is at points (N, 2)."""
        row, column = self._of(points).T
        return np.asarray(self.cells[row, column])

    def way(
        self, first: NDArray[np.float64], last: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Return the way (K, 2) from one place to another round what stands between; or none.

        An end where something stands is moved to where nothing does.
        """
        ends = self._of(np.array([first, last]))
        reach = round(AROUND_M / _CELL_M)
        low = np.maximum(ends.min(axis=0) - reach, 0)
        high = np.minimum(ends.max(axis=0) + reach + 1, self.cells.shape)
        part = self.cells[low[0] : high[0], low[1] : high[1]]
        if (part == SOLID).all():
            return None
        nearest = distance_transform_edt(part == SOLID, return_distances=False, return_indices=True)
        start, goal = (nearest[:, row, column] for row, column in (ends - low).tolist())
        cost = np.array([1.0, np.inf, _OFF_COSTS])[part]
        found = shortest_way(cost, start.astype(np.int64), goal.astype(np.int64))
        if not len(found) or len(found) * _CELL_M > _LONGEST_M:
            return None
        line = self.corner[:2] + ((found + low)[:, ::-1] + 0.5) * _CELL_M
        return np.asarray(uniform_filter1d(line, _LEVELLED, axis=0, mode="nearest"))
