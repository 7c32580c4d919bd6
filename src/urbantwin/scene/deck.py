"""Decks of roads that cross over others: slabs with parapets, above the ground surface."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import RoadNetwork, RoadSurface
from urbantwin.scene.surface import Spacing, surface_mesh
from urbantwin.scene.zones import deck_zones
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["deck_mesh"]

THICKNESS_M = 1.0
PARAPET_M = 1.1
#: No parapet where the deck's border is this close to the road that it leads to.
JOIN_M = 1.0


def deck_mesh(network: RoadNetwork, surface: RoadSurface, spacing: Spacing) -> LabelledMesh:
    """Return every deck above the ground: road, underside, sides and parapets."""
    meshes = []
    for level in network.levels[1:]:
        zones = [zone for zone in deck_zones(network, level) if not zone.area.is_empty]
        if not zones:
            continue

        def height(xy: NDArray[np.float64], level: int = level) -> NDArray[np.float64]:
            return surface.height(xy, level)

        top = surface_mesh(
            zones,
            road_height=height,
            terrain_height=height,
            spacing=spacing,
            lines=surface.ridges(level),
        )
        beside = shapely.union_all(
            [
                shapely.union(network.carriageway(other), network.footway(other))
                for other in network.levels
                if other != level
            ]
        )
        meshes += [top, _underside(top), _sides(top, beside)]
    return LabelledMesh.concatenate(meshes)


def _underside(top: LabelledMesh) -> LabelledMesh:
    return LabelledMesh.build(
        top.vertices - [0, 0, THICKNESS_M],
        top.faces[:, ::-1],
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def _sides(top: LabelledMesh, beside: shapely.Geometry) -> LabelledMesh:
    """Vertical faces along a deck's border, as high as the parapet where no road goes on."""
    a, b = _border(top)
    joined = shapely.buffer(beside, JOIN_M)
    open_end = shapely.contains_xy(joined, *((a + b)[:, :2] / 2).T)
    up = np.column_stack([np.zeros((len(a), 2)), np.where(open_end, 0.0, PARAPET_M)])
    down = [0.0, 0.0, THICKNESS_M]
    i, count = np.arange(len(a)), len(a)
    return LabelledMesh.build(
        np.concatenate([a - down, b - down, b + up, a + up]),
        np.concatenate(
            [
                np.column_stack([i, i + count, i + 2 * count]),
                np.column_stack([i, i + 2 * count, i + 3 * count]),
            ]
        ),
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def _border(mesh: LabelledMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return starts and ends (N, 3) of the edges with one triangle, the mesh on their left."""
    keys = np.round(mesh.vertices * 1e4).astype(np.int64)
    _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    directed = same.ravel()[mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    directed = directed[directed[:, 0] != directed[:, 1]]
    _, index, uses = np.unique(
        np.sort(directed, axis=1), axis=0, return_index=True, return_counts=True
    )
    once = directed[np.sort(index[uses == 1])]
    return mesh.vertices[first[once[:, 0]]], mesh.vertices[first[once[:, 1]]]
