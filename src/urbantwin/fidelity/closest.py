"""Exact distances from points to triangles, and to the nearest of many triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["NearestTriangle", "triangle_distances"]

#: Pairs worked on at once: the arrays of one step stay in the processor's cache.
_CHUNK = 4_096
#: Corners looked at per point and group in the first round; doubled until certain.
_FIRST_CORNERS = 5
#: Reach of the smallest group of triangles, metres.
_SMALLEST_M = 0.1


def triangle_distances(
    points: NDArray[np.float64],
    corner: NDArray[np.float64],
    side1: NDArray[np.float64],
    side2: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the distance (N,) of each point to its triangle.

    The nearest point of a triangle is the projection onto its plane where that falls inside
    (barycentric coordinates, Ericson 2005, "Real-time collision detection", 3.4), else the
    nearest of its three edges. A triangle without area is its edges, or one point.

    Args:
        points: (N, 3) metres.
        corner: (N, 3) a corner of each triangle, metres.
        side1: (N, 3) from that corner to the second, metres.
        side2: (N, 3) from that corner to the third, metres.
    """
    offset = points - corner
    g11 = np.einsum("ij,ij->i", side1, side1)
    g12 = np.einsum("ij,ij->i", side1, side2)
    g22 = np.einsum("ij,ij->i", side2, side2)
    d1 = np.einsum("ij,ij->i", side1, offset)
    d2 = np.einsum("ij,ij->i", side2, offset)
    square = np.einsum("ij,ij->i", offset, offset)

    best = np.minimum(_to_segment(square, d1, g11), _to_segment(square, d2, g22))
    third = _to_segment(square - 2 * d1 + g11, d2 - d1 - g12 + g11, g11 - 2 * g12 + g22)
    best = np.minimum(best, third)
    area = g11 * g22 - g12 * g12
    with np.errstate(invalid="ignore", divide="ignore"):
        v = (g22 * d1 - g12 * d2) / area
        w = (g11 * d2 - g12 * d1) / area
        face = square - v * d1 - w * d2
        inside = (area > 1e-12 * g11 * g22) & (v >= 0) & (w >= 0) & (v + w <= 1)
    best = np.where(inside, np.minimum(face, best), best)
    return np.asarray(np.sqrt(np.maximum(best, 0.0)))


def _to_segment(
    square: NDArray[np.float64], dot: NDArray[np.float64], length2: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return squared distances to segments, from |offset|^2, offset . side and |side|^2."""
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(length2 > 0, np.clip(dot / length2, 0.0, 1.0), 0.0)
    return np.asarray(square - 2 * t * dot + t * t * length2)


@dataclass(frozen=True, eq=False)
class _Group:
    """Triangles of about one size, found through their corners."""

    reach: float  # no point of these triangles is farther from its triangle's nearest corner
    tree: cKDTree  # of the corners
    first: NDArray[np.int64]  # (K + 1,) where a corner's triangles begin in `faces`
    faces: NDArray[np.int64]


class NearestTriangle:
    """Finds the distance to the nearest of many triangles, exactly.

    Let x be the point of a triangle nearest to p, at the distance d. The line from p to x is
    perpendicular to the face or edge that x lies in, so the triangle's corner nearest to x is
    at most sqrt(d^2 + r^2) from p, where r bounds the distance from any point of the triangle to
    its nearest corner (r = 0.58 of the longest edge). Triangles are put into groups by r (each
    at most twice the one before), the corners of each group into a k-d tree. Per group the
    triangles at the k nearest corners are measured; a point is done when the k-th corner is
    beyond sqrt(best^2 + r^2), else k is doubled. The answer is therefore the minimum itself and
    no approximation.
    """

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
        self._corner = vertices[faces[:, 0]]
        self._side1 = vertices[faces[:, 1]] - self._corner
        self._side2 = vertices[faces[:, 2]] - self._corner
        sides = (self._side1, self._side2, self._side1 - self._side2)
        # Of all triangles with a given longest edge, the regular one leaves its middle farthest.
        reach = np.sqrt(np.maximum.reduce([(side**2).sum(axis=1) for side in sides]) / 3)
        size = np.ceil(np.log2(np.maximum(reach, _SMALLEST_M) / _SMALLEST_M)).astype(np.int64)
        self._groups = []
        for number in np.unique(size):
            members = np.flatnonzero(size == number)
            corners, incident = np.unique(faces[members], return_inverse=True)
            incident = incident.ravel()
            self._groups.append(
                _Group(
                    reach=float(reach[members].max()),
                    tree=cKDTree(vertices[corners]),
                    first=np.concatenate([[0], np.cumsum(np.bincount(incident))]),
                    faces=members[np.argsort(incident, kind="stable") // 3],
                )
            )

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance (N,) of (N, 3) points to the nearest triangle, metres."""
        best = np.full(len(points), np.inf)
        for group in self._groups:  # a corner is a point of its triangle
            best = np.minimum(best, group.tree.query(points, workers=-1)[0])
        for group in self._groups:
            rows = np.arange(len(points))
            last = np.zeros(len(points))
            count = min(_FIRST_CORNERS, group.tree.n)
            while len(rows):
                limit = np.hypot(best[rows], group.reach)
                far, near = group.tree.query(
                    points[rows],
                    k=np.arange(1, count + 1),
                    distance_upper_bound=float(limit.max()) * (1 + 1e-9),
                    workers=-1,
                )
                # "Not nearer than the last one seen" and not "the next in order": corners at
                # the same distance come in any order.
                row, column = np.nonzero((far <= limit[:, None]) & (far >= last[:, None]))
                self._improve(best, points, group, rows[row], near[row, column])
                if count == group.tree.n:
                    break
                still_open = far[:, -1] <= np.hypot(best[rows], group.reach)
                rows, last = rows[still_open], far[still_open, -1]
                count = min(2 * count, group.tree.n)
        return best

    def _improve(
        self,
        best: NDArray[np.float64],
        points: NDArray[np.float64],
        group: _Group,
        rows: NDArray[np.int64],
        corners: NDArray[np.int64],
    ) -> None:
        """Lower ``best`` where a triangle at one of a point's candidate corners is nearer."""
        for start in range(0, len(rows), _CHUNK):
            corner = corners[start : start + _CHUNK]
            many = group.first[corner + 1] - group.first[corner]
            ends = np.cumsum(many)
            within = np.arange(ends[-1]) - np.repeat(ends - many, many)
            face = group.faces[np.repeat(group.first[corner], many) + within]
            row = np.repeat(rows[start : start + _CHUNK], many)
            found = triangle_distances(
                points[row], self._corner[face], self._side1[face], self._side2[face]
            )
            np.minimum.at(best, row, found)
