"""Extrusions of footprints between two heights, and their triangulated plans."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from urbantwin.scene.roof.facet import Facet

__all__ = ["Body", "clean_polygons", "rings_of", "triangulate"]


@dataclass(frozen=True)
class Body:
    """An extruded footprint between two heights, metres, site frame.

    Attributes:
        footprint: its area in plan.
        low: height of its level underside.
        high: height of its top.
        roof: facets of a sloped top, in the same heights; without any, the top is level.
        eaves: minimum height of a sloped top.
    """

    footprint: Polygon
    low: float
    high: float
    roof: tuple[Facet, ...] = ()
    eaves: float = -np.inf

    def lifted(self, by: float) -> Body:
        """Return the body moved up."""
        return replace(
            self,
            low=self.low + by,
            high=self.high + by,
            roof=tuple(facet.placed(1.0, by) for facet in self.roof),
            eaves=self.eaves + by,
        )


def clean_polygons(
    geometry: BaseGeometry, *, smallest_m2: float = 0.5, thinnest_m: float = 0.1
) -> list[Polygon]:
    """Return the valid polygons of a geometry that are large enough to be drawn."""
    flat = shapely.force_2d(geometry)
    if not flat.is_valid:
        flat = shapely.make_valid(flat, method="structure", keep_collapsed=False)
    found = []
    for piece in shapely.get_parts(shapely.get_parts(flat)):
        if not isinstance(piece, Polygon) or piece.area < max(smallest_m2, 1e-3):
            continue
        smooth = shapely.remove_repeated_points(piece, 0.005)
        if not smooth.is_valid:
            smooth = piece
        if not smooth.buffer(-thinnest_m / 2).is_empty:
            found.append(smooth)
    return found


def triangulate(polygon: Polygon) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the corners (V, 2) of a polygon and triangles (F, 3) over them, counter-clockwise.

    Only the polygon's own corners are used, so triangles of neighbours fit edge to edge.
    """
    corners = rings_of(polygon)
    vertices = np.concatenate(corners)
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    points = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    index = {(x, y): k for k, (x, y) in enumerate(vertices.tolist())}
    faces = np.array([index[x, y] for x, y in points.tolist()], np.int32).reshape(-1, 3)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    clockwise = _cross(b - a, c - a) < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    return vertices, faces


def rings_of(polygon: Polygon) -> list[NDArray[np.float64]]:
    """Return the corners of every ring, the solid on their left, without the closing corner."""
    oriented = shapely.orient_polygons(polygon)
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(oriented)]


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
