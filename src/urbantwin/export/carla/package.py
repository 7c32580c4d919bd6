"""The package: map mesh, OpenDRIVE, what to set down where, and how to import it."""

from __future__ import annotations

from pathlib import Path

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.export.carla.looks import looks_of
from urbantwin.export.carla.meshes import named_objects
from urbantwin.export.carla.names import map_name
from urbantwin.export.carla.readme import readme
from urbantwin.export.carla.rig import carla_rig
from urbantwin.export.carla.spawn_points import spawn_points
from urbantwin.export.carla.traffic import carla_traffic
from urbantwin.export.mesh import (
    HOW_TO_GET_FBX,
    blender_python,
    write_fbx,
    write_glb,
    write_obj,
)
from urbantwin.lidar.placement import place_rig
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.twin import Twin
from urbantwin.view.markings import markings

__all__ = ["write_carla"]


def write_carla(twin: Twin, folder: Path) -> list[str]:
    """Write what CARLA 0.9.16 imports as a map, and what drives traffic and sensors in it.

    ::

        README.txt                    how to import it
        carla.json                    what was written, from which twin
        traffic.json                  the mix of traffic
        spawn_points.json             places for vehicles
        rig.json                      the sensors as CARLA's blueprints
        UrbanTwin_<map>/              to be copied to carla/Import/
            UrbanTwin_<map>.json      the package, as make import reads it
            <map>/<map>.fbx           the mesh (.glb and .obj where there is no Blender)
            <map>/<map>.xodr          OpenDRIVE 1.4

    ``make import`` takes **every** ``.json`` under ``carla/Import`` for a package
    (``Util/BuildTools/Import.py``), so the package's folder holds one and no other.

    Returns:
        What a person should be told: a line where there is no FBX.

    Raises:
        InputError: the folder holds something else.
        StageError: Blender failed.
    """
    title = str(twin.manifest["name"])
    name = map_name(title, twin.frame.latitude, twin.frame.longitude)
    package = f"UrbanTwin_{name}"
    objects = named_objects(twin.mesh, markings(twin.roads, twin.ground_mesh, twin.lane_model))
    looks = looks_of(objects)
    interpreter = blender_python()
    notes = []
    with replaced_folder(folder, kind="carla", inputs=[twin.folder]) as scratch:
        here = scratch / package / name
        here.mkdir(parents=True)
        if interpreter:
            write_fbx(objects, here / f"{name}.fbx", looks, interpreter)
        else:
            write_glb(objects, here / f"{name}.glb", looks)
            write_obj(objects, here / f"{name}.obj", looks)
            notes.append(f"no FBX, glTF and OBJ instead: {HOW_TO_GET_FBX}")
        write_opendrive(
            twin.lane_model, twin.frame, here / f"{name}.xodr", version="1.4", name=name
        )
        entry = {
            "name": name,
            "source": f"./{name}/{name}.fbx",
            "use_carla_materials": True,
            "xodr": f"./{name}/{name}.xodr",
        }
        write_json(scratch / package / f"{package}.json", {"maps": [entry], "props": []})
        points = spawn_points(twin.roads)
        write_json(scratch / "spawn_points.json", {"map": name, "spawn_points": points})
        write_json(scratch / "traffic.json", {**carla_traffic(twin, scratch), "map": name})
        rig = carla_rig(
            place_rig(
                twin.rig_spec(),
                twin.mesh,
                file=twin.rig_path,
                anchor_height_m=twin.anchor_height_m,
            )
        )
        write_json(scratch / "rig.json", {"map": name, **rig})
        (scratch / "README.txt").write_text(readme(title, package, name, fbx=bool(interpreter)))
        kinds = [one.name.rsplit("_", 1)[0] for one in objects]
        write_json(
            scratch / "carla.json",
            {
                "kind": "carla",
                "carla": "0.9.16",
                "twin": title,
                "twin_sha256": twin.sha256,
                "package": package,
                "map": name,
                "mesh": "fbx" if interpreter else "glb, obj",
                "objects": {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)},
                "spawn_points": len(points),
                "frame": "x east, y south, z up of the anchor, metres (FBX: centimetres, y north)",
                "inputs": twin.manifest["inputs"],
            },
        )
    return notes
