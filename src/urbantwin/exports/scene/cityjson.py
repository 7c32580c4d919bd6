"""The buildings of a twin as CityJSON 2.0 (OGC 20-072r5) with semantic surfaces."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from urbantwin.errors import InputError
from urbantwin.exports.scene.georeference import utm_code
from urbantwin.geometry import LabelledMesh, SiteFrame
from urbantwin.scene import FIRST_OBJECT
from urbantwin.scene.building_surface import SURFACES, building_surfaces
from urbantwin.taxonomy import materials, semantic_id
from urbantwin.twin import Twin

__all__ = ["flat_faces", "write_cityjson"]


#: Adjacent faces whose normals differ by more than this are in different planes, radians.
_ANGLE = np.radians(0.5)


@dataclass(frozen=True, eq=False)
class Face:
    """A polygon.

    Attributes:
        rings: indices of vertices; the outer ring first, counter-clockwise seen from the front.
        first: index of one of its triangles.
    """

    rings: list[list[int]]
    first: int


def flat_faces(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], label: NDArray[np.int64]
) -> list[Face]:
    """Merge adjacent coplanar triangles with the same label into polygons.

    Groups with a border that touches itself in a corner remain triangles.

    Args:
        vertices: (V, 3).
        faces: (F, 3), without degenerate triangles.
        label: (F,); triangles with different labels are not merged.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    normal = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    group = _groups(faces, normal, label, len(vertices))
    # Edges without an opposite edge in the same group form the group's border.
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
    # Only edges shared by exactly two triangles connect them.
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
    """Return closed rings of edges; ``None`` if a vertex has several outgoing edges."""
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
    """Return the rings with the outer one first; ``None`` without exactly one outer ring."""
    areas = []
    for ring in rings:
        points = vertices[ring] - vertices[ring[0]]
        turned = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
        areas.append(float(turned @ normal))
    outside = [k for k, area in enumerate(areas) if area > 0]
    if len(outside) != 1:
        return None
    return [rings[outside[0]], *(rings[k] for k in range(len(rings)) if k != outside[0])]


#: Coordinates are whole millimetres.
_SCALE = 0.001


def write_cityjson(twin: Twin, path: Path) -> list[str]:
    """Write every building as a ``MultiSurface``.

    Coplanar triangles form one surface. Its type follows from its normal: roof, wall, ground or
    outer ceiling; glass in walls is a window, wood in walls a door. Coordinates are in the UTM zone
    of WGS 84 at the site; heights are the DEM's, or without a DEM metres above the anchor's ground.

    Returns:
        Notes for the user.

    Raises:
        InputError: the twin has no building.
    """
    mesh = twin.mesh
    buildings = _buildings(mesh)
    if not len(buildings.faces):
        raise InputError("has no building", file=twin.folder, expected="a twin with buildings")
    code = utm_code(twin.frame.latitude, twin.frame.longitude)
    base = twin.anchor_height_m
    points = _projected(buildings.vertices, twin.frame, code, base or 0.0)
    translate = np.floor(points.min(axis=0))
    whole, index = np.unique(
        np.round((points - translate) / _SCALE).astype(np.int64), axis=0, return_inverse=True
    )
    faces = index.ravel()[buildings.faces]
    objects = _objects(buildings, np.asarray(whole * _SCALE, np.float64), faces)
    low, high = whole.min(axis=0) * _SCALE + translate, whole.max(axis=0) * _SCALE + translate
    datum = "the DEM's heights" if base is not None else "heights above the anchor's ground"
    document: dict[str, Any] = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [_SCALE] * 3, "translate": translate.tolist()},
        "metadata": {
            "title": f"{twin.manifest['name']}: buildings, {datum}",
            "referenceSystem": f"https://www.opengis.net/def/crs/EPSG/0/{code}",
            "geographicalExtent": [round(float(v), 3) for v in (*low, *high)],
        },
        "CityObjects": objects,
        "vertices": whole.tolist(),
    }
    path.write_text(
        json.dumps(document, separators=(",", ":"), ensure_ascii=False) + "\n", encoding="utf-8"
    )
    return [] if base is not None else [f"EPSG:{code} has no heights; they are above the anchor"]


def _buildings(mesh: LabelledMesh) -> LabelledMesh:
    """Return the non-degenerate triangles of all parts that are buildings."""
    own = np.unique(mesh.part[mesh.semantic == semantic_id("building")])
    own = own[own >= FIRST_OBJECT]
    return mesh.select(np.isin(mesh.part, own) & (mesh.areas() > 1e-6))


def _projected(
    vertices: NDArray[np.float64], frame: SiteFrame, code: int, base: float
) -> NDArray[np.float64]:
    lonlat = frame.lonlat_from_site(vertices[:, :2])
    transform = Transformer.from_crs("EPSG:4326", f"EPSG:{code}", always_xy=True)
    east, north = transform.transform(lonlat[:, 0], lonlat[:, 1])
    return np.column_stack([east, north, vertices[:, 2] + base])


def _objects(
    mesh: LabelledMesh, vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> dict[str, Any]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    kept = (length > 1e-9) & (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
    mesh, faces = mesh_rows(mesh, kept), faces[kept]
    kind = building_surfaces(mesh)
    parts, number = np.unique(mesh.part, return_inverse=True)
    label = (number.ravel() * len(SURFACES) + kind) * 256 + mesh.material
    named = {one.id: one.name for one in materials().values()}
    found: dict[str, Any] = {
        f"building-{k + 1}": {
            "type": "Building",
            "attributes": {"part": int(part)},
            "geometry": [
                {
                    "type": "MultiSurface",
                    "lod": "2",
                    "boundaries": [],
                    "semantics": {"surfaces": [], "values": []},
                }
            ],
        }
        for k, part in enumerate(parts)
    }
    known: dict[tuple[int, int], int] = {}
    for face in flat_faces(vertices, faces, label):
        one = found[f"building-{int(number.ravel()[face.first]) + 1}"]
        geometry = one["geometry"][0]
        semantics = geometry["semantics"]
        key = (int(number.ravel()[face.first]), int(label[face.first]))
        if key not in known:
            known[key] = len(semantics["surfaces"])
            surface = SURFACES[int(kind[face.first])]
            material = named[int(mesh.material[face.first])]
            semantics["surfaces"].append({"type": surface, "material": material})
            if surface in ("Window", "Door"):
                geometry["lod"] = "3"
        geometry["boundaries"].append(face.rings)
        semantics["values"].append(known[key])
    for k in range(len(parts)):
        own = vertices[faces[number.ravel() == k], 2]
        height = round(float(own.max() - own.min()), 2)
        found[f"building-{k + 1}"]["attributes"]["height_m"] = height
    return found


def mesh_rows(mesh: LabelledMesh, kept: NDArray[np.bool_]) -> LabelledMesh:
    """Return a mesh with selected faces and all vertices."""
    return LabelledMesh(
        mesh.vertices, mesh.faces[kept], mesh.semantic[kept], mesh.material[kept], mesh.part[kept]
    )
