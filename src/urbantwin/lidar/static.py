"""What a fixed sensor's beams hit in the static world: computed once per rig and kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.returns import scatter_of_materials

__all__ = ["StaticHits", "cast_static"]

#: A ray closer to a triangle's plane than this (sine of the angle) keeps Embree's range: the
#: plane would answer with a wilder one.
_GRAZING = 1e-3


@dataclass(frozen=True, eq=False)
class StaticHits:
    """First hits of N rays in the static world.

    Attributes:
        range_m: (N,) float32, metres; ``inf`` where a ray hits nothing.
        face: (N,) int32, number of the triangle; -1 where a ray hits nothing.
        cosine: (N,) float32, cosine of the angle between ray and normal, 0..1; 0 without a hit.
        backscatter: (N,) float32, see ``returns``; 0 without a hit.
        semantic: (N,) uint16, class of the triangle; 0 (unlabelled) without a hit.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]
    cosine: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    semantic: NDArray[np.uint16]


def cast_static(
    mesh: LabelledMesh,
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    *,
    wavelength_nm: float = 905.0,
    surface: SurfaceMaterials | None = None,
    caster: EmbreeCaster | None = None,
) -> StaticHits:
    """Cast rays at the static world.

    The mesh is moved to the rays' origin in float64 before it becomes float32, so the error near
    the sensor does not grow with its distance from the anchor; ranges are then evaluated on the
    triangles' planes in float64.

    Args:
        mesh: the static world.
        origin: (3,) where all rays leave, in the mesh's frame.
        directions: (N, 3) unit vectors, in the mesh's frame.
        wavelength_nm: of the sensor's laser.
        surface: materials of the ground that are finer than the mesh, where a ray hits it.
        caster: of the mesh moved to that origin, where it is known already.
    """
    moved = mesh.vertices - origin
    if caster is None:
        caster = EmbreeCaster(moved, mesh.faces)
    found = caster.cast(np.zeros(3), directions.astype(np.float32))
    hit = np.flatnonzero(found.face >= 0)
    face = found.face[hit]

    normal = mesh.normals()[face]
    slant = (normal * directions[hit]).sum(axis=1)
    height = (normal * moved[mesh.faces[face, 0]]).sum(axis=1)
    range_m = found.range_m.astype(np.float64)
    exact = np.divide(height, slant, out=range_m[hit], where=np.abs(slant) > _GRAZING)
    range_m[hit] = exact

    count = len(directions)
    cosine = np.zeros(count, np.float32)
    cosine[hit] = np.abs(slant)
    backscatter = np.zeros(count, np.float32)
    material = mesh.material[face]
    if surface is not None:
        places = origin + directions[hit] * exact[:, None]
        material = surface.materials_of(mesh, face, places)
    scatter = scatter_of_materials(wavelength_nm)
    backscatter[hit] = scatter.backscatter(material, cosine[hit])
    semantic = np.zeros(count, np.uint16)
    semantic[hit] = mesh.semantic[face]
    return StaticHits(range_m.astype(np.float32), found.face, cosine, backscatter, semantic)
