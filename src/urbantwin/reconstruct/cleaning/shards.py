"""Shards: pieces of a mesh that float, or that are too small to be anything."""

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

#: Pieces nearer than this hold each other, metres: gaps of models and of scans.
_TOUCH_M = 0.12
#: A piece whose foot is at most this far over what is below stands on it, metres.
_FOOT_M = 0.3
#: Pieces with a side of this length or more may be the ground, metres.
_GROUND_SIDE_M = 4.0
#: A crown without its trunk: at least this thick and this long, at most this high up, metres.
_CROWN_M = (1.0, 2.5, 6.0)
#: A wire: at least this long, sagging less than this, and not this wide, metres.
_WIRE_M = (8.0, 6.0, 0.5)
#: Cells of the grid of the ground, metres.
_CELL_M = 1.0


@dataclass(frozen=True, eq=False)
class Shards:
    """What is to go and what an override kept.

    Attributes:
        faces: (F,) bool, triangles of shards.
        removed: the shards.
        kept: pieces that the rules would have taken and an override kept.
    """

    faces: NDArray[np.bool_]
    removed: list[Removal]
    kept: list[Removal]


def find_shards(mesh: TriangleMesh, pieces: Pieces, smallest_m: float, keep: Spots) -> Shards:
    """Return the pieces of a mesh that float or are too small.

    Pieces hold each other where they touch. A piece stands if its foot is on the ground or on a
    piece that stands, or if a piece that stands holds it: a lamp post, a roof on walls, a sign
    on its pole, the leaves of a tree. Everything else floats, and is a shard; so is what is
    smaller than ``smallest_m`` and held by the ground alone. Two things float and stay: the crown
    of a tree whose trunk no scan saw, and wires.

    Args:
        mesh: welded, site frame, metres.
        pieces: of the mesh.
        smallest_m: pieces whose longest side is below this are too small, metres.
        keep: pieces that stay whatever the rules say.
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
    # A small piece is carried by a thing, not by the ground that it happens to lie on.
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
    """Of K pieces: which are ground, which stand on it, its height there; the wide ones' rays."""

    ground: NDArray[np.bool_]
    on_ground: NDArray[np.bool_]
    base: NDArray[np.float64]
    wide: NDArray[np.bool_]
    rays: Rays


def _standing(mesh: TriangleMesh, pieces: Pieces) -> _Standing:
    """Return which pieces are ground, which stand on it, and the ground's height there."""
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
    # On a slope the foot's cell may be higher than the foot: its own height there decides.
    row, column = grid.cells(foot[:, :2])
    base = earth[row, column]
    slack = _FOOT_M + 0.1 * grid.step
    on_ground = foot[:, 2] <= base + slack
    # A house of a model without ground: nothing is under it that it could float over.
    nothing = np.isnan(rays.heights(foot[:, :2], foot[:, 2] - 1e-3))
    nothing &= np.isnan(rays.heights(pieces.middle[:, :2], pieces.low[:, 2] - 1e-3))
    on_ground |= wide & nothing
    # Ground itself: wide, and most of its vertices are at the ground's height.
    at = earth[grid.cells(mesh.vertices[:, :2])]
    low = np.abs(mesh.vertices[:, 2] - at) < slack
    of_vertex = np.zeros(len(mesh.vertices), np.int32)
    of_vertex[mesh.faces.ravel()] = np.repeat(pieces.of_face, 3)
    share = np.bincount(of_vertex, low, len(pieces)) / np.maximum(
        np.bincount(of_vertex, minlength=len(pieces)), 1
    )
    flat = pieces.size[:, 2] < np.maximum(0.3 * pieces.size[:, :2].max(axis=1), 0.05)
    ground = on_ground & wide & (share > 0.3)
    # Slabs of which a pavement may be made: flat, and nothing is under them.
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
    """Return which pieces (K,) are of floating groups that have a crown's or a wire's shape."""
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
    """Return which of K things are connected to one of ``start`` (K,) by pairs."""
    count = len(start)
    # One more thing that all of the start are tied to.
    rows = np.concatenate([pairs[:, 0], np.flatnonzero(start)])
    columns = np.concatenate([pairs[:, 1], np.full(int(start.sum()), count)])
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count + 1, count + 1))
    _, label = connected_components(graph, directed=False)
    return np.asarray(label[:count] == label[count])
