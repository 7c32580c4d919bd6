"""Decks of roads that cross over others: slabs with parapets, above the ground surface."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lift, RoadNetwork
from urbantwin.scene.surface import Heights, Spacing, surface_mesh
from urbantwin.scene.zones import deck_zones
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["deck_mesh"]

THICKNESS_M = 1.0
PARAPET_M = 1.1
#: No parapet where the deck's border is this close to the road that it leads to.
JOIN_M = 1.0


def deck_mesh(
    network: RoadNetwork, lift: Lift, elevation: Heights, spacing: Spacing
) -> LabelledMesh:
    """Return every deck above the ground: road, underside, sides and parapets."""
    meshes = []
    for level in network.levels[1:]:
        zones = [zone for zone in deck_zones(network, level) if not zone.area.is_empty]
        if not zones:
            continue

        def height(xy: NDArray[np.float64], level: int = level) -> NDArray[np.float64]:
            return elevation(xy) + lift.at(xy, level)

        top = surface_mesh(zones, road_height=height, terrain_height=height, spacing=spacing)
        outline = shapely.union_all([zone.area for zone in zones])
        beside = shapely.union_all(
            [
                shapely.union(network.carriageway(other), network.footway(other))
                for other in network.levels
                if other != level
            ]
        )
        meshes += [top, _underside(top), _sides(outline, beside, height, spacing)]
    return LabelledMesh.concatenate(meshes)


def _underside(top: LabelledMesh) -> LabelledMesh:
    return LabelledMesh.build(
        top.vertices - [0, 0, THICKNESS_M],
        top.faces[:, ::-1],
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def _sides(
    outline: shapely.Geometry, beside: shapely.Geometry, height: Heights, spacing: Spacing
) -> LabelledMesh:
    """Vertical faces round a deck, as high as the parapet where nothing continues the road."""
    meshes = []
    joined = shapely.buffer(beside, JOIN_M)
    for polygon in shapely.get_parts(shapely.orient_polygons(outline)):
        for ring in [polygon.exterior, *polygon.interiors]:
            xy = shapely.get_coordinates(shapely.segmentize(ring, min(spacing.road, 4.0)))
            z = height(xy)
            open_end = shapely.contains_xy(joined, *((xy[1:] + xy[:-1]) / 2).T)
            rise = np.where(open_end, 0.0, PARAPET_M)
            count = len(xy) - 1
            corners = [
                np.column_stack([xy[:-1], z[:-1] - THICKNESS_M]),
                np.column_stack([xy[1:], z[1:] - THICKNESS_M]),
                np.column_stack([xy[1:], z[1:] + rise]),
                np.column_stack([xy[:-1], z[:-1] + rise]),
            ]
            i = np.arange(count)
            first = np.column_stack([i, i + count, i + 2 * count])
            second = np.column_stack([i, i + 2 * count, i + 3 * count])
            meshes.append(
                LabelledMesh.build(
                    np.concatenate(corners),
                    np.concatenate([first, second]),
                    semantic_id("other-structure"),
                    material_id("concrete"),
                )
            )
    return LabelledMesh.concatenate(meshes)
