"""Meshes of actors supplied by users: glTF files, oriented and placed on the ground."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.io.gltf import read_gltf
from urbantwin.taxonomy import ACTOR_SEMANTICS, material_id, semantic_id

__all__ = ["buffers_beside", "read_actor_mesh"]

#: Our materials, and the patterns in a material's or object's name that select them; the first
#: match counts.
_WORDS: tuple[tuple[str, str], ...] = (
    ("reflex-reflector", "reflex"),
    ("retroreflector", "plate|retro"),
    ("rubber", "tire|tyre|rubber|shoe|sole"),
    ("glass", "glass|window|windscreen|windshield|lens|eye|pupil|iris"),
    ("metal-painted", "paint|body|lacquer|carpaint"),
    ("metal-bare", "chrome|mirror|steel|alumin|rim"),
    ("metal-dark", "metal|iron|brake|engine|chassis|black"),
    ("skin", "skin|lips|face"),
    ("cloth", "tissue|cloth|fabric|shirt|pants|vest|hair|padding|accessor|leather|seat"),
    ("wood", "wood"),
    ("plastic", "plastic"),
)
#: Length of actors by class, metres: other lengths indicate another unit.
_LONG_M = {
    "car": (2.0, 7.0), "van": (3.0, 9.0), "truck": (3.0, 26.0), "bus": (5.0, 26.0),
    "tram": (8.0, 80.0), "motorcycle": (1.2, 3.5), "bicycle": (0.7, 3.5), "pedestrian": (0.15, 2.5),
}  # fmt: skip
_TALL_M = (0.4, 5.0)
#: Forward axis of a glTF file (y is up) -> rows of the rotation to our axes.
_AHEAD = {
    "x": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-x": [[-1, 0, 0], [0, 0, 1], [0, 1, 0]],
    "z": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    "-z": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
}


def read_actor_mesh(
    path: Path, actor_class: str, *, scale: float = 1.0, forward: str | None = None
) -> LabelledMesh:
    """Return a glTF file's mesh in the asset frame: x forward, z up, centred on the ground.

    Materials are derived from names of materials and objects; the default is painted metal, for
    pedestrians cloth.

    Args:
        path: ``.gltf`` with its buffers beside it, or ``.glb``; in metres, y up, as in glTF.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        scale: metres per unit.
        forward: the forward axis: ``x``, ``-x``, ``z`` or ``-z``. By default x (ASAM OpenMATERIAL
            3D) if that fits the shape (a vehicle's longer side, a person's shorter one), otherwise
            z (glTF).

    Raises:
        InputError: the file is missing, not glTF, has no triangles, or not the size of its class.
    """
    if not path.is_file():
        raise InputError("not found", file=path, expected="a mesh as glTF")

    def beside(name: str) -> bytes:
        other = path.parent / name
        if not other.is_file() or not other.resolve().is_relative_to(path.parent.resolve()):
            raise InputError(f"needs {name[:80]!r}", file=path, expected="its files beside it")
        return other.read_bytes()

    mesh = read_gltf(path.read_bytes(), beside, name=path.name).mesh
    if mesh is None or not len(mesh.faces):
        raise InputError("has no triangles", file=path, expected="a mesh as glTF")
    vertices = mesh.vertices * scale
    if forward is None:
        x, _, z = np.ptp(vertices, axis=0)
        forward = "x" if (x >= z) != (actor_class == "pedestrian") else "z"
    vertices = vertices @ np.array(_AHEAD[forward], np.float64).T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    _check_size(high - low, actor_class, path)
    vertices = vertices - [*(low + high)[:2] / 2, low[2]]
    rest = "cloth" if actor_class == "pedestrian" else "metal-painted"
    material = np.array([_material(name, rest) for name in mesh.names], np.uint8)
    area = _areas(vertices, mesh.faces)
    kept = area > 1e-10
    return LabelledMesh.build(
        vertices,
        mesh.faces[kept],
        semantic_id(ACTOR_SEMANTICS[actor_class]),
        material[mesh.object[kept]] if len(material) else material_id(rest),
        mesh.object[kept] + 1,
    )


def buffers_beside(path: Path) -> list[Path]:
    """Return the existing files that a glTF file refers to."""
    try:
        document = json.loads(path.read_bytes())
    except ValueError:
        return []  # a .glb is self-contained
    named = [
        path.parent / one["uri"]
        for group in ("buffers", "images")
        for one in document.get(group, ())
        if not one.get("uri", "data:").startswith("data:")
    ]
    return sorted({one for one in named if one.is_file()})


def _check_size(size: NDArray[np.float64], actor_class: str, path: Path) -> None:
    low, high = _LONG_M.get(actor_class, (0.1, 80.0))
    if low <= size[0] <= high and _TALL_M[0] <= size[2] <= _TALL_M[1]:
        return
    length, width, height = size
    raise InputError(
        f"is {length:.3g} m long, {width:.3g} m wide and {height:.3g} m high for a {actor_class}",
        file=path,
        expected=f"{low:g} to {high:g} m long: give `scale`, metres of one unit, or `forward`",
    )


def _material(name: str, rest: str) -> int:
    """Return our material for ``"node / material"``: by its last part, otherwise by its first."""
    for text in reversed(name.lower().split(" / ")):
        for ours, words in _WORDS:
            if re.search(words, text):
                return material_id(ours)
    return material_id(rest)


def _areas(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
