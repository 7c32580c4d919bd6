"""Surfaces that touch themselves, made such that every edge has two faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from urbantwin.scene.solids import Solid

__all__ = ["with_simple_edges"]


def with_simple_edges(solid: Solid) -> Solid:
    """Return a closed surface in which every edge has exactly two faces.

    Where bodies touch along an edge only, four faces share it. Its vertices are repeated, so that
    each body has its own: positions do not change.
    """
    faces = solid.faces.astype(np.int64)
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    _, edge, count = np.unique(
        np.sort(np.column_stack([start, end]), axis=1),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    if (count == 2).all():
        return solid
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    simple = order[count[edge[order]] == 2].reshape(-1, 2)
    crowded = [np.flatnonzero(edge == number) for number in np.flatnonzero(count > 2)]
    pairs = [_paired(solid, half_edges, start, end) for half_edges in crowded]
    first, second = np.concatenate([simple, *pairs]).T
    # A half-edge k runs from corner k to the next corner of its face; its twin runs back.
    after = np.arange(len(start)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    here = np.concatenate([first, after[first]])
    there = np.concatenate([after[second], second])
    graph = coo_array((np.ones(len(here), bool), (here, there)), shape=(len(start),) * 2)
    number, vertex = connected_components(graph, directed=False)
    positions = np.empty((number, 3))
    positions[vertex] = solid.vertices[start]
    return Solid(positions, vertex.reshape(-1, 3).astype(np.int32))


def _paired(
    solid: Solid, half_edges: NDArray[np.int64], start: NDArray[np.int64], end: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Pair the half-edges (2 K,) of one edge such that the solid lies between each two."""
    low = np.minimum(start, end)[half_edges[0]]
    high = np.maximum(start, end)[half_edges[0]]
    axis = solid.vertices[high] - solid.vertices[low]
    axis /= np.linalg.norm(axis)
    apex = solid.faces[half_edges // 3, (half_edges + 2) % 3]
    reach = solid.vertices[apex] - solid.vertices[low]
    reach -= (reach @ axis)[:, None] * axis
    u = reach[0] / np.linalg.norm(reach[0])
    angle = np.arctan2(reach @ np.cross(axis, u), reach @ u)
    turn = half_edges[np.argsort(angle, kind="stable")]
    # Counter-clockwise about the axis, a face that runs against it is followed by the solid.
    opens = np.flatnonzero(start[turn] == high)
    return np.column_stack([turn[opens], np.roll(turn, -1)[opens]])
