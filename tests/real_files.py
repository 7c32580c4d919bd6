"""The real inputs that tests read, by their names: what else lies beside them is nobody's matter.

All are below the folder that the fixture ``shared_data`` gives.
"""

from pathlib import Path

__all__ = [
    "AHN3",
    "FOREGROUND",
    "MODELS",
    "SWEEPS",
    "argoverse_log",
    "argoverse_map",
    "osm_extract",
]

_LOG = "7fab2350-7eaf-3b7e-a39d-6937a4c1bede"
_MAP = {
    "lanes": f"log_map_archive_{_LOG}____PIT_city_47896.json",
    "to_cells": f"{_LOG}___img_Sim2_city.json",
    "heights": f"{_LOG}_ground_height_surface____PIT.npy",
}
#: The sweeps of Argoverse's log, in the order of time.
SWEEPS = tuple(
    f"sensors/lidar/{time_ns}.feather" for time_ns in (315966265259836000, 315966265360032000)
)
#: The two tiles of the survey of Delft, in ``airborne/delft-ahn3``.
AHN3 = ("ahn3/ahn3_cropped_1.laz", "ahn3/ahn3_cropped_2.laz")
#: The roadside clouds of New Brunswick, in ``lidar/newbrunswick-roadside``.
FOREGROUND = tuple(
    f"foreground/2021-10-20-15-30-35_frame_{number}.ply" for number in (200, 400, 600, 800, 1000)
)
#: The models in glTF, in ``meshes``.
MODELS = (
    *(
        f"kenney/models/vehicle-{name}.glb"
        for name in ("motorcycle", "truck-green", "truck-purple", "truck-red", "truck-yellow")
    ),
    "openmaterial/examples/example_asset.gltf",
    "openmaterial/examples/human_example/human_example.gltf",
    "openmaterial/examples/vehicle_example/vehicle_example.gltf",
)


def argoverse_log(shared_data: Path) -> Path:
    """Return the folder of Argoverse's log of Pittsburgh."""
    return shared_data / "lidar" / "argoverse2-pittsburgh" / _LOG


def argoverse_map(shared_data: Path, part: str) -> Path:
    """Return a file of the log's map: its ``lanes``, ``heights``, or what leads ``to_cells``."""
    return argoverse_log(shared_data) / "map" / _MAP[part]


def osm_extract(shared_data: Path, name: str) -> Path:
    """Return an extract of OpenStreetMap by the name of its place."""
    return shared_data / "osm" / f"{name}.osm{'.bz2' if name == 'West-Oakland' else ''}"
