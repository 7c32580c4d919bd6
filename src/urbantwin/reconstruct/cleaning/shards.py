"""Shards: pieces of a mesh that float, or that are too small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.contact import Contacts
from urbantwin.reconstruct.cleaning.height_grid import Grid, filled
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.removal import Removal, Spots
from urbantwin.reconstruct.cleaning.street_surface import bare_earth
from urbantwin.reconstruct.cleaning.weld import Pieces

__all__ = ["Shards", "find_shards"]

#: Maximum gap of pieces that support each other, metres: gaps of models and of scans.
_TOUCH_M = 0.12
#: Maximum height of a piece's foot above its support, metres.
_FOOT_M = 0.3
#: Minimum length of a ground piece, metres.
_GROUND_SIDE_M = 4.0
#: A crown without its trunk: minimum thickness, minimum length, and maximum height above ground,
#: metres.
_CROWN_M = (1.0, 2.5, 6.0)
#: A wire: minimum length, maximum sag, and maximum width, metres.
_WIRE_M = (8.0, 6.0, 0.5)
#: Cell size of the ground grid, metres.
_CELL_M = 1.0


@dataclass(frozen=True, eq=False)
class Shards:
    """Shards to remove, and pieces that an override kept.

    Attributes:
        faces: (F,) bool, triangles of shards.
        removed: the shards.
        kept: pieces that an override kept against the rules.
    """

    faces: NDArray[np.bool_]
    removed: list[Removal]
    kept: list[Removal]


def find_shards(mesh: TriangleMesh, pieces: Pieces, smallest_m: float, keep: Spots) -> Shards:
    """Return the pieces of a mesh that float or are too small.

    Touching pieces support each other. A piece is supported if its foot is on the ground or on a
    supported piece, or if it touches one: a lamp post, a roof on walls, a sign on its pole, the
    leaves of a tree. All other pieces float, and are shards; so are pieces smaller than
    ``smallest_m`` that only touch the ground. Two kinds of floating objects are kept: crowns of
    trees whose trunk was not scanned, and wires.

    Args:
        mesh: welded, site frame, metres.
        pieces: pieces of the mesh.
        smallest_m: minimum length of a piece's longest side, metres.
        keep: overrides that keep pieces.
    """
    none = np.zeros(len(mesh.faces), bool)
    if len(pieces) < 2:
        return Shards(none, [], [])
    standing = _standing(mesh, pieces)
    ground, on_ground, base = standing.ground, standing.on_ground, standing.base
    longest = pieces.size.max(axis=1)
    small = longest < smallest_m
    loose = ~on_ground | (small & ~ground)
    touching = Contacts(mesh, pieces, loose, standing.wide, standing.rays)
    pairs = np.concatenate([touching.within(_TOUCH_M), touching.resting(_FOOT_M)])
    # A small piece is supported by objects, not by the ground it lies on.
    lies = (small[pairs[:, 0]] & ground[pairs[:, 1]]) | (small[pairs[:, 1]] & ground[pairs[:, 0]])
    pairs = pairs[~lies]
    stands = _reached(pairs, ground | (on_ground & ~small))
    shard = ~stands & ~_crowns_and_wires(pieces, pairs, stands, base)
    numbers = np.flatnonzero(shard)
    kept_here = keep.near(pieces.middle[numbers])
    removed: list[Removal] = []
    kept: list[Removal] = []
    middle, extent = pieces.middle, pieces.size
    for number, spared in zip(numbers.tolist(), kept_here.tolist(), strict=True):
        gap = float(pieces.low[number, 2] - base[number])
        if not small[number]:
            why = f"floats {gap:.2f} m over what is below" if gap > 0 else "held by nothing"
        elif gap > _FOOT_M:
            why = f"smaller than {smallest_m:g} m, floats {gap:.2f} m over what is below"
        else:
            why = f"smaller than {smallest_m:g} m, part of nothing"
        size = extent[number]
        one = Removal(
            "shard",
            why,
            middle[number],
            np.array([size[:2].max(), size[:2].min(), size[2]]),
            float(pieces.area[number]),
            int(pieces.triangles[number]),
        )
        (kept if spared else removed).append(one)
    gone = np.zeros(len(pieces), bool)
    gone[numbers[~kept_here]] = True
    return Shards(gone[pieces.of_face], removed, kept)


@dataclass(frozen=True, eq=False)
class _Standing:
    """Of K pieces: ground, supported by ground, ground height; the wide pieces and their rays."""

    ground: NDArray[np.bool_]
    on_ground: NDArray[np.bool_]
    base: NDArray[np.float64]
    wide: NDArray[np.bool_]
    rays: Rays


def _standing(mesh: TriangleMesh, pieces: Pieces) -> _Standing:
    """Return the pieces that are ground or on the ground, and the ground's height there."""
    wide = pieces.size[:, :2].max(axis=1) >= _GROUND_SIDE_M
    if not wide.any():
        wide = pieces.area >= 0.2 * pieces.area.max()
    grid = Grid.over(
        (*pieces.low[:, :2].min(axis=0), *pieces.high[:, :2].max(axis=0)), _grid_step(pieces)
    )
    some = wide[pieces.of_face]
    rays = Rays(mesh.vertices, mesh.faces[some])
    below = float(pieces.low[:, 2].min()) - 1.0
    lowest = rays.heights(grid.centres(), below, up=True).reshape(grid.shape)
    earth = filled(np.where(bare_earth(lowest, grid.step), lowest, np.nan))
    foot = mesh.vertices[pieces.foot]
    # On a slope the foot's cell may be higher than the foot, so its own height there counts.
    row, column = grid.cells(foot[:, :2])
    base = earth[row, column]
    slack = _FOOT_M + 0.1 * grid.step
    on_ground = foot[:, 2] <= base + slack
    # a house in a model without ground, with nothing below
    nothing = np.isnan(rays.heights(foot[:, :2], foot[:, 2] - 1e-3))
    nothing &= np.isnan(rays.heights(pieces.middle[:, :2], pieces.low[:, 2] - 1e-3))
    on_ground |= wide & nothing
    # Ground is wide, with most vertices at ground height.
    at = earth[grid.cells(mesh.vertices[:, :2])]
    low = np.abs(mesh.vertices[:, 2] - at) < slack
    of_vertex = np.zeros(len(mesh.vertices), np.int32)
    of_vertex[mesh.faces.ravel()] = np.repeat(pieces.of_face, 3)
    share = np.bincount(of_vertex, low, len(pieces)) / np.maximum(
        np.bincount(of_vertex, minlength=len(pieces)), 1
    )
    flat = pieces.size[:, 2] < np.maximum(0.3 * pieces.size[:, :2].max(axis=1), 0.05)
    ground = on_ground & wide & (share > 0.3)
    # Slabs of a pavement are flat, with nothing below.
    under = rays.heights(pieces.middle[:, :2], pieces.low[:, 2] - 1e-3)
    ground |= on_ground & flat & np.isnan(under) & ~wide & (share > 0.5)
    return _Standing(ground, on_ground, base, wide, rays)


