"""Vehicles baked into a mesh: detected, cut out, the holes filled."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.clip import cut_along
from urbantwin.reconstruct.cleaning.connected_components import pieces_of
from urbantwin.reconstruct.cleaning.height_grid import Grid
from urbantwin.reconstruct.cleaning.hole_filling import Outline, fill, outline_of
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.removal import Removal, Spots
from urbantwin.reconstruct.cleaning.street_surface import REACH_M, WIDEST_M, Street, street_of_mesh
from urbantwin.reconstruct.cleaning.triangle_corners import bounds_of_faces, some_corner
from urbantwin.reconstruct.cleaning.vehicle import Blob, find_blobs, vehicle_kind
from urbantwin.reconstruct.cleaning.weld import selected

__all__ = ["Untrafficked", "without_traffic"]

#: What is higher than this over the ground under a vehicle is the vehicle's, metres.
_OVER_M = 0.05
#: The rim lies within this of the ground that is expected, metres.
_RIM_M = 0.35
#: Share of the rays from half a metre around a vehicle that meet it within a reach, metres.
_CLOSED, _SIDE_REACH_M = 0.6, 1.4
#: Cells of the grid that tells which triangles come near vehicles, metres.
_COARSE_M = 1.0
#: What an override names may be this high, metres.
_HIGHEST_M = 100.0


@dataclass(frozen=True, eq=False)
class Untrafficked:
    """A mesh without traffic.

    Attributes:
        mesh: the mesh, its surface closed.
        removed: what was taken out.
        kept: vehicles that an override kept.
        passed: objects on the carriageway that do not qualify as vehicles, and why.
    """

    mesh: TriangleMesh
    removed: list[Removal]
    kept: list[Removal]
    passed: list[Removal]


def without_traffic(
    mesh: TriangleMesh,
    region: shapely.Geometry,
    roads: shapely.Geometry | None,
    keep: Spots,
    remove: Spots | None = None,
) -> Untrafficked:
    """Return a mesh without the vehicles that are baked into it.

    Args:
        mesh: welded, site frame, metres.
        region: where to look.
        roads: carriageways and parking; ``None`` or empty looks everywhere, for cars only.
        keep: vehicles that stay.
        remove: if given, what stands there goes whatever it is, and nothing else does.
    """
    if not len(mesh.faces):
        return Untrafficked(mesh, [], [], [])
    rays = Rays(mesh.vertices, mesh.faces)
    bounds = np.array([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    widest, reach = (WIDEST_M, REACH_M) if remove is None else (remove.widest(WIDEST_M), _HIGHEST_M)
    street = street_of_mesh(rays, bounds, region, roads, widest, reach)
    known = street.shape is not None
    chosen: list[tuple[Blob, str, str, Outline]] = []
    kept, passed = [], []
    for blob in find_blobs(street, 0.2 if remove is not None else 0.3):
        if remove is not None:
            kind, why = "piece", "named by an override"
            if not remove.near([blob.middle])[0]:
                continue
        else:
            kind, why = vehicle_kind(blob, roads_known=known)
        if kind and remove is None and keep.near([blob.middle])[0]:
            kept.append(_removal(blob, kind, why))
            continue
        outline = None
        if kind:
            outline = _look(rays, street, blob, reach)
            if outline is None:
                kind, why = "", f"{why}; the ground around it is not to be seen"
            elif remove is None and not _closed_sides(rays, outline, blob):
                kind, why = "", f"{why}; open below or at its sides"
        if outline is None or not kind:
            if known and remove is None and blob.width > 0.5 and blob.length < 25.0:
                passed.append(_removal(blob, "other", why))
            continue
        chosen.append((blob, kind, why, outline))
    mesh, removed = _cut_out(mesh, chosen)
    return Untrafficked(mesh, removed, kept, passed)


def _look(rays: Rays, street: Street, blob: Blob, reach: float) -> Outline | None:
    """Return the outline of a blob as a close look shows it."""
    grid = street.grid
    mask = np.zeros(grid.shape, bool)
    rows, columns = blob.mask.shape
    mask[blob.row : blob.row + rows, blob.column : blob.column + columns] = blob.mask
    return outline_of(rays, grid.squares(mask), street.bare[mask], grid.centres(mask), reach)


def _removal(blob: Blob, kind: str, why: str) -> Removal:
    return Removal(kind, why, blob.middle, blob.size, 0.0, 0, blob.outline)


def _closed_sides(rays: Rays, outline: Outline, blob: Blob) -> bool:
    """Return whether rays from around meet a vehicle's sides: a shelter or a gantry is open."""
    around = shapely.buffer(blob.outline, 0.5, join_style="mitre")
    ring = shapely.segmentize(around.exterior, 0.4)
    line = shapely.get_coordinates(ring)
    way = np.diff(line, axis=0)
    length = np.linalg.norm(way, axis=1, keepdims=True)
    middle = line[:-1] + way / 2
    inward = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-9)
    if not shapely.is_ccw(around.exterior):
        inward = -inward
    base = outline.ground.at(middle)
    met = []
    for height in (0.3, 0.5, 0.8, 1.1):
        if height > 0.8 * blob.height:
            continue
        origins = np.column_stack([middle, base + height])
        _, distance = rays.first(origins, np.column_stack([inward, np.zeros(len(inward))]))
        met.append(float((distance < _SIDE_REACH_M).mean()))
    return not met or max(met) >= _CLOSED


