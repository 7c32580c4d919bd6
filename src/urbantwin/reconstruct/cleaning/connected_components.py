"""Connected components of a mesh: triangles that share vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.weld import areas_of_faces

__all__ = ["Pieces", "pieces_of"]


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected components of a mesh, K of them.

    Attributes:
        of_face: (F,) int32 number of each triangle's piece.
        low: (K, 3) least x, y, z, metres.
        high: (K, 3) greatest.
        area: (K,) square metres.
        triangles: (K,) how many.
        foot: (K,) int32 vertex that lies lowest.
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
        """Middle (K, 3) of the bounds."""
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