def _grid_step(pieces: Pieces) -> float:
    span = float((pieces.high[:, :2].max(axis=0) - pieces.low[:, :2].min(axis=0)).max())
    return max(_CELL_M, span / 2000)


def _crowns_and_wires(
    pieces: Pieces,
    pairs: NDArray[np.int64],
    stands: NDArray[np.bool_],
    base: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the mask of pieces (K,) in floating groups with the shape of a crown or a wire."""
    floats = ~stands
    count = len(pieces)
    pairs = pairs[floats[pairs].all(axis=1)]
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), (count, count))
    number, label = connected_components(graph, directed=False)
    low, high = np.full((number, 3), np.inf), np.full((number, 3), -np.inf)
    np.minimum.at(low, label, pieces.low)
    np.maximum.at(high, label, pieces.high)
    under = np.full(number, np.inf)
    np.minimum.at(under, label, pieces.low[:, 2] - base)
    size = high - low
    crown = (size.min(axis=1) > _CROWN_M[0]) & (size.max(axis=1) > _CROWN_M[1])
    crown &= under < _CROWN_M[2]
    wire = (size[:, :2].max(axis=1) > _WIRE_M[0]) & (size[:, 2] < _WIRE_M[1])
    wire &= np.bincount(label, pieces.area, number) < _WIRE_M[2] * size.max(axis=1)
    return np.asarray(floats & (crown | wire)[label])


def _reached(pairs: NDArray[np.int64], start: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask of K items connected to one of ``start`` (K,) by pairs."""
    count = len(start)
    # an additional item connected to all of the start
    rows = np.concatenate([pairs[:, 0], np.flatnonzero(start)])
    columns = np.concatenate([pairs[:, 1], np.full(int(start.sum()), count)])
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count + 1, count + 1))
    _, label = connected_components(graph, directed=False)
    return np.asarray(label[:count] == label[count])
