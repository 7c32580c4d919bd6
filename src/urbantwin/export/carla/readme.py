"""What a person needs to know to import the package."""

from __future__ import annotations

from urbantwin.export.carla.names import OBJECTS, folder_of
from urbantwin.export.mesh import HOW_TO_GET_FBX

__all__ = ["readme"]


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
