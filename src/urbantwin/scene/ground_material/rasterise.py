"""Rasterising areas and classified cells into the tiles of a layer."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry.surface_material import TILE, MaterialLayer

__all__ = ["Cells", "cells_of_layer", "cells_of_quads", "layer_of_cells"]

#: Columns and rows (N, 2) of cells.
Cells = NDArray[np.int64]
#: Heights (N,) of a surface at points (N, 2).
Heights = Callable[[NDArray[np.float64]], NDArray[np.float64]]
#: Number of cells processed in one batch.
BATCH = 2_000_000
#: Approximate length of the pieces into which shapes are cut, metres: the axis-aligned box of a
#: long slanted line has ten times its cells.
PIECE_M = 0.5


def cells_of_quads(
    quads: NDArray[np.float64], cell_m: float, within: shapely.Geometry | None = None
) -> Cells:
    """Return the cells whose centre is in any of some convex quadrilaterals, each once.

    Args:
        quads: (N, 4, 2) corners, metres, in either order; a triangle has a corner twice.
        cell_m: side of a cell, metres.
        within: area to which the cells are limited.
    """
    if within is not None:
        shapely.prepare(within)
        inside = shapely.covers(within, shapely.polygons(quads))
        touching = ~inside & shapely.intersects(within, shapely.polygons(quads))
        found = _unique(_inside(quads[touching], cell_m))
        middle = (found + 0.5) * cell_m
        found = found[shapely.contains_xy(within, middle[:, 0], middle[:, 1])]
        return _unique(iter([found, *_inside(quads[inside], cell_m)]))
    return _unique(_inside(quads, cell_m))


def _inside(quads: NDArray[np.float64], cell_m: float) -> Iterator[Cells]:
    """Yield cells of batches of quadrilaterals; a cell in two of them appears twice."""
    quads = _pieces(quads)
    area = np.sum(
        quads[..., 0] * np.roll(quads[..., 1], -1, 1)
        - quads[..., 1] * np.roll(quads[..., 0], -1, 1),
        axis=1,
    )
    around = np.where((area > 0)[:, None, None], quads, quads[:, ::-1]) / cell_m
    low = np.floor(around.min(axis=1)).astype(np.int64)
    size = np.floor(around.max(axis=1)).astype(np.int64) - low + 1
    count = size.prod(axis=1)
    ends = np.cumsum(count)
    first = 0
    while first < len(quads):
        before = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, before + BATCH, side="right")))
        part = slice(first, last)
        which = np.repeat(np.arange(first, last), count[part])
        step = np.arange(len(which)) - np.repeat(ends[part] - count[part] - before, count[part])
        cell = low[which] + np.column_stack([step % size[which, 0], step // size[which, 0]])
        middle = cell + 0.5
        good = np.ones(len(cell), bool)
        for k in range(4):
            a, b = around[which, k], around[which, (k + 1) % 4]
            edge, way = b - a, middle - a
            good &= edge[:, 0] * way[:, 1] - edge[:, 1] * way[:, 0] >= -1e-9
        yield cell[good]
        first = last


def _pieces(quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quadrilaterals cut across their longer sides."""
    sides = np.linalg.norm(quads - np.roll(quads, -1, axis=1), axis=2)
    along = np.maximum(sides[:, 0], sides[:, 2])
    across = np.maximum(sides[:, 1], sides[:, 3])
    turned = np.where((along >= across)[:, None, None], quads, np.roll(quads, -1, axis=1))
    count = np.maximum(1, np.ceil(np.maximum(along, across) / PIECE_M)).astype(np.int64)
    which = np.repeat(np.arange(len(quads)), count)
    step = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    low, high = (((step + k) / count[which])[:, None] for k in (0, 1))
    a, b, c, d = np.moveaxis(turned[which], 1, 0)
    return np.stack(
        [a + (b - a) * low, a + (b - a) * high, d + (c - d) * high, d + (c - d) * low], axis=1
    )


def _unique(parts: Iterator[Cells]) -> Cells:
    whole = np.concatenate([np.zeros((0, 2), np.int64), *parts])
    # Sorted and not hashed as in ``np.unique``, which is several times slower.
    keys = np.sort((whole[:, 1] << 32) + whole[:, 0] + (1 << 31))
    keys = keys[np.diff(keys, prepend=keys[:1] - 1) != 0]
    return np.column_stack([(keys & 0xFFFFFFFF) - (1 << 31), keys >> 32])


def cells_of_layer(layer: MaterialLayer) -> Cells:
    """Return the columns and rows (N, 2) of a layer's cells."""
    tile, row, column = np.nonzero(np.unpackbits(layer.bits, axis=2))
    return layer.tiles[tile].astype(np.int64) * TILE + np.column_stack([column, row])


def layer_of_cells(
    cells: Cells, *, material: int, level: int, cell_m: float, height: Heights
) -> MaterialLayer:
    """Return the layer of some cells.

    Args:
        cells: columns and rows, each cell once.
        material: number of their material.
        level: level of their surface.
        cell_m: side of a cell, metres.
        height: height of the surface.
    """
    tile = cells // TILE
    order = np.lexsort((tile[:, 0], tile[:, 1]))
    cells, tile = cells[order], tile[order]
    new = np.ones(len(tile), bool)
    new[1:] = (tile[1:] != tile[:-1]).any(axis=1)
    tiles = tile[new]
    grid = np.zeros((len(tiles), TILE, TILE), bool)
    within = cells - tile * TILE
    grid[np.cumsum(new) - 1, within[:, 1], within[:, 0]] = True
    corners = tiles[:, None, None] + np.array([[[0, 0], [1, 0]], [[0, 1], [1, 1]]])
    places, where = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    z = height(places * (TILE * cell_m)) if len(places) else np.zeros(0)
    return MaterialLayer(
        material,
        level,
        cell_m,
        tiles.astype(np.int32),
        np.packbits(grid, axis=2),
        z[where.ravel()].reshape(-1, 2, 2).astype(np.float32),
    )
