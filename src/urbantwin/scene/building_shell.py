"""Building shells: the closed surface of a union of extrusions with level or sloped tops.

The plan is divided into cells by all outlines, all creases of roofs and all lines where two tops
intersect. A cell is solid between pairs of surfaces that do not cross within it. Each corner of the
plan has one column of heights that all adjacent cells share, and there is a wall where a cell is
solid and its neighbour is not. Every vertex is a corner of the plan at one of its column's heights,
so the surface is closed for every plan.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from urbantwin.geometry import area_intersection
from urbantwin.geometry.manifold import is_closed, with_simple_edges
from urbantwin.scene.extrusion import Body, rings_of, triangulate
from urbantwin.scene.facade.wall import FLOOR, ROOF, WALL, Opening, Wall, WallMesh, wall_mesh
from urbantwin.scene.roof.facet import Facet
from urbantwin.scene.solids import Solid

__all__ = ["Shell", "ShellPlan"]

#: Outlines are snapped to this grid, metres: OpenStreetMap stores 1e-7 degrees = 1 cm.
GRID_M = 0.01
#: Creases of roofs are snapped to this grid, metres.
FINE_M = 0.001
#: Heights of one corner that differ by less than this are merged.
SAME_HEIGHT_M = 0.02

#: An edge is split at crossings of surfaces this many times over.
SPLITS = 6

#: A surface: (body, facet), facet -1 for the body's underside, -2 for its level top.
Surface = tuple[int, int]
UNDER, LEVEL = -1, -2
#: A solid interval of a cell: its lower and its upper surface.
Layer = tuple[Surface, Surface]


@dataclass(frozen=True, eq=False)
class Shell:
    """A closed surface with the kind and the body number of each face (F,)."""

    solid: Solid
    kind: NDArray[np.uint8]
    body: NDArray[np.int32]


class ShellPlan:
    """The cells of a union of bodies, its columns of heights, and its walls.

    Attributes:
        bodies: bodies of the union.
        walls: the vertical pieces of the surface, which can get openings.
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.bodies = bodies
        self._place: list[tuple[float, float]] = []
        self._number: dict[tuple[float, float], int] = {}
        self._facets: list[list[Facet]] = []
        cells = self._cells()
        self._layers = self._layers_of(cells)
        solid = [k for k, layers in enumerate(self._layers) if layers]
        self._layers = [self._layers[k] for k in solid]
        self._outlines = self._split([cells[k] for k in solid])
        self._heights = self._columns()
        self.walls: list[Wall] = list(self._walls())

    def build(self, openings: Sequence[Sequence[Opening]] | None = None) -> Shell:
        """Return the surface.

        Args:
            openings: for each of ``walls``, its recessed openings.
        """
        vertices: dict[tuple[int, float], int] = {}
        faces: list[tuple[int, int, int]] = []
        kinds: list[int] = []
        owners: list[int] = []

        def vertex(corner: int, z: float) -> int:
            return vertices.setdefault((corner, z), len(vertices))

        for outline, layers in zip(self._outlines, self._layers, strict=True):
            triangles = self._triangles(outline)
            corners = {k for triangle in triangles for k in triangle}
            stacked = {k: self._stacked(k, layers) for k in corners}
            for n, (under, over) in enumerate(layers):
                for a, b, c in triangles:
                    top = [(k, stacked[k][n][1]) for k in (a, b, c)]
                    foot = [(k, stacked[k][n][0]) for k in (a, c, b)]
                    if set(top) == set(foot):
                        continue
                    for ring_of, kind, owner in ((top, ROOF, over), (foot, FLOOR, under)):
                        faces.append(tuple(vertex(*place) for place in ring_of))  # type: ignore[arg-type]
                        kinds.append(kind)
                        owners.append(owner[0])
        extra: list[WallMesh] = []
        for number, wall in enumerate(self.walls):
            holes = openings[number] if openings is not None else ()
            ring = [vertex(wall.start, z) for z in wall.left[::-1]]
            ring += [vertex(wall.end, z) for z in wall.right]
            mesh = wall_mesh(wall, ring, holes) if holes else None
            if mesh is not None:
                extra.append(mesh)
                continue
            for triangle in _zipped(wall, ring):
                faces.append(triangle)
                kinds.append(WALL)
                owners.append(wall.body)
        keys = list(vertices)
        corner = np.array([key[0] for key in keys], np.int64)
        xyz = np.column_stack(
            [
                np.array(self._place, np.float64).reshape(-1, 2)[corner],
                np.array([key[1] for key in keys]),
            ]
        )
        own = np.array(faces, np.int64).reshape(-1, 3)
        pieces, own_kind = [own], [np.array(kinds, np.uint8)]
        own_body = [np.array(owners, np.int32)]
        places = [xyz]
        count = len(xyz)
        for mesh in extra:
            shift = np.where(mesh.faces < 0, -mesh.faces - 1, mesh.faces + count)
            pieces.append(shift)
            own_kind.append(mesh.kind)
            own_body.append(np.full(len(shift), mesh.body, np.int32))
            places.append(mesh.vertices)
            count += len(mesh.vertices)
        solid = Solid(np.concatenate(places), np.concatenate(pieces).astype(np.int32))
        if not is_closed(solid.faces):
            solid = Solid(*with_simple_edges(solid.vertices, solid.faces))
        return Shell(solid, np.concatenate(own_kind), np.concatenate(own_body))

    def _corner(self, x: float, y: float) -> int:
        number = self._number.setdefault((x, y), len(self._number))
        if number == len(self._place):
            self._place.append((x, y))
        return number

    def _height(self, surface: Surface, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a surface's heights (N,) at points (N, 2)."""
        body = self.bodies[surface[0]]
        if surface[1] == UNDER:
            return np.full(len(xy), body.low)
        if surface[1] == LEVEL:
            return np.full(len(xy), body.high)
        height = self._facets[surface[0]][surface[1]].height(xy)
        return np.clip(height, body.eaves, body.high)

    def _cells(self) -> list[Polygon]:
        """Divide the plan."""
        bodies = self.bodies
        self._alone = False
        self._facets = [list(body.roof) for body in bodies]
        if len(bodies) == 1 and not bodies[0].roof:
            alone = bodies[0].footprint
            self._inside = [alone]
            self._alone = not alone.interiors or bool(alone.boundary.is_simple)
            if self._alone:
                return [alone]
        grid = GRID_M if len(bodies) > 1 else FINE_M
        # Snapped to the grid, then precision reset, so that cut pieces keep exact coordinates.
        outlines = [
            shapely.set_precision(shapely.set_precision(body.footprint, grid), 0) for body in bodies
        ]
        self._inside = outlines
        lines = [outline.boundary for outline in outlines]
        sloped = any(body.roof for body in bodies)
        for body, outline in zip(bodies, outlines, strict=True):
            if body.roof:
                creases = shapely.union_all([facet.area.boundary for facet in body.roof])
                lines.append(shapely.intersection(creases, outline))
        if sloped and len(bodies) > 1:
            lines += self._meetings(outlines)
        joined = shapely.unary_union(lines, grid_size=FINE_M if sloped else GRID_M)
        return [
            cell
            for cell in shapely.get_parts(shapely.polygonize(shapely.get_parts(joined)))
            if cell.area > 1e-4
        ]

    def _meetings(self, outlines: list[Polygon]) -> Iterator[LineString]:
        """Yield the lines in plan along which surfaces of different bodies intersect."""
        for i, j in combinations(range(len(outlines)), 2):
            if not (self._facets[i] or self._facets[j]):
                continue
            if not outlines[i].intersects(outlines[j]):
                continue
            both = area_intersection(outlines[i], outlines[j])
            if both.area < 0.01:
                continue
            for first, first_area in self._surfaces(i):
                for second, second_area in self._surfaces(j):
                    if first[1] < 0 and second[1] < 0:
                        continue
                    area = area_intersection(area_intersection(both, first_area), second_area)
                    if area.area > 0.01:
                        yield from self._crossing(first, second, area)

    def _surfaces(self, body: int) -> list[tuple[Surface, Polygon]]:
        found = [((body, UNDER), self.bodies[body].footprint)]
        if not self._facets[body]:
            return [*found, ((body, LEVEL), self.bodies[body].footprint)]
        return found + [((body, k), facet.area) for k, facet in enumerate(self._facets[body])]

    def _plane(self, surface: Surface) -> NDArray[np.float64]:
        body = self.bodies[surface[0]]
        if surface[1] < 0:
            return np.array([0.0, 0.0, body.low if surface[1] == UNDER else body.high])
        return np.array(self._facets[surface[0]][surface[1]].plane)

    def _crossing(
        self, first: Surface, second: Surface, area: shapely.Geometry
    ) -> Iterator[LineString]:
        a, b, c = self._plane(first) - self._plane(second)
        steep = float(np.hypot(a, b))
        gap = shapely.get_coordinates(area) @ np.array([a, b]) + c
        if steep < 1e-6 or gap.min() > -SAME_HEIGHT_M or gap.max() < SAME_HEIGHT_M:
            return
        middle = shapely.get_coordinates(area.centroid)[0]
        normal = np.array([a, b]) / steep
        foot = middle - normal * ((middle @ np.array([a, b]) + c) / steep)
        along = np.array([-normal[1], normal[0]]) * area.length
        line = shapely.intersection(LineString([foot - along, foot + along]), area)
        yield from (part for part in shapely.get_parts(line) if isinstance(part, LineString))

    def _layers_of(self, cells: list[Polygon]) -> list[list[Layer]]:
        """Return the solid layers of each cell, from bottom to top."""
        points = np.array([cell.representative_point() for cell in cells])
        xy = shapely.get_coordinates(points)
        found: list[list[tuple[float, float, Surface, Surface]]] = [[] for _ in cells]
        for k, body in enumerate(self.bodies):
            inside = np.arange(len(cells))
            if not self._alone:
                shapely.prepare(self._inside[k])
                inside = np.flatnonzero(shapely.intersects(self._inside[k], points))
            if not len(inside):
                continue
            facet = np.full(len(inside), LEVEL)
            if self._facets[k]:
                tree = shapely.STRtree([facet.area for facet in self._facets[k]])
                facet = tree.query_nearest(points[inside], all_matches=False)[1]
            for cell, top in zip(inside.tolist(), facet.tolist(), strict=True):
                high = float(self._height((k, top), xy[cell : cell + 1])[0])
                if high > body.low + 1e-6:
                    found[cell].append((body.low, high, (k, UNDER), (k, top)))
        return [_merged(intervals) for intervals in found]

    def _split(self, cells: list[Polygon]) -> list[list[NDArray[np.int64]]]:
        """Number the corners of all cells' rings; add corners where surfaces cross at an edge."""
        rings = [
            [np.array([self._corner(x, y) for x, y in ring.tolist()]) for ring in rings_of(cell)]
            for cell in cells
        ]
        if not any(self._facets):
            return rings
        beside: dict[tuple[int, int], list[int]] = {}
        for number, cell in enumerate(rings):
            for ring in cell:
                for p, q in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True):
                    beside.setdefault((min(p, q), max(p, q)), []).append(number)
        new: dict[tuple[int, int], list[int]] = {}
        for (p, q), cells_here in beside.items():
            surfaces = {s for n in cells_here for layer in self._layers[n] for s in layer}
            if all(surface[1] < 0 for surface in surfaces):
                continue
            if len(self.bodies) == 1 and self._meet(p, q, surfaces):
                continue
            ends = np.array([self._place[p], self._place[q]])
            shares = self._crossings(ends, sorted(surfaces), (0.0, 1.0), SPLITS)
            if shares:
                points = ends[0] + np.array(shares)[:, None] * (ends[1] - ends[0])
                new[p, q] = [self._corner(x, y) for x, y in points.tolist()]
        if not new:
            return rings
        return [[_with_corners(ring, new) for ring in cell] for cell in rings]

    def _meet(self, p: int, q: int, surfaces: set[Surface]) -> bool:
        """Return whether the adjacent facets of one roof have equal heights along an edge."""
        facets = [self._facets[k][number].plane for k, number in surfaces if number >= 0]
        if len(facets) == 1:
            return True
        for x, y in (self._place[p], self._place[q]):
            heights = [a * x + b * y + c for a, b, c in facets]
            if max(heights) - min(heights) > SAME_HEIGHT_M:
                return False
        return True

    def _crossings(
        self,
        ends: NDArray[np.float64],
        surfaces: list[Surface],
        between: tuple[float, float],
        most: int,
    ) -> list[float]:
        """Return shares of an edge (0..1) at which surfaces cross; none cross between them."""
        share = np.array(between)
        points = ends[0] + share[:, None] * (ends[1] - ends[0])
        height = np.array([self._height(surface, points) for surface in surfaces])
        gap = height[:, None] - height[None]
        found = np.argwhere((gap[..., 0] > SAME_HEIGHT_M) & (gap[..., 1] < -SAME_HEIGHT_M))
        if not len(found) or not most:
            return []
        first, second = (surfaces[k] for k in found[0])
        low, high = between
        # Halving: surfaces end at their eaves and top, so that a gap need not be linear.
        for _ in range(40):
            middle = (low + high) / 2
            place = ends[:1] + middle * (ends[1:] - ends[:1])
            apart = float((self._height(first, place) - self._height(second, place))[0])
            if abs(apart) < 1e-6:
                break
            low, high = (middle, high) if apart > 0 else (low, middle)
        return [
            *self._crossings(ends, surfaces, (between[0], middle), most - 1),
            middle,
            *self._crossings(ends, surfaces, (middle, between[1]), most - 1),
        ]

    def _columns(self) -> dict[tuple[int, Surface], float]:
        """Return the height of every surface at every corner; nearly equal heights are merged."""
        at: dict[int, set[Surface]] = {}
        for outline, layers in zip(self._outlines, self._layers, strict=True):
            surfaces = {surface for layer in layers for surface in layer}
            for ring in outline:
                for corner in ring.tolist():
                    at.setdefault(corner, set()).update(surfaces)
        by_surface: dict[Surface, list[int]] = {}
        for corner, surfaces in at.items():
            for surface in surfaces:
                by_surface.setdefault(surface, []).append(corner)
        place = np.array(self._place, np.float64).reshape(-1, 2)
        raw: dict[int, list[tuple[float, Surface]]] = {corner: [] for corner in at}
        for surface, corners in by_surface.items():
            for corner, z in zip(
                corners, self._height(surface, place[corners]).tolist(), strict=True
            ):
                raw[corner].append((z, surface))
        heights: dict[tuple[int, Surface], float] = {}
        self._levels: dict[int, list[float]] = {}
        for corner, column in raw.items():
            column.sort()
            levels: list[float] = []
            last = -np.inf
            for z, surface in column:
                if z - last > SAME_HEIGHT_M:
                    levels.append(z)
                last = z
                heights[corner, surface] = levels[-1]
            self._levels[corner] = levels
        return heights

    def _stacked(self, corner: int, layers: list[Layer]) -> list[tuple[float, float]]:
        """Return the heights of a cell's layers at one of its corners, in ascending order.

        Slivers of a few millimetres are not cut where surfaces cross in them.
        """
        stack = []
        least = -np.inf
        for under, over in layers:
            low = max(self._heights[corner, under], least)
            least = max(self._heights[corner, over], low)
            stack.append((low, least))
        return stack

    def _triangles(self, outline: list[NDArray[np.int64]]) -> list[list[int]]:
        if len(outline) == 1 and len(outline[0]) == 3:
            return [outline[0].tolist()]
        places = [[self._place[k] for k in ring.tolist()] for ring in outline]
        _, faces = triangulate(Polygon(places[0], places[1:]))
        corners = np.concatenate(outline)
        return corners[faces].tolist()  # type: ignore[no-any-return]

    def _walls(self) -> Iterator[Wall]:
        """Yield the upright pieces between cells."""
        owner: dict[tuple[int, int], int] = {}
        for number, outline in enumerate(self._outlines):
            for ring in outline:
                for p, q in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True):
                    owner[p, q] = number
        for (p, q), number in owner.items():
            beyond = owner.get((q, p))
            here = self._intervals(p, q, number)
            there = [] if beyond is None else self._intervals(p, q, beyond)
            for low, high, body in _minus(here, there):
                left = [z for z in self._levels[p] if low[0] <= z <= high[0]]
                right = [z for z in self._levels[q] if low[1] <= z <= high[1]]
                if len(left) + len(right) > 2:
                    yield Wall(
                        p, q, self._place[p], self._place[q], left, right, body, beyond is None
                    )

    def _intervals(self, p: int, q: int, cell: int) -> list[tuple[Ends, Ends, int]]:
        """Return a cell's layers above one of its edges: lower and upper ends, and the body."""
        layers = self._layers[cell]
        return [
            ((low, other_low), (high, other_high), over[0])
            for (low, high), (other_low, other_high), (_, over) in zip(
                self._stacked(p, layers), self._stacked(q, layers), layers, strict=True
            )
        ]


