"""The plan of a site behind a layout: carriageways, crossings and buildings, as rings of points."""

from __future__ import annotations

import numpy as np
import shapely

from urbantwin.geometry import LabelledMesh, area_union
from urbantwin.taxonomy import semantic_id
from urbantwin.twin import Twin

__all__ = ["Rings", "site_plan"]

#: Outlines in metres of the site frame.
Rings = list[list[list[float]]]

#: What is finer than this is not drawn, metres.
_FINE_M = 0.3


def site_plan(twin: Twin, middle: tuple[float, float], reach_m: float) -> dict[str, Rings]:
    """Return what lies around a point: ``road``, ``crossing`` and ``building``.

    Args:
        twin: the twin.
        middle: of the plan, site frame.
        reach_m: half its edge.
    """
    x, y = middle
    window = shapely.box(x - reach_m, y - reach_m, x + reach_m, y + reach_m)
    network = twin.roads
    road = area_union([network.carriageway(level) for level in network.levels])
    crossing = [lane.polygon for lane in network.lanes if lane.kind == "crossing"]
    areas = {
        "road": road,
        "crossing": area_union(crossing),
        "building": _roofs(twin.mesh, window),
    }
    return {name: _rings(shapely.intersection(area, window)) for name, area in areas.items()}


def _roofs(mesh: LabelledMesh, window: shapely.Polygon) -> shapely.Geometry:
    """Return what buildings cover in plan."""
    face = np.flatnonzero(mesh.semantic == semantic_id("building"))
    corners = mesh.triangles()[face][:, :, :2]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    wide = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) > 0.02
    west, south, east, north = window.bounds
    low, high = corners.min(axis=1), corners.max(axis=1)
    near = (high > [west, south]).all(axis=1) & (low < [east, north]).all(axis=1)
    pieces = shapely.polygons(corners[wide & near])
    return shapely.union_all(shapely.make_valid(pieces), grid_size=0.01)


def _rings(area: shapely.Geometry) -> Rings:
    area = shapely.simplify(area, _FINE_M)
    found: Rings = []
    for part in shapely.get_parts(area):
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        rings = (part.exterior, *part.interiors)
        found += [np.round(shapely.get_coordinates(ring), 1).tolist() for ring in rings]
    return found
