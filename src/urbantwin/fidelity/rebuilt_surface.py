"""The surface rebuilt from one real cloud, the reference of point-to-mesh distances.

A LiDAR sees the first surface in every direction, so a cloud is a height field over directions.
Its points are triangulated by their azimuth and elevation as seen from the sensor (constrained
Delaunay, no constraints), and triangles that cannot be a surface are cut:

- an edge longer than ``MAX_EDGE_M``, or wider than ``MAX_ANGLE_DEG`` seen from the sensor: the
  sensor sampled too sparsely there to know;
- a triangle seen at less than ``MIN_GRAZING_DEG`` (Bogoslavskyi and Stachniss 2016, "Fast range
  image-based segmentation of sparse 3D laser scans", use 10 degrees for the same decision), which
  bridges a near object and the one behind it, unless it is as level as a street
  (``LEVEL_DEG``): streets are what a sensor sees at grazing angles.

Points left without a triangle stay in the surface as points, so no distance to the surface is
larger than the distance to the nearest real point that it was built from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import pythoncdt
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.compiled.surface_triangles import can_be_surface

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = [
    "LEVEL_DEG",
    "MAX_ANGLE_DEG",
    "MAX_EDGE_M",
    "MIN_GRAZING_DEG",
    "Surface",
    "rebuild_surface",
]

#: Longest edge of a triangle, metres.
MAX_EDGE_M = 2.0
#: Widest edge of a triangle seen from the sensor, degrees.
MAX_ANGLE_DEG = 4.0
#: Least angle between a triangle and the line of sight, degrees.
MIN_GRAZING_DEG = 10.0
#: A triangle whose normal is this close to the vertical counts as street, degrees.
LEVEL_DEG = 15.0

_SEAM_RAD = np.radians(MAX_ANGLE_DEG)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, and the points that are in none of them.

    Attributes:
        vertices: (V, 3) float64, metres, the cloud's frame.
        faces: (F, 3) int64, indices of vertices; a point without a triangle is a face of one
            vertex three times.
        triangles: how many of the faces are true triangles.
        covered: share of the vertices that are a corner of a true triangle, 0..1.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    triangles: int
    covered: float


def rebuild_surface(points: NDArray[np.float64], origin: ArrayLike = (0.0, 0.0, 0.0)) -> Surface:
    """Rebuild the surface that a sensor at ``origin`` saw.

    Args:
        points: (N, 3) metres, N >= 1.
        origin: (3,) the sensor's place in the frame of the points, metres.
    """
    seen = points - np.asarray(origin, np.float64)
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    elevation = np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
    # The circle is cut open at +-pi: a strip of either side is repeated on the other.
    low = np.flatnonzero(azimuth < -np.pi + _SEAM_RAD)
    high = np.flatnonzero(azimuth > np.pi - _SEAM_RAD)
    index = np.concatenate([np.arange(len(points)), low, high])
    angles = np.column_stack([azimuth, elevation])[index]
    angles[len(points) : len(points) + len(low), 0] += 2 * np.pi
    angles[len(points) + len(low) :, 0] -= 2 * np.pi
    # Two points in one direction: the first, in the order of the cloud.
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
