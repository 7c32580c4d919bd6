"""A twin's scene for programs that show or simulate 3D: glTF, OBJ, PLY, USD, FBX, CityJSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from urbantwin.artefact import replaced_file
from urbantwin.drawing.markings import markings
from urbantwin.errors import InputError
from urbantwin.exports.mesh import (
    Look,
    MeshObject,
    write_fbx,
    write_glb,
    write_obj,
)
from urbantwin.exports.scene.cityjson import write_cityjson
from urbantwin.exports.scene.georeference import georeference
from urbantwin.exports.scene.objects import named_objects
from urbantwin.exports.scene.ply import write_ply
from urbantwin.exports.scene.usd import write_usd
from urbantwin.twin import Twin

__all__ = ["SCENE_FORMATS", "write_scene"]

Notes = Sequence[str] | None
#: What readers know a format by.
_ENDINGS = {
    "glb": (".glb",),
    "obj": (".obj",),
    "ply": (".ply",),
    "usd": (".usd", ".usda", ".usdc"),
    "fbx": (".fbx",),
    "cityjson": (".json",),
}


def write_scene(twin: Twin, path: Path, name: str) -> Notes:
    """Write a twin's static world to a file, whole or not at all.

    Args:
        twin: the twin.
        path: the file; OBJ has its materials in a ``.mtl`` beside it.
        name: one of ``SCENE_FORMATS``.

    Returns:
        What a person should be told.

    Raises:
        InputError: ``path`` cannot be used, or what writes the format is not installed.
        StageError: what writes it failed.
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
