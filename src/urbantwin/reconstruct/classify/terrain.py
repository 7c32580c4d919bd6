"""The ground of a mesh: its lowest connected surface, without buildings and plants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.ground import Elevation
from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.height_grid import Grid, filled
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.street_surface import bare_earth

__all__ = ["STEP_M", "Terrain", "edges_between", "terrain_of"]

#: Cell size of the ground grid, metres.
STEP_M = 0.5
#: Maximum number of cells per side: larger models get larger cells.
_MOST_CELLS = 2_000
#: Maximum height of the ground above its lowest surface: roughness, curbs, metres.
_NEAR_M = 0.3
#: A face steeper than this is a wall if it rises higher than a curb (cosine of its slope).
_STEEP = 0.5
_WALL_M = 0.5


@dataclass(frozen=True, eq=False)
class Terrain:
    """The ground under a mesh.

    Attributes:
        grid: the cells.
        height: (rows, columns) of the ground, everywhere, metres.
        is_ground: (F,) mask of the ground triangles.
        top: (rows, columns) height of the highest surface, nan if there is none.
        top_face: (rows, columns) its triangle, -1 if there is none.
    """

    grid: Grid
    height: NDArray[np.float64]
    is_ground: NDArray[np.bool_]
    top: NDArray[np.float64]
    top_face: NDArray[np.int32]

    def under(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ground's height (N,) under points (N, 2 or 3)."""
        return np.asarray(self.height[self.grid.cells(points)])

    def lies_low(self, mesh: TriangleMesh) -> NDArray[np.bool_]:
        """Return the mask of triangles (F,) flat on the ground: lawns labelled as vegetation."""
        over = mesh.vertices[:, 2] - self.under(mesh.vertices)
        corner = mesh.vertices[mesh.faces]
        cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        level = cross[:, 2] > 0.7 * np.linalg.norm(cross, axis=1)
        return np.asarray(level & (np.abs(over[mesh.faces]).max(axis=1) < 0.5))


def terrain_of(
    mesh: TriangleMesh,
    said_ground: NDArray[np.bool_],
    said_other: NDArray[np.bool_],
    elevation: Elevation | None,
) -> Terrain:
    """Separate the ground of a mesh from the objects on it.

    Args:
        mesh: welded, site frame, metres.
        said_ground: (F,) triangles labelled as ground by names or the file.
        said_other: (F,) triangles labelled as anything else.
        elevation: the ground from other sources.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    span = float((high - low)[:2].max())
    grid = Grid.over((*low[:2], *high[:2]), max(STEP_M, span / _MOST_CELLS))
    centres = grid.centres()
    rays = Rays(mesh.vertices, mesh.faces)
    start = np.column_stack([centres, np.full(len(centres), high[2] + 1.0)])
    face, distance = rays.first(start, [0.0, 0.0, -1.0])
    top = np.where(face >= 0, start[:, 2] - distance, np.nan).reshape(grid.shape)
    surface = rays.heights(centres, float(low[2]) - 1.0, up=True).reshape(grid.shape)
    # Feet of walls count where no ground surface exists.
    feet = mesh.vertices
    if said_other.any() and not said_other.all():
        some = np.zeros(len(feet), bool)
        some[mesh.faces[~said_other].ravel()] = True
        feet = feet[some]
    lowest = np.fmin(surface, grid.lowest(feet))
    if said_ground.any():
        used, faces = np.unique(mesh.faces[said_ground], return_inverse=True)
        named = Rays(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32))
        earth = named.heights(centres, float(high[2]) + 1.0).reshape(grid.shape)
    else:
        earth = np.where(bare_earth(lowest, grid.step, slope=0.15), lowest, np.nan)
        if elevation is not None:
            known = elevation.raw_at(centres).reshape(grid.shape)
            earth[np.abs(earth - known) > 3.0] = np.nan
            if np.isnan(earth).all():
                earth = known
    height = filled(earth)
    is_ground = said_ground | (
        _near_ground(mesh, grid, height) & ~said_other & (not said_ground.any())
    )
    return Terrain(grid, height, is_ground, top, face.reshape(grid.shape))


def _near_ground(mesh: TriangleMesh, grid: Grid, height: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of triangles (F,) on the ground that are not the feet of walls."""
    under = height[grid.cells(mesh.vertices[:, :2])]
    over = mesh.vertices[:, 2] - under
    corner = over[mesh.faces]
    near = (corner.max(axis=1) < _NEAR_M + 0.1) & (corner.mean(axis=1) < _NEAR_M)
    # A face larger than a cell is also compared at its centre.
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    near |= np.abs(middle[:, 2] - height[grid.cells(middle[:, :2])]) < 0.1
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    cross = np.cross(b - a, c - a)
    length = np.maximum(np.linalg.norm(cross, axis=1), 1e-12)
    steep = np.abs(cross[:, 2]) < _STEEP * length
    near &= ~steep | (corner.max(axis=1) < _NEAR_M)
    # Connected steep faces that rise higher than a curb are one wall, including its foot.
    walls = np.flatnonzero(steep)
    if len(walls):
        first, second = edges_between(mesh.faces[walls])
        graph = coo_matrix(
            (np.ones(len(first), np.int8), (first, second)), (len(walls), len(walls))
        )
        number, label = connected_components(graph, directed=False)
        highest = np.full(number, -np.inf)
        np.maximum.at(highest, label, corner[walls].max(axis=1))
        near[walls] &= highest[label] < _WALL_M
    return np.asarray(near)


def edges_between(faces: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs (P,), (P,) of triangles that share an edge."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys = sides[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + sides[:, 1]
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.argsort(keys, kind="stable")
    same = keys[order[1:]] == keys[order[:-1]]
    return owner[order[:-1][same]], owner[order[1:][same]]
