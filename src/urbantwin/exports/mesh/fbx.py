"""FBX, written by Blender in a process of its own.

Blender's Python module ``bpy`` is an optional extra under the GPL; UrbanTwin never imports it but
runs ``blender_fbx.py`` as a program beside itself.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from urbantwin.artefact import passing_folder
from urbantwin.errors import StageError
from urbantwin.exports.mesh.mesh_object import Look, MeshObject

__all__ = ["HOW_TO_GET_FBX", "blender_python", "write_fbx"]

#: Names the Python interpreter that has ``bpy``, where it is not this one.
VARIABLE = "URBANTWIN_BLENDER_PYTHON"
HOW_TO_GET_FBX = "pip install 'urbantwin[fbx]' (Blender, Python 3.11), then export again"
_PROGRAM = Path(__file__).with_name("blender_fbx.py")


def blender_python() -> str | None:
    """Return the interpreter that has Blender's module ``bpy``, ``None`` where there is none."""
    named = os.environ.get(VARIABLE)
    if named:
        return named
    return sys.executable if importlib.util.find_spec("bpy") else None


def write_fbx(
    objects: Sequence[MeshObject], path: Path, looks: Mapping[str, Look], interpreter: str
) -> None:
    """Write FBX 7.4: one mesh per object, named as it; x east, y north, z up, centimetres.

    Unreal mirrors y as it imports (``FbxMainImport.cpp``, ``ConvertPos``), so the mesh comes out
    in CARLA's frame. The same objects give the same bytes.

    Args:
        objects: what to write.
        path: the file.
        looks: how the objects' materials look, by name.
        interpreter: a Python with ``bpy``.

    Raises:
        StageError: Blender failed.
    """
    with passing_folder("urbantwin-fbx") as scratch:
        arrays: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]] = {}
        for number, one in enumerate(objects):
            arrays[f"{number}/vertices"] = one.vertices
            arrays[f"{number}/faces"] = one.faces
            arrays[f"{number}/material"] = one.material
        np.savez(scratch / "objects.npz", allow_pickle=False, **arrays)
        used = sorted({name for one in objects for name in one.materials})
        job = {
            "objects": [{"name": one.name, "materials": one.materials} for one in objects],
            "colours": {name: looks[name].colour for name in used},
            "out": str(path.resolve()),
        }
        (scratch / "job.json").write_text(json.dumps(job))
        command = [interpreter, "-P", str(_PROGRAM), str(scratch)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                check=False,
                # Blender numbers an FBX's objects by the hashes of their names.
                env={**os.environ, "PYTHONHASHSEED": "0"},
            )
        except OSError as error:
            raise StageError(f"Blender's Python {interpreter} does not run ({error})") from None
    if done.returncode or not path.is_file():
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        raise StageError(f"Blender failed: {lines[-1].strip() if lines else done.returncode}")
