"""The real inputs that tests read, by their names: what else lies beside them is nobody's matter.

All are below the folder that the fixture ``shared_data`` gives.
"""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

__all__ = [
    "AHN3",
    "FOREGROUND",
    "MODELS",
    "SWEEPS",
    "argoverse_log",
    "argoverse_map",
    "osm_extract",
    "ouster_scans",
    "roadside",
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


#: The scans of the OS1-128 and its metadata, in ``lidar/ouster-os1-128``.
_OUSTER = ("OS-1-128_v2.3.0_1024x10.json", "OS-1-128_v2.3.0_1024x10_lb_n3.pcap")
_BEAMS = ("beams_elevation.mat", "range_thrld_matrix.mat")
_REST_OF_LOG = (
    "annotations.feather",
    "calibration/egovehicle_SE3_sensor.feather",
    "calibration/intrinsics.feather",
    "city_SE3_egovehicle.feather",
)


@cache
def _alone(folder: Path, names: tuple[str, ...]) -> Path:
    """Return a folder of the same name in which only these of its files stand, as links."""
    place = Path(tempfile.mkdtemp(prefix="urbantwin-test-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    for name in names:
        link = place / folder.name / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(folder / name)
    return place / folder.name


def argoverse_log(shared_data: Path) -> Path:
    """Return the folder of Argoverse's log of Pittsburgh."""
    log = shared_data / "lidar" / "argoverse2-pittsburgh" / _LOG
    maps = (f"map/{name}" for name in _MAP.values())
    return _alone(log.resolve(), (*SWEEPS, *_REST_OF_LOG, *maps))


def ouster_scans(shared_data: Path) -> Path:
    """Return the folder of the OS1-128's scans."""
    return _alone((shared_data / "lidar" / "ouster-os1-128").resolve(), _OUSTER)


def roadside(shared_data: Path) -> Path:
    """Return the folder of New Brunswick's roadside sensor."""
    folder = shared_data / "lidar" / "newbrunswick-roadside"
    return _alone(folder.resolve(), (*_BEAMS, *FOREGROUND))


def argoverse_map(shared_data: Path, part: str) -> Path:
    """Return a file of the log's map: its ``lanes``, ``heights``, or what leads ``to_cells``."""
    return argoverse_log(shared_data) / "map" / _MAP[part]


def osm_extract(shared_data: Path, name: str) -> Path:
    """Return an extract of OpenStreetMap by the name of its place."""
    return shared_data / "osm" / f"{name}.osm{'.bz2' if name == 'West-Oakland' else ''}"
