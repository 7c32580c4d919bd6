"""The ground as one watertight surface: zones triangulated together, joined by curbs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from urbantwin.geometry import LabelledMesh, row_keys
from urbantwin.progress import Progress, between, each, untold
from urbantwin.scene.dropped_curb import DroppedCurbs
from urbantwin.scene.zones import Zone
from urbantwin.taxonomy import material_id, semantic_id

if TYPE_CHECKING:
    from typing_extensions import Buffer

__all__ = ["PARTS", "Spacing", "surface_mesh"]

#: ``part`` numbers of the ground's triangles; other objects start at ``FIRST_OBJECT``.
PARTS = {
    "terrain": 0,
    "carriageway": 1,
    "footway": 2,
    "island": 3,
    "paved": 4,
    "curb": 5,
    "water": 6,
}
#: Maximum distance from every zone of a triangle that still belongs to the ground, metres.
SPECK_M = 0.1
#: Vertices are snapped to this grid, so that zones that touch share their vertices.
GRID_M = 0.01
#: Minimum distance of added terrain vertices from borders of zones, metres.
SLIT_M = 0.1
#: Distance over which the terrain changes from the road's height to the ground's, metres.
BLEND_M = 10.0

#: Maximum distance of an edge of a road's triangle from the road surface, and the shortest edge
#: that is still split for it, metres.
FIT_M, SHORTEST_M = 0.003, 0.4
#: Triangles below this area, doubled, are dropped.
SLIVER_M2 = 1e-9
#: Rounds of splitting.
ROUNDS = 10
#: An edge's number: its lower vertex index times this, plus the other index.
CODE = 1 << 31

Heights = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Spacing:
    """Maximum distance between vertices on roads and on terrain, metres."""

    road: float
    terrain: float


def surface_mesh(
    zones: Sequence[Zone],
    *,
    road_height: Heights,
    terrain_height: Heights,
    spacing: Spacing,
    lines: Sequence[shapely.LineString] = (),
    drops: DroppedCurbs | None = None,
    bends: NDArray[np.float64] | None = None,
    tell: Progress = untold,
) -> LabelledMesh:
    """Triangulate zones that tile an area into one surface.

    Neighbouring zones share their vertices in plan. Where two zones have different heights along an
    edge, a vertical strip (a curb) joins them, so the surface has no gap. Terrain has the road's
    height along roads and returns to its own height within about ``BLEND_M``. Road triangles are
    split until none deviates from the road surface by more than a few millimetres.

    Args:
        zones: the zones, without overlaps.
        road_height: height of the carriageway at (N, 2) points, metres.
        terrain_height: height of the bare earth at (N, 2) points, metres.
        spacing: maximum distances between vertices.
        lines: ridges of roads; triangles do not cross them.
        drops: dropped curbs.
        bends: (N, 2) points at which the terrain bends: additional vertices.
        tell: called with the share done (0..1) and the current task.
    """
    tell(0.0, "borders")
    drops = drops or DroppedCurbs()
    plan = _plan(zones, spacing, [*lines, *drops.lines()], bends)
    xy, triangles, road = _fitted(plan, zones, road_height, between(tell, 0.2, 0.6))
    tell(0.6, "heights")
    zone = _zone_of(zones, xy[triangles].mean(axis=1))
    triangles, zone = triangles[zone >= 0], zone[zone >= 0]
    step = np.array([np.nan if z.step is None else z.step for z in zones])[zone]
    step = step[:, None] * drops.share(xy)[triangles]
    still = np.array([z.kind == "water" for z in zones])[zone]
    corner_z = _heights(xy, triangles, step, road, terrain_height(xy), still)
    tell(0.9, "curbs")
    vertices, faces = _weld(xy, triangles, corner_z)
    part = np.array([PARTS[z.kind] for z in zones])[zone]
    semantic = np.array([z.semantic for z in zones])[zone]
    material = np.array([z.material for z in zones])[zone]
    ground = LabelledMesh.build(vertices, faces, semantic, material, part)
    return LabelledMesh.concatenate([ground, _curbs(xy, triangles, corner_z)])


def _plan(
    zones: Sequence[Zone],
    spacing: Spacing,
    lines: Sequence[shapely.LineString],
    bends: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (N, 2), and the edges (E, 2) that the triangulation must keep."""
    paved = shapely.union_all([z.area for z in zones if z.step is not None])
    ridges = shapely.intersection(shapely.union_all(list(lines)), paved)
    borders = shapely.union_all(
        [*(shapely.boundary(z.area) for z in zones), *_lines_of(ridges)], grid_size=GRID_M
    )
    borders = shapely.segmentize(borders, spacing.road)
    parts = shapely.get_parts(borders)
    coordinates, line = shapely.get_coordinates(parts, return_index=True)
    rounded = np.round(coordinates / 1e-4).astype(np.int64)
    _, first, index = np.unique(row_keys(rounded), axis=0, return_index=True, return_inverse=True)
    keys, index = rounded[first], index.ravel()
    joined = line[1:] == line[:-1]
    edges = np.sort(np.column_stack([index[:-1], index[1:]])[joined], axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    edges = edges[np.unique(row_keys(edges), axis=0, return_index=True)[1]]
    extra = np.concatenate(
        [
            _grid_points(z.area, spacing.road if z.step is not None else spacing.terrain)
            for z in zones
        ]
    )
    shapely.prepare(borders)
    extra = extra[
        ~shapely.dwithin(borders, shapely.points(extra), min(spacing.road, spacing.terrain) / 4)
    ]
    if bends is not None and len(bends):
        extra = np.unique(np.concatenate([extra, _beside(bends, zones, borders)]), axis=0)
    return np.concatenate([keys * 1e-4, extra]), edges


def _beside(
    bends: NDArray[np.float64], zones: Sequence[Zone], borders: shapely.Geometry
) -> NDArray[np.float64]:
    """Return the (N, 2) points that are within terrain, but not on its borders."""
    paved = shapely.union_all([z.area for z in zones if z.step is not None])
    shapely.prepare(paved)
    free = bends[~shapely.contains_xy(paved, bends[:, 0], bends[:, 1])]
    return np.asarray(free[~shapely.dwithin(borders, shapely.points(free), SLIT_M)])


def _lines_of(shape: shapely.Geometry) -> list[shapely.Geometry]:
    return [part for part in shapely.get_parts(shape) if part.geom_type == "LineString"]


def _fitted(
    plan: tuple[NDArray[np.float64], NDArray[np.int64]],
    zones: Sequence[Zone],
    road_height: Heights,
    tell: Progress,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Split edges of road triangles until all are on the road surface.

    Returns:
        Points (N, 2), triangles (F, 3), and the road's height (N,) at the points.
    """
    xy, kept = plan
    z = road_height(xy)
    paved = shapely.union_all([zone.area for zone in zones if zone.step is not None])
    shapely.prepare(paved)
    good = np.zeros(0, np.int64)
    for _ in each(range(ROUNDS), tell, "triangles"):
        xy, triangles = _triangulated(xy, kept)
        if len(xy) > len(z):  # a point was added where fixed edges cross
            z = np.concatenate([z, road_height(xy[len(z) :])])
        middle = xy[triangles].mean(axis=1)
        inside = triangles[shapely.contains_xy(paved, middle[:, 0], middle[:, 1])]
        edges = np.sort(inside[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        code = np.unique(edges[:, 0] * CODE + edges[:, 1])
        code = code[~np.isin(code, good, assume_unique=True)]
        a, b = code // CODE, code % CODE
        length = np.linalg.norm(xy[b] - xy[a], axis=1)
        long = length > SHORTEST_M
        a, b, code = a[long], b[long], code[long]
        off = np.zeros(len(a))
        for share in (0.25, 0.5, 0.75):
            there = road_height(xy[a] + share * (xy[b] - xy[a]))
            off = np.maximum(off, np.abs(there - z[a] - share * (z[b] - z[a])))
        bad = off > FIT_M
        bad[bad] = _new(xy, (xy[a[bad]] + xy[b[bad]]) / 2)
        good = np.union1d(good, code[~bad])
        if not bad.any():
            break
        added = len(xy) + np.arange(int(bad.sum()))
        middle = (xy[a[bad]] + xy[b[bad]]) / 2
        xy, z = np.concatenate([xy, middle]), np.concatenate([z, road_height(middle)])
        kept_code = kept.min(axis=1) * CODE + kept.max(axis=1)
        order = np.argsort(code[bad])
        at = np.searchsorted(code[bad][order], kept_code)
        at = order[np.minimum(at, len(order) - 1)]
        split = code[bad][at] == kept_code
        halves = [np.column_stack([kept[split][:, end], added[at[split]]]) for end in (0, 1)]
        kept = np.concatenate([kept[~split], *halves])
    else:
        xy, triangles = _triangulated(xy, kept)
        if len(xy) > len(z):
            z = np.concatenate([z, road_height(xy[len(z) :])])
    return xy, triangles, z


def _new(xy: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (N,) are new and not duplicates."""
    keys = np.round(np.concatenate([xy, points]) / 1e-4).astype(np.int64)
    _, first = np.unique(row_keys(keys), axis=0, return_index=True)
    new = np.zeros(len(keys), bool)
    new[first] = True
    return new[len(xy) :]


def _triangulated(
    xy: NDArray[np.float64], kept: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Constrained Delaunay triangulation; triangles counter-clockwise."""
    mesh = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO,
        pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE,
        GRID_M / 100,
    )
    mesh.insert_vertices(cast("Buffer", np.ascontiguousarray(xy)))
    mesh.insert_edges(cast("Buffer", kept.astype(np.uint32)))
    mesh.erase_super_triangle()
    corners = mesh.vertices_array()
    triangles = mesh.triangles_array()["vertices"].astype(np.int64)
    points = np.column_stack([corners["x"], corners["y"]])
    # Points along the outer border that rounding took off their line make slivers with the hull.
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return points, triangles[doubled > SLIVER_M2]


def _grid_points(area: shapely.Geometry, step: float) -> NDArray[np.float64]:
    """Points of a staggered grid inside an area."""
    west, south, east, north = area.bounds
    rows = np.arange(np.floor(south / step), np.ceil(north / step) + 1)
    columns = np.arange(np.floor(west / step), np.ceil(east / step) + 1)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    grid[:, 0] += 0.5 * (grid[:, 1] % 2)
    points = grid * step
    shapely.prepare(area)
    return np.asarray(points[shapely.contains_xy(area, points[:, 0], points[:, 1])])


def _zone_of(zones: Sequence[Zone], points: NDArray[np.float64]) -> NDArray[np.int64]:
    found = np.full(len(points), -1)
    for number, zone in enumerate(zones):
        shapely.prepare(zone.area)
        inside = shapely.intersects_xy(zone.area, points[:, 0], points[:, 1])
        found[inside & (found < 0)] = number
    # Snapping moves borders by millimetres and zones omit very small areas: triangles outside all
    # zones are assigned to the nearest zone.
    missing = np.flatnonzero(found < 0)
    if len(missing):
        areas = np.array([zone.area for zone in zones])
        distance = shapely.distance(shapely.points(points[missing])[:, None], areas[None, :])
        nearest = distance.argmin(axis=1)
        close = distance.min(axis=1) < SPECK_M
        found[missing[close]] = nearest[close]
    return found


def _heights(
    xy: NDArray[np.float64],
    triangles: NDArray[np.int64],
    step: NDArray[np.float64],
    road: NDArray[np.float64],
    terrain: NDArray[np.float64],
    still: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the height (F, 3) of each triangle's corners; ``step`` (F, 3) above the road.

    Terrain that is ``still`` (F,), i.e. water, keeps its height next to roads.
    """
    natural = np.isnan(step[:, 0])
    z = road[triangles] + np.where(natural[:, None], 0.0, step)
    if not natural.any():
        return z
    # Terrain has the height of the highest road surface at a shared vertex.
    top = np.full(len(xy), -np.inf)
    np.maximum.at(top, triangles[~natural].ravel(), z[~natural].ravel())
    fixed = np.isfinite(top)
    correction = np.where(fixed, top - terrain, 0.0)
    fixed[triangles[still].ravel()] = True
    correction = _spread(xy, triangles[natural], correction, fixed)
    z[natural] = (terrain + correction)[triangles[natural]]
    return z


def _spread(
    xy: NDArray[np.float64],
    triangles: NDArray[np.int64],
    value: NDArray[np.float64],
    fixed: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Solve (laplacian - 1 / BLEND_M^2) value = 0 on the terrain, with fixed values given."""
    used = np.zeros(len(xy), bool)
    used[triangles.ravel()] = True
    free = used & ~fixed
    if not free.any() or not value[fixed & used].any():
        return value
    a, b, c = (xy[triangles[:, k]] for k in range(3))
    doubled = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) + 1e-12
    rows, columns, weights = [], [], []
    for k in range(3):
        i, j, opposite = triangles[:, (k + 1) % 3], triangles[:, (k + 2) % 3], xy[triangles[:, k]]
        cotangent = ((xy[i] - opposite) * (xy[j] - opposite)).sum(axis=1) / doubled
        rows += [i, j]
        columns += [j, i]
        weights += [np.maximum(cotangent, 1e-3) / 2] * 2
    n = len(xy)
    stiffness = coo_matrix(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), (n, n)
    ).tocsr()
    mass = np.bincount(triangles.ravel(), np.repeat(doubled / 6, 3), minlength=n)
    system = diags(np.asarray(stiffness.sum(axis=1)).ravel() + mass / BLEND_M**2) - stiffness
    system = system.tocsr()[free]
    known = np.where(fixed & used, value, 0.0)
    solved = known.copy()
    solved[free] = spsolve(system[:, free].tocsc(), -system @ known)
    return solved


def _weld(
    xy: NDArray[np.float64], triangles: NDArray[np.int64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Merge vertices of equal position and height."""
    height = np.round(z.ravel() * 1e5).astype(np.int64)
    keys = np.column_stack([triangles.ravel(), height])
    _, first, inverse = np.unique(row_keys(keys), axis=0, return_index=True, return_inverse=True)
    vertices = np.column_stack([xy[triangles.ravel()[first]], z.ravel()[first]])
    return vertices, inverse.reshape(-1, 3)


def _curbs(
    xy: NDArray[np.float64], triangles: NDArray[np.int64], z: NDArray[np.float64]
) -> LabelledMesh:
    """Return vertical strips along edges whose two triangles have different heights."""
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    z_start, z_end = z.ravel(), np.roll(z, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort([start, high, low])
    pair = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    first, second = order[:-1][pair], order[1:][pair]
    # ``second`` has the opposite direction: its start is ``first``'s end.
    gap_start = z_start[first] - z_end[second]
    gap_end = z_end[first] - z_start[second]
    stepped = np.maximum(np.abs(gap_start), np.abs(gap_end)) > 1e-4
    first, second = first[stepped], second[stepped]
    a = np.column_stack([xy[start[first]], z_start[first]])
    b = np.column_stack([xy[end[first]], z_end[first]])
    a2 = np.column_stack([xy[start[first]], z_end[second]])
    b2 = np.column_stack([xy[end[first]], z_start[second]])
    count = len(first)
    vertices = np.concatenate([a, b, a2, b2])
    i = np.arange(count)
    # Seen from ``second``'s side (right of a -> b) the strip under ``first`` faces outwards.
    faces = np.concatenate(
        [
            np.column_stack([i, i + 2 * count, i + 3 * count]),
            np.column_stack([i, i + 3 * count, i + count]),
        ]
    )
    strip = LabelledMesh.build(
        vertices, faces, semantic_id("sidewalk"), material_id("concrete"), PARTS["curb"]
    )
    return strip.select(strip.areas() > 1e-9)
