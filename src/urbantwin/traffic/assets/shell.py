"""The body of a vehicle as one closed shell: a side profile with width.

The profile is a polygon in the vertical plane, with wheel arches cut out. Both sides of the body
are that polygon, triangulated and shifted to the half-width that the section (tumblehome) and the
plan (narrower at nose and tail) give at each point; strips across the vehicle join the outlines.
Edges between side and top are rounded by the distance to the profile's upper outline.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.assets.solid import Solid

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["Outline", "Panel", "Section", "arched_outline", "shell"]

#: Columns of the strips across the vehicle, as shares of the half-width.
COLUMNS = np.array([-1.0, -0.88, -0.56, -0.28, 0.0, 0.28, 0.56, 0.88, 1.0])

#: Materials of a stretch of the outline: (|column| up to, material), from the middle outwards.
#: Lamps are lens and reflector in one: their covers return like paint.
BANDS: dict[str, tuple[tuple[float, str], ...]] = {
    "paint": ((1.0, "metal-painted"),),
    "dark": ((1.0, "metal-dark"),),
    "under": ((1.0, "metal-dark"),),
    "windscreen": ((0.88, "glass"), (1.0, "metal-painted")),
    "grille": ((0.56, "metal-dark"), (1.0, "metal-painted")),
    "lamps": ((0.56, "metal-painted"), (1.0, "plastic")),
    "grille-lamps": ((0.56, "metal-dark"), (1.0, "plastic")),
}


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed profile, counter-clockwise with x to the right and z up.

    Attributes:
        points: (N, 2) x and z, metres.
        tags: N keys of ``BANDS``, for the edge that leaves each point.
    """

    points: NDArray[np.float64]
    tags: tuple[str, ...]

    def polygon(self) -> shapely.Polygon:
        """Return the profile as a polygon."""
        return shapely.Polygon(self.points)

    def reach(self, z: float) -> tuple[float, float]:
        """Return the rearmost and the foremost x of the profile at a height."""
        line = shapely.LineString([(-50.0, z), (50.0, z)])
        low, _, high, _ = self.polygon().intersection(line).bounds
        return float(low), float(high)

    def refined(self, step: float) -> Outline:
        """Return the outline with no edge longer than ``step``."""
        points, tags = [], []
        for start, end, tag in zip(
            self.points, np.roll(self.points, -1, axis=0), self.tags, strict=True
        ):
            pieces = max(1, int(np.ceil(np.linalg.norm(end - start) / step)))
            points += [start + (end - start) * k / pieces for k in range(pieces)]
            tags += [tag] * pieces
        return Outline(np.array(points), tuple(tags))


@dataclass(frozen=True)
class Panel:
    """A polygon of another material in both sides of the body: a window, a door, a trim.

    Attributes:
        corners: x and z, metres.
        material: name.
        corner_radius: metres.
        side: ``both``, ``left`` or ``right``.
    """

    corners: tuple[tuple[float, float], ...]
    material: str
    corner_radius: float = 0.0
    side: str = "both"

    def polygon(self) -> shapely.Polygon:
        """Return the panel with rounded corners."""
        sharp = shapely.Polygon(self.corners)
        if self.corner_radius == 0.0:
            return sharp
        return sharp.buffer(-self.corner_radius).buffer(self.corner_radius, quad_segs=2)


@dataclass(frozen=True)
class Section:
    """The width of a body, and the curvature of its surfaces.

    Attributes:
        half_width: largest half-width, metres.
        by_height: (z, factor) pairs: the section.
        by_length: (x, factor) pairs, x rising: the plan.
        edge_radius: rounding between the sides and the rest of the outline, metres.
        nose_bulge: distance of the nose's middle ahead of its corners, metres.
        tail_bulge: the same at the tail.
        crown: height of the roof's middle above its edges, metres.
    """

    half_width: float
    by_height: tuple[tuple[float, float], ...]
    by_length: tuple[tuple[float, float], ...]
    edge_radius: float
    nose_bulge: float = 0.0
    tail_bulge: float = 0.0
    crown: float = 0.0

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the half-width (N,) at points (N, 2) x, z of the profile, before rounding."""
        from scipy.interpolate import PchipInterpolator

        width = np.full(len(points), self.half_width)
        for axis, knots in ((1, self.by_height), (0, self.by_length)):
            where, factor = np.array(knots).T
            inside = np.clip(points[:, axis], where[0], where[-1])
            width *= PchipInterpolator(where, factor)(inside)
        return width

    def curved(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return vertices (V, 3) with nose, tail and roof bulging towards their middle."""
        x, y, z = vertices.T
        out = np.square(y / self.half_width)
        half_length, top = np.abs(x).max(), z.max()
        along = np.clip((np.abs(x) / half_length - 0.3) / 0.7, 0, 1) ** 1.5
        bulge = np.where(x > 0, self.nose_bulge, self.tail_bulge)
        up = np.clip((z / top - 0.35) / 0.65, 0, 1)
        return np.column_stack([x - np.sign(x) * bulge * along * out, y, z - self.crown * up * out])


