"""Decimation within an error that is below the resolution of a LiDAR."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.deviation import Deviation, Surface, deviation, normals_of
from urbantwin.reconstruct.cleaning.weld import areas_of_faces, selected, some_corner

__all__ = ["Decimated", "decimated", "unseen_error"]

#: Minimum error bound, metres: a third of the range accuracy of +-3 cm in datasheets (Velodyne
#: VLP-32C 63-9378, HDL-32E 97-0038), below the noise of a single return.
NEAR_M = 0.01
#: Growth with range: a sixth of a beam divergence of 3 mrad (Velodyne VLP-32C: 3.0 x 1.5 mrad;
#: Ouster OS1: 0.35 degree = 6 mrad; the beam's footprint at 100 m is 0.3 m).
PER_METRE = 0.5e-3
#: Maximum error bound, metres.
FAR_M = 0.05
#: Bounds of the quadrics in multiples of the error, tried in sequence: quadrics sum the squares of
#: all planes of a vertex, so their root exceeds the true distance.
_TRIES = (2.0, 2.0, 1.0, 0.5)
#: Share of remaining triangles above which a try is discarded.
_WORTH = 0.9
#: Share of triangles beyond the bound from which decimation is abandoned: noise of the size of the
#: bound.
_HOPELESS = 0.5
#: fast_simplification keeps its mesh in globals between calls.
_ONE_AT_A_TIME = Lock()


@dataclass(frozen=True, eq=False)
class Decimated:
    """A mesh with fewer triangles.

    Attributes:
        mesh: the mesh.
        error: (Z,) bound of each zone, metres, nearest zone first.
        measured: (Z,) maximum distance of the surfaces, both ways, metres.
        p95: (Z,) 95th percentile of the sampled distances, metres.
    """

    mesh: TriangleMesh
    error: list[float]
    measured: list[float]
    p95: list[float]


def unseen_error(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the chordal error (N,) that a LiDAR does not resolve at distances (N,), metres."""
    return np.clip(PER_METRE * distance, NEAR_M, FAR_M)


def decimated(
    mesh: TriangleMesh,
    sensors: NDArray[np.float64],
    error_m: float | None,
    label: NDArray[np.int64] | None = None,
) -> Decimated:
    """Return a mesh with fewer triangles whose surface is within a bound of the original.

    Edges are collapsed while the quadric error (Garland and Heckbert 1997) of the new vertex is
    below the bound; borders are unchanged. The distance between both surfaces is then measured,
    both ways. Where it is too large the original surface is kept, until the bound holds everywhere.
    Zones of distance to the nearest sensor have their own bounds and are joined without gaps.

    Args:
        mesh: welded, site frame, metres.
        sensors: (S, 3) sensor positions; without any, all triangles are near.
        error_m: one bound for the whole mesh, metres; ``None`` for ``unseen_error``.
        label: (F,) labels; borders between triangles of different labels are kept.
    """
    zone, errors = _zones(mesh, sensors, error_m)
    kinds = zone if label is None else zone * (int(label.max(initial=0)) + 1) + label

    def fewer(number: int) -> tuple[TriangleMesh, Deviation]:
        part = zone == number
        return _within(selected(mesh, part), kinds[part], errors[number])

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        done = list(pool.map(fewer, range(len(errors))))
    return Decimated(
        _joined([part for part, _ in done], mesh),
        errors,
        [gap.most for _, gap in done],
        [gap.p95 for _, gap in done],
    )


def _joined(parts: list[TriangleMesh], mesh: TriangleMesh) -> TriangleMesh:
    """Return the joined parts of one mesh."""
    some = [part for part in parts if len(part.faces)]
    if not some:
        return selected(mesh, np.zeros(len(mesh.faces), bool))
    objects = np.concatenate([part.object for part in some])
    return replace(TriangleMesh.concatenate(some), object=objects, names=mesh.names)


def _zones(
    mesh: TriangleMesh, sensors: NDArray[np.float64], error_m: float | None
) -> tuple[NDArray[np.int64], list[float]]:
    """Return each triangle's zone (F,) and each zone's bound."""
    count = len(mesh.faces)
    if error_m is not None or not len(sensors):
        return np.zeros(count, np.int64), [NEAR_M if error_m is None else error_m]
    corner = mesh.vertices[mesh.faces]
    distance = np.full(count, np.inf)
    for sensor in np.asarray(sensors, np.float64).reshape(-1, 3):
        away = np.sqrt(((corner - sensor) ** 2).sum(axis=2).min(axis=1))
        distance = np.minimum(distance, away)
    # Bounds double from zone to zone; a zone has the bound of its nearest triangle.
    steps = np.floor(np.log2(unseen_error(distance) / NEAR_M)).astype(np.int64)
    numbers, zone = np.unique(steps, return_inverse=True)
    return zone.ravel(), [float(NEAR_M * 2.0**n) for n in numbers]


