"""A watertight body under the patches of a roof."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry.manifold import is_closed, with_simple_edges
from urbantwin.reconstruct.airborne.roof_cells import RoofPatch

__all__ = ["flat_solid", "roof_solid"]

#: Height difference below which two patches join at a corner, metres: a LiDAR does not see the
#: step.
_STEP_M = 0.12
#: Distance from a corner within which planes intersect at the corner, metres.
_SHORT_M = 0.05
#: Triangles below this area are degenerate, square metres.
_AREA_M2 = 1e-7

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]


def flat_solid(outline: shapely.Polygon, base: float, top: float) -> Triangles:
    """Return the closed prism over an outline."""
    plane = np.array([0.0, 0.0, top])
    result = roof_solid([RoofPatch(outline, plane)], base, (top, top))
    if result is None:
        raise ValueError("an outline that cannot be extruded")
    return result


def roof_solid(
    patches: Sequence[RoofPatch], base: float, heights: tuple[float, float]
) -> Triangles | None:
    """Return the closed body between a base and the planes over patches.

    Patches must cover their outline without overlap and share corners. Walls are built under the
    outer border and where the planes of neighbours have different heights.

    Args:
        patches: patches of one building.
        base: height of the underside, metres.
        heights: minimum and maximum height of the roof, metres.

    Returns:
        Vertices (V, 3) and faces (F, 3), counter-clockwise seen from outside; ``None`` if the
        patches do not form a closed body.
    """
    body = _Body(base, heights)
    for patch in patches:
        body.add(shapely.orient_polygons(patch.polygon), patch.plane)
    body.level()
    body.cross()
    if not body.roof() or not body.walls() or not body.floor():
        return None
    vertices, faces = body.triangles()
    closed = with_simple_edges(vertices, faces) if _even(faces) else None
    if closed is None or not is_closed(closed[1]):
        return None
    vertices, faces = closed
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if (doubled < 2 * _AREA_M2).any():
        return None
    return vertices, faces


def _even(faces: NDArray[np.int32]) -> bool:
    """Return whether every edge is used equally often in both directions."""
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    size = int(faces.max(initial=0)) + 1
    return bool(np.array_equal(np.sort(start * size + end), np.sort(end * size + start)))


class _Body:
    """Builds the body; each corner of the plan has a column of heights, one per patch."""

    def __init__(self, base: float, heights: tuple[float, float]) -> None:
        self.base = base
        self.low, self.high = heights
        self.xy: list[tuple[float, float]] = []
        self.corners: dict[tuple[float, float], int] = {}
        #: Rings of corner indices of each patch, exterior first.
        self.rings: list[list[list[int]]] = []
        #: (corner, patch) -> height.
        self.z: dict[tuple[int, int], float] = {}
        self.vertices: dict[tuple[int, float], int] = {}
        self.faces: list[tuple[int, int, int]] = []
        self.edges: dict[tuple[int, int], int] = {}

    def add(self, polygon: shapely.Polygon, plane: NDArray[np.float64]) -> None:
        number = len(self.rings)
        rings = []
        for ring in (polygon.exterior, *polygon.interiors):
            at = np.asarray(ring.coords)[:-1, :2]
            z = np.clip(at @ plane[:2] + plane[2], self.low, self.high)
            corners = [self._corner(x, y) for x, y in at.tolist()]
            self.z.update(
                ((corner, number), float(h)) for corner, h in zip(corners, z, strict=True)
            )
            rings.append(corners)
        self.rings.append(rings)

    def _corner(self, x: float, y: float) -> int:
        key = (round(x, 6), round(y, 6))
        number = self.corners.setdefault(key, len(self.xy))
        if number == len(self.xy):
            self.xy.append((x, y))
        return number

    def level(self) -> None:
        """Make nearly equal heights at a corner equal."""
        columns: dict[int, list[tuple[float, int]]] = {}
        for (corner, patch), z in self.z.items():
            columns.setdefault(corner, []).append((z, patch))
        for corner, column in columns.items():
            column.sort()
            start = 0
            for k in range(1, len(column) + 1):
                apart = k == len(column) or column[k][0] - column[k - 1][0] > _STEP_M
                if apart or column[k][0] - column[start][0] > 3 * _STEP_M:
                    mean = sum(z for z, _ in column[start:k]) / (k - start)
                    for _, patch in column[start:k]:
                        self.z[corner, patch] = mean
                    start = k

    def _find_edges(self) -> None:
        self.edges = {
            (p, q): number
            for number, rings in enumerate(self.rings)
            for ring in rings
            for p, q in zip(ring, ring[1:] + ring[:1], strict=True)
        }

    def cross(self) -> None:
        """Add a corner where the planes of two neighbours intersect along their border."""
        self._find_edges()
        put: dict[tuple[int, int], int] = {}
        for (p, q), a in self.edges.items():
            b = self.edges.get((q, p))
            if b is None or p > q:
                continue
            here, there = self.z[p, a] - self.z[p, b], self.z[q, a] - self.z[q, b]
            if here * there >= 0:
                continue
            t = here / (here - there)
            (x0, y0), (x1, y1) = self.xy[p], self.xy[q]
            end = min(t, 1 - t) * np.hypot(x1 - x0, y1 - y0)
            if end < _SHORT_M:
                corner = p if t < 0.5 else q
                self.z[corner, a] = self.z[corner, b]
                continue
            z = self.z[p, a] + t * (self.z[q, a] - self.z[p, a])
            corner = self._corner(x0 + t * (x1 - x0), y0 + t * (y1 - y0))
            self.z[corner, a] = self.z[corner, b] = z
            put[p, q] = put[q, p] = corner
        if not put:
            return
        for rings in self.rings:
            for k, ring in enumerate(rings):
                longer: list[int] = []
                for p, q in zip(ring, ring[1:] + ring[:1], strict=True):
                    longer.append(p)
                    if (p, q) in put:
                        longer.append(put[p, q])
                rings[k] = longer
        self._find_edges()

    def _vertex(self, corner: int, z: float) -> int:
        return self.vertices.setdefault((corner, z), len(self.vertices))

    def roof(self) -> bool:
        """Build the roof; return False if a patch cannot be triangulated over its own corners."""
        for number, rings in enumerate(self.rings):
            at = [np.array([self.xy[c] for c in ring]) for ring in rings]
            triangles = self._triangulated(shapely.Polygon(at[0], at[1:]))
            if triangles is None:
                return False
            for corner in triangles:
                if any((c, number) not in self.z for c in corner):
                    return False
                a, b, c = (self._vertex(c, self.z[c, number]) for c in corner)
                self.faces.append((a, b, c))
        return True

    def _triangulated(self, polygon: shapely.Polygon) -> list[list[int]] | None:
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        xy = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
        u, v = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
        clockwise = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0
        xy[clockwise] = xy[clockwise][:, ::-1]
        keys = np.round(xy.reshape(-1, 2), 6).tolist()
        found = [self.corners.get((x, y)) for x, y in keys]
        if any(corner is None for corner in found):
            return None
        return np.array(found).reshape(-1, 3).tolist()

    def walls(self) -> bool:
        """Build the walls under each border, with every height of both its columns."""
        levels: dict[int, set[float]] = {}
        for (corner, _), z in self.z.items():
            levels.setdefault(corner, set()).add(z)
        outer = [edge for edge in self.edges if edge[::-1] not in self.edges]
        for edge in outer:
            for corner in edge:
                levels[corner].add(self.base)
        for (p, q), a in self.edges.items():
            b = self.edges.get((q, p))
            left, right = self.z[p, a], self.z[q, a]
            foot_left = self.base if b is None else self.z[p, b]
            foot_right = self.base if b is None else self.z[q, b]
            if left < foot_left or right < foot_right:
                continue
            self._wall(
                (p, sorted(z for z in levels[p] if foot_left <= z <= left)),
                (q, sorted(z for z in levels[q] if foot_right <= z <= right)),
            )
        return True

    def _wall(self, left: tuple[int, list[float]], right: tuple[int, list[float]]) -> None:
        (p, up_p), (q, up_q) = left, right
        i = j = 0
        while i + 1 < len(up_p) or j + 1 < len(up_q):
            turn = i + 1 == len(up_p) or (j + 1 < len(up_q) and up_q[j + 1] <= up_p[i + 1])
            foot = self._vertex(p, up_p[i]), self._vertex(q, up_q[j])
            if turn:
                j += 1
                self.faces.append((*foot, self._vertex(q, up_q[j])))
            else:
                i += 1
                self.faces.append((*foot, self._vertex(p, up_p[i])))

    def floor(self) -> bool:
        """Build the underside over the corners of the outer border."""
        outer = [edge for edge in self.edges if edge[::-1] not in self.edges]
        lines = shapely.linestrings([[self.xy[p], self.xy[q]] for p, q in outer])
        area = shapely.build_area(shapely.multilinestrings(lines))
        sheets = shapely.get_parts(area)
        laid: list[list[int]] = []
        for sheet in sheets:
            triangles = self._triangulated(sheet)
            if triangles is None:
                return False
            laid.extend(triangles)
        for a, b, c in laid:
            corner = [self._vertex(k, self.base) for k in (c, b, a)]
            self.faces.append((corner[0], corner[1], corner[2]))
        return True

    def triangles(self) -> Triangles:
        keys = list(self.vertices)
        xy = np.array([self.xy[corner] for corner, _ in keys]).reshape(-1, 2)
        z = np.array([z for _, z in keys])
        return np.column_stack([xy, z]), np.array(self.faces, np.int32).reshape(-1, 3)