def arched_outline(
    upper: Sequence[tuple[float, float, str]],
    axles: Sequence[float],
    *,
    arch_centre_z: float,
    arch_radius: float,
    steps: int = 10,
) -> Outline:
    """Close an upper profile with an under-body that has wheel arches.

    Args:
        upper: x, z and tag from the lowest point of the nose over the roof to the lowest point
            of the tail, x falling overall.
        axles: x of the axles that have arches, metres.
        arch_centre_z: height of the arches' centres, metres.
        arch_radius: metres.
        steps: edges per arch.
    """
    points = [(x, z) for x, z, _ in upper]
    tags = [tag for _, _, tag in upper[:-1]] + ["under"]
    (x_rear, z_rear), (x_front, z_front) = points[-1], points[0]
    for axle in sorted(axles):
        floor = z_rear + (axle - x_rear) / (x_front - x_rear) * (z_front - z_rear)
        dip = np.arcsin(np.clip((arch_centre_z - floor) / arch_radius, -1, 1))
        for angle in np.linspace(np.pi + dip, -dip, steps + 1):
            points.append(
                (axle + arch_radius * np.cos(angle), arch_centre_z + arch_radius * np.sin(angle))
            )
            tags.append("under")
    return Outline(np.array(points), tuple(tags))


def shell(
    outline: Outline, section: Section, panels: Sequence[Panel] = (), *, step: float = 0.2
) -> Solid:
    """Return the closed body of a profile.

    Args:
        outline: the profile.
        section: its widths.
        panels: polygons of other materials in the sides, inside the profile and apart from
            each other.
        step: longest edge of the outline, and the grid of the sides, metres.
    """
    outline = outline.refined(step)
    rim, columns = len(outline.points), len(COLUMNS)
    flat = outline.points
    across = _half_width(outline, section, flat)[:, None] * COLUMNS
    grid = np.stack(np.broadcast_arrays(flat[:, :1], across, flat[:, 1:]), axis=-1)
    strips, names = _strips(outline)
    vertices, faces = [grid.reshape(-1, 3)], [strips]
    count = rim * columns
    before: list[Panel] | None = None
    for side, column, sign in (("right", 0, -1.0), ("left", columns - 1, 1.0)):
        side_panels = [panel for panel in panels if panel.side in ("both", side)]
        if side_panels != before:  # both sides are equal for most vehicles
            flat, triangles, materials = _side(outline, side_panels, section.edge_radius, step)
            before = side_panels
        inner = flat[rim:]
        y = sign * _half_width(outline, section, inner)
        vertices.append(np.column_stack([inner[:, 0], y, inner[:, 1]]))
        index = np.concatenate([np.arange(rim) * columns + column, np.arange(len(inner)) + count])
        faces.append(index[triangles] if side == "right" else index[triangles[:, ::-1]])
        names += materials
        count += len(inner)
    return Solid.build(section.curved(np.concatenate(vertices)), np.concatenate(faces), names)


