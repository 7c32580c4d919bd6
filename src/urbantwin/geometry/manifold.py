"""Repair of surfaces that touch themselves, so that every edge has two faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["is_closed", "with_simple_edges"]

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]


def is_closed(faces: NDArray[np.int32]) -> bool:
    """Return whether every edge of triangles (F, 3) runs once each way: watertight and oriented."""
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    size = int(faces.max(initial=0)) + 1
    there, back = start * size + end, end * size + start
    unique, count = np.unique(there, return_counts=True)
    return bool((count == 1).all() and np.array_equal(unique, np.sort(back)))


def with_simple_edges(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Triangles:
    """Return a closed surface in which every edge has exactly two faces.

    If bodies touch only along an edge, four faces share it. Its vertices are duplicated, so that
    each body has its own; positions do not change.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) of a closed surface, counter-clockwise seen from outside.
    """
    corners = faces.astype(np.int64)
    start = corners.ravel()
    end = np.roll(corners, -1, axis=1).ravel()
    _, edge, count = np.unique(
        np.sort(np.column_stack([start, end]), axis=1),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    if (count == 2).all():
        return vertices, faces
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    simple = order[count[edge[order]] == 2].reshape(-1, 2)
    crowded = [np.flatnonzero(edge == number) for number in np.flatnonzero(count > 2)]
    pairs = [_paired(vertices, corners, half_edges, start, end) for half_edges in crowded]
    first, second = np.concatenate([simple, *pairs]).T
    # A half-edge k runs from corner k to the next corner of its face; its twin runs back.
    after = np.arange(len(start)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    here = np.concatenate([first, after[first]])
    there = np.concatenate([after[second], second])
    graph = coo_array((np.ones(len(here), bool), (here, there)), shape=(len(start),) * 2)
    number, vertex = connected_components(graph, directed=False)
    positions = np.empty((number, 3))
    positions[vertex] = vertices[start]
    return positions, vertex.reshape(-1, 3).astype(np.int32)


def _paired(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    half_edges: NDArray[np.int64],
    start: NDArray[np.int64],
    end: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Pair the half-edges (2 K,) of one edge such that the solid is between each two."""
    low = np.minimum(start, end)[half_edges[0]]
    high = np.maximum(start, end)[half_edges[0]]
    axis = vertices[high] - vertices[low]
    axis /= np.linalg.norm(axis)
    apex = faces[half_edges // 3, (half_edges + 2) % 3]
    reach = vertices[apex] - vertices[low]
    reach -= (reach @ axis)[:, None] * axis
    u = reach[0] / np.linalg.norm(reach[0])
    angle = np.arctan2(reach @ np.cross(axis, u), reach @ u)
    turn = half_edges[np.argsort(angle, kind="stable")]
    # Counter-clockwise about the axis, a face that runs against it is followed by the solid.
    opens = np.flatnonzero(start[turn] == high)
    return np.column_stack([turn[opens], np.roll(turn, -1)[opens]])
