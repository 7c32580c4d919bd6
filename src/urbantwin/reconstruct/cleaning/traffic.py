"""Detection and removal of vehicles that are part of a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.outline import Outline, outline_of
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.removal import Removal, Spots
from urbantwin.reconstruct.cleaning.street_surface import REACH_M, WIDEST_M, Street, street_of_mesh
from urbantwin.reconstruct.cleaning.vehicle import Blob, find_blobs, vehicle_kind
from urbantwin.reconstruct.cleaning.weld import areas_of_faces, pieces_of, selected, some_corner

__all__ = ["Untrafficked", "without_traffic"]

#: Height above the ground from which triangles belong to the vehicle, metres.
_OVER_M = 0.05
#: Minimum share of horizontal rays, starting half a metre outside, that hit the vehicle within the
#: given distance, metres.
_CLOSED, _SIDE_REACH_M = 0.6, 1.4
#: Lowered triangles with less area (upright flanks) are dropped, square metres.
_NO_AREA_M2 = 1e-9
#: Maximum height of objects that overrides name, metres.
_HIGHEST_M = 100.0


@dataclass(frozen=True, eq=False)
class Untrafficked:
    """A mesh without traffic.

    Attributes:
        mesh: the mesh, its surface closed.
        removed: removed vehicles.
        kept: vehicles that an override kept.
        passed: objects on the carriageway that do not qualify as vehicles, with the reason.
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
    """Return a mesh without the vehicles that are part of it.

    Args:
        mesh: welded, site frame, metres.
        region: search region.
        roads: carriageways and parking; ``None`` or empty searches everywhere, for cars only.
        keep: overrides that keep vehicles.
        remove: if given, only objects at these positions are removed, of any kind.
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
    mesh, removed = _without(mesh, chosen)
    return Untrafficked(mesh, removed, kept, passed)


def _look(rays: Rays, street: Street, blob: Blob, reach: float) -> Outline | None:
    """Return the detailed outline of a blob."""
    grid = street.grid
    mask = np.zeros(grid.shape, bool)
    rows, columns = blob.mask.shape
    mask[blob.row : blob.row + rows, blob.column : blob.column + columns] = blob.mask
    return outline_of(rays, grid.squares(mask), street.bare[mask], grid.centres(mask), reach)


def _removal(blob: Blob, kind: str, why: str) -> Removal:
    return Removal(kind, why, blob.middle, blob.size, 0.0, 0, blob.outline)


def _closed_sides(rays: Rays, outline: Outline, blob: Blob) -> bool:
    """Return whether horizontal rays hit a vehicle's sides: a shelter or a gantry is open."""
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


def _without(
    mesh: TriangleMesh, chosen: list[tuple[Blob, str, str, Outline]]
) -> tuple[TriangleMesh, list[Removal]]:
    """Remove vehicles from a mesh.

    A vehicle on a surface that continues under it is deleted. The vertices of one that is part of
    the surface are lowered onto the surrounding ground: nothing is cut, so the surface stays
    closed.
    """
    removed: list[Removal] = []
    vertices = mesh.vertices.copy()
    gone, lowered = (np.zeros(len(mesh.faces), bool) for _ in range(2))
    corners = mesh.vertices[mesh.faces]
    for blob, kind, why, outline in chosen:
        if outline.covered:
            own = _standing_inside(mesh, outline)
            gone |= own
        else:
            some = _raised(mesh.vertices, outline)
            vertices[some, 2] = outline.ground.at(mesh.vertices[some, :2])
            own = some_corner(some, mesh.faces)
            lowered |= own
        removed.append(
            replace(
                _removal(blob, kind, why),
                area=_area(corners[own]),
                count=int(own.sum()),
                outline=outline.area,
                closed=0.0 if outline.covered else float(outline.area.area),
            )
        )
    if not removed:
        return mesh, []
    like = _looks(corners.mean(axis=1), lowered & ~gone, ~(lowered | gone))
    found = TriangleMesh(
        vertices,
        mesh.faces,
        None if mesh.colour is None else mesh.colour[like],
        mesh.object[like],
        mesh.names,
        None if mesh.semantic is None else mesh.semantic[like],
    )
    flat = lowered & (areas_of_faces(found) < _NO_AREA_M2)
    return selected(found, ~(gone | flat)), removed


def _raised(vertices: NDArray[np.float64], outline: Outline) -> NDArray[np.bool_]:
    """Return the mask of vertices (V,) of a vehicle that is part of the surface."""
    west, south, east, north = outline.area.bounds
    x, y, z = vertices.T
    near = np.flatnonzero(
        (x > west) & (x < east) & (y > south) & (y < north) & (z < outline.top + 0.3)
    )
    near = near[shapely.contains_xy(outline.area, x[near], y[near])]
    found = np.zeros(len(vertices), bool)
    found[near[z[near] > outline.ground.at(vertices[near, :2]) - 0.5]] = True
    return found


def _looks(
    middle: NDArray[np.float64], new: NDArray[np.bool_], rest: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the triangle (F,) with the colour and class for each; the nearest for new ones."""
    like = np.arange(len(middle))
    if new.any() and rest.any():
        beside = np.flatnonzero(rest)
        like[new] = beside[cKDTree(middle[beside, :2]).query(middle[new, :2])[1]]
    return like


def _standing_inside(work: TriangleMesh, outline: Outline) -> NDArray[np.bool_]:
    """Return the mask of a vehicle's triangles on a surface that continues under it."""
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
    # Tyres and sills touch the ground: whole pieces are removed.
    pieces = pieces_of(work)
    inner = np.bincount(pieces.of_face[some], minlength=len(pieces)) == pieces.triangles
    high = np.bincount(pieces.of_face[gone], minlength=len(pieces)) > 0
    return np.asarray(gone | (inner & high)[pieces.of_face])


def _area(corners: NDArray[np.float64]) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
