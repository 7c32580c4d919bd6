"""Semantic surfaces of buildings for CityGML and CityJSON."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id

__all__ = ["SURFACES", "building_surfaces"]

#: Semantic surfaces of CityJSON 2.0, section 3.3; ``building_surfaces`` gives indices of them.
SURFACES = (
    "GroundSurface",
    "OuterCeilingSurface",
    "WallSurface",
    "RoofSurface",
    "Window",
    "Door",
)
GROUND, CEILING, WALL, ROOF, WINDOW, DOOR = range(6)

#: A surface that rises by less than this (z of its unit normal) is upright: steeper than 87 deg.
UPRIGHT = 0.05
#: Level strips no wider than this are the sills and heads of windows, metres.
REVEAL_M = 0.16
#: An underside this near to a building's lowest point stands on the ground, metres.
FOOT_M = 0.6


def building_surfaces(mesh: LabelledMesh) -> NDArray[np.uint8]:
    """Classify triangles of buildings: (F,) indices of ``SURFACES``.

    Args:
        mesh: triangles of buildings (as ``building_mesh`` makes them, or imported ones), each
            building with a ``part`` of its own.

    Returns:
        By the normal: undersides at a building's foot are its ground, others ceilings over open
        air; what is steeper than 87 degrees is wall. Upright glass in walls of another material
        is a window, upright wood in such walls a door.
    """
    if not len(mesh.faces):
        return np.zeros(0, np.uint8)
    corners = mesh.triangles()
    rise = mesh.normals()[:, 2]
    kind = np.full(len(mesh.faces), WALL, np.uint8)
    kind[rise > UPRIGHT] = ROOF
    _, part = np.unique(mesh.part, return_inverse=True)
    foot = np.full(part.max() + 1, np.inf)
    np.minimum.at(foot, part, corners[:, :, 2].min(axis=1))
    under = rise < -UPRIGHT
    kind[under] = CEILING
    kind[under & (corners[:, :, 2].max(axis=1) < foot[part] + FOOT_M)] = GROUND
    # A reveal's sill and head: level, and as narrow as the reveal is deep.
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    narrow = 2 * mesh.areas() <= REVEAL_M * longest
    kind[narrow & (np.abs(rise) > 0.99) & (kind != GROUND)] = WALL
    upright = kind == WALL
    glass, wood = (upright & (mesh.material == material_id(name)) for name in ("glass", "wood"))
    # What has more wood than other walls has wooden walls: doors in them cannot be told.
    area = mesh.areas()

    def of_part(chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
        sums = np.bincount(part[chosen], area[chosen], minlength=len(foot))
        return np.asarray(sums[part], np.float64)

    kind[glass & (of_part(upright & ~glass) > 0)] = WINDOW
    kind[wood & (of_part(upright & ~glass & ~wood) > of_part(wood))] = DOOR
    return kind
