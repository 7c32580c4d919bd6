"""Chimneys, lift houses and other small objects on a roof, as upright boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from urbantwin.reconstruct.airborne.roof_cells import GRID_M, RoofPatch
from urbantwin.reconstruct.airborne.roof_lines import main_directions
from urbantwin.reconstruct.airborne.roof_solid import roof_solid

__all__ = ["roof_objects"]

#: Minimum height of an object above its roof, metres.
_HIGH_M = 0.4
#: Maximum distance of its points from each other in plan, metres.
_LINK_M = 0.6
_FEWEST = 5
#: Minimum and maximum side in plan, metres: masts are thinner; crowns over the roof are wider.
_THIN_M, _WIDE_M = 0.4, 5.0
#: Minimum point density of a box's top relative to the roof's, which crowns and cables lack.
_FILL = 0.35
#: Depth of the closed box below the roof, metres.
_SUNK_M = 0.2

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]


def roof_objects(
    outline: shapely.Polygon,
    patches: Sequence[RoofPatch],
    points: NDArray[np.float64],
    density: float,
) -> list[Triangles]:
    """Return a closed box for each object on a roof.

    Args:
        outline: outline of the building.
        patches: patches of its roof.
        points: (N, 3) of the roof, all of them.
        density: points per square metre.
    """
    roof = surface_heights(patches, points[:, :2])
    high = points[np.nan_to_num(points[:, 2] - roof, nan=-1.0) > _HIGH_M]
    if len(high) < _FEWEST:
        return []
    pairs = cKDTree(high[:, :2]).query_pairs(_LINK_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), (len(high),) * 2)
    count, number = connected_components(graph, directed=False)
    angle = float(main_directions(outline)[0])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
    inner = outline.buffer(-0.02)
    found = []
    for mine in groups if count else []:
        box = _box(high[mine], turn, density)
        if box is None:
            continue
        place, top = box
        place = shapely.set_precision(shapely.intersection(place, inner), GRID_M)
        if place.geom_type != "Polygon" or place.area < _THIN_M**2:
            continue
        corners = np.vstack([shapely.get_coordinates(place), place.centroid.coords[0]])
        foot = np.nanmin(np.append(surface_heights(patches, corners), top)) - _SUNK_M
        if top - foot < _HIGH_M:
            continue
        solid = roof_solid([RoofPatch(place, np.array([0.0, 0.0, top]))], foot, (top, top))
        if solid is not None:
            found.append(solid)
    return found


def _box(
    points: NDArray[np.float64], turn: NDArray[np.float64], density: float
) -> tuple[shapely.Polygon, float] | None:
    """Return a rectangle around points along the building, and its top; ``None`` if invalid."""
    if len(points) < _FEWEST:
        return None
    turned = points[:, :2] @ turn.T
    # Half the point spacing is added on each side.
    edge = 0.25 / np.sqrt(max(density, 1.0))
    low, high = np.percentile(turned, [2, 98], axis=0)
    low, high = low - edge, high + edge
    side = high - low
    if side.min() < _THIN_M or side.max() > _WIDE_M:
        return None
    if len(points) < _FILL * density * side[0] * side[1]:
        return None
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return shapely.Polygon(corners @ turn), float(np.percentile(points[:, 2], 75))


def surface_heights(patches: Sequence[RoofPatch], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights (N,) of patches at points in plan; nan outside."""
    z = np.full(len(xy), np.nan)
    tree = shapely.STRtree(np.array([patch.polygon for patch in patches], dtype=object))
    point, patch = tree.query(shapely.points(xy), predicate="intersects")
    planes = np.array([item.plane for item in patches])[patch]
    z[point] = (planes[:, :2] * xy[point]).sum(axis=1) + planes[:, 2]
    return z
