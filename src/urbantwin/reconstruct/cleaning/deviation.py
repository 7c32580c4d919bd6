"""Deviation between two surfaces, measured both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.rays import Rays

__all__ = ["Deviation", "Surface", "deviation", "distances_to_triangles", "normals_of"]

#: Number of triangles, nearest by their centres, that are measured exactly if a ray has no hit.
_NEIGHBOURS = 24


@dataclass(frozen=True, eq=False)
class Deviation:
    """Distances between an old and a new surface.

    Attributes:
        most: maximum of all samples, metres.
        p95: their 95th percentile, metres.
        old: (F,) maximum at each old triangle, metres.
        new: (F',) maximum at each new triangle, metres.
        old_of_new: (F',) old triangle at each new one's centre.
        new_of_old: (F,) new triangle at each old one's first corner.
    """

    most: float
    p95: float
    old: NDArray[np.float64]
    new: NDArray[np.float64]
    old_of_new: NDArray[np.int64]
    new_of_old: NDArray[np.int64]

    @classmethod
    def none(cls, count: int) -> Deviation:
        """Return the deviation of a mesh from itself: zero."""
        zero = np.zeros(count)
        return cls(0.0, 0.0, zero, zero, np.arange(count), np.arange(count))


def deviation(
    part: TriangleMesh,
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    old: Surface,
    reach: float,
) -> Deviation:
    """Return the sampled Hausdorff distance between a mesh and a simplified one.

    Samples are all old vertices, and the centres of the new triangles and of their edges. From each
    a ray is cast along the surface's normal, both ways; its hit is an upper bound of the distance.
    Without a hit within reach (at edges and borders) the distance to the nearest triangles is
    computed.

    Args:
        part: the old triangles that were simplified.
        points: (V', 3) new vertices.
        triangles: (F', 3) new triangles.
        old: the whole old surface.
        reach: maximum distance of a ray's hit, metres.
    """
    corners = points[triangles]
    old_normal, new_normal = normals_of(part.vertices[part.faces]), normals_of(corners)
    new = Surface(points, triangles)
    at_vertex = np.zeros(len(part.vertices), np.int64)
    at_vertex[part.faces.ravel()] = np.repeat(np.arange(len(part.faces)), 3)
    d1, new_of_vertex = new.nearest(part.vertices, old_normal[at_vertex], reach)
    d2, old_of_new = old.nearest(corners.mean(axis=1), new_normal, reach)
    sides = ((corners + np.roll(corners, -1, axis=1)) / 2).reshape(-1, 3)
    d3, _ = old.nearest(sides, np.repeat(new_normal, 3, axis=0), reach)
    all_of_them = np.concatenate([d1, d2, d3])
    return Deviation(
        float(all_of_them.max(initial=0.0)),
        float(np.percentile(all_of_them, 95)) if len(all_of_them) else 0.0,
        d1[part.faces].max(axis=1),
        np.maximum(d2, d3.reshape(-1, 3).max(axis=1)),
        old_of_new,
        new_of_vertex[part.faces[:, 0]],
    )


class Surface:
    """A searchable surface of triangles.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices.
    """

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        self._rays = Rays(vertices, faces)
        self._corners = vertices[faces]
        self._tree: cKDTree | None = None

    def nearest(
        self, places: NDArray[np.float64], normal: NDArray[np.float64], reach: float
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return a bound of the distance (N,) to the surface, and the triangle (N,) there."""
        # one ray through the position from outside covers both sides
        start = places - normal * (2 * reach)
        face, along = self._rays.first(start, normal.astype(np.float32))
        found = face.astype(np.int64)
        distance = np.abs(along.astype(np.float64) - 2 * reach)
        again = np.flatnonzero(~(distance <= reach))
        if len(again):
            # another surface may block it, so cast from the position itself, both ways
            for sign in (1.0, -1.0):
                way = sign * normal[again]
                face, along = self._rays.first(places[again] - way * 1e-4, way.astype(np.float32))
                better = along < distance[again]
                distance[again[better]] = along[better]
                found[again[better]] = face[better]
            again = again[~(distance[again] <= reach)]
        if len(again):
            if self._tree is None:
                self._tree = cKDTree(self._corners.mean(axis=1))
            count = min(_NEIGHBOURS, len(self._corners))
            for part in np.array_split(again, max(1, len(again) // 50_000)):
                _, index = self._tree.query(places[part], k=count, workers=-1)
                index = index.reshape(len(part), count)
                exact = distances_to_triangles(
                    np.repeat(places[part], count, axis=0), self._corners[index.ravel()]
                ).reshape(len(part), count)
                best = exact.argmin(axis=1)
                rows = np.arange(len(part))
                value = exact[rows, best]
                better = value < distance[part]
                distance[part[better]] = value[better]
                found[part[better]] = index[rows, best][better]
        return distance, found


def normals_of(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit normals (N, 3) of triangles (N, 3, 3); up for triangles without area."""
    a, b, c = np.moveaxis(corners, 1, 0)
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    cross = np.column_stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
    length = np.sqrt(np.einsum("ij,ij->i", cross, cross))[:, None]
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), cross.shape).copy()
    return np.asarray(np.divide(cross, length, out=up, where=length > 1e-12))


def distances_to_triangles(
    points: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance (N,) of points (N, 3) to triangles (N, 3, 3), one each.

    Ericson 2005, "Real-time collision detection", 3.4: the projection if it is inside, otherwise
    the nearest of the three edges.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = normals_of(corners)
    best = np.minimum.reduce([_to_segment(points, p, q) for p, q in ((a, b), (b, c), (c, a))])
    side = [
        np.einsum("ij,ij->i", np.cross(q - p, points - p), normal)
        for p, q in ((a, b), (b, c), (c, a))
    ]
    inside = (side[0] >= 0) & (side[1] >= 0) & (side[2] >= 0)
    plane = np.abs(np.einsum("ij,ij->i", points - a, normal))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12
    return np.asarray(np.where(inside & area, plane, best))


def _to_segment(
    points: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    way = end - start
    square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-30)
    share = np.clip(np.einsum("ij,ij->i", points - start, way) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - (start + share[:, None] * way), axis=1))
