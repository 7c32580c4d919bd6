"""The surface rebuilt from a real cloud, and distances of synthetic points to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import pythoncdt
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.compiled.surface_triangles import can_be_surface
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.sampling import sample_rows

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["MAX_POINTS", "RealSurface", "Spread", "Surface", "rebuild_surface"]

#: Maximum edge of a triangle, metres.
MAX_EDGE_M = 2.0
#: Maximum angular extent of a triangle seen from the sensor, degrees.
MAX_ANGLE_DEG = 4.0
#: Minimum angle between a triangle and the line of sight, degrees.
MIN_GRAZING_DEG = 10.0
#: Maximum angle between a street triangle's normal and the vertical, degrees.
LEVEL_DEG = 15.0

_SEAM_RAD = np.radians(MAX_ANGLE_DEG)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, and the points that belong to none.

    Attributes:
        vertices: (V, 3) float64, metres, the cloud's frame.
        faces: (F, 3) int64, indices of vertices; a point without a triangle is a face of one vertex
            three times.
        triangles: number of true triangles among the faces.
        covered: share of the vertices that are a corner of a true triangle, 0..1.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    triangles: int
    covered: float


def rebuild_surface(points: NDArray[np.float64], origin: ArrayLike = (0.0, 0.0, 0.0)) -> Surface:
    """Return the surface that a sensor at ``origin`` saw.

    Args:
        points: (N, 3) metres, N >= 1.
        origin: (3,) position of the sensor in the frame of the points, metres.
    """
    seen = points - np.asarray(origin, np.float64)
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    elevation = np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
    # The azimuth wraps at +-pi: a strip of either side is repeated on the other.
    low = np.flatnonzero(azimuth < -np.pi + _SEAM_RAD)
    high = np.flatnonzero(azimuth > np.pi - _SEAM_RAD)
    index = np.concatenate([np.arange(len(points)), low, high])
    angles = np.column_stack([azimuth, elevation])[index]
    angles[len(points) : len(points) + len(low), 0] += 2 * np.pi
    angles[len(points) + len(low) :, 0] -= 2 * np.pi
    # of several points in one direction, the first of the cloud
    order = np.lexsort(angles.T[::-1])
    order = order[np.append(True, (np.diff(angles[order], axis=0) != 0).any(axis=1))]
    angles, index = angles[order], index[order]

    corner = _delaunay(angles)
    kept = can_be_surface(
        angles,
        seen,
        corner,
        index,
        np.radians(MAX_ANGLE_DEG),
        MAX_EDGE_M,
        np.sin(np.radians(MIN_GRAZING_DEG)),
        np.cos(np.radians(LEVEL_DEG)),
    )
    faces = index[corner[kept]]

    used = np.zeros(len(points), bool)
    used[faces] = True
    lone = np.repeat(np.flatnonzero(~used)[:, None], 3, axis=1)
    return Surface(
        vertices=points,
        faces=np.concatenate([faces, lone]),
        triangles=len(faces),
        covered=float(used.mean()),
    )


def _delaunay(angles: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the Delaunay triangles (T, 3) of (N, 2) distinct points."""
    if len(angles) < 3 or np.linalg.matrix_rank(angles - angles[0]) < 2:
        return np.zeros((0, 3), np.int64)
    mesh = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO,
        pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED,
        0.0,
    )
    mesh.insert_vertices(cast("Buffer", angles))
    mesh.erase_super_triangle()
    return mesh.triangles_array()["vertices"].astype(np.int64)


#: Maximum number of measured points; larger clouds are sampled at random (reproducibly).
MAX_POINTS = 10_000
#: One in this many real points is held out of the rebuild, to evaluate it.
HELD_OUT = 10
#: Seed of the held-out sample: with that of the measured points, clouds of the same size would be
#: measured at the very points that the surface lacks.
_HELD_OUT_KEY = 1


@dataclass(frozen=True)
class Spread:
    """Distances in metres."""

    mean: float
    median: float
    p95: float

    @classmethod
    def of(cls, distances: NDArray[np.float64]) -> Spread:
        """Summarise (N,) distances, N >= 1."""
        median, p95 = np.percentile(distances, [50, 95])
        return cls(float(distances.mean()), float(median), float(p95))


class RealSurface:
    """The surface of one real frame, rebuilt from nine tenths of its points.

    Cloud-to-surface distance as in Metro (Cignoni, Rocchini, Scopigno 1998, "Metro: measuring error
    on simplified surfaces"), one way: from the synthetic points to the real surface. The held-out
    tenth gives the distance of real points from the surface (``rebuild_error``): smaller values are
    not significant.

    Attributes:
        surface: the triangles (`Surface`).
        rebuild_error: distances of the held-out real points; None without held-out points.
    """

    def __init__(self, real: NDArray[np.float64], origin: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        held_out = sample_rows(len(real), len(real) // HELD_OUT, _HELD_OUT_KEY)
        self.surface: Surface = rebuild_surface(np.delete(real, held_out, axis=0), origin)
        self._nearest = NearestTriangle(self.surface.vertices, self.surface.faces)
        self.rebuild_error: Spread | None = None
        if len(held_out):
            self.rebuild_error = self.distances_of(real[held_out])

    def distances_of(self, synthetic: NDArray[np.float64]) -> Spread:
        """Summarise the distances of (M, 3) points, M >= 1, to the surface."""
        return Spread.of(self.sampled_distances(synthetic)[1])

    def sampled_distances(
        self, synthetic: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return indices (S,) of measured ones of (M, 3) points, and their distances, metres."""
        rows = sample_rows(len(synthetic), min(len(synthetic), MAX_POINTS))
        return rows, self._nearest.distances(synthetic[rows])
