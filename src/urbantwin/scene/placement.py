"""Placing objects: inside the region, off carriageways, on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.site.extract import OsmFeature

__all__ = [
    "along_nearest",
    "beside_carriageway",
    "not_imported",
    "on_ground",
    "toward_carriageway",
]


def beside_carriageway(
    xy: NDArray[np.float64], carriageway: Geometry, *, margin_m: float, farthest_m: float
) -> NDArray[np.float64]:
    """Move points on a carriageway to its nearest side.

    Args:
        xy: (N, 2) points, site frame.
        carriageway: area without points, site frame.
        margin_m: distance of moved points from it.
        farthest_m: maximum distance by which a point is moved.

    Returns:
        (N, 2) points; nan if the distance would be greater.
    """
    placed = np.array(xy, np.float64).reshape(-1, 2)
    if carriageway.is_empty or not len(placed):
        return placed
    taken = carriageway.buffer(margin_m)
    shapely.prepare(taken)
    inside = np.flatnonzero(shapely.contains_xy(taken, placed[:, 0], placed[:, 1]))
    if not len(inside):
        return placed
    line = shapely.shortest_line(shapely.points(placed[inside]), taken.boundary)
    ends = shapely.get_coordinates(line).reshape(-1, 2, 2)
    move = ends[:, 1] - ends[:, 0]
    placed[inside] = ends[:, 1]
    placed[inside[np.linalg.norm(move, axis=1) > farthest_m]] = np.nan
    return placed


def toward_carriageway(
    xy: NDArray[np.float64], carriageway: Geometry, *, farthest_m: float
) -> NDArray[np.float64]:
    """Return the yaw (N,) from each of (N, 2) points to the nearest carriageway, radians.

    nan if no carriageway is within ``farthest_m``.
    """
    points = np.asarray(xy, np.float64).reshape(-1, 2)
    if carriageway.is_empty or not len(points):
        return np.full(len(points), np.nan)
    line = shapely.shortest_line(shapely.points(points), carriageway)
    ends = shapely.get_coordinates(line).reshape(-1, 2, 2)
    way = ends[:, 1] - ends[:, 0]
    far = np.linalg.norm(way, axis=1) > farthest_m
    return np.where(far, np.nan, np.arctan2(way[:, 1], way[:, 0]))


def on_ground(xy: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) points on the ground; unknown heights become those of the nearest known."""
    z = np.array(height, np.float64)
    unknown = ~np.isfinite(z)
    if unknown.any():
        known = np.flatnonzero(~unknown)
        if len(known):
            from scipy.spatial import cKDTree

            z[unknown] = z[known[cKDTree(xy[known]).query(xy[unknown])[1]]]
        else:
            z[:] = 0.0
    return np.column_stack([xy, z])


def not_imported(features: Sequence[OsmFeature], without: Geometry | None) -> list[OsmFeature]:
    """Return features without those replaced by imported geometry.

    Args:
        features: the map's features, site frame.
        without: area in which they are removed, site frame; ``None``: no area.

    Returns:
        Points outside that area, and the pieces of lines and areas outside it.
    """
    if without is None or without.is_empty:
        return list(features)
    shapely.prepare(without)
    shapes = np.array([feature.geometry for feature in features], object)
    touched = shapely.intersects(shapes, without)
    kept = []
    for feature, meets in zip(features, touched.tolist(), strict=True):
        if not meets:
            kept.append(feature)
        elif feature.geometry.geom_type != "Point":
            rest = shapely.difference(feature.geometry, without)
            pieces = shapely.get_parts(rest)
            if feature.geometry.geom_type == "LineString":
                kept += [replace(feature, geometry=piece) for piece in pieces if not piece.is_empty]
            elif not rest.is_empty:
                kept.append(replace(feature, geometry=rest))
    return kept


def along_nearest(
    xy: NDArray[np.float64], lines: Sequence[Geometry], *, farthest_m: float
) -> NDArray[np.float64]:
    """Return the yaw (N,) of the nearest line to each of (N, 2) points, radians.

    nan if no line is within ``farthest_m``.
    """
    points = np.asarray(xy, np.float64).reshape(-1, 2)
    yaw = np.full(len(points), np.nan)
    shapes = [line for line in lines if line.geom_type == "LineString" and line.length > 0]
    if not shapes or not len(points):
        return yaw
    spots = shapely.points(points)
    tree = shapely.STRtree(shapes)
    number, nearest = tree.query_nearest(spots, max_distance=farthest_m, all_matches=False)
    own = tree.geometries[nearest]
    at = shapely.line_locate_point(own, spots[number])
    length = shapely.length(own)
    step = np.minimum(0.25, length / 4)
    behind = shapely.line_interpolate_point(own, np.clip(at - step, 0, length - step))
    ahead = shapely.line_interpolate_point(own, np.clip(at + step, step, length))
    way = shapely.get_coordinates(ahead) - shapely.get_coordinates(behind)
    yaw[number] = np.arctan2(way[:, 1], way[:, 0])
    return yaw
