"""Welding of meshes, their connected pieces, and bounds of triangles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.io.model import TriangleMesh

__all__ = [
    "WELD_M",
    "Pieces",
    "areas_of_faces",
    "bounds_of_faces",
    "cleared",
    "pieces_of",
    "selected",
    "some_corner",
    "welded",
]


def bounds_of_faces(
    vertices: NDArray[np.float64], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and the maximum coordinates (F, D) of triangles.

    Args:
        vertices: (V, D) metres.
        faces: (F, 3) indices.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def every_corner(flag: NDArray[np.bool_], faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return the mask of triangles (F,) with the flag (V,) at all corners."""
    return np.asarray(flag[faces[:, 0]] & flag[faces[:, 1]] & flag[faces[:, 2]])


def some_corner(flag: NDArray[np.bool_], faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return the mask of triangles (F,) with the flag (V,) at any corner."""
    return np.asarray(flag[faces[:, 0]] | flag[faces[:, 1]] | flag[faces[:, 2]])


#: Distance below which vertices are merged, metres: the resolution of float32 within 1 km of the
#: origin.
WELD_M = 1e-4
#: Minimum area of a valid triangle, square metres.
_NO_AREA_M2 = 1e-9


def welded(mesh: TriangleMesh) -> TriangleMesh:
    """Return the mesh with coincident vertices merged; files repeat them for textures.

    Args:
        mesh: site frame, metres, without nan.
    """
    if not len(mesh.vertices):
        return mesh
    low = mesh.vertices.min(axis=0)
    cells = np.rint((mesh.vertices - low) / WELD_M).astype(np.int64)
    span = cells.max(axis=0) + 1
    if float(span[0]) * float(span[1]) * float(span[2]) < 2**62:
        keys = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
        _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    else:
        _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    # Keep the order of the file, so that neighbours stay near in memory.
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    faces = rank[place.ravel()][mesh.faces]
    return replace(mesh, vertices=mesh.vertices[first[order]], faces=faces)


def cleared(mesh: TriangleMesh) -> tuple[TriangleMesh, dict[str, int]]:
    """Return the welded mesh without invalid triangles, and the numbers of removed ones by reason.

    Args:
        mesh: site frame, metres.

    Returns:
        The mesh, and counts: ``not_finite`` (a corner is nan or infinite), ``degenerate`` (no
            area), ``duplicate`` (the same three corners in any orientation).
    """
    finite = np.asarray(np.isfinite(mesh.vertices).all(axis=1))
    good = every_corner(finite, mesh.faces)
    counts = {"not_finite": int((~good).sum())}
    if not good.all():
        mesh = selected(mesh, good)
    elif not finite.all():
        mesh = selected(mesh)
    mesh = welded(mesh)
    flat = areas_of_faces(mesh) < _NO_AREA_M2
    a, b, c = mesh.faces.T
    flat |= (a == b) | (b == c) | (c == a)
    counts["degenerate"] = int(flat.sum())
    again = _repeated(mesh.faces) & ~flat
    counts["duplicate"] = int(again.sum())
    if counts["degenerate"] or counts["duplicate"]:
        mesh = selected(mesh, ~(flat | again))
    return mesh, counts


def selected(
    mesh: TriangleMesh, keep: NDArray[np.bool_] | NDArray[np.int64] | None = None
) -> TriangleMesh:
    """Return the triangles of a mask or of indices (``None``: all) without unused vertices.

    As ``TriangleMesh.select``, but faster.
    """
    part = slice(None) if keep is None else keep
    faces = mesh.faces[part]
    used = np.zeros(len(mesh.vertices), bool)
    used[faces.ravel()] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return TriangleMesh(
        mesh.vertices[used],
        number[faces],
        None if mesh.colour is None else mesh.colour[part],
        mesh.object[part],
        mesh.names,
        None if mesh.semantic is None else mesh.semantic[part],
    )


def areas_of_faces(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Return areas (F,), square metres."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return np.asarray(np.sqrt(x * x + y * y + z * z) / 2)


def _repeated(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return whether a triangle (F,) has the corners of an earlier one."""
    count = len(faces)
    again = np.zeros(count, bool)
    if not count:
        return again
    corners = np.sort(faces, axis=1).astype(np.int64)
    base = int(corners.max()) + 1
    keys = corners[:, 0] * base + corners[:, 1]
    if base < 2**21:  # three corners fit into 63 bits
        order = np.argsort(keys * base + corners[:, 2], kind="stable")
    else:
        order = np.lexsort((corners[:, 2], keys))
    same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    again[order[1:][same]] = True
    return again


@dataclass(frozen=True, eq=False)
class Pieces:
    """The K connected components of a mesh.

    Attributes:
        of_face: (F,) int32 index of each triangle's piece.
        low: (K, 3) minimum x, y, z, metres.
        high: (K, 3) maximum.
        area: (K,) square metres.
        triangles: (K,) number of triangles.
        foot: (K,) int32 index of the lowest vertex.
    """

    of_face: NDArray[np.int32]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    area: NDArray[np.float64]
    triangles: NDArray[np.int64]
    foot: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.area)

    @property
    def size(self) -> NDArray[np.float64]:
        """Extent (K, 3) along x, y and z, metres."""
        return self.high - self.low

    @property
    def middle(self) -> NDArray[np.float64]:
        """Centre (K, 3) of the bounds."""
        return (self.low + self.high) / 2


def pieces_of(mesh: TriangleMesh) -> Pieces:
    """Return the pieces of a welded mesh.

    Args:
        mesh: welded (``welded``), every vertex used.
    """
    count = len(mesh.vertices)
    a, b, c = mesh.faces.T
    rows, columns = np.concatenate([a, b]), np.concatenate([b, c])
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count, count))
    number, of_vertex = connected_components(graph, directed=False)
    of_face = of_vertex[a].astype(np.int32) if len(a) else np.zeros(0, np.int32)
    order = np.argsort(of_vertex, kind="stable")
    starts = np.searchsorted(of_vertex[order], np.arange(number))
    if number:
        sorted_vertices = mesh.vertices[order]
        low = np.minimum.reduceat(sorted_vertices, starts)
        high = np.maximum.reduceat(sorted_vertices, starts)
        by_height = np.lexsort((mesh.vertices[:, 2], of_vertex))
        foot = by_height[starts]
    else:
        low = high = np.zeros((0, 3))
        foot = np.zeros(0, np.int64)
    return Pieces(
        of_face,
        low,
        high,
        np.asarray(np.bincount(of_face, areas_of_faces(mesh), number), np.float64),
        np.bincount(of_face, minlength=number).astype(np.int64),
        foot,
    )
