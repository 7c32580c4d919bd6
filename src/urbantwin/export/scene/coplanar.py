"""Coplanar triangles that touch, joined into polygons with holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

__all__ = ["Face", "flat_faces"]

#: Neighbours whose normals differ by more than this lie in different planes, radians.
_ANGLE = np.radians(0.5)


@dataclass(frozen=True, eq=False)
class Face:
    """A polygon.

    Attributes:
        rings: indices of vertices, the outside first, counter-clockwise seen from the front.
        first: a triangle of it.
    """

    rings: list[list[int]]
    first: int


def flat_faces(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], label: NDArray[np.int64]
) -> list[Face]:
    """Join triangles of the same label over the edges where they lie in one plane.

    What does not bound an area once (it touches itself in a corner) stays triangles.

    Args:
        vertices: (V, 3).
        faces: (F, 3), without triangles of no area.
        label: (F,); triangles of different labels are not joined.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    normal = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    group = _groups(faces, normal, label, len(vertices))
    # Edges that no neighbour of the same group has in the other direction bound the group.
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    owner = np.repeat(group, 3)
    code = (owner * len(vertices) + start) * len(vertices) + end
    back = (owner * len(vertices) + end) * len(vertices) + start
    outer = ~np.isin(code, back)
    order = np.argsort(owner[outer], kind="stable")
    start, end, owner = start[outer][order], end[outer][order], owner[outer][order]
    begins = np.searchsorted(owner, np.arange(int(group.max(initial=-1)) + 2))
    members = np.argsort(group, kind="stable")
    member_begins = np.searchsorted(group[members], np.arange(len(begins)))
    found: list[Face] = []
    for number in range(len(begins) - 1):
        span = slice(begins[number], begins[number + 1])
        own = members[member_begins[number] : member_begins[number + 1]]
        rings = _rings(start[span].tolist(), end[span].tolist())
        ordered = None if rings is None else _ordered(rings, vertices, normal[own[0]])
        if ordered is None:
            found += [Face([faces[one].tolist()], int(one)) for one in own]
        else:
            found.append(Face(ordered, int(own[0])))
    return found


def _groups(
    faces: NDArray[np.int64],
    normal: NDArray[np.float64],
    label: NDArray[np.int64],
    count: int,
) -> NDArray[np.int64]:
    low, high = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).T
    code = low * count + high
    order = np.argsort(code, kind="stable")
    same = code[order][1:] == code[order][:-1]
    # Only edges that exactly two triangles share join them.
    alone = ~np.concatenate([[False], same[:-1]]) & ~np.concatenate([same[1:], [False]])
    pairs = same & alone
    one, other = order[:-1][pairs] // 3, order[1:][pairs] // 3
    flat = (normal[one] * normal[other]).sum(axis=1) > np.cos(_ANGLE)
    flat &= label[one] == label[other]
    links = coo_matrix(
        (np.ones(int(flat.sum())), (one[flat], other[flat])), shape=(len(faces), len(faces))
    )
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def _rings(start: list[int], end: list[int]) -> list[list[int]] | None:
    """Return closed rings of edges, ``None`` where a vertex has more than one way on."""
    following = dict(zip(start, end, strict=True))
    if len(following) < len(start):
        return None
    rings: list[list[int]] = []
    while following:
        first, here = next(iter(following.items()))
        ring = [first]
        del following[first]
        while here != first:
            ring.append(here)
            if here not in following:
                return None
            here = following.pop(here)
        if len(ring) < 3:
            return None
        rings.append(ring)
    return rings or None


def _ordered(
    rings: list[list[int]], vertices: NDArray[np.float64], normal: NDArray[np.float64]
) -> list[list[int]] | None:
    """Put the outside first; ``None`` where there is not exactly one."""
    areas = []
    for ring in rings:
        points = vertices[ring] - vertices[ring[0]]
        turned = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
        areas.append(float(turned @ normal))
    outside = [k for k, area in enumerate(areas) if area > 0]
    if len(outside) != 1:
        return None
    return [rings[outside[0]], *(rings[k] for k in range(len(rings)) if k != outside[0])]