def _within(
    mesh: TriangleMesh, kinds: NDArray[np.int64], error: float
) -> tuple[TriangleMesh, Deviation]:
    """Return a mesh with fewer triangles, and its deviation from the original."""
    free = _shared(mesh)
    if not free.any():
        return mesh, Deviation.none(len(mesh.faces))
    old = Surface(mesh.vertices, mesh.faces)
    for bound in error * np.array(_TRIES):
        part = selected(mesh, free)
        fewer = _collapsed(part, kinds[free], bound)
        if len(fewer[1]) > _WORTH * len(part.faces):
            break
        gap = deviation(part, *fewer, old, error)
        if gap.most <= error:
            new = _attributed(mesh, part, *fewer, gap)
            return _joined([new, selected(mesh, ~free)], mesh), gap
        # Triangles beyond the bound and their neighbours are kept.
        far = (gap.old > error) | (gap.new > error)[gap.new_of_old]
        some = np.zeros(len(mesh.faces), bool)
        some[gap.old_of_new[gap.new > error]] = True
        far |= some[free]
        if not far.any():
            break
        touched = np.zeros(len(part.vertices), bool)
        touched[part.faces[far].ravel()] = True
        free[np.flatnonzero(free)[some_corner(touched, part.faces)]] = False
        if free.sum() < (1.0 - _WORTH) * len(mesh.faces) or far.mean() > _HOPELESS:
            break
    return mesh, Deviation.none(len(mesh.faces))


def _shared(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """Return the mask of triangles (F,) with a corner shared by three or more.

    Corners of fewer triangles are on a border, and are fixed: single triangles and quads have no
    others.
    """
    around = np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices))
    return some_corner(around > 2, mesh.faces)


def _collapsed(
    mesh: TriangleMesh, kinds: NDArray[np.int64], bound: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices and triangles after all collapses with a quadric error below a bound.

    The library collapses every edge with an error below the square root of double's epsilon in the
    mesh's unit. The mesh is therefore scaled so that this equals the bound.
    """
    # A vertex of two kinds is duplicated: borders of kinds become borders of the mesh, which are
    # fixed.
    keys = mesh.faces.astype(np.int64) + len(mesh.vertices) * kinds[:, None]
    used, faces = np.unique(keys, return_inverse=True)
    vertices = mesh.vertices[used % len(mesh.vertices)]
    middle = vertices.mean(axis=0)
    scale = float(np.sqrt(np.finfo(np.float64).eps)) / bound
    with _ONE_AT_A_TIME:
        points, triangles = fast_simplification.simplify(
            (vertices - middle) * scale,
            faces.reshape(-1, 3).astype(np.int32),
            target_count=1,
            lossless=True,
            preserve_border=True,
        )
    points = np.asarray(points, np.float64) / scale + middle
    return points, np.asarray(triangles, np.int32)


def _attributed(
    mesh: TriangleMesh,
    part: TriangleMesh,
    points: NDArray[np.float64],
    triangles: NDArray[np.int32],
    gap: Deviation,
) -> TriangleMesh:
    """Return the new triangles with the colours and names of the original ones under them."""
    colour = None
    if mesh.colour is not None and part.colour is not None:
        # Area-weighted mean of the original triangles on a new one, at edges only of those with the
        # same object and orientation.
        new_normal = normals_of(points[triangles])[gap.new_of_old]
        alike = np.einsum("ij,ij->i", normals_of(part.vertices[part.faces]), new_normal) > 0.7
        alike &= part.object == mesh.object[gap.old_of_new][gap.new_of_old]
        area = areas_of_faces(part) * alike
        weight = np.bincount(gap.new_of_old, area, len(triangles))
        colour = mesh.colour[gap.old_of_new]
        mean = [
            np.bincount(gap.new_of_old, area * part.colour[:, k], len(triangles)) for k in range(3)
        ]
        some = weight > 0
        colour[some] = np.rint(np.column_stack(mean)[some] / weight[some, None]).astype(np.uint8)
    return TriangleMesh(
        points,
        triangles,
        colour,
        mesh.object[gap.old_of_new],
        mesh.names,
        None if mesh.semantic is None else mesh.semantic[gap.old_of_new],
    )
