"""The static world as objects with names: ``building 12``, ``pole 7``, ``road``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.export.mesh import Look, MeshObject
from urbantwin.export.scene.materials import look_of
from urbantwin.geometry import LabelledMesh
from urbantwin.scene import FIRST_OBJECT
from urbantwin.scene.surface import PARTS
from urbantwin.taxonomy import semantic_classes, semantic_id

__all__ = ["PAINT", "kind_of_part", "named_objects"]

#: Parts of the ground by their names.
_GROUND = {"carriageway": "road", "footway": "sidewalk", "paved": "paved ground"}
#: What an object of a class is called.
_NOUNS = {
    "building": "building",
    "fence": "fence",
    "other-structure": "structure",
    "vegetation": "vegetation",
    "trunk": "tree",
    "pole": "pole",
    "traffic-sign": "sign",
    "other-object": "object",
    "terrain": "ground",
    "water": "water",
}
#: What the paint on the road is called.
PAINT = "lane paint"
#: A part that has any of these is called after it, whatever else it has.
_TELLING = ("building", "trunk", "pole")


def named_objects(
    mesh: LabelledMesh, paint: LabelledMesh
) -> tuple[list[MeshObject], dict[str, Look]]:
    """Return the world as one object per part, in the order of their numbers, and their looks.

    Objects carry their class, its number and their ``part`` of ``scene.npz`` as extras. The paint
    on the road is an object of its own, without a part.

    Args:
        mesh: the static world, site frame.
        paint: the paint on the road, close above it.
    """
    order = np.argsort(mesh.part, kind="stable")
    parts, begin = np.unique(mesh.part[order], return_index=True)
    counted: dict[str, int] = {}
    objects: list[MeshObject] = []
    looks: dict[str, Look] = {}
    for part, faces in zip(parts, np.split(order, begin[1:]), strict=True):
        noun, kind = kind_of_part(int(part), mesh.semantic[faces])
        name = noun
        if part >= FIRST_OBJECT:
            counted[noun] = counted.get(noun, 0) + 1
            name = f"{noun} {counted[noun]}"
        extras: dict[str, object] = {
            "semantic": kind,
            "semantic_id": semantic_id(kind),
            "part": int(part),
        }
        objects.append(_object(name, mesh, faces, extras, looks))
    if len(paint.faces):
        extras = {"semantic": "road", "semantic_id": semantic_id("road")}
        every = np.arange(len(paint.faces))
        objects.append(_object(PAINT, paint, every, extras, looks))
    return objects, looks


def kind_of_part(part: int, semantic: NDArray[np.uint16]) -> tuple[str, str]:
    """Return what an object is called, and its class.

    Args:
        part: its number.
        semantic: (F,) classes of its triangles.
    """
    names = {one.id: one.name for one in semantic_classes().values()}
    numbers, counts = np.unique(semantic, return_counts=True)
    present = [names[int(one)] for one in numbers]
    kind = next((one for one in _TELLING if one in present), present[int(np.argmax(counts))])
    if part < FIRST_OBJECT:
        ground = {number: name for name, number in PARTS.items()}
        name = ground.get(part, f"ground {part}")
        return _GROUND.get(name, name), kind
    return _NOUNS.get(kind, kind), "vegetation" if kind == "trunk" else kind


def _object(
    name: str,
    mesh: LabelledMesh,
    faces: NDArray[np.int64],
    extras: dict[str, object],
    looks: dict[str, Look],
) -> MeshObject:
    used, corners = np.unique(mesh.faces[faces], return_inverse=True)
    both = mesh.semantic[faces].astype(np.int64) * 256 + mesh.material[faces]
    pairs, material = np.unique(both, return_inverse=True)
    labels = []
    for pair in pairs:
        label, look = look_of(int(pair) // 256, int(pair) % 256)
        looks[label] = look
        labels.append(label)
    return MeshObject(
        name,
        mesh.vertices[used],
        corners.reshape(-1, 3).astype(np.int32),
        material.ravel().astype(np.int32),
        tuple(labels),
        extras,
    )
