"""Triangles cut exactly along the outline of an area in plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.weld import bounds_of_faces, selected, some_corner

__all__ = ["Cut", "clipped", "cut_along"]

#: Distance within which a vertex is on a line, metres.
_ON_LINE_M = 1e-6
#: Cells per side of the grid that excludes triangles far from the outline.
_COARSE = 128


@dataclass(frozen=True, eq=False)
class Cut:
    """A mesh cut along an outline.

    Attributes:
        vertices: (V', 3) the original vertices, followed by new ones.
        faces: (F', 3) triangles; none crosses the outline.
        parent: (F',) original triangle of each.
        inside: (F',) whether it is inside the outline in plan.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    parent: NDArray[np.int64]
    inside: NDArray[np.bool_]


def clipped(
    mesh: TriangleMesh, region: shapely.Polygon | shapely.MultiPolygon
) -> tuple[TriangleMesh, int]:
    """Return the part of a mesh in a region, cut at its border, and the number of cut triangles.

    Args:
        mesh: welded, site frame, metres.
        region: in plan, site frame, metres.
    """
    cut = cut_along(mesh, region)
    crossed = np.bincount(cut.parent, minlength=len(mesh.faces)) > 1
    return _part(mesh, cut, cut.inside), int(crossed.sum())


def cut_along(mesh: TriangleMesh, area: shapely.Polygon | shapely.MultiPolygon) -> Cut:
    """Cut triangles along an outline so that none crosses it; neighbours stay connected.

    Each edge of the outline is a vertical plane. Each triangle edge that it crosses gets one new
    vertex, shared by its triangles, so no cracks and no T-junctions appear.

    Args:
        mesh: welded, site frame, metres.
        area: in plan, site frame, metres.
    """
    faces = mesh.faces.astype(np.int64)
    count = len(mesh.vertices)
    west, south, east, north = area.bounds
    low, high = bounds_of_faces(mesh.vertices[:, :2], faces)
    shapely.prepare(area)
    outline = area.boundary
    shapely.prepare(outline)
    beyond = (high[:, 0] < west) | (high[:, 1] < south) | (low[:, 0] > east) | (low[:, 1] > north)
    within = np.zeros(len(faces), bool)
    near = np.flatnonzero(~beyond)
    if len(near) > _COARSE**2:
        coarse, inner = _coarse(area, low[near], high[near])
        within[near[~coarse]] = inner[~coarse]
        near = near[coarse]
    boxes = shapely.box(low[near, 0], low[near, 1], high[near, 0], high[near, 1])
    meets = shapely.intersects(outline, boxes)
    clear = near[~meets]
    within[clear] = shapely.contains_xy(area, low[clear, 0], low[clear, 1])
    work = near[meets]
    # Neighbours of cut triangles share their edges and must be cut, too.
    touched = np.zeros(count, bool)
    touched[faces[work].ravel()] = True
    around = some_corner(touched, faces)
    around[work] = True

    used, local = np.unique(faces[around], return_inverse=True)
    vertices, pieces, parent = _split(
        mesh.vertices[used], local.reshape(-1, 3), np.flatnonzero(around), _segments(area)
    )
    middle = vertices[pieces].mean(axis=1)
    # Map back to the mesh's indices; new vertices follow.
    number = np.concatenate([used, count + np.arange(len(vertices) - len(used))])
    pieces = number[pieces]
    vertices = np.concatenate([mesh.vertices, vertices[len(used) :]])
    inside_piece = shapely.contains_xy(area, middle[:, 0], middle[:, 1])
    rest = ~around
    return Cut(
        vertices,
        np.concatenate([faces[rest], pieces]).astype(np.int32),
        np.concatenate([np.flatnonzero(rest), parent]),
        np.concatenate([within[rest], inside_piece]),
    )


def _coarse(
    area: shapely.Geometry, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the masks of boxes (N,) that may cross the outline, and that are inside."""
    west, south, east, north = area.bounds
    step = np.maximum(np.array([east - west, north - south]) / _COARSE, 1e-9)
    edge_x, edge_y = (np.arange(_COARSE + 1) * step[k] + (west, south)[k] for k in (0, 1))
    x, y = np.meshgrid(edge_x[:-1], edge_y[:-1])
    # a small margin, so that rounding leaves no outline between two cells
    hair = 1e-3 * step
    cells = shapely.box(x - hair[0], y - hair[1], x + step[0] + hair[0], y + step[1] + hair[1])
    met = shapely.intersects(area.boundary, cells)
    within = shapely.contains_xy(area, x + step[0] / 2, y + step[1] / 2)
    sums = np.zeros((_COARSE + 1, _COARSE + 1), np.int64)
    sums[1:, 1:] = met.cumsum(axis=0).cumsum(axis=1)
    first = np.clip(((low - (west, south)) / step).astype(np.int64), 0, _COARSE - 1)
    last = np.clip(((high - (west, south)) / step).astype(np.int64), 0, _COARSE - 1) + 1
    total = (
        sums[last[:, 1], last[:, 0]]
        - sums[first[:, 1], last[:, 0]]
        - sums[last[:, 1], first[:, 0]]
        + sums[first[:, 1], first[:, 0]]
    )
    return total > 0, within[first[:, 1], first[:, 0]]


def _segments(area: shapely.Geometry) -> NDArray[np.float64]:
    """Return the edges (E, 2, 2) of an area's outline."""
    rings = []
    for polygon in shapely.get_parts(area):
        for ring in shapely.get_rings(polygon):
            corners = shapely.get_coordinates(ring)
            rings.append(np.stack([corners[:-1], corners[1:]], axis=1))
    return np.concatenate(rings) if rings else np.zeros((0, 2, 2))


def _split(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    parent: NDArray[np.int64],
    segments: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Split triangles by the vertical plane through each segment that they cross."""
    for start, end in segments:
        way = end - start
        length = float(np.hypot(*way))
        if length < _ON_LINE_M:
            continue
        way = way / length
        corner = vertices[faces][:, :, :2] - start
        across = corner[:, :, 0] * -way[1] + corner[:, :, 1] * way[0]
        across[np.abs(across) < _ON_LINE_M] = 0.0
        along = corner @ way
        crosses = (across.min(axis=1) < 0) & (across.max(axis=1) > 0)
        crosses &= (along.max(axis=1) > -_ON_LINE_M) & (along.min(axis=1) < length + _ON_LINE_M)
        # Far from the segment, a triangle crosses its line only.
        crosses[crosses] = _meets(corner[crosses], across[crosses], way, length)
        if not crosses.any():
            continue
        count = len(vertices)
        following = np.roll(faces, -1, axis=1)
        a, b = np.minimum(faces, following), np.maximum(faces, following)
        keys = a * np.int64(count) + b
        opposite = across * np.roll(across, -1, axis=1) < 0
        cut_keys = np.unique(keys[crosses][opposite[crosses]])
        if not len(cut_keys):
            # The line passes through a corner of each triangle only.
            continue
        is_cut = np.isin(keys, cut_keys)
        first, second = vertices[cut_keys // count], vertices[cut_keys % count]
        d1 = (first[:, :2] - start) @ np.array([-way[1], way[0]])
        d2 = (second[:, :2] - start) @ np.array([-way[1], way[0]])
        share = (d1 / (d1 - d2))[:, None]
        vertices = np.concatenate([vertices, first + share * (second - first)])
        middle = np.where(is_cut, count + np.searchsorted(cut_keys, keys), -1)
        faces, parent = _split_edges(faces, parent, middle)
    return vertices, faces, parent


def _meets(
    corner: NDArray[np.float64],
    across: NDArray[np.float64],
    way: NDArray[np.float64],
    length: float,
) -> NDArray[np.bool_]:
    """Return whether triangles (N,) that cross a segment's line cross the segment."""
    along = corner @ way
    following, across2 = np.roll(along, -1, axis=1), np.roll(across, -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = along + across / (across - across2) * (following - along)
    on_edge = across * across2 < 0
    places = np.concatenate(
        [np.where(on_edge, at, np.nan), np.where(across == 0, along, np.nan)], 1
    )
    low, high = np.nanmin(places, axis=1), np.nanmax(places, axis=1)
    return np.asarray((high > -_ON_LINE_M) & (low < length + _ON_LINE_M))


def _split_edges(
    faces: NDArray[np.int64], parent: NDArray[np.int64], middle: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split triangles at the new vertices (F, 3) of their edges, -1 for uncut edges."""
    number = (middle >= 0).sum(axis=1)
    out, parents = [faces[number == 0]], [parent[number == 0]]

    one = np.flatnonzero(number == 1)
    if len(one):
        turn = np.argmax(middle[one] >= 0, axis=1)  # the cut edge first
        a, b, c, m, _, _ = _turned(faces[one], middle[one], turn)
        out += [np.column_stack([a, m, c]), np.column_stack([m, b, c])]
        parents += [parent[one]] * 2

    two = np.flatnonzero(number == 2)
    if len(two):
        turn = (np.argmax(middle[two] < 0, axis=1) + 1) % 3  # the uncut edge last
        a, b, c, m, n, _ = _turned(faces[two], middle[two], turn)
        out += [np.column_stack([m, b, n]), np.column_stack([a, m, n]), np.column_stack([a, n, c])]
        parents += [parent[two]] * 3

    three = np.flatnonzero(number == 3)
    if len(three):  # impossible for a line; handled for completeness
        a, b, c, m, n, k = _turned(faces[three], middle[three], np.zeros(len(three), np.int64))
        out += [np.column_stack(t) for t in ((a, m, k), (m, b, n), (k, n, c), (m, n, k))]
        parents += [parent[three]] * 4
    return np.concatenate(out), np.concatenate(parents)


def _turned(
    faces: NDArray[np.int64], middle: NDArray[np.int64], turn: NDArray[np.int64]
) -> tuple[NDArray[np.int64], ...]:
    """Return corners and edge vertices, rotated to start at the corner ``turn`` (N,)."""
    rows = np.arange(len(faces))
    corners = [faces[rows, (turn + k) % 3] for k in range(3)]
    edges = [middle[rows, (turn + k) % 3] for k in range(3)]
    return (*corners, *edges)


def _part(mesh: TriangleMesh, cut: Cut, keep: NDArray[np.bool_]) -> TriangleMesh:
    """Return the pieces with a true ``keep`` (F',), with their triangles' attributes."""
    parent = cut.parent[keep]
    whole = replace(
        mesh,
        vertices=cut.vertices,
        faces=cut.faces[keep],
        colour=None if mesh.colour is None else mesh.colour[parent],
        object=mesh.object[parent],
        semantic=None if mesh.semantic is None else mesh.semantic[parent],
    )
    return selected(whole)
