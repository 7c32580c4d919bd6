"""The buildings of a twin as CityJSON 2.0 (OGC 20-072r5) with semantic surfaces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.exports.scene.coplanar import flat_faces
from urbantwin.exports.scene.georeference import utm_code
from urbantwin.geometry import LabelledMesh, SiteFrame
from urbantwin.scene import FIRST_OBJECT
from urbantwin.scene.building_surface import SURFACES, building_surfaces
from urbantwin.taxonomy import materials, semantic_id
from urbantwin.twin import Twin

__all__ = ["write_cityjson"]

#: Coordinates are whole millimetres.
_SCALE = 0.001


def write_cityjson(twin: Twin, path: Path) -> list[str]:
    """Write every building as a ``MultiSurface``.

    Triangles that lie in one plane are one surface. Its type follows from its normal: roof,
    wall, ground or outer ceiling; panes of glass in walls are windows, wood in them doors.
    Coordinates are in the UTM zone of WGS 84 at the site; heights are the DEM's, or without one
    metres above the anchor's ground.

    Returns:
        What a person should be told.

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
    """Return the triangles of all parts that are buildings and of some area."""
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
    """Return a mesh with some of its faces and all of its vertices."""
    return LabelledMesh(
        mesh.vertices, mesh.faces[kept], mesh.semantic[kept], mesh.material[kept], mesh.part[kept]
    )
