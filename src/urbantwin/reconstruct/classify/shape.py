"""Classification by shape and colour: buildings, plants, poles, other objects."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.classify.colours import is_green
from urbantwin.reconstruct.classify.terrain import Terrain
from urbantwin.reconstruct.cleaning.weld import Pieces, pieces_of, selected
from urbantwin.taxonomy import semantic_id

__all__ = ["classes_by_shape"]

#: Size of the columns in which directions of faces are counted, metres: larger than a window,
#: smaller than a tree.
_COLUMN_M = 2.5
#: Share of the area in the three most frequent of 26 directions below which a column is rough:
#: nearly 1 for walls and roofs, about 0.35 for a sphere, less for leaves.
_ROUGH = 0.45
#: Minimum height and area of buildings.
_HOUSE_HEIGHT_M, _HOUSE_AREA_M2 = 2.2, 6.0
#: Minimum height and maximum width of poles.
_POLE_HEIGHT_M, _POLE_WIDTH_M = 1.8, 1.2


def classes_by_shape(
    mesh: TriangleMesh, terrain: Terrain, roads: shapely.Geometry | None
) -> NDArray[np.uint16]:
    """Return the class (F,) of triangles of objects on the ground.

    Args:
        mesh: the objects only; site frame, metres, every vertex used.
        terrain: the ground under it.
        roads: carriageways, to find decks over them.
    """
    out = np.full(len(mesh.faces), semantic_id("other-object"), np.uint16)
    if not len(mesh.faces):
        return out
    corner = mesh.vertices[mesh.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    normal = cross / np.maximum(2 * area, 1e-12)[:, None]
    plant = _plants(mesh, corner, normal, area, terrain)
    out[plant] = semantic_id("vegetation")
    rest = np.flatnonzero(~plant)
    if len(rest):
        part = selected(mesh, rest)
        out[rest] = _things(part, pieces_of(part), normal[rest], area[rest], terrain, roads)
    return out


def _plants(
    mesh: TriangleMesh,
    corner: NDArray[np.float64],
    normal: NDArray[np.float64],
    area: NDArray[np.float64],
    terrain: Terrain,
) -> NDArray[np.bool_]:
    """Return the mask of triangles of plants: faces in all directions, or green and not flat."""
    middle = corner.mean(axis=1)
    column = np.floor((middle[:, :2] - mesh.vertices[:, :2].min(axis=0)) / _COLUMN_M).astype(int)
    width = int(column[:, 1].max()) + 3
    number = (column[:, 0] + 1) * width + column[:, 1] + 1
    count = (int(column[:, 0].max()) + 3) * width
    way = np.rint(normal * 1.2).astype(int) + 1  # 26 directions, the central cell is unused
    direction = (way[:, 0] * 3 + way[:, 1]) * 3 + way[:, 2]
    spread = np.bincount(number * 27 + direction, area, count * 27).reshape(-1, 27)
    commonest = np.partition(spread, -3, axis=1)[:, -3:].sum(axis=1)
    total = spread.sum(axis=1)
    planar = np.divide(commonest, total, out=np.ones_like(total), where=total > 0)
    # Columns are averaged over their neighbours by area: corners of houses are not plants.
    grid, weight = (planar * total).reshape(-1, width), total.reshape(-1, width)
    mean = _around(grid) / np.maximum(_around(weight), 1e-9)
    flat = mean.ravel()[number]
    rough = flat < _ROUGH
    if mesh.colour is None:
        return np.asarray(rough)
    green = np.bincount(number, area * is_green(mesh.colour), count)
    share = np.divide(green, total, out=np.zeros_like(total), where=total > 0)[number]
    leafy = (share > 0.5) & (flat < 0.85) & is_green(mesh.colour)
    high = middle[:, 2] - terrain.under(middle) > 0.3
    grey = share < 0.15
    coloured = bool(np.ptp(mesh.colour, axis=0).max() > 20)
    return np.asarray((rough & ~(grey & coloured & (flat > 0.35))) | (leafy & high))


def _around(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sums over each cell and its eight neighbours."""
    padded = np.pad(grid, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])


def _things(
    part: TriangleMesh,
    pieces: Pieces,
    normal: NDArray[np.float64],
    area: NDArray[np.float64],
    terrain: Terrain,
    roads: shapely.Geometry | None,
) -> NDArray[np.uint16]:
    """Return the class (F,) of triangles by their connected piece."""
    size = pieces.size
    base = terrain.under(pieces.middle)
    rise = pieces.high[:, 2] - base
    longest, shortest = size[:, :2].max(axis=1), size[:, :2].min(axis=1)
    count = len(pieces)
    upward = np.bincount(pieces.of_face, area * np.maximum(normal[:, 2], 0), count)
    upright = np.bincount(pieces.of_face, area * (np.abs(normal[:, 2]) < 0.3), count)
    plan = np.maximum(upward, 0.0)
    # wall area relative to the walls of the bounding box
    walled = upright / np.maximum(2 * size[:, :2].sum(axis=1) * np.maximum(size[:, 2], 0.1), 1e-6)
    gap = pieces.low[:, 2] - base

    kind = np.full(count, semantic_id("other-object"), np.uint16)
    house = (rise >= _HOUSE_HEIGHT_M) & (plan >= _HOUSE_AREA_M2) & (shortest >= 1.8)
    kind[house] = semantic_id("building")
    thin = (shortest < 0.7) & (longest > 2.0) & (rise < 4.0) & (rise > 0.4) & (longest > rise)
    kind[thin & ~house] = semantic_id("fence")
    slim = (size[:, 2] >= _POLE_HEIGHT_M) & (longest <= np.maximum(_POLE_WIDTH_M, size[:, 2] / 2))
    slim &= plan < 1.5
    kind[slim & ~house] = semantic_id("pole")
    deck = (walled < 0.25) & (plan > 10.0) & (gap > 1.5)
    if roads is not None and not roads.is_empty:
        middle = part.vertices[part.faces].mean(axis=1)
        over = shapely.contains_xy(roads, middle[:, 0], middle[:, 1])
        share = np.bincount(pieces.of_face, area * over, count) / np.maximum(pieces.area, 1e-9)
        deck |= (walled < 0.35) & (share > 0.4) & (plan > 10.0)
    kind[deck] = semantic_id("other-structure")
    return kind[pieces.of_face]
