"""Binary glTF 2.0: metres, y up."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.exports.mesh.mesh_object import Look, MeshObject

__all__ = ["write_glb", "y_up"]

_JSON, _BIN = 0x4E4F534A, 0x004E4942  # chunks of a GLB (glTF 2.0, 4.4)
_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963


def write_glb(
    objects: Sequence[MeshObject],
    path: Path,
    looks: Mapping[str, Look],
    extras: Mapping[str, object] | None = None,
) -> None:
    """Write binary glTF: a node per object with its name; x east, y up, z south, metres.

    Args:
        objects: objects to write.
        path: the file.
        looks: appearance of the objects' materials, by name.
        extras: extras of the scene.
    """
    names = sorted({name for one in objects for name in one.materials})
    body = bytearray()
    scene: dict[str, Any] = {"nodes": list(range(len(objects)))}
    if extras:
        scene["extras"] = dict(extras)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "UrbanTwin"},
        "scene": 0,
        "scenes": [scene],
        "nodes": [_node(one, number) for number, one in enumerate(objects)],
        "meshes": [],
        "materials": [_material(name, looks[name]) for name in names],
        "accessors": [],
        "bufferViews": [],
    }
    for one in objects:
        attributes = {"POSITION": _add(document, body, y_up(one.vertices).astype("<f4"), _ARRAY)}
        if one.normals is not None:
            attributes["NORMAL"] = _add(document, body, y_up(one.normals).astype("<f4"), _ARRAY)
        if one.uv is not None:
            turned = one.uv * [1.0, -1.0] + [0.0, 1.0]  # glTF counts rows from the top
            attributes["TEXCOORD_0"] = _add(document, body, turned.astype("<f4"), _ARRAY)
        primitives = []
        for number, material in enumerate(one.materials):
            faces = one.faces[one.material == number].astype("<u4").reshape(-1)
            primitives.append(
                {
                    "attributes": attributes,
                    "indices": _add(document, body, faces, _ELEMENTS),
                    "material": names.index(material),
                }
            )
        document["meshes"].append({"name": one.name, "primitives": primitives})
    document["buffers"] = [{"byteLength": len(body)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with path.open("wb") as stream:
        stream.write(b"glTF" + struct.pack("<II", 2, 28 + len(text) + len(body)))
        stream.write(struct.pack("<II", len(text), _JSON) + text)
        stream.write(struct.pack("<II", len(body), _BIN) + body)


def y_up(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) with y up and z south."""
    return np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])


def _node(one: MeshObject, mesh: int) -> dict[str, Any]:
    node: dict[str, Any] = {"name": one.name, "mesh": mesh}
    if one.extras:
        node["extras"] = dict(one.extras)
    return node


def _material(name: str, look: Look) -> dict[str, Any]:
    surface = {
        "baseColorFactor": [*look.colour, look.alpha],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9,
    }
    material: dict[str, Any] = {"name": name, "pbrMetallicRoughness": surface}
    if look.alpha < 1.0:
        material["alphaMode"] = "BLEND"
    if look.extras:
        material["extras"] = dict(look.extras)
    return material


def _add(
    document: dict[str, Any], body: bytearray, values: NDArray[np.generic], target: int
) -> int:
    """Append an array to the buffer and return the number of its accessor."""
    view = {"buffer": 0, "byteOffset": len(body), "byteLength": values.nbytes, "target": target}
    document["bufferViews"].append(view)
    accessor: dict[str, Any] = {
        "bufferView": len(document["bufferViews"]) - 1,
        "componentType": _FLOAT if target == _ARRAY else _UINT,
        "count": len(values),
        "type": f"VEC{values.shape[1]}" if target == _ARRAY else "SCALAR",
    }
    if target == _ARRAY:
        accessor["min"] = [float(v) for v in values.min(axis=0)]
        accessor["max"] = [float(v) for v in values.max(axis=0)]
    document["accessors"].append(accessor)
    body += values.tobytes()
    return len(document["accessors"]) - 1
