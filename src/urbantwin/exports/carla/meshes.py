"""The twin's mesh as objects that CARLA can name, tag and cull."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.exports.mesh import Look, MeshObject
from urbantwin.exports.scene.materials import look_of
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import materials, semantic_classes

__all__ = ["named_objects", "navigation_objects"]

#: Edge of the squares that ground and plants are cut into, metres.
CELL_M = 100.0
#: Object of each semantic class. Buildings are separate objects; all others are joined per square.
_OBJECT_OF = {
    "road": "Road_Road",
    "parking": "Road_Road",
    "sidewalk": "Road_Sidewalk",
    "other-ground": "Terrain",
    "terrain": "Terrain",
    "building": "Building",
    "fence": "Fence",
    "other-structure": "Wall",
    "vegetation": "Vegetation",
    "trunk": "Vegetation",
    "pole": "Pole",
    "traffic-sign": "TrafficSign",
    "other-object": "Static",
}
#: Ground faces steeper than this are curbs.
_UPRIGHT = 0.5
#: RoadRunner's name of a material, by which CARLA chooses its own material
#: (``PrepareAssetsForCookingCommandlet.cpp``). None may contain ``light`` or ``sign``.
_ROADRUNNER = {
    ("Road_Road", ""): "Asphalt1_Road",
    ("Road_Marking", ""): "LaneMarking1_Marking",
    ("Road_Sidewalk", ""): "Sidewalk_Residential_Sidewalk",
    ("Road_Curb", ""): "Concrete_Curb",
    ("Terrain", "grass"): "Grass2_rrx_Ground",
    ("Terrain", "soil"): "Rural_Ground",
    ("Terrain", ""): "Apartment_Ground",
}
#: Object -> area for pedestrians.
_AREAS = {
    "Road_Road": "road",
    "Road_Marking": "road",
    "Road_Curb": "road",
    "Road_Sidewalk": "sidewalk",
    "Terrain": "grass",
}


def named_objects(
    mesh: LabelledMesh, paint: LabelledMesh
) -> tuple[list[MeshObject], dict[str, Look]]:
    """Split the static scene into named objects, in a fixed order, with their appearance.

    Args:
        mesh: the static scene, site frame.
        paint: the markings on the road.
    """
    kinds = _kinds(mesh)
    found: list[MeshObject] = []
    looks: dict[str, Look] = {}
    for kind in (*dict.fromkeys(_OBJECT_OF.values()), "Road_Curb", "TrafficLight"):
        part = mesh.select(kinds == kind)
        by_part = kind in ("Building", "TrafficLight", "TrafficSign")
        found += _objects(kind, part, looks, by_part=by_part)
    return [*found, *_objects("Road_Marking", paint, looks, by_part=False)], looks


def navigation_objects(objects: Sequence[MeshObject]) -> list[MeshObject]:
    """Return objects for ``RecastBuilder``, each with its pedestrian area as its only material.

    It uses the names ``road``, ``sidewalk``, ``crosswalk``, ``grass`` and ``block`` (CARLA's
    ``Util/DockerUtils/fbx/src/FBX2OBJ.cpp`` derives them from the names of meshes; areas in
    ``LibCarla/source/carla/nav/Navigation.h``). Crosswalks come from the OpenDRIVE, by CARLA's own
    ``get_xodr_crosswalks.py``. Ground of soil and grass is ``grass``, which pedestrians avoid;
    ``FBX2OBJ`` makes it ``block``.
    """
    return [
        replace(one, material=np.zeros_like(one.material), materials=(navigation_area(one.name),))
        for one in objects
    ]


def navigation_area(name: str) -> str:
    """Return the area for pedestrians of an object by its name."""
    return next((area for key, area in _AREAS.items() if name.startswith(key)), "block")


def _kinds(mesh: LabelledMesh) -> NDArray[np.str_]:
    """Return the object name (F,) of each triangle."""
    names = {row.id: name for name, row in semantic_classes().items()}
    table = np.full(max(names) + 1, "Static", dtype="<U20")
    for number, name in names.items():
        table[number] = _OBJECT_OF.get(name, "Static")
    kinds = table[mesh.semantic]
    # Side faces of sidewalks are curbs; low raised ground between lanes is entirely a curb, so that
    # CARLA's pedestrians do not walk along it.
    sides = np.abs(mesh.normals()[:, 2]) < _UPRIGHT
    kinds[(kinds == "Road_Sidewalk") & sides] = "Road_Curb"
    # A pole with signal heads or a plate belongs to them: CARLA creates both from the OpenDRIVE.
    on_pole = np.isin(mesh.part, np.unique(mesh.part[kinds == "Pole"])) & (mesh.part > 0)
    for head, whole in (("Static", "TrafficLight"), ("TrafficSign", "TrafficSign")):
        parts = np.unique(mesh.part[on_pole & (kinds == head)])
        kinds[np.isin(mesh.part, parts) & np.isin(kinds, ("Pole", head))] = whole
    return kinds


def _objects(
    kind: str, mesh: LabelledMesh, looks: dict[str, Look], *, by_part: bool
) -> Iterator[MeshObject]:
    if not len(mesh.faces):
        return
    if by_part:
        group = np.unique(mesh.part, return_inverse=True)[1]
    else:
        cell = np.floor(mesh.triangles()[:, :, :2].mean(axis=1) / CELL_M).astype(np.int64)
        group = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    stuff = {row.id: name for name, row in materials().items()}
    for number in range(int(group.max()) + 1):
        part = mesh.select(group == number)
        used, first, material = np.unique(part.material, return_index=True, return_inverse=True)
        names = [_material_name(kind, stuff[int(one)]) for one in used]
        for name, number_of, face in zip(names, used, first, strict=True):
            colour = look_of(int(part.semantic[face]), int(number_of))[1].colour
            looks.setdefault(name, Look(colour))
        yield MeshObject(
            f"{kind}_{number}",
            part.vertices,
            part.faces,
            material.astype(np.int32),
            tuple(names),
        )


def _material_name(kind: str, material: str) -> str:
    for key in ((kind, material), (kind, "")):
        if key in _ROADRUNNER:
            return _ROADRUNNER[key]
    # CARLA would omit a mesh with "light" in a material's name.
    return f"M_{kind}_{material.replace('light', 'pale').replace('-', '_')}"
