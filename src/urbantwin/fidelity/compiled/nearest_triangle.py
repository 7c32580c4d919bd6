"""Distance of points to the nearest triangle of a tree."""

import numpy as np
from numba import njit

from urbantwin.fidelity.compiled.box_tree import run_of

__all__ = ["nearest_squares"]

_STACK = 128
#: Sine of an angle below which a triangle is treated as its edges.
_FLAT = 1e-6


@njit(cache=True, nogil=True)
def _edge_square(px, py, pz, ex, ey, ez):
    """Return the squared distance of p to the segment from the origin to e."""
    length = ex * ex + ey * ey + ez * ez
    t = 0.0
    if length > 0.0:
        t = min(max((px * ex + py * ey + pz * ez) / length, 0.0), 1.0)
    dx, dy, dz = px - t * ex, py - t * ey, pz - t * ez
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _triangle_square(point, corner, side1, side2):
    """Return the squared distance of a point (3,) to a triangle: a corner and two sides (3,).

    The nearest point is the projection onto its plane if that is inside (barycentric coordinates,
    Ericson 2005, "Real-time collision detection", 3.4), otherwise the nearest of the three edges. A
    triangle without area is its edges, or one point.
    """
    px, py, pz = point[0] - corner[0], point[1] - corner[1], point[2] - corner[2]
    ux, uy, uz = side1[0], side1[1], side1[2]
    vx, vy, vz = side2[0], side2[1], side2[2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    area = uu * vv - uv * uv
    if area > _FLAT * _FLAT * uu * vv:
        pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
        s, t = (vv * pu - uv * pv) / area, (uu * pv - uv * pu) / area
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            dx = px - s * ux - t * vx
            dy = py - s * uy - t * vy
            dz = pz - s * uz - t * vz
            return dx * dx + dy * dy + dz * dz
    first = _edge_square(px, py, pz, ux, uy, uz)
    second = _edge_square(px, py, pz, vx, vy, vz)
    third = _edge_square(px - ux, py - uy, pz - uz, vx - ux, vy - uy, vz - uz)
    return min(first, second, third)


@njit(cache=True, nogil=True)
def _to_box(point, box):
    dx = max(box[0] - point[0], point[0] - box[3], 0.0)
    dy = max(box[1] - point[1], point[1] - box[4], 0.0)
    dz = max(box[2] - point[2], point[2] - box[5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def nearest_squares(points, turn, corner, side1, side2, box, found):
    """Fill in the squared distances (N,) of points (N, 3) to the nearest triangle.

    Args:
        points: (N, 3).
        turn: (K,) order of the points, neighbours in space in sequence: each search starts with the
            triangle nearest to the previous point.
        corner: (F, 3) first corner of each triangle, in the tree's order.
        side1: (F, 3) from there to the second corner.
        side2: (F, 3) from there to the third.
        box: boxes of the tree's parts.
        found: (N,) output.
    """
    leaves = (len(box) + 1) // 2
    waiting = np.empty(_STACK, np.int64)
    away = np.empty(_STACK)
    near = 0
    for row in turn:
        point = points[row]
        best = _triangle_square(point, corner[near], side1[near], side2[near])
        waiting[0], away[0], top = 0, 0.0, 1
        while top:
            top -= 1
            if away[top] >= best:
                continue
            part = waiting[top]
            if part >= leaves - 1:
                begin, end = run_of(part - leaves + 1, leaves, len(corner))
                for k in range(begin, end):
                    square = _triangle_square(point, corner[k], side1[k], side2[k])
                    if square < best:
                        best, near = square, k
                continue
            closer, farther = 2 * part + 1, 2 * part + 2
            close, far = _to_box(point, box[closer]), _to_box(point, box[farther])
            if close > far:
                closer, farther, close, far = farther, closer, far, close
            if far < best:
                waiting[top], away[top] = farther, far
                top += 1
            if close < best:
                waiting[top], away[top] = closer, close
                top += 1
        found[row] = best
