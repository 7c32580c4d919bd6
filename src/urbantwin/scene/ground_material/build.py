"""All that is known of the ground's materials beyond its triangles."""

from __future__ import annotations

import shapely

from urbantwin.geometry import SurfaceMaterials
from urbantwin.roads import LaneModel, RoadNetwork
from urbantwin.scene.ground_material.paint import LevelHeight, paint_layers

__all__ = ["surface_materials"]


def surface_materials(
    model: LaneModel | None,
    network: RoadNetwork,
    region: shapely.Polygon,
    height: LevelHeight,
) -> SurfaceMaterials:
    """Return the materials that lie on the ground's triangles: lane paint.

    Args:
        model: the lane model; without it little is known of what is painted.
        network: its lanes.
        region: region of interest, site frame.
        height: of the roads' surface on a level.
    """
    return SurfaceMaterials(tuple(paint_layers(model, network, region, height)))
