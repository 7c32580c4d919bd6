"""Planes of a roof, by region growing over its points.

Region growing from the flattest neighbourhoods (Rabbani, van den Heuvel and Vosselman 2006,
"Segmentation of point clouds using smoothness constraint", ISPRS Archives 36(5)), as the
reconstruction of the Dutch 3D BAG does (Peters, Dukai, Vitalis, van Liempt and Stoter 2022,
"Automated 3D reconstruction of LoD2 and LoD1 models for all 10 million buildings of the
Netherlands", PE&RS 88(3)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["RoofPlanes", "roof_planes"]

_NEIGHBOURS = 14
#: Tolerance (metres) and cosine per pass: planes; then, over the remaining points, gently curved or
#: rough surfaces in facets.
_PASSES = ((0.10, np.cos(np.radians(22.0))), (0.22, np.cos(np.radians(38.0))))
#: Maximum z of the normal of a wall.
_WALL = np.cos(np.radians(77.0))
#: Maximum difference of planes to be merged, over their points, metres.
_SAME_M = 0.10
_SMALLEST_M2 = 0.8


@dataclass(frozen=True, eq=False)
class RoofPlanes:
    """Planes z = a x + b y + c and their points.

    Attributes:
        planes: (P, 3) a, b, c in the coordinates of the points.
        label: (N,) int64 index of each point's plane, -1 for none.
        wall: (N,) bool, points of vertical faces.
    """

    planes: NDArray[np.float64]
    label: NDArray[np.int64]
    wall: NDArray[np.bool_]


def roof_planes(points: NDArray[np.float64], density: float) -> RoofPlanes:
    """Return the planes of one roof.

    Args:
        points: (N, 3) of the roof, near the origin, metres.
        density: points per square metre, in plan.

    Returns:
        Planes by falling number of points; none with too few points.
    """
    count = len(points)
    smallest = int(max(8, _SMALLEST_M2 * density))
    if count < smallest:
        return RoofPlanes(np.zeros((0, 3)), np.full(count, -1, np.int64), np.zeros(count, bool))
    near = cKDTree(points).query(points, min(_NEIGHBOURS, count))[1].astype(np.int64)
    normal, rough = _normals(points, near)
    wall = normal[:, 2] < _WALL
    label = np.full(count, -1, np.int64)
    label[wall] = -2
    planes = np.zeros((0, 3))
    for tolerance, cosine in _PASSES:
        order = np.argsort(rough, kind="stable")
        found = _grow(points, normal, near, order, label, tolerance, cosine, smallest, len(planes))
        planes = np.concatenate([planes, found])
        planes, label = _merged(points, planes, label)
    label[label < 0] = -1
    return RoofPlanes(planes, label, wall)


def fitted(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a, b, c of the least squares plane in z."""
    middle = points.mean(axis=0)
    design = points[:, :2] - middle[:2]
    slope = np.linalg.lstsq(design, points[:, 2] - middle[2], rcond=None)[0]
    return np.array([slope[0], slope[1], middle[2] - slope @ middle[:2]])


