"""Building the layers of the ground's materials from the lane model and imagery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, MaterialLayer, SurfaceMaterials, area_difference, grown
from urbantwin.roads import LaneModel, RoadNetwork
from urbantwin.roads.marking import painted
from urbantwin.roads.network import CARRIAGEWAY_KINDS
from urbantwin.scene.ground_material.picture import picture_materials
from urbantwin.scene.ground_material.rasterise import cells_of_layer, cells_of_quads, layer_of_cells
from urbantwin.scene.ground_material.visible_ground import ground_heights
from urbantwin.site import Orthophoto
from urbantwin.taxonomy import material_id

__all__ = ["GroundMaterials", "ground_materials", "paint_layers", "surface_materials"]

#: Size of cells of lane paint, metres: a third of the width of a line.
PAINT_CELL_M = 0.05
#: Distance beyond the region within which paint is kept, because streets continue there, metres.
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
        height: height of the roads' surface.
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


@dataclass(frozen=True)
class GroundMaterials:
    """Materials on the ground, and counts for the manifest."""

    surface: SurfaceMaterials
    notes: dict[str, object]


def surface_materials(
    model: LaneModel | None,
    network: RoadNetwork,
    region: shapely.Polygon,
    height: LevelHeight,
) -> SurfaceMaterials:
    """Return the lane model's paint; see `ground_materials`."""
    return ground_materials(model, network, region, height).surface


def ground_materials(
    model: LaneModel | None,
    network: RoadNetwork,
    region: shapely.Polygon,
    height: LevelHeight,
    *,
    mesh: LabelledMesh | None = None,
    photo: Orthophoto | None = None,
) -> GroundMaterials:
    """Return the materials on the ground's triangles.

    Paint is from the lane model. Where a picture clearly shows a carriageway, the paint of the
    picture is used instead. Under trees, vehicles and other objects that hide the road, the lane
    model's paint is kept.

    Args:
        model: the lane model; without it only few markings are known.
        network: its lanes.
        region: region of interest, site frame.
        height: height of the roads' surface on a level.
        mesh: the static scene; only needed with a picture.
        photo: a picture of the ground.
    """
    paint = paint_layers(model, network, region, height)
    if photo is None or mesh is None:
        return GroundMaterials(SurfaceMaterials(tuple(paint)), {"lane_paint_m2": _area(paint)})
    ground = _Ground(mesh, height)
    modelled = SurfaceMaterials(tuple(paint))
    seen = picture_materials(
        photo, mesh, network.levels, ground, lambda points: modelled.at(points) > 0
    )
    kept = []
    for layer in paint:
        cells = cells_of_layer(layer)
        hidden = ~seen.shows(np.asarray((cells + 0.5) * layer.cell_m, np.float64))
        kept.append(
            layer_of_cells(
                cells[hidden],
                material=layer.material,
                level=layer.level,
                cell_m=layer.cell_m,
                height=_Level(height, layer.level),
            )
        )
    notes: dict[str, object] = {"lane_paint_m2": _area(kept), "imagery": list(photo.notes)}
    return GroundMaterials(SurfaceMaterials((*kept, *seen.layers)), notes | seen.notes)


def _area(layers: list[MaterialLayer]) -> float:
    return round(sum(layer.area for layer in layers), 1)


@dataclass(frozen=True, eq=False)
class _Ground:
    """Height of the ground on level 0, of roads above it."""

    mesh: LabelledMesh
    roads: LevelHeight

    def __call__(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        if level:
            return self.roads(xy, level)
        z = ground_heights(self.mesh, xy)
        missing = np.isnan(z)
        z[missing] = self.roads(xy[missing], 0)
        return z


@dataclass(frozen=True, eq=False)
class _Level:
    height: LevelHeight
    level: int

    def __call__(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.height(xy, self.level)
