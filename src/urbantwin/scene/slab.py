"""Slabs: closed bodies over an area between two surfaces (platforms, decks, basins, ballast)."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon

from urbantwin.scene.solids import Solid

__all__ = ["plain_polygons", "plan_of", "slab"]

#: Grid for corners of areas: 1 mm, in metres.
GRID_M = 0.001


def plain_polygons(shape: shapely.Geometry, *, smallest_m2: float = 0.05) -> list[Polygon]:
    """Return the valid polygons of a shape, without corners closer than a centimetre."""
    smooth = shapely.remove_repeated_points(shapely.force_2d(shape), 0.01)
    snapped = shapely.set_precision(shapely.make_valid(smooth), GRID_M)
    pieces = shapely.get_parts(shapely.get_parts(snapped))
    whole = [p for p in pieces if isinstance(p, Polygon) and p.area >= smallest_m2]
    # Where rings touch, a wall's vertical edge would have four faces: the rings are separated.
    apart = [p if not p.interiors or p.boundary.is_simple else _shrunk(p) for p in whole]
    parts = shapely.get_parts(apart)
    return [p for p in parts if isinstance(p, Polygon) and p.area >= smallest_m2]


def _shrunk(polygon: Polygon) -> shapely.Geometry:
    inner = polygon.buffer(-5 * GRID_M, join_style="mitre", mitre_limit=2)
    return shapely.set_precision(shapely.remove_repeated_points(inner, GRID_M), GRID_M)


def plan_of(polygon: Polygon) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Return the corners (V, 2) of a polygon, triangles (F, 3) counter-clockwise, edges (E, 2).

    Triangles use only the polygon's own corners; the polygon is on the left of its edges.
    """
    rings = [
        shapely.get_coordinates(ring)[:-1]
        for ring in shapely.get_rings(shapely.orient_polygons(polygon))
    ]
    xy = np.concatenate(rings)
    starts = np.cumsum([0] + [len(ring) for ring in rings[:-1]])
    edges = np.concatenate(
        [
            np.column_stack([start + np.arange(len(r)), start + np.roll(np.arange(len(r)), -1)])
            for start, r in zip(starts, rings, strict=True)
        ]
    )
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corner = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    number = {tuple(point): k for k, point in enumerate(xy.tolist())}
    faces = np.array([number[tuple(p)] for p in corner.reshape(-1, 2).tolist()], np.int32)
    faces = faces.reshape(-1, 3)
    a, b, c = (xy[faces[:, k]] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces[turn < 0] = faces[turn < 0][:, ::-1]
    return xy, faces, edges


def slab(polygon: Polygon, low: ArrayLike, high: ArrayLike) -> Solid:
    """Return the closed body over a polygon (holes allowed).

    Args:
        polygon: its plan.
        low: height of its underside, one number or one per corner of ``plan_of`` (V,).
        high: height of its top, in the same form, above ``low`` everywhere.
    """
    xy, top, edges = plan_of(polygon)
    count = len(xy)
    z = np.concatenate([np.broadcast_to(np.asarray(s, np.float64), count) for s in (low, high)])
    here, there = edges.T
    walls = np.concatenate(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
        ]
    )
    faces = np.concatenate([walls, top + count, top[:, ::-1]]).astype(np.int32)
    return Solid(np.column_stack([np.tile(xy, (2, 1)), z]), faces)