def _normals(
    points: NDArray[np.float64], near: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return upward unit normals (N, 3) of neighbourhoods, and their thickness (N,), metres."""
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", around, around) / near.shape[1]
    values, vectors = np.linalg.eigh(spread)
    normal = vectors[:, :, 0] * np.where(vectors[:, 2, :1] < 0, -1.0, 1.0)
    return normal, np.sqrt(np.maximum(values[:, 0], 0.0))


def _merged(
    points: NDArray[np.float64], planes: NDArray[np.float64], label: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Merge equal planes, largest first, and fit each to its points."""
    label = label.copy()
    order = np.argsort(-np.bincount(label[label >= 0], minlength=len(planes)), kind="stable")
    kept: list[NDArray[np.float64]] = []
    members: list[NDArray[np.int64]] = []
    for number in order.tolist():
        mine = np.flatnonzero(label == number)
        if not len(mine):
            continue
        for k, other in enumerate(kept):
            tilt = np.hypot(*(planes[number, :2] - other[:2]))
            if tilt > 0.12 or _rms(points[mine], other) > 2 * _SAME_M:
                continue
            both = np.concatenate([members[k], mine])
            joint = fitted(points[both])
            if _rms(points[mine], joint) < _SAME_M and _rms(points[members[k]], joint) < _SAME_M:
                kept[k], members[k] = joint, both
                break
        else:
            kept.append(fitted(points[mine]))
            members.append(mine)
    result = np.where(label == -2, -2, -1)
    for k, mine in enumerate(members):
        result[mine] = k
    return np.array(kept).reshape(-1, 3), result


def _rms(points: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    off = points[:, 2] - points[:, :2] @ plane[:2] - plane[2]
    return float(np.sqrt(np.mean(off**2) / (1.0 + plane[:2] @ plane[:2])))


@njit(cache=True)
def _solved(s: NDArray[np.float64]) -> tuple[float, float, float]:  # pragma: no cover  (compiled)
    """Return a, b, c of the plane from the sums n, x, y, z, xx, xy, yy, xz, yz."""
    n = s[0]
    mx, my, mz = s[1] / n, s[2] / n, s[3] / n
    xx, xy, yy = s[4] / n - mx * mx, s[5] / n - mx * my, s[6] / n - my * my
    xz, yz = s[7] / n - mx * mz, s[8] / n - my * mz
    det = xx * yy - xy * xy
    if det < 1e-9:
        return 0.0, 0.0, mz
    a = (xz * yy - yz * xy) / det
    b = (yz * xx - xz * xy) / det
    return a, b, mz - a * mx - b * my


@njit(cache=True)
def _grow(  # pragma: no cover  (compiled)  # noqa: PLR0912, PLR0913, PLR0915, PLR0917
    points: NDArray[np.float64],
    normal: NDArray[np.float64],
    near: NDArray[np.int64],
    order: NDArray[np.int64],
    label: NDArray[np.int64],
    tolerance: float,
    cosine: float,
    smallest: int,
    first: int,
) -> NDArray[np.float64]:
    """Grow planes over unlabelled points; indices from ``first`` are written to ``label``."""
    count, reach = near.shape
    planes = np.zeros((count // smallest + 1, 3))
    found = 0
    queue = np.empty(count, np.int64)
    seen = np.full(count, -1, np.int64)
    tried = np.zeros(count, np.bool_)
    sums = np.zeros(9)
    for turn in range(count):
        seed = order[turn]
        if label[seed] != -1 or tried[seed]:
            continue
        n = normal[seed]
        a, b = -n[0] / n[2], -n[1] / n[2]
        c = points[seed, 2] - a * points[seed, 0] - b * points[seed, 1]
        # The seed's plane passes through the mean of its neighbours.
        offset = 0.0
        for k in range(reach):
            p = points[near[seed, k]]
            offset += p[2] - a * p[0] - b * p[1] - c
        c += offset / reach
        sums[:] = 0.0
        queue[0] = seed
        seen[seed] = turn
        size, done, fit = 1, 0, 2 * reach
        scale = 1.0 / np.sqrt(1.0 + a * a + b * b)
        while done < size:
            here = queue[done]
            x, y, z = points[here]
            sums += np.array([1.0, x, y, z, x * x, x * y, y * y, x * z, y * z])
            done += 1
            if done >= fit:
                a, b, c = _solved(sums)
                scale = 1.0 / np.sqrt(1.0 + a * a + b * b)
                fit = int(1.3 * done) + 1
            for k in range(reach):
                there = near[here, k]
                if seen[there] == turn or label[there] != -1:
                    continue
                px, py, pz = points[there]
                if abs(pz - a * px - b * py - c) * scale > tolerance:
                    continue
                m = normal[there]
                if (m[2] - a * m[0] - b * m[1]) * scale < cosine:
                    continue
                seen[there] = turn
                queue[size] = there
                size += 1
        if size >= smallest and found < len(planes):
            a, b, c = _solved(sums)
            planes[found] = (a, b, c)
            for k in range(size):
                label[queue[k]] = first + found
            found += 1
        else:
            for k in range(min(size, reach)):
                tried[queue[k]] = True
    return planes[:found]
