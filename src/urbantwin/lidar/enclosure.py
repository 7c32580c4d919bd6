"""Point-in-solid test: whether a sensor is inside a building, a pole or a wall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_classes, semantic_id

__all__ = ["enclosing"]

#: Vertices within this distance are merged, metres.
_WELD_M = 1e-4
_WORDS = {
    "fence": "a fence",
    "other-structure": "a structure",
    "vegetation": "a plant",
    "trunk": "a tree's trunk",
    "pole": "a pole",
    "traffic-sign": "a traffic sign",
}


def enclosing(point: NDArray[np.float64], mesh: LabelledMesh) -> str | None:
    """Return a description of the solid that encloses a point, or ``None``.

    Buildings may lack a floor; every other object has an inside only if its surface is closed:
    every edge is shared by an even number of triangles.

    Args:
        point: (3,) in the mesh's frame.
        mesh: any triangles.
    """
    building = mesh.semantic == semantic_id("building")
    if _is_in_any_part(point, mesh.select(building)):
        return "a building"
    faces = np.flatnonzero(~building)
    faces = faces[_may_enclose(point, mesh.triangles()[faces], _group(mesh, faces))]
    if not len(faces):
        return None
    corners = mesh.vertices[mesh.faces[faces]]
    _, corner = np.unique(np.rint(corners.reshape(-1, 3) / _WELD_M), axis=0, return_inverse=True)
    welded = corner.reshape(-1, 3)
    count = int(welded.max()) + 1
    sides = welded[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    links = coo_matrix((np.ones(len(sides), bool), (sides[:, 0], sides[:, 1])), (count, count))
    _, component = connected_components(links, directed=False)
    body = component[welded[:, 0]]
    candidates = np.flatnonzero(_may_enclose(point, corners, body))
    for number_of_body in np.unique(body[candidates]).tolist():
        triangles = candidates[body[candidates] == number_of_body]
        if (
            _is_closed(welded[triangles])
            and abs(_solid_angles(point, corners[triangles]).sum()) > 2 * np.pi
        ):
            semantic = int(mesh.semantic[faces[triangles[0]]])
            name = next(c.name for c in semantic_classes().values() if c.id == semantic)
            return _WORDS.get(name, "something solid")
    return None


def _group(mesh: LabelledMesh, faces: NDArray[np.intp]) -> NDArray[np.int64]:
    """Return a group number (F,), the same for faces of one class and part."""
    return mesh.part[faces].astype(np.int64) << 16 | mesh.semantic[faces]


def _may_enclose(
    point: NDArray[np.float64], triangles: NDArray[np.float64], group: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Return the triangles (F, 3, 3) of groups (F,) whose bounding box contains the point."""
    numbers, which = np.unique(group, return_inverse=True)
    low = np.full((len(numbers), 3), np.inf)
    high = -low
    np.minimum.at(low, which, triangles.min(axis=1))
    np.maximum.at(high, which, triangles.max(axis=1))
    holds = np.all((low <= point) & (point <= high), axis=1)
    return np.asarray(holds[which])


def _is_closed(faces: NDArray[np.integer]) -> bool:
    """Return whether every edge is shared by an even number of triangles."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return bool((count % 2 == 0).all())


def _is_in_any_part(point: NDArray[np.float64], buildings: LabelledMesh) -> bool:
    """Return whether any part of a mesh encloses a point, by its winding number.

    The solid angles of a closed part's triangles sum to 4 pi for an inside point and to 0 outside.
    A building without a floor covers more than 2 pi from inside and less from outside, so 2 pi
    separates both cases for it too.
    """
    _, building = np.unique(buildings.part, return_inverse=True)
    total = np.bincount(building, _solid_angles(point, buildings.triangles()))
    return bool((np.abs(total) > 2 * np.pi).any())


def _solid_angles(
    point: NDArray[np.float64], triangles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the signed solid angles (F,) of triangles (F, 3, 3) seen from a point.

    Van Oosterom and Strackee 1983, IEEE Trans. Biomed. Eng. 30(2), eq. 8.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    scale = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return np.asarray(2 * np.arctan2(volume, scale))