def _half_width(
    outline: Outline, section: Section, places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the half-width (N,) at points (N, 2) x, z, including the rounded edges."""
    inset = _distance_to_upper(outline, places)
    return section.at(places) - _rounding(inset, section.edge_radius)


def _side(
    outline: Outline, panels: Sequence[Panel], radius: float, step: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], list[str]]:
    """Triangulate the profile: points (N, 2), the outline's first; faces (F, 3); materials."""
    body = outline.polygon()
    windows = [panel.polygon() for panel in panels]
    points = [outline.points]
    rim = np.arange(len(outline.points))
    edges = [np.column_stack([rim, np.roll(rim, -1)])]
    count = len(rim)
    for window in windows:
        ring = shapely.get_coordinates(window.exterior.segmentize(step))[:-1]
        index = np.arange(len(ring)) + count
        edges.append(np.column_stack([index, np.roll(index, -1)]))
        points.append(ring)
        count += len(ring)
    free = _free_points(body, radius, step)
    lines = shapely.union_all([window.exterior for window in windows])
    if windows:
        free = free[shapely.distance(shapely.points(free), lines) > 0.2 * step]
    points.append(free)
    flat = np.concatenate(points)

    triangulation = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
    )
    triangulation.insert_vertices(cast("Buffer", flat))
    triangulation.insert_edges(cast("Buffer", np.concatenate(edges).astype(np.uint32)))
    triangulation.erase_outer_triangles()
    faces = triangulation.triangles_array()["vertices"].astype(np.int64)
    middles = shapely.points(flat[faces].mean(axis=1))
    names = np.full(len(faces), "metal-painted", dtype=object)
    for panel, window in zip(panels, windows, strict=True):
        names[shapely.contains(window, middles)] = panel.material
    return flat, faces, [str(name) for name in names]


def _free_points(body: shapely.Polygon, radius: float, step: float) -> NDArray[np.float64]:
    """Return points (N, 2) inside a profile: rings along its rounded edge, and a grid."""
    rings = [
        shapely.get_coordinates(body.buffer(-inset).segmentize(step))[:-1]
        for inset in (0.3 * radius, radius)
    ]
    # Points too close together would give slivers.
    rings = [ring[_spaced_indices(ring, 0.3 * step)] for ring in rings]
    x0, z0, x1, z1 = body.bounds
    x, z = np.meshgrid(np.arange(x0, x1, step), np.arange(z0, z1, 0.6 * step))
    grid = np.column_stack([x.ravel(), z.ravel()])
    core = body.buffer(-radius - 0.3 * step)
    return np.concatenate([*rings, grid[shapely.contains(core, shapely.points(grid))]])


def _spaced_indices(ring: NDArray[np.float64], least: float) -> list[int]:
    """Return the indices of a path's points that keep a least distance between neighbours."""
    indices = [0]
    places = ring.tolist()
    for index in range(1, len(places)):
        x, z = places[index]
        neighbours = (places[indices[-1]], places[0])
        if all(math.sqrt((u - x) ** 2 + (w - z) ** 2) >= least for u, w in neighbours):
            indices.append(index)
    return indices


def _distance_to_upper(outline: Outline, flat: NDArray[np.float64]) -> NDArray[np.float64]:
    ends = np.roll(outline.points, -1, axis=0)
    above = np.array([tag != "under" for tag in outline.tags])
    edges = np.stack([outline.points, ends], axis=1)[above]
    upper = shapely.multilinestrings(shapely.linestrings(edges))
    return np.asarray(shapely.distance(shapely.points(flat), upper))


def _rounding(inset: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return the inset (N,) of a quarter circle of ``radius`` at a distance from its end."""
    u = np.clip(1 - inset / radius, 0, 1)
    return np.asarray(radius * (1 - np.sqrt(1 - np.square(u))))


def _strips(outline: Outline) -> tuple[NDArray[np.int64], list[str]]:
    """Return the faces (F, 3) across the vehicle and their materials."""
    columns, rim = len(COLUMNS), len(outline.points)
    outer = np.maximum(np.abs(COLUMNS[:-1]), np.abs(COLUMNS[1:])).tolist()
    across = {
        tag: [next(name for limit, name in BANDS[tag] if out <= limit) for out in outer]
        for tag in set(outline.tags)
    }
    corner = np.arange(rim)[:, None] * columns + np.arange(columns - 1)
    after = np.roll(corner, -1, axis=0)
    pairs = [[corner, after + 1, after], [corner, corner + 1, after + 1]]
    faces = np.moveaxis(np.array(pairs), (0, 1), (2, 3)).reshape(-1, 3)
    return faces, [name for tag in outline.tags for name in across[tag] for _ in range(2)]
