"""Casting rays at triangles: the seam between our geometry and a ray tracer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import embreex.mesh_construction
import embreex.rtcore_scene
import numpy as np
from numpy.typing import NDArray

__all__ = ["EmbreeCaster", "Hits", "RayCaster"]


@dataclass(frozen=True, eq=False)
class Hits:
    """What N rays hit first.

    Attributes:
        range_m: (N,) float32, distance to the first hit; ``inf`` where a ray hits nothing.
        face: (N,) int32, the face that was hit; -1 where a ray hits nothing.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]


class RayCaster(Protocol):
    """Finds the first triangle along each of many rays that leave from one point."""

    def cast(self, origin: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray.

        Args:
            origin: (3,) where the rays leave, metres.
            directions: (N, 3) unit vectors.
        """
        ...


class EmbreeCaster:
    """Embree 4 in robust mode, in which no ray slips through the edge of two triangles.

    Embree computes in single precision: keep vertices and origin within a few hundred metres of
    zero. Both sides of a triangle are hit.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
    """

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        self._scene = None
        if len(faces):
            self._scene = embreex.rtcore_scene.EmbreeScene(robust=True)
            # Kept: the scene refers to its geometry without owning it.
            self._mesh = embreex.mesh_construction.TriangleMesh(
                self._scene, vertices.astype(np.float32), faces.astype(np.int32)
            )

    def cast(self, origin: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray; see `RayCaster`."""
        count = len(directions)
        if self._scene is None or count == 0:
            return Hits(np.full(count, np.inf, np.float32), np.full(count, -1, np.int32))
        origins = np.empty((count, 3), np.float32)
        origins[:] = origin
        found = self._scene.run(origins, directions, output=True)
        missed = found["geomID"] < 0
        range_m = found["tfar"]
        range_m[missed] = np.inf
        face = found["primID"]
        face[missed] = -1
        return Hits(range_m, face)
