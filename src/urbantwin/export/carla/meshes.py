"""The twin's mesh as objects that CARLA can name, tag and cull."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.export.mesh import MeshObject
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import materials, semantic_classes

__all__ = ["named_objects"]

#: Edge of the squares that ground and plants are cut into, metres.
CELL_M = 100.0
#: Semantic class -> object. Buildings are objects of their own, all else is joined by square.
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
#: Faces of the ground steeper than this stand: they are curbs.
_UPRIGHT = 0.5
#: Material of an object's faces -> RoadRunner's name, by which CARLA chooses a material of its own
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


def named_objects(mesh: LabelledMesh, paint: LabelledMesh) -> list[MeshObject]:
    """Split the static world into named objects, in a fixed order.

    Args:
        mesh: the static world, site frame.
        paint: the markings on the road.
    """
    kinds = _kinds(mesh)
    found: list[MeshObject] = []
    for kind in (*dict.fromkeys(_OBJECT_OF.values()), "Road_Curb", "TrafficLight"):
        part = mesh.select(kinds == kind)
        found += _objects(kind, part, by_part=kind in ("Building", "TrafficLight", "TrafficSign"))
    return found + list(_objects("Road_Marking", paint, by_part=False))


def _kinds(mesh: LabelledMesh) -> NDArray[np.str_]:
    """Return the object (F,) that each triangle belongs to."""
    names = {row.id: name for name, row in semantic_classes().items()}
    table = np.full(max(names) + 1, "Static", dtype="<U20")
    for number, name in names.items():
        table[number] = _OBJECT_OF.get(name, "Static")
    kinds = table[mesh.semantic]
    # Flush sides of sidewalks are curbs; low raised ground between lanes is a curb all over, so
    # that CARLA lets no pedestrian walk along it.
    sides = np.abs(mesh.normals()[:, 2]) < _UPRIGHT
    kinds[(kinds == "Road_Sidewalk") & sides] = "Road_Curb"
    # A pole with lamps or with a plate goes with them: CARLA sets up both from the OpenDRIVE.
    on_pole = np.isin(mesh.part, np.unique(mesh.part[kinds == "Pole"])) & (mesh.part > 0)
    for head, whole in (("Static", "TrafficLight"), ("TrafficSign", "TrafficSign")):
        parts = np.unique(mesh.part[on_pole & (kinds == head)])
        kinds[np.isin(mesh.part, parts) & np.isin(kinds, ("Pole", head))] = whole
    return kinds


def _objects(kind: str, mesh: LabelledMesh, *, by_part: bool) -> Iterator[MeshObject]:
    if not len(mesh.faces):
        return
    if by_part:
        group = np.unique(mesh.part, return_inverse=True)[1]
    else:
        cell = np.floor(mesh.triangles()[:, :, :2].mean(axis=1) / CELL_M).astype(np.int64)
        group = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    names = {row.id: name for name, row in materials().items()}
    for number in range(int(group.max()) + 1):
        part = mesh.select(group == number)
        used, material = np.unique(part.material, return_inverse=True)
        yield MeshObject(
            f"{kind}_{number}",
            part.vertices,
            part.faces,
            material.astype(np.int32),
            tuple(_material_name(kind, names[int(one)]) for one in used),
        )


def _material_name(kind: str, material: str) -> str:
    for key in ((kind, material), (kind, "")):
        if key in _ROADRUNNER:
            return _ROADRUNNER[key]
    return f"M_{kind}_{material.replace('-', '_')}"
