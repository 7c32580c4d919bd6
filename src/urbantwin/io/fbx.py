"""FBX, read by ufbx in a child process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.io.child import read_in_child
from urbantwin.io.model import ImportedModel, TriangleMesh
from urbantwin.io.polygons import triangulated
from urbantwin.io.texture import beside, picture_of, srgb_from_linear, texture_colours
from urbantwin.io.trust import (
    MOST_TRIANGLES,
    check_coordinates,
    content_of,
    count_within,
    valid_faces,
)

__all__ = ["read_fbx"]

_GREY = 128
Arrays = dict[str, NDArray[Any]]


def read_fbx(path: Path) -> ImportedModel:
    """Read the meshes of an FBX in the file's world frame, converted to z up and metres.

    FBX states its axes and its unit. Each node is an object with its name, one per material;
    colours are the material's diffuse image or colour.

    Raises:
        InputError: it cannot be read, holds no triangle, or ufbx is not installed.
    """
    check_extra("fbx", "reading FBX", modules=("ufbx",), file=path)
    nodes, materials, unit_m = read_in_child(
        "urbantwin.io.fbx:_scene", path, file=path, size=path.stat().st_size, expected="FBX"
    )
    problems: list[str] = []
    pictures = _pictures(path, materials, problems)
    corners = sum(int((node["faces"][:, 1] - 2).clip(0).sum()) for _, _, node in nodes)
    count_within(corners, MOST_TRIANGLES, "triangles", path)
    meshes, dropped = [], 0
    for name, names, arrays in nodes:
        mesh, lost = _node(path, name, names or [""], arrays, materials, pictures)
        dropped += lost
        if mesh is not None:
            meshes.append(mesh)
    if not meshes:
        raise InputError("holds no triangle", file=path, expected="an FBX with meshes")
    mesh = TriangleMesh.concatenate(meshes)
    notes: dict[str, object] = {
        "triangles": len(mesh.faces),
        "faces_without_area_dropped": dropped,
        "objects": len(mesh.names),
        "unit_in_file_m": unit_m,
    }
    return ImportedModel(
        mesh, up="z", unit_m=1.0, problems=tuple(problems), notes=notes, files=content_of(path)
    )


def _node(
    path: Path,
    name: str,
    names: list[str],
    arrays: Arrays,
    materials: dict[str, Any],
    pictures: dict[str, NDArray[np.uint8]],
) -> tuple[TriangleMesh | None, int]:
    """Return the mesh of a node, and the number of omitted triangles without area."""
    matrix = arrays["matrix"]
    vertices = arrays["vertices"] @ matrix[:, :3].T + matrix[:, 3]
    check_coordinates(vertices, path, f"{name}: vertex")
    large = arrays["faces"][:, 1] >= 3
    begin, size = arrays["faces"][large].T
    where = np.repeat(begin - (np.cumsum(size) - size), size) + np.arange(int(size.sum()))
    corner = arrays["corners"][where]
    ring = np.repeat(np.arange(len(size)), size)
    if not len(corner) or not len(vertices):
        return None, 0
    inside = np.clip(corner, 0, len(vertices) - 1)
    index, face = triangulated(vertices[inside], ring, np.arange(len(size)))
    faces, kept = valid_faces(corner[index], len(vertices), path)
    if np.linalg.det(matrix[:, :3]) < 0:
        faces = faces[:, ::-1]
    face, index = face[kept], where[index[kept]]
    if not len(faces):
        return None, int((~kept).sum())
    which = np.zeros(len(faces), np.int64)
    if "material" in arrays:
        which = np.clip(arrays["material"][large][face], 0, len(names) - 1)
    colour = _colours(which, names, materials, pictures, arrays, index)
    used, number = np.unique(which, return_inverse=True)
    labels = tuple(
        " / ".join(dict.fromkeys(part for part in (name, names[k]) if part)) for k in used
    )
    mesh = TriangleMesh(vertices, faces, colour, number.ravel().astype(np.int32), labels)
    return mesh, int((~kept).sum())


def _colours(
    which: NDArray[np.int64],
    names: list[str],
    materials: dict[str, Any],
    pictures: dict[str, NDArray[np.uint8]],
    arrays: Arrays,
    index: NDArray[np.int64],
) -> NDArray[np.uint8] | None:
    """Return colours (F, 3) of the image, otherwise of the corners, otherwise of the material."""
    plain = [materials.get(name, {}).get("colour") for name in names]
    table = [
        np.full(3, _GREY, np.uint8) if light is None else _srgb(np.array(light)) for light in plain
    ]
    colour = np.array(table)[which]
    coloured = any(plain)
    if "colour" in arrays:
        light = arrays["colour"][arrays["colour_corners"][index]][..., :3].mean(axis=1)
        colour, coloured = _srgb(light), True
    if "uv" in arrays:
        for number, name in enumerate(names):
            own = which == number
            if name in pictures and own.any():
                uv = arrays["uv"][arrays["uv_corners"][index[own]]]
                colour[own] = texture_colours(uv, pictures[name])
                coloured = True
    return colour if coloured else None


def _srgb(light: NDArray[np.float64]) -> NDArray[np.uint8]:
    return srgb_from_linear(np.nan_to_num(light))


def _pictures(
    path: Path, materials: dict[str, Any], problems: list[str]
) -> dict[str, NDArray[np.uint8]]:
    pictures = {}
    for name, material in materials.items():
        if "picture" not in material:
            continue
        source = material.get("content") or beside(path.parent, material["picture"])
        picture = None if source is None else picture_of(source)
        if picture is None:
            label = Path(str(material["picture"]).replace("\\", "/")).name
            problems.append(f"{path.name}: its picture {label} is not beside it or cannot be read")
            continue
        pictures[name] = picture
    return pictures


# -- in the child process

#: Python objects of ufbx 0.0.5 must not be destroyed while the scene is in use: all are held until
#: the process ends.
_held: list[Any] = []


def _at(item: Any, *names: str) -> Any:  # noqa: ANN401 - ufbx has no useful types
    """Return an attribute of an attribute ..., all of them kept alive."""
    for name in names:
        item = getattr(item, name)
        _held.append(item)
    return item


def _items(sequence: Any) -> list[Any]:  # noqa: ANN401
    """Return the items of a ufbx list, all of them kept alive."""
    items = [sequence[number] for number in range(len(sequence))]
    _held.extend(items)
    return items


def _scene(path: Path) -> tuple[list[tuple[str, list[str], Arrays]], dict[str, Any], float]:
    """Return name, materials and arrays of each node; the materials; and the file's unit, metres.

    Coordinates are z up, in metres, in the file's world frame.
    """
    import gc

    import ufbx

    gc.disable()
    scene = ufbx.load_file(
        str(path),
        target_axes=ufbx.axes_right_handed_z_up,
        target_unit_meters=1.0,
        load_external_files=False,
    )
    _held.append(scene)
    nodes: list[tuple[str, list[str], Arrays]] = []
    materials: dict[str, Any] = {}
    for node in _items(_at(scene, "nodes")):
        mesh = _at(node, "mesh")
        if mesh is None or not len(_at(mesh, "faces")):
            continue
        names = []
        for material in _items(_at(node, "materials")):
            names.append(_at(material, "name"))
            if names[-1] not in materials:
                materials[names[-1]] = _described(material)
        nodes.append((_at(node, "name"), names, _arrays(node, mesh)))
    return nodes, materials, float(_at(scene, "settings", "original_unit_meters"))


def _arrays(node: Any, mesh: Any) -> Arrays:  # noqa: ANN401
    """Return a node's matrix, and its mesh's corners, faces, materials and colours."""
    matrix = _at(node, "geometry_to_world")
    columns = [[_at(_at(matrix, c), k) for k in "xyz"] for c in ("c0", "c1", "c2", "c3")]
    arrays: Arrays = {
        "matrix": np.array(columns, np.float64).T,
        "vertices": np.array(_at(mesh, "vertex_position", "values"), np.float64).reshape(-1, 3),
        "corners": np.array(_at(mesh, "vertex_position", "indices"), np.int64),
        "faces": np.array(_at(mesh, "faces"), np.int64).reshape(-1, 2),
    }
    if len(_at(mesh, "face_material")):
        arrays["material"] = np.array(_at(mesh, "face_material"), np.int64)
    for key, name in (("uv", "vertex_uv"), ("colour", "vertex_color")):
        if _at(mesh, name, "exists"):
            arrays[key] = np.array(_at(mesh, name, "values"), np.float64)
            arrays[f"{key}_corners"] = np.array(_at(mesh, name, "indices"), np.int64)
    return arrays


def _described(material: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return a material's colour (linear RGB), and its image's name and embedded bytes."""
    diffuse = _at(material, "fbx", "diffuse_color")
    value = _at(diffuse, "value_vec4")
    known = bool(_at(diffuse, "has_value"))
    described: dict[str, Any] = {"colour": [_at(value, k) for k in "xyz"] if known else None}
    texture = _at(diffuse, "texture")
    if texture is not None:
        described["content"] = bytes(_at(texture, "content") or b"")
        described["picture"] = _at(texture, "relative_filename") or _at(texture, "filename")
    return described
