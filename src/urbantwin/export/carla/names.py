"""Names of meshes by which CARLA tags them, and safe names of maps.

``make import`` calls every mesh of a map ``<map>_<object>`` and sorts by what that name contains
(carla 0.9.16, ``MoveAssetsCommandlet.cpp`` and ``SSTags.h``; the names are RoadRunner's). Unreal
compares without regard to case. A mesh whose name contains ``light`` or ``sign`` is imported but
not placed in the world (``PrepareAssetsForCookingCommandlet.cpp``), because CARLA sets up its own
from the map's OpenDRIVE. So a street called "Lightfoot Road" would come out empty, unless its
map's name is chosen with care.
"""

from __future__ import annotations

import re
import unicodedata

__all__ = ["OBJECTS", "folder_of", "map_name"]

#: First part of an object's name -> CARLA's folder of its semantic tag (``Tagger.cpp``).
OBJECTS = {
    "Road_Road": "Road",
    "Road_Marking": "RoadLine",
    "Road_Sidewalk": "SideWalk",
    "Road_Curb": "SideWalk",
    "Terrain": "Terrain",
    "Building": "Building",
    "Vegetation": "Vegetation",
    "Pole": "Pole",
    "Fence": "Fence",
    "Wall": "Wall",
    "Static": "Static",
    "TrafficLight": "TrafficLight",
    "TrafficSign": "TrafficSign",
}
#: In the order in which ``make import`` looks for them; all else becomes Terrain.
_SORTED = (
    ("road_road", "Road"),
    ("roads_road", "Road"),
    ("road_marking", "RoadLine"),
    ("roads_marking", "RoadLine"),
    ("terrain", "Terrain"),
    ("road_sidewalk", "SideWalk"),
    ("roads_sidewalk", "SideWalk"),
    ("road_curb", "SideWalk"),
    ("roads_curb", "SideWalk"),
    ("road_gutter", "SideWalk"),
    ("roads_gutter", "SideWalk"),
)
_NOT_PLACED = ("light", "sign")
#: Words that mean something to CARLA wherever they stand in a name.
_WORDS = re.compile(
    r"light|sign|terrain|tile|roads?(?=_(?:road|marking|sidewalk|curb|gutter))", re.IGNORECASE
)
_LONGEST = 32
_LETTERS = str.maketrans({"ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "Ae", "ł": "l", "Ł": "L"})


def folder_of(asset: str) -> str | None:
    """Return the folder that ``make import`` moves a mesh to; ``None`` where it is not placed."""
    name = asset.lower()
    if any(word in name for word in _NOT_PLACED):
        return None
    return next((folder for key, folder in _SORTED if key in name), "Terrain")


def map_name(name: str, latitude: float, longitude: float) -> str:
    """Return a map's name for CARLA: letters, digits and ``_``, without words that it looks for.

    A word that CARLA looks for is broken: ``perth_lights`` becomes ``perth_li_ghts``. A name
    without Latin letters gives way to the place: ``Map_25p0330_121p5654``.
    """
    plain = unicodedata.normalize("NFKD", name.translate(_LETTERS))
    plain = plain.encode("ascii", "ignore").decode()
    slug = re.sub(r"[^A-Za-z0-9]+", "_", plain)[:_LONGEST].strip("_")
    slug = _WORDS.sub(lambda found: f"{found[0][:2]}_{found[0][2:]}", slug)
    if re.search(r"roads?$", slug, re.IGNORECASE):  # "Main_Road" + "_Marking" means a marking
        slug += "_Map"
    if not re.match(r"[A-Za-z]", slug):
        slug = f"Map_{_degrees(latitude)}_{_degrees(longitude)}"
    return slug


def _degrees(value: float) -> str:
    return f"{'m' if value < 0 else ''}{abs(value):.4f}".replace(".", "p")
