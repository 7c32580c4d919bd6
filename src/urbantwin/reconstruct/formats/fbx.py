"""FBX, read by ufbx in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import passing_folder
from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.reconstruct.formats.texture import beside, picture_of, texture_colours
from urbantwin.reconstruct.formats.triangulation import triangulated
from urbantwin.reconstruct.formats.validity import (
    MOST_TRIANGLES,
    check_coordinates,
    content_of,
    count_within,
    valid_faces,
)
from urbantwin.reconstruct.model import ImportedModel, TriangleMesh

__all__ = ["read_fbx"]

_PROGRAM = Path(__file__).with_name("fbx_program.py")
#: Reading takes no longer than this, seconds.
LONGEST_S = 600
_GREY = 128


def read_fbx(path: Path) -> ImportedModel:
    """Read the meshes of an FBX, in the file's world, turned z up and scaled to metres.

    FBX says its axes and its unit. A node is an object, named as it, and one per material; colours
    are the material's diffuse picture or colour.

    Raises:
        InputError: it cannot be read, holds nothing, or ufbx is not installed.
    """
    check_extra("fbx", "reading FBX", modules=("ufbx",), file=path)
    with passing_folder("urbantwin-fbx") as folder:
        command = [sys.executable, "-P", str(_PROGRAM), str(path.resolve()), str(folder)]
        try:
            done = subprocess.run(command, capture_output=True, check=False, timeout=LONGEST_S)
            failed = done.returncode != 0
        except subprocess.TimeoutExpired:
            failed = True
        error = folder / "error.txt"
        if failed or error.exists() or not (folder / "nodes.json").exists():
            why = f" ({error.read_text(encoding='utf-8')})" if error.exists() else ""
            raise InputError(f"cannot be read as FBX{why}", file=path, expected="a whole FBX")
        said = json.loads((folder / "nodes.json").read_text(encoding="utf-8"))
        with np.load(folder / "nodes.npz") as arrays:
            return _model(path, folder, said, {key: arrays[key] for key in arrays.files})


def _model(
    path: Path, folder: Path, said: dict[str, Any], arrays: dict[str, NDArray[Any]]
) -> ImportedModel:
    problems: list[str] = []
    pictures = _pictures(path, folder, said["materials"], problems)
    count_within(
        sum(int((v[:, 1] - 2).clip(0).sum()) for k, v in arrays.items() if k.endswith("/faces")),
        MOST_TRIANGLES,
        "triangles",
        path,
    )
    meshes, dropped = [], 0
    for number, node in enumerate(said["nodes"]):
        own = {key.split("/")[1]: v for key, v in arrays.items() if key.startswith(f"{number}/")}
        mesh, lost = _node(path, node, own, said["materials"], pictures)
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
        "unit_in_file_m": said["said"]["unit_m"],
    }
    return ImportedModel(
        mesh, up="z", unit_m=1.0, problems=tuple(problems), notes=notes, files=content_of(path)
    )


def _node(
    path: Path,
    node: dict[str, Any],
    own: dict[str, NDArray[Any]],
    materials: dict[str, Any],
    pictures: dict[str, NDArray[np.uint8]],
) -> tuple[TriangleMesh | None, int]:
    matrix = own["matrix"]
    vertices = own["vertices"] @ matrix[:, :3].T + matrix[:, 3]
    check_coordinates(vertices, path, f"{node['name']}: vertex")
    large = own["faces"][:, 1] >= 3
    begin, size = own["faces"][large].T
    where = np.repeat(begin - (np.cumsum(size) - size), size) + np.arange(int(size.sum()))
    corner = own["corners"][where]
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
    names = node["materials"] or [""]
    which = np.zeros(len(faces), np.int64)
    if "material" in own:
        which = np.clip(own["material"][large][face], 0, len(names) - 1)
    colour = _colours(which, names, materials, pictures, own, index)
    used, number = np.unique(which, return_inverse=True)
    labels = tuple(
        " / ".join(dict.fromkeys(part for part in (node["name"], names[k]) if part)) for k in used
    )
    mesh = TriangleMesh(vertices, faces, colour, number.ravel().astype(np.int32), labels)
    return mesh, int((~kept).sum())


def _colours(
    which: NDArray[np.int64],
    names: list[str],
    materials: dict[str, Any],
    pictures: dict[str, NDArray[np.uint8]],
    own: dict[str, NDArray[Any]],
    index: NDArray[np.int64],
) -> NDArray[np.uint8] | None:
    """Return colours (F, 3): picture, else colours of corners, else of the material."""
    known = [materials.get(name, {}) for name in names]
    table = np.array([_srgb(one.get("colour")) for one in known])
    colour = table[which]
    some = any(one.get("colour") for one in known)
    if "colour" in own:
        colour = _bytes(own["colour"][own["colour_corners"][index]][..., :3].mean(axis=1))
        some = True
    if "uv" in own:
        for number, name in enumerate(names):
            mine = which == number
            if name in pictures and mine.any():
                uv = own["uv"][own["uv_corners"][index[mine]]]
                colour[mine] = texture_colours(uv, pictures[name])
                some = True
    return colour if some else None


def _pictures(
    path: Path, folder: Path, materials: dict[str, Any], problems: list[str]
) -> dict[str, NDArray[np.uint8]]:
    found = {}
    for name, one in materials.items():
        if "picture" not in one:
            continue
        file = (
            folder / one["embedded"] if "embedded" in one else beside(path.parent, one["picture"])
        )
        picture = None if file is None else picture_of(file)
        if picture is None:
            label = Path(str(one["picture"]).replace("\\", "/")).name
            problems.append(f"{path.name}: its picture {label} is not beside it or cannot be read")
            continue
        found[name] = picture
    return found


def _srgb(linear: list[float] | None) -> NDArray[np.uint8]:
    if linear is None:
        return np.full(3, _GREY, np.uint8)
    return _bytes(np.array(linear))


def _bytes(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Linear light to sRGB bytes (IEC 61966-2-1)."""
    value = np.clip(np.nan_to_num(linear), 0.0, 1.0)
    curved = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.round(curved * 255).astype(np.uint8)