def _cut_out(
    mesh: TriangleMesh, chosen: list[tuple[Blob, str, str, Outline]]
) -> tuple[TriangleMesh, list[Removal]]:
    """Cut vehicles out of a mesh and close it."""
    if not chosen:
        return mesh, []
    groups = _groups([outline for *_, outline in chosen])
    removed: list[Removal] = []
    works: list[TriangleMesh] = []
    used_by: list[NDArray[np.int64]] = []
    away = np.zeros(len(mesh.faces), bool)
    for numbers, together in _neighbourhoods([outline for outline, _ in groups], mesh):
        away[numbers] = True
        used, local = np.unique(mesh.faces[numbers], return_inverse=True)
        work = replace(
            mesh,
            vertices=mesh.vertices[used],
            faces=local.reshape(-1, 3).astype(np.int32),
            colour=None if mesh.colour is None else mesh.colour[numbers],
            object=mesh.object[numbers],
            semantic=None if mesh.semantic is None else mesh.semantic[numbers],
        )
        for group in together:
            outline, members = groups[group]
            work, area, count, closed = _cut_one(work, outline)
            share = 1.0 / len(members)
            for k in members:
                blob, kind, why, _ = chosen[k]
                removed.append(
                    replace(
                        _removal(blob, kind, why),
                        area=area * share,
                        count=round(count * share),
                        outline=outline.area,
                        closed=closed * share,
                    )
                )
        works.append(work)
        used_by.append(used.astype(np.int64))
    return _put_back(mesh, ~away, works, used_by), removed


def _put_back(
    mesh: TriangleMesh,
    rest: NDArray[np.bool_],
    works: list[TriangleMesh],
    used_by: list[NDArray[np.int64]],
) -> TriangleMesh:
    """Return the rest of a mesh with the parts that were worked on; shared vertices stay shared."""
    vertices, faces, next_number = [mesh.vertices], [mesh.faces[rest]], len(mesh.vertices)
    for work, used in zip(works, used_by, strict=True):
        new = work.vertices[len(used) :]
        number = np.concatenate([used, next_number + np.arange(len(new))]).astype(np.int32)
        vertices.append(new)
        faces.append(number[work.faces])
        next_number += len(new)
    colour, semantic = None, None
    if mesh.colour is not None:
        parts = [work.colour for work in works if work.colour is not None]
        colour = np.concatenate([mesh.colour[rest], *parts])
    if mesh.semantic is not None:
        kinds = [work.semantic for work in works if work.semantic is not None]
        semantic = np.concatenate([mesh.semantic[rest], *kinds])
    objects = np.concatenate([mesh.object[rest], *(work.object for work in works)])
    return selected(
        TriangleMesh(
            np.concatenate(vertices), np.concatenate(faces), colour, objects, mesh.names, semantic
        )
    )


