"""The map's mesh as glTF 2.0 (binary) and Wavefront OBJ: metres, y up, as both expect it."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.export.carla.meshes import MeshObject

__all__ = ["colour_of", "write_glb", "write_obj"]

_JSON, _BIN = 0x4E4F534A, 0x004E4942  # chunks of a GLB (glTF 2.0, 4.4)
_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
#: Colours of materials by what their names contain, linear RGB.
_COLOURS = (
    ("LaneMarking", (0.85, 0.85, 0.85)),
    ("Asphalt", (0.10, 0.10, 0.11)),
    ("asphalt", (0.10, 0.10, 0.11)),
    ("Sidewalk", (0.42, 0.40, 0.37)),
    ("Concrete", (0.45, 0.45, 0.43)),
    ("Grass", (0.14, 0.28, 0.09)),
    ("Rural", (0.25, 0.20, 0.13)),
    ("Apartment", (0.30, 0.28, 0.26)),
    ("foliage", (0.07, 0.22, 0.05)),
    ("bark", (0.16, 0.11, 0.07)),
    ("wood", (0.30, 0.20, 0.11)),
    ("brick", (0.38, 0.15, 0.10)),
    ("roofing", (0.22, 0.12, 0.10)),
    ("glass", (0.15, 0.20, 0.24)),
    ("metal", (0.28, 0.29, 0.31)),
    ("plaster", (0.62, 0.58, 0.50)),
)
_GREY = (0.5, 0.5, 0.5)


def colour_of(material: str) -> tuple[float, float, float]:
    """Return a material's colour, linear RGB from 0 to 1."""
    return next((colour for key, colour in _COLOURS if key in material), _GREY)


def write_glb(objects: Sequence[MeshObject], path: Path) -> None:
    """Write binary glTF: one node per object, named as it; x east, y up, z south, metres."""
    names = sorted({name for one in objects for name in one.materials})
    body = bytearray()
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "UrbanTwin"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(objects)))}],
        "nodes": [{"name": one.name, "mesh": number} for number, one in enumerate(objects)],
        "meshes": [],
        "materials": [_material(name) for name in names],
        "accessors": [],
        "bufferViews": [],
    }
    for one in objects:
        places = _y_up(one.vertices).astype("<f4")
        position = _add(document, body, places, _ARRAY)
        primitives = []
        for number, material in enumerate(one.materials):
            faces = one.faces[one.material == number].astype("<u4").reshape(-1)
            primitives.append(
                {
                    "attributes": {"POSITION": position},
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


def write_obj(objects: Sequence[MeshObject], path: Path) -> None:
    """Write OBJ with its materials beside it: one ``o`` per object; x east, y up, z south."""
    library = path.with_suffix(".mtl")
    names = sorted({name for one in objects for name in one.materials})
    rows = [f"newmtl {n}\nKd {' '.join(f'{c:.3f}' for c in colour_of(n))}\n" for n in names]
    library.write_text("\n".join(rows))
    first = 1
    with path.open("w") as stream:
        stream.write(f"# metres, x east, y up, z south\nmtllib {library.name}\n")
        for one in objects:
            stream.write(f"o {one.name}\n")
            np.savetxt(stream, _y_up(one.vertices), fmt="v %.4f %.4f %.4f")
            for number, material in enumerate(one.materials):
                stream.write(f"usemtl {material}\n")
                faces = one.faces[one.material == number].astype(np.int64) + first
                np.savetxt(stream, faces, fmt="f %d %d %d")
            first += len(one.vertices)


def _y_up(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([points[:, 0], points[:, 2], -points[:, 1]])


def _material(name: str) -> dict[str, Any]:
    surface = {
        "baseColorFactor": [*colour_of(name), 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9,
    }
    return {"name": name, "pbrMetallicRoughness": surface}


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
        "type": "VEC3" if target == _ARRAY else "SCALAR",
    }
    if target == _ARRAY:
        accessor["min"] = [float(v) for v in values.min(axis=0)]
        accessor["max"] = [float(v) for v in values.max(axis=0)]
    document["accessors"].append(accessor)
    body += values.tobytes()
    return len(document["accessors"]) - 1
