"""The ground that people walk on: what stands near their ways, and where there is footway."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from urbantwin.traffic.compiled.asides import BESIDE_M
from urbantwin.traffic.compiled.crowd import MOST_M
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.footing import BODY_M
from urbantwin.traffic.paths.solids import ROOM_M
from urbantwin.traffic.paths.walked_cells import WalkedCells

__all__ = ["WalkedGround", "box_rows"]

#: What stands is looked up in cells of this size, metres.
_STILL_CELL_M = 2.0
#: Who has little room keeps so far from what stands, metres, from the middle.
_TIGHT_M = 0.1


class WalkedGround:
    """What people go between.

    Attributes:
        boxes: (B, 7) what stands on the ground, see ``compiled.crowd.walked``, like what follows.
        still: where the numbers of what stands begin of each cell.
        numbers: those numbers.
        within: those cells.
        cells: what is where they walk.

    Args:
        xy: (N, 2) where people walk, site frame.
        blocks: what stands on the ground.
        solids: outlines of what stands in people's way.
        footway: who is on it stays there.
    """

    def __init__(
        self,
        xy: NDArray[np.float64],
        blocks: PlanBoxes,
        solids: NDArray[np.object_],
        footway: shapely.Geometry,
    ) -> None:
        self.boxes = box_rows(blocks.xy, blocks.yaw, blocks.half)
        points = xy if len(xy) else np.zeros((1, 2))
        self.still, self.numbers, self.within = _still_cells(points, blocks)
        inner = shapely.buffer(solids, _TIGHT_M - ROOM_M)
        self.cells = WalkedCells(points, inner, footway, MOST_M + 1.0)
        self._beside_road = shapely.buffer(footway, -BODY_M)
        shapely.prepare(self._beside_road)

    def on_footway(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (K, 2) are on the footway, with room for a body."""
        return np.asarray(shapely.contains_xy(self._beside_road, *xy.T), np.bool_)


def box_rows(
    xy: NDArray[np.float64], yaw: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return boxes as rows (N, 7), see ``compiled.crowd.walked``."""
    return np.column_stack([xy, np.cos(yaw), np.sin(yaw), half, np.hypot(*half.T)])


def _still_cells(
    xy: NDArray[np.float64], blocks: PlanBoxes
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return what stands near each cell where people walk, see ``compiled.crowd.walked``."""
    low = xy.min(axis=0) - 2 * _STILL_CELL_M
    cell = ((xy - low) / _STILL_CELL_M).astype(np.int64)
    shape = cell.max(axis=0) + 3
    used = np.zeros(shape[::-1], np.bool_)
    used[cell[:, 1], cell[:, 0]] = True
    row, column = np.nonzero(binary_dilation(used, np.ones((3, 3), np.bool_)))
    west, south = low[0] + column * _STILL_CELL_M, low[1] + row * _STILL_CELL_M
    squares = shapely.box(west, south, west + _STILL_CELL_M, south + _STILL_CELL_M)
    tree = shapely.STRtree(blocks.polygons)
    which, block = tree.query(squares, predicate="dwithin", distance=BESIDE_M)
    order = np.lexsort([block, which])
    counts = np.zeros(int(shape.prod()) + 1, np.int64)
    number = row * shape[0] + column
    np.add.at(counts, number[which] + 1, 1)
    # Cells are numbered by row, and so are the squares.
    return (
        np.cumsum(counts),
        block[order].astype(np.int64),
        np.array([*low, _STILL_CELL_M, *shape], np.float64),
    )
