"""Flat polygons in space, with holes, cut into triangles."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["triangulated"]


def triangulated(
    points: NDArray[np.float64],
    ring: NDArray[np.int64],
    polygon: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of polygons between their own corners (constrained Delaunay).

    A polygon is projected onto its plane by Newell's normal (Sutherland et al. 1974). One that
    intersects itself there is cut into a fan.

    Args:
        points: (N, 3) corners, ring after ring, the first corner of a ring not repeated.
        ring: (N,) index of each corner's ring, ascending.
        polygon: (rings,) index of each ring's polygon, ascending; the first ring of a polygon is
            its exterior, counter-clockwise seen from the front; the others are holes.

    Returns:
        triangles (F, 3): indices of corners, oriented as the polygon; and the polygon (F,) of each.
    """
    if not len(points):
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    of_corner = polygon[ring]
    size = np.bincount(of_corner, minlength=int(polygon.max()) + 1)
    rings = np.bincount(polygon, minlength=len(size))
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    found: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    three = np.flatnonzero((size == 3) & (rings == 1))
    found.append((start[three][:, None] + np.arange(3), three))
    rest = np.flatnonzero((size > 3) & (rings > 0))
    if len(rest):
        found.append(_cut(points, ring, of_corner, rest, start, size))
    triangles = np.concatenate([item[0] for item in found])
    owner = np.concatenate([item[1] for item in found])
    order = np.argsort(owner, kind="stable")
    return triangles[order], owner[order]


def _cut(
    points: NDArray[np.float64],
    ring: NDArray[np.int64],
    of_corner: NDArray[np.int64],
    rest: NDArray[np.int64],
    start: NDArray[np.int64],
    size: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    wanted = np.zeros(len(size), np.bool_)
    wanted[rest] = True
    corner = np.flatnonzero(wanted[of_corner])
    plan = _in_plane(points, ring, of_corner, corner, len(size))
    number = np.searchsorted(rest, of_corner[corner])
    _, local_ring = np.unique(ring[corner], return_inverse=True)
    coordinates, of_ring = _closed(plan, local_ring)
    # Corners too far away to determine a plane form no closed ring.
    coordinates = np.where(np.isfinite(coordinates), coordinates, 0.0)
    closed = shapely.linearrings(coordinates, indices=of_ring)
    ring_owner = number[np.concatenate([[True], local_ring[1:] != local_ring[:-1]])]
    shapes = shapely.polygons(closed, indices=ring_owner)
    sound = shapely.is_valid(shapes)
    cut, sound[sound] = _triangles(shapes[sound])
    parts, owner = shapely.get_parts(cut, return_index=True)
    owner = np.flatnonzero(sound)[owner]
    xy = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    triangles = _corners_at(xy, owner, plan, number, corner)
    turned = _area(xy)
    triangles[turned < 0] = triangles[turned < 0][:, ::-1]
    # invalid holes are ignored: the fan covers the exterior only
    fans, fan_owner = _fans(rest[~sound], ring, start, size)
    return np.concatenate([triangles, fans]), np.concatenate([rest[owner], fan_owner])


def _triangles(
    shapes: NDArray[np.object_],
) -> tuple[NDArray[np.object_], NDArray[np.bool_]]:
    """Return the triangles of every shape that GEOS can cut, and the mask of these shapes.

    GEOS fails on valid shapes whose corners nearly coincide, or range from 1e-300 to 1e300.
    """
    try:
        return shapely.constrained_delaunay_triangles(shapes), np.ones(len(shapes), np.bool_)
    except shapely.GEOSException:
        if len(shapes) == 1:
            return shapes[:0], np.zeros(1, np.bool_)
    halves = [_triangles(part) for part in np.array_split(shapes, 2)]
    return np.concatenate([cut for cut, _ in halves]), np.concatenate([ok for _, ok in halves])


def _area(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    first, second = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _in_plane(
    points: NDArray[np.float64],
    ring: NDArray[np.int64],
    of_corner: NDArray[np.int64],
    corner: NDArray[np.int64],
    count: int,
) -> NDArray[np.float64]:
    """Return corners (M, 2) in the planes of their polygons, counter-clockwise from the front."""
    here = points[corner]
    following = np.append(corner[1:], corner[0])
    last = np.append(ring[corner][1:] != ring[corner][:-1], True)
    first_of = np.searchsorted(ring, ring[corner])
    following = np.where(last, first_of, following)
    outer = ring[corner] == ring[np.searchsorted(of_corner, of_corner[corner])]
    middle = points[np.searchsorted(of_corner, of_corner[corner])]
    cross = np.cross(here - middle, points[following] - middle) * outer[:, None]
    normal = np.stack(
        [np.bincount(of_corner[corner], weights=cross[:, k], minlength=count) for k in range(3)],
        axis=1,
    )
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    up = np.divide(normal, length, out=np.tile([0.0, 0.0, 1.0], (count, 1)), where=length > 0)
    # any direction not parallel to the normal
    aside = np.eye(3)[np.argmin(np.abs(up), axis=1)]
    east = np.cross(aside, up)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(up, east)
    owner = of_corner[corner]
    offset = here - middle
    return np.column_stack(
        [(offset * east[owner]).sum(axis=1), (offset * north[owner]).sum(axis=1)]
    )


def _closed(
    plan: NDArray[np.float64], ring: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Repeat the first corner of every ring at its end; rings of fewer than three are padded."""
    size = np.bincount(ring)
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    extra = np.maximum(1, 4 - size)
    order = np.concatenate([np.arange(len(ring)), np.repeat(start, extra)])
    owner = np.concatenate([ring, np.repeat(np.arange(len(size)), extra)])
    sort = np.argsort(owner, kind="stable")
    return plan[order[sort]], owner[sort]


def _corners_at(
    xy: NDArray[np.float64],
    owner: NDArray[np.int64],
    plan: NDArray[np.float64],
    number: NDArray[np.int64],
    corner: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the polygon corner at each corner (F, 3) of triangles."""
    flat = xy.reshape(-1, 2)
    keys = np.concatenate(
        [np.column_stack([number, plan]), np.column_stack([np.repeat(owner, 3), flat])]
    )
    # -0.0 and 0.0 are equal
    _, index = np.unique(keys + 0.0, axis=0, return_inverse=True)
    index = index.ravel()
    place = np.full(int(index.max()) + 1, -1, np.int64)
    place[index[: len(plan)][::-1]] = corner[::-1]
    return place[index[len(plan) :]].reshape(-1, 3)


def _fans(
    polygons: NDArray[np.int64],
    ring: NDArray[np.int64],
    start: NDArray[np.int64],
    size: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    outside = np.searchsorted(ring, ring[start[polygons]], side="right") - start[polygons]
    count = np.maximum(outside - 2, 0)
    owner = np.repeat(polygons, count)
    first = np.repeat(start[polygons], count)
    step = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return np.column_stack([first, first + step + 1, first + step + 2]), owner
