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
#: An underside within this height of a building's lowest point is on the ground, metres.
FOOT_M = 0.6


def building_surfaces(mesh: LabelledMesh) -> NDArray[np.uint8]:
    """Classify triangles of buildings: (F,) indices of ``SURFACES``.

    Args:
        mesh: triangles of buildings (from ``building_mesh``, or imported ones), each building with
            its own ``part``.

    Returns:
        Classes by the normal. Undersides at the lower end of a building are its ground, others
        ceilings over open air; faces steeper than 87 degrees are walls. Vertical glass in walls of
        another material is a window, vertical wood in such walls a door.
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
    # A reveal's sill and head: level, and narrower than the depth of a reveal.
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    narrow = 2 * mesh.areas() <= REVEAL_M * longest
    kind[narrow & (np.abs(rise) > 0.99) & (kind != GROUND)] = WALL
    upright = kind == WALL
    glass, wood = (upright & (mesh.material == material_id(name)) for name in ("glass", "wood"))
    # Parts with more wood than other walls have wooden walls: their doors cannot be detected.
    area = mesh.areas()

    def of_part(chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
        sums = np.bincount(part[chosen], area[chosen], minlength=len(foot))
        return np.asarray(sums[part], np.float64)

    kind[glass & (of_part(upright & ~glass) > 0)] = WINDOW
    kind[wood & (of_part(upright & ~glass & ~wood) > of_part(wood))] = DOOR
    return kind