def _merged(intervals: list[tuple[float, float, Surface, Surface]]) -> list[Layer]:
    """Merge intervals of one cell that overlap or touch."""
    merged: list[tuple[float, float, Surface, Surface]] = []
    for low, high, under, top in sorted(intervals):
        if merged and low <= merged[-1][1] + SAME_HEIGHT_M:
            if high > merged[-1][1]:
                merged[-1] = (merged[-1][0], high, merged[-1][2], top)
        else:
            merged.append((low, high, under, top))
    return [(under, top) for _, _, under, top in merged]


#: A height over both ends of an edge.
Ends = tuple[float, float]


def _minus(
    here: Sequence[tuple[Ends, Ends, int]], there: Sequence[tuple[Ends, Ends, int]]
) -> Iterator[tuple[Ends, Ends, int]]:
    """Yield the parts of the intervals on one side of an edge that are open on the other side.

    Heights above an edge do not cross, so they are compared by their sums.
    """
    for low, high, body in here:
        start = low
        for other_low, other_high, _ in there:
            if sum(other_high) <= sum(start) or sum(other_low) >= sum(high):
                continue
            if sum(other_low) > sum(start):
                yield start, other_low, body
            if sum(other_high) > sum(start):
                start = other_high
        if sum(start) < sum(high):
            yield start, high, body


def _zipped(wall: Wall, ring: list[int]) -> Iterator[tuple[int, int, int]]:
    """Yield triangles between the two columns of a wall, solid on the left of start -> end."""
    left, right = wall.left, wall.right
    left_vertices, right_vertices = ring[: len(left)][::-1], ring[len(left) :]
    i = j = 0
    while i + 1 < len(left) or j + 1 < len(right):
        up_right = i + 1 == len(left) or (j + 1 < len(right) and right[j + 1] <= left[i + 1])
        if up_right:
            yield left_vertices[i], right_vertices[j], right_vertices[j + 1]
            j += 1
        else:
            yield left_vertices[i], right_vertices[j], left_vertices[i + 1]
            i += 1


def _with_corners(
    ring: NDArray[np.int64], new: dict[tuple[int, int], list[int]]
) -> NDArray[np.int64]:
    longer: list[int] = []
    for p, q in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True):
        longer.append(p)
        between = new.get((min(p, q), max(p, q)), [])
        longer += between if p < q else between[::-1]
    return np.array(longer)
