"""A twin's scene for programs that show or simulate 3D: glTF, OBJ, PLY, USD, FBX, CityJSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file
from urbantwin.drawing.markings import markings
from urbantwin.errors import InputError
from urbantwin.exports.mesh import (
    Look,
    MeshObject,
    check_fbx,
    write_fbx,
    write_glb,
    write_obj,
)
from urbantwin.exports.scene.cityjson import write_cityjson
from urbantwin.exports.scene.georeference import georeference
from urbantwin.exports.scene.materials import look_of
from urbantwin.exports.scene.usd import check_usd, write_usd
from urbantwin.geometry import LabelledMesh
from urbantwin.scene import FIRST_OBJECT
from urbantwin.scene.surface import PARTS
from urbantwin.taxonomy import materials, semantic_classes, semantic_id
from urbantwin.twin import Twin

__all__ = ["SCENE_FORMATS", "write_scene"]


#: Parts of the ground by their names.
_GROUND = {"carriageway": "road", "footway": "sidewalk", "paved": "paved ground"}
#: Names of objects, by class.
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
#: Name of the road paint.
PAINT = "lane paint"
#: A part with any of these classes is named after it.
_TELLING = ("building", "trunk", "pole")


def named_objects(
    mesh: LabelledMesh, paint: LabelledMesh
) -> tuple[list[MeshObject], dict[str, Look]]:
    """Return the world as one object per part, in order of part numbers, and their looks.

    Objects have their class, its number and their ``part`` in ``scene.npz`` as extras. Road paint
    is a separate object without a part.

    Args:
        mesh: the static scene, site frame.
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
    """Return the name of an object, and its class.

    Args:
        part: part number.
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


def write_ply(mesh: LabelledMesh, path: Path, comments: Mapping[str, object]) -> None:
    """Write a PLY whose faces carry colour, class, material and part; vertices are double.

    Comments list the names of the class and material numbers.

    Args:
        mesh: the scene, site frame.
        path: the file.
        comments: further comments, key and value.
    """
    pairs, which = np.unique(
        mesh.semantic.astype(np.int64) * 256 + mesh.material, return_inverse=True
    )
    colours = [_srgb(look_of(int(pair) // 256, int(pair) % 256)[1].colour) for pair in pairs]
    face = np.dtype(
        [
            ("count", "u1"),
            ("corners", "<i4", 3),
            ("colour", "u1", 3),
            ("semantic", "<u2"),
            ("material", "u1"),
            ("part", "<i4"),
        ]
    )
    rows = np.zeros(len(mesh.faces), face)
    rows["count"], rows["corners"] = 3, mesh.faces
    rows["colour"] = np.array(colours, np.uint8).reshape(-1, 3)[which.ravel()]
    rows["semantic"], rows["material"], rows["part"] = mesh.semantic, mesh.material, mesh.part
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {key} {value}" for key, value in comments.items()),
        *_legend("semantic", mesh.semantic, {o.id: o.name for o in semantic_classes().values()}),
        *_legend("material", mesh.material, {o.id: o.name for o in materials().values()}),
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        *(f"property uchar {channel}" for channel in ("red", "green", "blue")),
        "property ushort semantic",
        "property uchar material",
        "property int part",
        "end_header",
    ]
    with path.open("wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii", "replace"))
        stream.write(mesh.vertices.astype("<f8").tobytes())
        stream.write(rows.tobytes())


def _legend(
    word: str, values: np.ndarray[tuple[int], np.dtype[np.generic]], names: Mapping[int, str]
) -> list[str]:
    return [f"comment {word} {int(one)} {names[int(one)]}" for one in np.unique(values)]


def _srgb(linear: tuple[float, float, float]) -> list[int]:
    value = np.array(linear)
    curved = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return [int(one) for one in np.round(curved * 255)]


Notes = Sequence[str] | None
#: File name suffixes of each format.
_ENDINGS = {
    "glb": (".glb",),
    "obj": (".obj",),
    "ply": (".ply",),
    "usd": (".usd", ".usda", ".usdc"),
    "fbx": (".fbx",),
    "cityjson": (".json",),
}
#: Checks of formats with optional packages.
_CHECKS = {"usd": check_usd, "fbx": check_fbx}


def write_scene(twin: Twin, path: Path, name: str) -> Notes:
    """Write a twin's static scene to a file, atomically.

    Args:
        twin: the twin.
        path: the file; OBJ gets its materials in a ``.mtl`` beside it.
        name: one of ``SCENE_FORMATS``.

    Returns:
        Notes for the user.

    Raises:
        InputError: ``path`` cannot be used, or a package for the format is not installed.
        StageError: the package failed.
    """
    if path.is_dir():
        raise InputError(
            "is a folder", file=path, expected=f"a file, such as {path.name}/scene.{name}"
        )
    if path.suffix.lower() not in _ENDINGS[name]:
        raise InputError(
            f"ends in {path.suffix or 'nothing'}",
            file=path,
            expected=f"a name that ends in {' or '.join(_ENDINGS[name])}",
        )
    if name in _CHECKS:
        _CHECKS[name]()
    with replaced_file(path, kind=name, inputs=[twin.folder]) as scratch:
        return SCENE_FORMATS[name](twin, scratch)


def _objects(twin: Twin) -> tuple[list[MeshObject], dict[str, Look]]:
    return named_objects(twin.mesh, markings(twin.roads, twin.ground_mesh, twin.lane_model))


def _glb(twin: Twin, path: Path) -> Notes:
    objects, looks = _objects(twin)
    write_glb(objects, path, looks, {"georeference": georeference(twin)})
    return None


def _obj(twin: Twin, path: Path) -> Notes:
    objects, looks = _objects(twin)
    place = georeference(twin)
    comments = [f"{key}: {value}" for key, value in place.items() if value is not None]
    write_obj(objects, path, looks, comments)
    return None


def _ply(twin: Twin, path: Path) -> Notes:
    place = {key: value for key, value in georeference(twin).items() if value is not None}
    write_ply(twin.mesh, path, place)
    return None


def _usd(twin: Twin, path: Path) -> Notes:
    objects, looks = _objects(twin)
    write_usd(objects, path, looks, georeference(twin))
    return None


def _fbx(twin: Twin, path: Path) -> Notes:
    objects, looks = _objects(twin)
    write_fbx(objects, path, looks)
    return None


SCENE_FORMATS: dict[str, Callable[[Twin, Path], Notes]] = {
    "glb": _glb,
    "obj": _obj,
    "ply": _ply,
    "usd": _usd,
    "fbx": _fbx,
    "cityjson": write_cityjson,
}
