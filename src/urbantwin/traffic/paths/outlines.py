"""Outlines in plan of what stands, and which boxes come near to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.traffic.paths.box_plan import PlanBoxes

__all__ = ["Outlines"]

#: What is near whom is found first by cells of this size, metres.
_CELL_M = 1.0


class Outlines:
    """Shapes in plan; how far it is to the nearest is kept cell by cell, once it was asked.

    Args:
        shapes: S of them, site frame.
    """

    def __init__(self, shapes: ArrayLike) -> None:
        self._tree = shapely.STRtree(shapes)
        self._cells, self._away = np.zeros(0, np.int64), np.zeros(0)

    def near(self, xy: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the rows (R,) of points (N, 2) that shapes may be nearer to than ``reach`` (N,).

        It is looked at cell by cell, so that rows that are near each other cost as one.
        """
        if not len(xy) or not len(self._tree):
            return np.zeros(0, np.int64)
        key = np.round(xy / _CELL_M).astype(np.int64) @ np.array([1 << 32, 1])
        cells, which = np.unique(key, return_inverse=True)
        return np.flatnonzero(self._away_from(cells)[which] - _CELL_M <= reach)

    def beside(
        self, boxes: PlanBoxes, within_m: float = 0.0
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows (P,) of boxes that come near to shapes, and which these are (P,).

        Args:
            boxes: N of them.
            within_m: boxes are grown by so much to each side, metres.
        """
        near = self.near(boxes.xy, np.hypot(*boxes.half.T) + within_m)
        wide = replace(boxes, half=boxes.half + within_m).take(near)
        row, shape = self._tree.query(wide.polygons, predicate="intersects")
        return near[row], shape

    def _away_from(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how far it is from the middle of cells (C,), sorted, to the nearest shape."""
        new = np.setdiff1d(cells, self._cells, assume_unique=True)
        if len(new):
            y = (new + (1 << 31)) % (1 << 32) - (1 << 31)
            middle = np.column_stack([(new - y) >> 32, y]) * _CELL_M
            (cell, _), found = self._tree.query_nearest(
                shapely.points(middle), return_distance=True, all_matches=False
            )
            away = np.full(len(new), np.inf)
            away[cell] = found
            at = np.searchsorted(self._cells, new)
            self._cells = np.insert(self._cells, at, new)
            self._away = np.insert(self._away, at, away)
        return self._away[np.searchsorted(self._cells, cells)]
