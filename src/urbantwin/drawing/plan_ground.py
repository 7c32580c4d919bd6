"""Areas of a plan: ground, buildings, plants, lanes by kind, footways, islands, curbs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from urbantwin.drawing.footprint import footprints
from urbantwin.drawing.plan_style import Look
from urbantwin.drawing.road_furniture import islands
from urbantwin.geometry import LabelledMesh
from urbantwin.roads import RoadNetwork
from urbantwin.roads.model import LaneModel
from urbantwin.scene.surface import PARTS

__all__ = ["draw_ground", "draw_surfaces", "fill"]

#: Lanes with a separate fill; all other parts of the carriageway are drawn as one.
_OWN_FILL = ("driving", "bus", "bicycle", "parking", "shoulder")
#: A carriageway's edge within this distance of a raised area is a curb, metres.
_AT_CURB_M = 0.35
#: Results of `_of_mesh`, as long as the mesh is in use.
_OUTLINES: WeakKeyDictionary[LabelledMesh, tuple[list[shapely.Geometry], ...]] = WeakKeyDictionary()


def fill(
    axes: Axes,
    shapes: Iterable[shapely.Geometry],
    colour: str,
    **kwargs: Any,  # noqa: ANN401 - matplotlib's own keywords
) -> None:
    """Fill polygons and multipolygons, holes left open."""
    patches = []
    for shape in shapes:
        for part in shapely.get_parts(shape):
            if part.geom_type != "Polygon" or part.is_empty:
                continue
            rings = [part.exterior, *part.interiors]
            outline = Outline.make_compound_path(
                *[Outline(np.asarray(ring.coords)[:, :2], closed=True) for ring in rings]
            )
            patches.append(PathPatch(outline))
    if patches:
        given: dict[str, Any] = {"facecolor": colour, "edgecolor": "none", "linewidth": 0}
        given.update(kwargs)
        axes.add_collection(PatchCollection(patches, **given), autolim=False)


def draw_ground(axes: Axes, region: shapely.Polygon, mesh: LabelledMesh | None, look: Look) -> None:
    """Draw the region's ground, and the objects on it."""
    fill(axes, [region], look.ground, zorder=0)
    if mesh is None:
        return
    islands_of_mesh, plants, buildings = _of_mesh(mesh)
    fill(
        axes,
        islands_of_mesh,
        look.lanes["island"],
        zorder=4,
        edgecolor=look.curb,
        linewidth=0.7,
    )
    fill(axes, plants, look.green, zorder=2)
    fill(axes, buildings, look.building, zorder=3, edgecolor=look.edge, linewidth=0.5)


def _of_mesh(mesh: LabelledMesh) -> tuple[list[shapely.Geometry], ...]:
    """Return the outlines of islands, plants and buildings; several plans show the same mesh."""
    if mesh not in _OUTLINES:
        # Areas between carriageways are raised in the scene, even without a lane in the model.
        island = mesh.select(mesh.part == PARTS["island"])
        found = (
            footprints(island, "other-ground"),
            footprints(mesh, "vegetation", hull=True),
            footprints(mesh, "building"),
        )
        _OUTLINES[mesh] = tuple(list(one.values()) for one in found)
    return _OUTLINES[mesh]


def draw_surfaces(axes: Axes, network: RoadNetwork, model: LaneModel | None, look: Look) -> None:
    """Draw carriageways and footways, level by level: a deck hides the ways below it."""
    raised = islands(network, model)
    for level in network.levels:
        zorder = 10.0 + 10 * level
        lanes = [lane for lane in network.lanes if lane.level == level]
        carriageway, footway = network.carriageway(level), network.footway(level)
        if level:
            deck = shapely.buffer(shapely.union_all([carriageway, footway]), 0.8)
            fill(axes, [deck], look.curb, zorder=zorder)
        fill(axes, [footway], look.lanes["sidewalk"], zorder=zorder + 0.2)
        fill(axes, [carriageway], look.lanes["junction"], zorder=zorder + 0.4)
        for kind in _OWN_FILL:
            shapes = [lane.polygon for lane in lanes if lane.kind == kind]
            fill(axes, shapes, look.lanes[kind], zorder=zorder + 0.6)
        own = [area for _, area in raised] if level == 0 else []
        fill(
            axes, own, look.lanes["island"], zorder=zorder + 0.7, edgecolor=look.curb, linewidth=0.7
        )
        stands = shapely.buffer(shapely.union_all([footway, *own]), _AT_CURB_M)
        edge = shapely.intersection(shapely.boundary(carriageway), stands)
        lines = [
            shapely.get_coordinates(part)
            for part in shapely.get_parts(shapely.line_merge(edge))
            if part.geom_type == "LineString"
        ]
        curbs = LineCollection(lines, colors=look.curb, linewidths=0.8, zorder=zorder + 1.6)
        axes.add_collection(curbs, autolim=False)