def _groups(outlines: list[Outline]) -> list[tuple[Outline, list[int]]]:
    """Return outlines with those that overlap made one, and which of the given each is."""
    groups: list[tuple[Outline, list[int]]] = []
    for k, outline in enumerate(outlines):
        members = [k]
        apart = []
        for other, theirs in groups:
            if shapely.distance(other.area, outline.area) < 0.01:
                outline = other.joined(outline)  # noqa: PLW2901
                members = theirs + members
            else:
                apart.append((other, theirs))
        groups = [*apart, (outline, members)]
    return groups


def _neighbourhoods(
    outlines: list[Outline], mesh: TriangleMesh
) -> list[tuple[NDArray[np.int64], list[int]]]:
    """Return, for outlines that share no triangle with others, the triangles near, and which."""
    low, high = bounds_of_faces(mesh.vertices[:, :2], mesh.faces)
    bounds = np.array([outline.area.bounds for outline in outlines])
    grid = Grid.over((*bounds[:, :2].min(axis=0), *bounds[:, 2:].max(axis=0)), _COARSE_M)
    mask = np.zeros(grid.shape, bool)
    (r0, c0), (r1, c1) = grid.cells(bounds[:, :2]), grid.cells(bounds[:, 2:])
    for a, b, c, d in zip(r0, r1, c0, c1, strict=True):
        mask[a : b + 1, c : d + 1] = True
    sums = np.zeros((grid.rows + 1, grid.columns + 1), np.int32)
    sums[1:, 1:] = mask.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    (a, c), (b, d) = grid.cells(low), grid.cells(high)
    b, d = b + 1, d + 1
    some = np.flatnonzero(sums[b, d] - sums[a, d] - sums[b, c] + sums[a, c])
    low, high = low[some], high[some]
    found: list[tuple[NDArray[np.int64], list[int]]] = []
    touched = np.zeros(len(mesh.vertices), bool)
    # Their neighbours are among these: what shares a vertex with them.
    touched[mesh.faces[some].ravel()] = True
    ring = np.flatnonzero(some_corner(touched, mesh.faces))
    faces = mesh.faces[ring]
    for number, (west, south, east, north) in enumerate(bounds):
        near = (high[:, 0] >= west) & (low[:, 0] <= east)
        near &= (high[:, 1] >= south) & (low[:, 1] <= north)
        touched[:] = False
        touched[mesh.faces[some[near]].ravel()] = True
        mine, together = ring[some_corner(touched, faces)], [number]
        apart = []
        for theirs, others in found:
            if np.isin(mine, theirs, assume_unique=True).any():
                mine, together = np.union1d(mine, theirs), others + together
            else:
                apart.append((theirs, others))
        found = [*apart, (mine, together)]
    return found


def _cut_one(work: TriangleMesh, outline: Outline) -> tuple[TriangleMesh, float, int, float]:
    """Return the mesh without one vehicle, its area and triangles, and the area closed."""
    if outline.covered:
        gone = _standing_inside(work, outline)
        area, count = _area(work.vertices[work.faces[gone]]), int(gone.sum())
        rest = np.flatnonzero(~gone)
        return _attributes(work, work.vertices, work.faces[rest], rest), area, count, 0.0
    cut = cut_along(work, outline.area)
    middle = cut.vertices[cut.faces].mean(axis=1)
    over = np.full(len(middle), np.inf)
    inside = np.flatnonzero(cut.inside)
    over[inside] = middle[inside, 2] - outline.ground.at(middle[inside, :2])
    top = outline.top - float(outline.ground.at(np.array([outline.area.centroid.coords[0]]))[0])
    gone = cut.inside & (over > -0.5) & (over < top + 0.3)
    if not gone.any():
        return work, 0.0, 0, 0.0
    rim = _rim(cut.vertices, cut.faces, gone, outline)
    try:
        extra, triangles = fill(outline, cut.vertices[rim])
    except (RuntimeError, ValueError):  # an outline that crosses itself: the vehicle stays
        return work, 0.0, 0, 0.0
    number = np.concatenate([rim, len(cut.vertices) + np.arange(len(extra))])
    vertices = np.concatenate([cut.vertices, extra])
    patch = number[triangles].astype(np.int32)
    keep = np.flatnonzero(~gone)
    # The new triangles look like the nearest of those that were left around.
    beside = keep[_beside(middle[keep], outline)]
    if not len(beside):
        beside = keep if len(keep) else np.arange(len(gone))
    like = beside[cKDTree(middle[beside]).query(vertices[patch].mean(axis=1))[1]]
    parent = np.concatenate([cut.parent[keep], cut.parent[like]])
    closed = _area(vertices[patch])
    mesh = _attributes(work, vertices, np.concatenate([cut.faces[keep], patch]), parent)
    return (
        mesh,
        _area(cut.vertices[cut.faces[gone]]),
        len(np.unique(cut.parent[gone])),
        closed,
    )


