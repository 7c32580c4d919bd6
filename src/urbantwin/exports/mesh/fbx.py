"""FBX export by Assimp, whose library is in the wheel ``cmeel-assimp``."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import passing_folder
from urbantwin.errors import InputError, StageError
from urbantwin.exports.mesh.gltf import write_glb
from urbantwin.exports.mesh.mesh_object import Look, MeshObject
from urbantwin.extras import check_extra, how_to_install

__all__ = ["check_fbx", "write_fbx"]

#: FBX's unit is the centimetre.
_CM_PER_M = 100.0
#: Axes in the file (``FbxAxisSystem``): z up, x right, -y towards the viewer. Assimp writes Maya's,
#: y up, unless the converted scene came from an FBX.
_AXES = {"UpAxis": 2, "FrontAxis": 1, "FrontAxisSign": -1, "OriginalUpAxis": 2}
#: When it was made; Assimp writes the time of day.
_DATE = {"Year": 1970, "Month": 1, "Day": 1, "Hour": 0, "Minute": 0, "Second": 0}
#: ``aiProcess_JoinIdenticalVertices``: coincident corners become one vertex in the file.
_JOIN_IDENTICAL_VERTICES = 0x2


def check_fbx() -> None:
    """Check that Assimp is available, before any work.

    Raises:
        InputError: Assimp is not installed or does not load.
    """
    _assimp()


def write_fbx(objects: Sequence[MeshObject], path: Path, looks: Mapping[str, Look]) -> None:
    """Write binary FBX 7.5: one mesh per object with its name; x east, y north, z up, centimetres.

    Unreal mirrors y on import (``FbxMainImport.cpp``, ``ConvertPos``), which gives CARLA's frame.
    Nodes have no transform; the objects' extras are their properties. Every triangle has its own
    normal, and texture coordinates in metres, projected along the dominant axis. The same objects
    give the same bytes.

    Args:
        objects: objects to write, at least two: Assimp merges a single one with the scene.
        path: the file.
        looks: appearance of the objects' materials, by name.

    Raises:
        InputError: Assimp is not installed.
        StageError: Assimp failed.
    """
    with passing_folder("urbantwin-fbx") as scratch:
        source, made = scratch / "scene.glb", scratch / "scene.fbx"
        write_glb([_by_corner(one) for one in objects], source, looks)
        _convert(source, made)
        content = bytearray(made.read_bytes())
    for name, value in _DATE.items():
        _set(content, _text(name)[4:] + b"I", value)
    for name, value in _AXES.items():
        kind = b"S" + _text("int") + b"S" + _text("Integer") + b"S" + _text("")
        _set(content, b"S" + _text(name) + kind + b"I", value)
    path.write_bytes(content)


def _by_corner(one: MeshObject) -> MeshObject:
    """Return an object with separate corners per triangle, in the axes that become FBX's."""
    corners = one.vertices[one.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    side = np.argmax(np.abs(normal), axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[side]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(
        normal, length, out=np.tile([0.0, 0.0, 1.0], (len(normal), 1)), where=length > 0
    )
    return replace(
        one,
        vertices=_CM_PER_M * _untouched(corners.reshape(-1, 3)),
        faces=np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
        normals=_untouched(np.repeat(normal, 3, axis=0)),
        uv=np.take_along_axis(corners, across[:, None, :], axis=2).reshape(-1, 2),
    )


def _untouched(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) that glTF's ``y_up`` maps to the given ones."""
    return np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])


def _convert(source: Path, made: Path) -> None:
    """Turn a glTF into an FBX by Assimp's C interface (``cimport.h``, ``cexport.h``)."""
    assimp = _assimp()
    scene = assimp.aiImportFile(os.fsencode(source), 0)
    if not scene:
        raise StageError(f"Assimp failed: {assimp.aiGetErrorString().decode(errors='replace')}")
    try:
        if assimp.aiExportScene(scene, b"fbx", os.fsencode(made), _JOIN_IDENTICAL_VERTICES):
            said = assimp.aiGetErrorString().decode(errors="replace")
            raise StageError(f"Assimp failed: {said}")
    finally:
        assimp.aiReleaseImport(scene)


@cache
def _assimp() -> ctypes.CDLL:
    """Load the library from its wheel, beside the package ``cmeel``."""
    if sys.platform == "win32":
        raise InputError("FBX is not written on Windows", place="--to", expected="another format")
    check_extra("fbx", "writing FBX", modules=("cmeel",))
    found = importlib.util.find_spec("cmeel")
    assert found is not None
    assert found.origin is not None
    prefix = Path(found.origin).parent.parent / "cmeel.prefix"
    try:
        for compression in sorted(prefix.glob("lib*/libz.so.1")):  # not on the search path
            ctypes.CDLL(str(compression), ctypes.RTLD_GLOBAL)
        ending = "dylib" if sys.platform == "darwin" else "so"
        library = ctypes.CDLL(str(prefix / "lib" / f"libassimp.{ending}"))
    except OSError as error:
        raise InputError(
            f"Assimp does not load ({error})", expected=how_to_install("fbx")
        ) from None
    library.aiImportFile.argtypes = [ctypes.c_char_p, ctypes.c_uint]
    library.aiImportFile.restype = ctypes.c_void_p
    library.aiExportScene.argtypes = [
        ctypes.c_void_p,
        ctypes.c_char_p,
        ctypes.c_char_p,
        ctypes.c_uint,
    ]
    library.aiReleaseImport.argtypes = [ctypes.c_void_p]
    library.aiGetErrorString.restype = ctypes.c_char_p
    return library


def _text(text: str) -> bytes:
    """Return a text in FBX's format: length, then bytes."""
    return struct.pack("<I", len(text)) + text.encode()


def _set(content: bytearray, before: bytes, value: int) -> None:
    """Replace the first number after some bytes."""
    at = content.find(before)
    if at < 0:
        raise StageError(f"Assimp wrote an FBX without {before!r}")
    content[at + len(before) : at + len(before) + 4] = struct.pack("<i", value)
