"""The CARLA package: map mesh, OpenDRIVE, spawn points, traffic, rig and how to import it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.exports.carla.meshes import named_objects
from urbantwin.exports.carla.names import OBJECTS, folder_of, map_name
from urbantwin.exports.carla.rig import carla_rig
from urbantwin.exports.carla.spawn_points import spawn_points
from urbantwin.exports.carla.traffic import carla_traffic
from urbantwin.exports.mesh import (
    HOW_TO_GET_FBX,
    Look,
    MeshObject,
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
    ("roof-tile", (0.36, 0.13, 0.08)),
    ("slate", (0.13, 0.14, 0.16)),
    ("stone", (0.38, 0.36, 0.33)),
    ("concrete", (0.45, 0.45, 0.43)),
    ("glass", (0.15, 0.20, 0.24)),
    ("metal", (0.28, 0.29, 0.31)),
    ("plaster", (0.62, 0.58, 0.50)),
)
_GREY = (0.5, 0.5, 0.5)


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


def colour_of(material: str) -> tuple[float, float, float]:
    """Return a material's colour, linear RGB from 0 to 1."""
    return next((colour for key, colour in _COLOURS if key in material), _GREY)


def looks_of(objects: Sequence[MeshObject]) -> dict[str, Look]:
    """Return how every material of the objects looks."""
    return {name: Look(colour_of(name)) for one in objects for name in one.materials}


def readme(title: str, package: str, name: str, *, fbx: bool) -> str:
    """Return how to import a package, in some twenty lines.

    Args:
        title: the twin's name.
        package: name of the package.
        name: of the map.
        fbx: whether the mesh is there as FBX.
    """
    by_hand = ", ".join(
        kind
        for kind, folder in OBJECTS.items()
        if folder_of(f"{name}_{kind}_0") not in (folder, None)
    )
    missing = (
        f"   There is no {name}.fbx yet: {HOW_TO_GET_FBX};",
        "   or make it from the .glb with a tool of yours (centimetres, y north, z up).",
    )
    lines = [
        f"{title}: a map for CARLA 0.9.16, made by UrbanTwin",
        "",
        f"Package: {package}",
        f"Map: {name}",
        "",
        "You need CARLA built from source (with CARLA's Unreal Engine 4.26).",
        "1. Copy the package's folder, and nothing else of this one, to carla/Import/: there,",
        "   make import takes every .json for a package.",
        *(() if fbx else missing),
        "2. In carla/: make import. Then make launch; the map is in Content/<package>/Maps.",
        f'3. For a packaged CARLA: make package ARGS="--packages={package}";',
        "   put the archive into its Import folder and run ImportAssets.sh there.",
        "4. In Python: client.load_world(<map>). Without the mesh:",
        "   client.generate_opendrive_world(open('<map>.xodr').read())",
        "",
        "Semantic tags: make import moves Road_Road, Road_Marking, Road_Sidewalk, Road_Curb and",
        "Terrain meshes to the folders of their tags and all others to Terrain. In the editor's",
        "Content Browser move these on from Static/Terrain/<map> to Static/<name>/<map>:",
        f"{by_hand}.",
        "TrafficLight and TrafficSign meshes are not placed: CARLA sets up its own by the .xodr.",
        "",
        "Frame: x east, y south, z up, metres from the anchor, as in carla.Map. The FBX has",
        "centimetres and y north; Unreal mirrors y as it imports.",
        "traffic.json, spawn_points.json and rig.json are what urbantwin carla sets up.",
    ]
    return "\n".join(lines) + "\n"
