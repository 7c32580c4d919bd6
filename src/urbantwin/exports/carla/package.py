"""The CARLA package: map mesh, OpenDRIVE, spawn points, traffic, rig and how to import it."""

from __future__ import annotations

import shutil
import textwrap
from pathlib import Path

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.drawing.markings import markings
from urbantwin.exports.carla import live
from urbantwin.exports.carla.check import NOT_PROVEN
from urbantwin.exports.carla.meshes import named_objects, navigation_objects
from urbantwin.exports.carla.names import OBJECTS, folder_of, map_name
from urbantwin.exports.carla.rig import carla_rig
from urbantwin.exports.carla.spawn_points import spawn_points
from urbantwin.exports.carla.traffic import carla_traffic
from urbantwin.exports.mesh import Look, write_fbx, write_obj
from urbantwin.lidar.placement import place_rig
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.twin import Twin

__all__ = ["write_carla"]


def write_carla(twin: Twin, folder: Path) -> None:
    """Write what CARLA 0.9.16 imports as a map, and what drives traffic and sensors in it.

    ::

        README.txt                    how to import it
        carla.json                    what was written, from which twin
        traffic.json                  the mix of traffic
        spawn_points.json             places for vehicles
        rig.json                      the sensors as CARLA's blueprints
        navigation/<map>.obj          where people walk, for RecastBuilder
        UrbanTwin_<map>/              to be copied to carla/Import/
            UrbanTwin_<map>.json      the package, as make import reads it
            <map>/<map>.fbx           the mesh
            <map>/<map>.xodr          OpenDRIVE 1.4

    ``make import`` takes **every** ``.json`` under ``carla/Import`` for a package
    (``Util/BuildTools/Import.py``), so the package's folder holds one and no other.

    Raises:
        InputError: the folder holds something else, or Assimp is not installed.
        StageError: Assimp failed.
    """
    title = str(twin.manifest["name"])
    name = map_name(title, twin.frame.latitude, twin.frame.longitude)
    package = f"UrbanTwin_{name}"
    paint = markings(twin.roads, twin.ground_mesh, twin.lane_model)
    objects, looks = named_objects(twin.mesh, paint)
    with replaced_folder(folder, kind="carla", inputs=[twin.folder]) as scratch:
        here = scratch / package / name
        here.mkdir(parents=True)
        write_fbx(objects, here / f"{name}.fbx", looks)
        walked = navigation_objects(objects)
        areas = {area: Look((0.5, 0.5, 0.5)) for one in walked for area in one.materials}
        (scratch / "navigation").mkdir()
        write_obj(walked, scratch / "navigation" / f"{name}.obj", areas)
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
        shutil.copyfile(live.__file__, scratch / "run_in_carla.py")
        (scratch / "README.txt").write_text(readme(title, package, name), encoding="utf-8")
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
                "mesh": "fbx",
                "objects": {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)},
                "spawn_points": len(points),
                "frame": "x east, y south, z up of the anchor, metres (FBX: centimetres, y north)",
                "inputs": twin.manifest["inputs"],
            },
        )


def readme(title: str, package: str, name: str) -> str:
    """Return how to import a package, in some thirty lines.

    Args:
        title: the twin's name.
        package: name of the package.
        name: of the map.
    """
    by_hand = ", ".join(
        kind
        for kind, folder in OBJECTS.items()
        if folder_of(f"{name}_{kind}_0") not in (folder, None)
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
        f"2. Copy navigation/{name}.obj to carla/Util/DockerUtils/dist/. From it, and the",
        "   crosswalks of the .xodr, make import builds where people walk; without it they have",
        "   nowhere to, because CARLA's FBX2OBJ needs an SDK that is not to be had any more.",
        "3. In carla/: make import. Then make launch; the map is in Content/<package>/Maps.",
        f'4. For a packaged CARLA: make package ARGS="--packages={package}";',
        "   put the archive into its Import folder and run ImportAssets.sh there.",
        "5. In Python: client.load_world(<map>). Without the mesh:",
        "   client.generate_opendrive_world(open('<map>.xodr').read())",
        "",
        "Semantic tags: make import moves Road_Road, Road_Marking, Road_Sidewalk, Road_Curb and",
        "Terrain meshes to the folders of their tags and all others to Terrain. In the editor's",
        "Content Browser move these on from Static/Terrain/<map> to Static/<name>/<map>:",
        f"{by_hand}.",
        "TrafficLight and TrafficSign meshes are not placed: CARLA sets up its own by the .xodr.",
        "CARLA knows no signal programs: at a junction, the stages have green one after another.",
        "",
        "Frame: x east, y south, z up, metres from the anchor, as in carla.Map. The FBX has",
        "centimetres and y north; Unreal mirrors y as it imports.",
        "run_in_carla.py spawns traffic.json, spawn_points.json and rig.json on a server, and",
        "records frames: python run_in_carla.py FRAMES.",
        "",
        "Checked: `urbantwin dataset verify` puts every file here before the rules of CARLA's own",
        "code, and names the file of CARLA that has the rule; with CARLA's Python package, also",
        "lanes, signals and spawn points.",
        *textwrap.wrap(f"Not proven: {NOT_PROVEN}.", 88),
    ]
    return "\n".join(lines) + "\n"
