"""Writes FBX with Blender: run as a program by a Python that has ``bpy``, never imported.

It imports nothing of UrbanTwin. Its argument is a folder with ``job.json`` and ``objects.npz``.
"""

from __future__ import annotations

import datetime
import json
import sys
import types
from pathlib import Path
from typing import Any

import bpy
import numpy as np

#: FBX's unit is the centimetre.
CM_PER_M = 100.0


def write(folder: Path) -> None:
    """Build every object and export them all."""
    job: dict[str, Any] = json.loads((folder / "job.json").read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    # One Blender unit is a centimetre, so that neither coordinates nor nodes are scaled.
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 1.0 / CM_PER_M
    materials = {name: material(name, colour) for name, colour in job["colours"].items()}
    with np.load(folder / "objects.npz") as arrays:
        for number, entry in enumerate(job["objects"]):
            rows = (arrays[f"{number}/{name}"] for name in ("vertices", "faces", "material"))
            mesh = build(entry["name"], *rows)
            for name in entry["materials"]:
                mesh.materials.append(materials[name])
            scene.collection.objects.link(bpy.data.objects.new(entry["name"], mesh))
    fixed_date()
    bpy.ops.export_scene.fbx(
        filepath=job["out"],
        axis_forward="Y",
        axis_up="Z",
        apply_unit_scale=True,
        apply_scale_options="FBX_SCALE_NONE",
        object_types={"MESH"},
        mesh_smooth_type="FACE",
        bake_anim=False,
        add_leaf_bones=False,
    )


def material(name: str, colour: list[float]) -> Any:  # noqa: ANN401 - Blender has no types
    """Make a plain material."""
    made = bpy.data.materials.new(name)
    made.diffuse_color = (*colour, 1.0)
    made.use_nodes = True
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*colour, 1.0)
    return made


def build(
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    which: np.ndarray,
) -> Any:  # noqa: ANN401 - Blender has no types
    """Make a mesh of triangles with texture coordinates in metres, from the nearest side."""
    mesh = bpy.data.meshes.new(name)
    count = len(faces)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", (vertices * CM_PER_M).astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    mesh.polygons.foreach_set("material_index", which.astype(np.int32))
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    side = np.argmax(np.abs(normal), axis=1)
    across = np.array([[1, 2], [0, 2], [0, 1]])[side]
    uv = np.take_along_axis(corners, across[:, None, :], axis=2)
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    return mesh


def fixed_date() -> None:
    """Make the exporter stamp one and the same date on every file."""
    from io_scene_fbx import export_fbx_bin

    class Date(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> Date:
            return cls(1970, 1, 1, tzinfo=tz)

    export_fbx_bin.datetime = types.SimpleNamespace(datetime=Date)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
