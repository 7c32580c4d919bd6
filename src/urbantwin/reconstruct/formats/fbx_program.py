"""Reads FBX with ufbx: run as a program beside UrbanTwin, never imported.

A file that is damaged can end the library's process; here it ends only this one. Its arguments
are the FBX and a folder, to which it writes ``nodes.json`` and ``nodes.npz``.
"""

from __future__ import annotations

import gc
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import ufbx

#: The Python objects of ufbx 0.0.5 must not be taken down while the scene is in use, so all of
#: them are held until the process ends.
_held: list[Any] = []


def at(thing: Any, *names: str) -> Any:  # noqa: ANN401 - ufbx has no useful types
    """Return an attribute of an attribute ..., all of them held."""
    for name in names:
        thing = getattr(thing, name)
        _held.append(thing)
    return thing


def items(things: Any) -> list[Any]:  # noqa: ANN401
    """Return the items of a list of ufbx, all of them held."""
    found = [things[number] for number in range(len(things))]
    _held.extend(found)
    return found


def main(source: str, folder: Path) -> None:
    """Write the meshes of all nodes: z up, metres, in the file's world."""
    options: dict[str, Any] = {
        "target_axes": ufbx.axes_right_handed_z_up,
        "target_unit_meters": 1.0,
        "load_external_files": False,
    }
    try:
        scene = ufbx.load_file(source, **options)
    except Exception as error:
        (folder / "error.txt").write_text(
            type(error).__name__.removesuffix("Error"), encoding="utf-8"
        )
        return
    _held.append(scene)
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    nodes: list[dict[str, Any]] = []
    materials: dict[str, dict[str, Any]] = {}
    for node in items(at(scene, "nodes")):
        mesh = at(node, "mesh")
        if mesh is None or not len(at(mesh, "faces")):
            continue
        names = []
        for material in items(at(node, "materials")):
            names.append(at(material, "name"))
            if names[-1] not in materials:
                materials[names[-1]] = described(material, folder, len(materials))
        for key, values in arrays_of(node, mesh).items():
            arrays[f"{len(nodes)}/{key}"] = values
        nodes.append({"name": at(node, "name"), "materials": names})
    np.savez(folder / "nodes.npz", allow_pickle=False, **arrays)
    settings = at(scene, "settings")
    said = {"unit_m": float(at(settings, "original_unit_meters"))}
    text = json.dumps({"nodes": nodes, "materials": materials, "said": said})
    (folder / "nodes.json").write_text(text, encoding="utf-8")


def arrays_of(node: Any, mesh: Any) -> dict[str, np.ndarray[Any, Any]]:  # noqa: ANN401
    """Return a node's place, and its mesh's corners, faces, materials and colours."""
    matrix = at(node, "geometry_to_world")
    columns = [[at(at(matrix, c), k) for k in "xyz"] for c in ("c0", "c1", "c2", "c3")]
    found: dict[str, np.ndarray[Any, Any]] = {
        "matrix": np.array(columns, np.float64).T,
        "vertices": np.array(at(mesh, "vertex_position", "values"), np.float64).reshape(-1, 3),
        "corners": np.array(at(mesh, "vertex_position", "indices"), np.int64),
        "faces": np.array(at(mesh, "faces"), np.int64).reshape(-1, 2),
    }
    if len(at(mesh, "face_material")):
        found["material"] = np.array(at(mesh, "face_material"), np.int64)
    for key, name in (("uv", "vertex_uv"), ("colour", "vertex_color")):
        if at(mesh, name, "exists"):
            found[key] = np.array(at(mesh, name, "values"), np.float64)
            found[f"{key}_corners"] = np.array(at(mesh, name, "indices"), np.int64)
    return found


def described(material: Any, folder: Path, number: int) -> dict[str, Any]:  # noqa: ANN401
    """Return a material's colour (linear RGB) and picture; embedded pictures are written out."""
    diffuse = at(material, "fbx", "diffuse_color")
    value = at(diffuse, "value_vec4")
    known = bool(at(diffuse, "has_value"))
    found: dict[str, Any] = {"colour": [at(value, k) for k in "xyz"] if known else None}
    texture = at(diffuse, "texture")
    if texture is not None:
        content = bytes(at(texture, "content") or b"")
        if content:
            found["embedded"] = f"picture-{number}"
            (folder / found["embedded"]).write_bytes(content)
        found["picture"] = at(texture, "relative_filename") or at(texture, "filename")
    return found


if __name__ == "__main__":
    gc.disable()
    main(sys.argv[1], Path(sys.argv[2]))
    sys.stdout.flush()
    os._exit(0)
