"""Road markings of the lane model as layers of the ground's materials."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import MaterialLayer, area_difference, grown
from urbantwin.roads import LaneModel, RoadNetwork
from urbantwin.roads.marking import painted
from urbantwin.roads.network import CARRIAGEWAY_KINDS
from urbantwin.scene.ground_material.rasterise import cells_of_quads, layer_of_cells
from urbantwin.taxonomy import material_id

__all__ = ["PAINT_CELL_M", "paint_layers"]

#: Cells of lane paint, metres: a third of the width of a line.
PAINT_CELL_M = 0.05
#: Paint this far beyond the region is kept: streets go on there for a while.
BEYOND_M = 60.0

#: Height (N,) of the roads of a level at points (N, 2).
LevelHeight = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


def paint_layers(
    model: LaneModel | None, network: RoadNetwork, region: shapely.Polygon, height: LevelHeight
) -> list[MaterialLayer]:
    """Return one layer of paint per level.

    Args:
        model: the lane model; without it only few markings are known.
        network: its lanes.
        region: region of interest, site frame.
        height: of the roads' surface.
    """
    paint = painted(network, model)
    around = shapely.box(*region.buffer(BEYOND_M).bounds)
    near = shapely.intersects(around, shapely.polygons(paint.quads)) if len(paint.quads) else []
    layers = []
    for level in sorted(set(paint.level[near].tolist())):
        raised = area_difference(
            network.area_of(("median", "island"), level),
            network.area_of((*CARRIAGEWAY_KINDS, "connection", "crossing"), level),
        )
        driven = area_difference(grown(network.carriageway(level), 0.1), raised)
        chosen = paint.quads[np.asarray(near) & (paint.level == level)]
        cells = cells_of_quads(chosen, PAINT_CELL_M, driven)
        if len(cells):
            layers.append(
                layer_of_cells(
                    cells,
                    material=material_id("road-paint"),
                    level=level,
                    cell_m=PAINT_CELL_M,
                    height=partial(_on_level, height, level),
                )
            )
    return layers


def _on_level(height: LevelHeight, level: int, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    return height(xy, level)
