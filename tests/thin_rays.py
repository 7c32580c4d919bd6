"""Thin rays from one place at a static world: what tests ask a mesh with."""

from typing import NamedTuple

import numpy as np

from urbantwin.geometry.rays import RayScene
from urbantwin.lidar.returns import scatter_of_materials

__all__ = ["StaticHits", "cast_static"]


class StaticHits(NamedTuple):
    """First hits of N rays; range ``inf``, face -1 and the rest 0 where a ray hits nothing."""

    range_m: np.ndarray
    face: np.ndarray
    cosine: np.ndarray
    backscatter: np.ndarray
    semantic: np.ndarray


def cast_static(mesh, origin, directions, *, wavelength_nm=905.0, surface=None):
    """Cast rays (N, 3) from one place (3,), and say what comes back of a laser's light."""
    found = RayScene(mesh.vertices - origin, mesh.faces).cast(np.zeros(3), directions)
    hit = np.flatnonzero(found.face >= 0)
    face = found.face[hit]
    material = mesh.material[face]
    if surface is not None:
        places = origin + directions[hit] * found.range_m[hit, None].astype(np.float64)
        material = surface.materials_of(mesh, face, places)
    count = len(directions)
    cosine, back = np.zeros(count, np.float32), np.zeros(count, np.float32)
    cosine[hit] = np.abs((mesh.normals()[face] * directions[hit]).sum(axis=1))
    back[hit] = scatter_of_materials(wavelength_nm).backscatter(material, cosine[hit])
    semantic = np.zeros(count, np.uint16)
    semantic[hit] = mesh.semantic[face]
    return StaticHits(found.range_m, found.face, cosine, back, semantic)
