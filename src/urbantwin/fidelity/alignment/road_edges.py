"""Edges of the twin's carriageway."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.taxonomy import semantic_id

__all__ = ["road_edges"]

_EVERY_M = 0.25
#: Distance from an edge at which the ground on either side is examined, metres.
_ASIDE_M = 0.15
#: Maximum height difference to the sidewalk beside an edge, metres.
_STEP_M = 0.5
_CARRIAGEWAY = tuple(semantic_id(name) for name in ("road", "parking"))


def road_edges(ground: LabelledMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (N, 3) along the edges of carriageways, and unit vectors (N, 3) to the road.

    Edges are those of carriageway triangles beside other ground, without the border of the twin and
    seams between triangles of one street.

    Args:
        ground: walkable triangles.
    """
    none = np.zeros((0, 3)), np.zeros((0, 3))
    road = ground.select(np.isin(ground.semantic, _CARRIAGEWAY))
    if not len(road.faces):
        return none
    start, end = _open_edges(road)
    length = np.linalg.norm((end - start)[:, :2], axis=1)
    count = np.maximum(1, np.rint(length / _EVERY_M)).astype(int) * (length > 0.02)
    edge = np.repeat(np.arange(len(start)), count)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (number + 0.5) / count[edge]
    places = start[edge] + share[:, None] * (end - start)[edge]
    ahead = (end - start)[edge, :2] / length[edge, None]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(edge))])
    probe = DownwardProbe(ground)
    sides = []
    for aside in (_ASIDE_M * left, -_ASIDE_M * left):
        above = places + aside + [0.0, 0.0, _STEP_M]
        face = probe.face_below(above)
        height = probe.height_below(above)
        near = (face >= 0) & (np.abs(height - places[:, 2]) < _STEP_M)
        sides.append((near, near & np.isin(ground.semantic[face], _CARRIAGEWAY)))
    (near_left, road_left), (near_right, road_right) = sides
    kept = near_left & near_right & (road_left != road_right)
    return places[kept], np.where(road_left[:, None], left, -left)[kept]


def _open_edges(mesh: LabelledMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both ends (E, 3) of the edges that belong to one triangle only."""
    _, same = np.unique(np.round(mesh.vertices, 3), axis=0, return_inverse=True)
    same = same.reshape(-1)
    faces = mesh.faces
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = np.sort(same[pairs], axis=1)
    _, first, number = np.unique(key, axis=0, return_index=True, return_counts=True)
    alone = pairs[np.sort(first[number == 1])]
    return mesh.vertices[alone[:, 0]], mesh.vertices[alone[:, 1]]
