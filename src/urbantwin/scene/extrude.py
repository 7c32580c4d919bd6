"""Watertight solids over footprints: prisms, and unions of prisms of different heights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from urbantwin.scene.manifold import with_simple_edges
from urbantwin.scene.solids import Solid

__all__ = ["Body", "clean_polygons", "extrude", "prism", "triangulate"]

#: Footprints that meet are joined on this grid, metres: OpenStreetMap stores 1e-7 degrees = 1 cm.
GRID_M = 0.01

Interval = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """An upright prism: a footprint between two heights, metres, site frame."""

    footprint: Polygon
    low: float
    high: float


def clean_polygons(
    geometry: BaseGeometry, *, smallest_m2: float = 0.5, thinnest_m: float = 0.1
) -> list[Polygon]:
    """Return the valid polygons of a geometry, without what is too small or thin to be drawn."""
    flat = shapely.force_2d(geometry)
    if not flat.is_valid:
        flat = shapely.make_valid(flat, method="structure", keep_collapsed=False)
    found = []
    for piece in shapely.get_parts(shapely.get_parts(flat)):
        if not isinstance(piece, Polygon) or piece.area < smallest_m2:
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
    corners = _rings(polygon)
    vertices = np.concatenate(corners)
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    points = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    index = {(x, y): k for k, (x, y) in enumerate(vertices.tolist())}
    faces = np.array([index[x, y] for x, y in points.tolist()], np.int32).reshape(-1, 3)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    clockwise = _cross(b - a, c - a) < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    return vertices, faces


def prism(polygon: Polygon, low: float, high: float) -> Solid:
    """Return the closed prism over a polygon (holes allowed) between two heights."""
    polygon = _apart(polygon)
    xy, cap = triangulate(polygon)
    count = len(xy)
    vertices = np.column_stack([np.tile(xy, (2, 1)), np.repeat([low, high], count)])
    here, there = _ring_edges(polygon)
    walls = np.concatenate(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
        ]
    )
    return Solid(vertices, np.concatenate([walls, cap + count, cap[:, ::-1]]).astype(np.int32))


def extrude(bodies: Sequence[Body]) -> Solid:
    """Return the union of prisms as one closed surface, without the faces between them.

    The plan is divided into cells by every outline; a cell is solid in the union of its bodies'
    height intervals, and a wall stands where a cell is solid and its neighbour is not.
    """
    if len(bodies) == 1:
        return prism(bodies[0].footprint, bodies[0].low, bodies[0].high)
    cells, solid = _cells(bodies)
    sheet = _Sheet()
    edges: dict[tuple[int, int], int] = {}
    caps = []
    for number, cell in enumerate(cells):
        xy, faces = triangulate(cell)
        corner = np.array([sheet.corner(x, y) for x, y in xy.tolist()])
        caps.append(corner[faces])
        here, there = _ring_edges(cell)
        edges.update(
            ((int(p), int(q)), number) for p, q in zip(corner[here], corner[there], strict=True)
        )
        for p in set(corner.tolist()):
            sheet.levels[p].update(z for interval in solid[number] for z in interval)
    for number, faces in enumerate(caps):
        for low, high in solid[number]:
            sheet.add_level(faces[:, ::-1], low)
            sheet.add_level(faces, high)
    for (p, q), number in edges.items():
        beyond = edges.get((q, p))
        for low, high in _minus(solid[number], [] if beyond is None else solid[beyond]):
            sheet.add_wall(p, q, low, high)
    return with_simple_edges(sheet.solid())


class _Sheet:
    """Collects the surface; corners of the plan carry columns of heights."""

    def __init__(self) -> None:
        self.corners: dict[tuple[float, float], int] = {}
        self.levels: list[set[float]] = []
        self.vertices: dict[tuple[int, float], int] = {}
        self.faces: list[tuple[int, int, int]] = []

    def corner(self, x: float, y: float) -> int:
        number = self.corners.setdefault((x, y), len(self.corners))
        if number == len(self.levels):
            self.levels.append(set())
        return number

    def vertex(self, corner: int, z: float) -> int:
        return self.vertices.setdefault((corner, z), len(self.vertices))

    def add_level(self, faces: NDArray[np.signedinteger[Any]], z: float) -> None:
        for a, b, c in faces.tolist():
            self.faces.append((self.vertex(a, z), self.vertex(b, z), self.vertex(c, z)))

    def add_wall(self, p: int, q: int, low: float, high: float) -> None:
        """Fill the wall over p -> q, solid on its left, with every level of both its columns."""
        left = sorted(z for z in self.levels[p] if low <= z <= high)
        right = sorted(z for z in self.levels[q] if low <= z <= high)
        i = j = 0
        while i + 1 < len(left) or j + 1 < len(right):
            up_right = i + 1 == len(left) or (j + 1 < len(right) and right[j + 1] <= left[i + 1])
            foot = self.vertex(p, left[i]), self.vertex(q, right[j])
            if up_right:
                j += 1
                self.faces.append((*foot, self.vertex(q, right[j])))
            else:
                i += 1
                self.faces.append((*foot, self.vertex(p, left[i])))

    def solid(self) -> Solid:
        xy = np.array(list(self.corners)).reshape(-1, 2)
        keys = list(self.vertices)
        corner = np.array([key[0] for key in keys], np.int64)
        z = np.array([key[1] for key in keys])
        return Solid(
            np.column_stack([xy[corner], z]), np.array(self.faces, np.int32).reshape(-1, 3)
        )


def _cells(bodies: Sequence[Body]) -> tuple[list[Polygon], list[list[Interval]]]:
    """Divide the plan of all bodies into cells, each with its solid height intervals."""
    outlines = [
        shapely.set_precision(body.footprint, GRID_M, mode="valid_output") for body in bodies
    ]
    lines = shapely.unary_union([outline.boundary for outline in outlines], grid_size=GRID_M)
    cells, solid = [], []
    for cell in shapely.get_parts(shapely.polygonize(shapely.get_parts(lines))):
        inside = shapely.intersects(np.array(outlines), cell.representative_point())
        intervals = _union(
            [(bodies[k].low, bodies[k].high) for k in np.flatnonzero(inside).tolist()]
        )
        if intervals:
            cells.append(cell)
            solid.append(intervals)
    return cells, solid


def _union(intervals: Sequence[Interval]) -> list[Interval]:
    merged: list[Interval] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], high))
        else:
            merged.append((low, high))
    return merged


def _minus(intervals: Sequence[Interval], others: Sequence[Interval]) -> Iterator[Interval]:
    for low, high in intervals:
        start = low
        for other_low, other_high in others:
            if other_high <= start or other_low >= high:
                continue
            if other_low > start:
                yield start, other_low
            start = max(start, other_high)
        if start < high:
            yield start, high


def _rings(polygon: Polygon) -> list[NDArray[np.float64]]:
    """Return the corners of every ring, the solid on their left, the closing corner left out."""
    oriented = shapely.orient_polygons(polygon)
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(oriented)]


def _ring_edges(polygon: Polygon) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ends of every ring's edges as numbers of the corners of ``_rings``."""
    here, there, start = [], [], 0
    for ring in _rings(polygon):
        numbers = np.arange(start, start + len(ring))
        here.append(numbers)
        there.append(np.roll(numbers, -1))
        start += len(ring)
    return np.concatenate(here), np.concatenate(there)


def _apart(polygon: Polygon) -> Polygon:
    """Shrink a polygon by millimetres if its rings touch: no wall's edge may have four faces."""
    if not polygon.interiors or polygon.boundary.is_simple:
        return polygon
    shrunk = polygon.buffer(-0.005, join_style="mitre")
    if isinstance(shrunk, MultiPolygon):
        shrunk = max(shrunk.geoms, key=lambda piece: piece.area)
    return shrunk


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
