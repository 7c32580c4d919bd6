"""Heights of a mesh under given points, by rays cast vertically down."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry.mesh import LabelledMesh
from urbantwin.geometry.rays import RayScene

__all__ = ["DownwardProbe"]


class DownwardProbe:
    """Casts rays down onto a mesh."""

    def __init__(self, mesh: LabelledMesh) -> None:
        self._scene = RayScene(mesh.vertices, mesh.faces)
        self._triangles = mesh.triangles()

    def face_below(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the first face (N,) vertically below each of (N, 3) points; -1 for none."""
        origins = np.asarray(points, np.float32).reshape(-1, 3)
        down = np.broadcast_to(np.array([0, 0, -1], np.float32), origins.shape)
        return self._scene.cast_single(origins, down).face.astype(np.int64)

    def height_below(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the height (N,) of the first face below each of (N, 3) points; nan without one.

        The height is evaluated on the face's plane in float64, not taken from the ray.
        """
        xyz = np.asarray(points, np.float64).reshape(-1, 3)
        face = self.face_below(xyz)
        hit = face >= 0
        a, b, c = np.moveaxis(self._triangles[face[hit]], 1, 0)
        normal = np.cross(b - a, c - a)
        offset = xyz[hit, :2] - a[:, :2]
        height = np.full(len(xyz), np.nan)
        height[hit] = a[:, 2] - (normal[:, :2] * offset).sum(axis=1) / normal[:, 2]
        return height
