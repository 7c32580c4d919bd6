"""What stands still and what moves, where no labels say it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

__all__ = ["CELL_M", "LEAST_FRAMES", "SHARE", "Background"]

#: Edge of the cells that the background is kept in, metres.
CELL_M = 0.4
#: Share of the frames that a cell must be occupied in to be background.
SHARE = 0.5
#: Fewer frames than this tell nothing apart.
LEAST_FRAMES = 5
_BITS = 21


class Background:
    """The cells of space that hold points in most frames of a fixed sensor.

    A cell is background if it, or a cell that touches it, holds points in at least half of the
    frames: noise carries the points of a surface to and fro across the edge of a cell (the
    filter of Wu, Xu and Zheng 2017, "Automatic background filtering method for roadside LiDAR
    data", with a share in place of its density threshold). What stands still all the time, a
    parked car, is background too; a tree in the wind is now and then foreground, and what a
    sparse far beam meets only sometimes is.

    Args:
        frames: points (N, 3) of each frame, metres, one frame of reference.

    Raises:
        ValueError: fewer than ``LEAST_FRAMES`` frames.
    """

    def __init__(self, frames: Iterable[NDArray[np.float64]]) -> None:
        step = [_offset(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
        keys = []
        for points in frames:
            own = np.unique(_keys(_cells(points)))
            keys.append(np.unique(own[:, None] + np.array(step)))
        if len(keys) < LEAST_FRAMES:
            raise ValueError(f"{len(keys)} frames: at least {LEAST_FRAMES} are needed")
        cells, count = np.unique(np.concatenate(keys), return_counts=True)
        self._cells = cells[count >= SHARE * len(keys)]

    def foreground(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of (N, 3) points lie in no background cell."""
        return ~np.isin(_keys(_cells(points)), self._cells)


def _cells(points: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.floor(points / CELL_M).astype(np.int64)


def _keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number for every cell; cells beyond 400 km are put at that distance."""
    limit = 2 ** (_BITS - 1) - 2
    x, y, z = np.clip(cells, -limit, limit).T
    return np.asarray((x << (2 * _BITS)) + (y << _BITS) + z)


def _offset(x: int, y: int, z: int) -> int:
    return (x << (2 * _BITS)) + (y << _BITS) + z