def _standing_inside(work: TriangleMesh, outline: Outline) -> NDArray[np.bool_]:
    """Return which triangles are a vehicle's that stands on a surface that goes on under it."""
    west, south, east, north = outline.area.bounds
    corners = work.vertices[work.faces]
    able = (corners[:, :, 0].min(axis=1) >= west) & (corners[:, :, 0].max(axis=1) <= east)
    able &= (corners[:, :, 1].min(axis=1) >= south) & (corners[:, :, 1].max(axis=1) <= north)
    some = np.flatnonzero(able)
    shapely.prepare(outline.area)
    flat = corners[some].reshape(-1, 3)
    within = shapely.contains_xy(outline.area, flat[:, 0], flat[:, 1]).reshape(-1, 3).all(axis=1)
    some = some[within]
    gone = np.zeros(len(work.faces), bool)
    middle = corners[some].mean(axis=1)
    gone[some] = (middle[:, 2] > outline.ground.at(middle[:, :2]) + _OVER_M) & (
        corners[some, :, 2].max(axis=1) < outline.top + 0.3
    )
    # Tyres and sills lie on the ground: whole pieces of it go with it.
    pieces = pieces_of(work)
    inner = np.bincount(pieces.of_face[some], minlength=len(pieces)) == pieces.triangles
    high = np.bincount(pieces.of_face[gone], minlength=len(pieces)) > 0
    return np.asarray(gone | (inner & high)[pieces.of_face])


def _rim(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    gone: NDArray[np.bool_],
    outline: Outline,
) -> NDArray[np.int64]:
    """Return the vertices of what stays that lie on the outline, on the ground, each place once."""
    both = np.zeros(len(vertices), bool)
    both[faces[gone].ravel()] = True
    stays = np.zeros(len(vertices), bool)
    stays[faces[~gone].ravel()] = True
    rim = np.flatnonzero(both & stays)
    if not len(rim):
        return rim
    line = outline.area.exterior
    rim = rim[shapely.distance(line, shapely.points(vertices[rim, :2])) < 2e-5]
    off = np.abs(vertices[rim, 2] - outline.ground.at(vertices[rim, :2]))
    rim, off = rim[off < _RIM_M], off[off < _RIM_M]
    rim = rim[np.argsort(off, kind="stable")]
    _, once = np.unique(np.round(vertices[rim, :2], 4), axis=0, return_index=True)
    return np.asarray(rim[np.sort(once)])


def _beside(middle: NDArray[np.float64], outline: Outline) -> NDArray[np.int64]:
    west, south, east, north = shapely.buffer(outline.area, 1.0).bounds
    near = (middle[:, 0] > west) & (middle[:, 0] < east)
    near &= (middle[:, 1] > south) & (middle[:, 1] < north)
    some = np.flatnonzero(near)
    low = np.abs(middle[some, 2] - outline.ground.at(middle[some, :2])) < 0.1
    return np.asarray(some[low])


def _area(corners: NDArray[np.float64]) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _attributes(
    mesh: TriangleMesh,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    parent: NDArray[np.int64],
) -> TriangleMesh:
    return TriangleMesh(
        vertices,
        faces.astype(np.int32),
        None if mesh.colour is None else mesh.colour[parent],
        mesh.object[parent],
        mesh.names,
        None if mesh.semantic is None else mesh.semantic[parent],
    )
