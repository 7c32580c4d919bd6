"""Names of meshes by which CARLA tags them, and safe names of maps.

``make import`` names every mesh of a map ``<map>_<object>`` and sorts by substrings of that name
(carla 0.9.16, ``MoveAssetsCommandlet.cpp`` and ``SSTags.h``; the names are RoadRunner's). Unreal
compares case-insensitively. A mesh with ``light`` or ``sign`` in its name is imported but not
placed in the world (``PrepareAssetsForCookingCommandlet.cpp``), because CARLA creates its own from
the map's OpenDRIVE. So the map of a street called "Lightfoot Road" would be empty, unless its name
is changed.
"""

from __future__ import annotations

import re
import unicodedata

__all__ = ["OBJECTS", "folder_of", "map_name"]

#: CARLA's folder of the semantic tag, by the first part of an object's name (``Tagger.cpp``).
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
#: In the order of checks in ``make import``; anything else becomes Terrain.
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
#: Substrings with a meaning to CARLA anywhere in a name.
_WORDS = re.compile(
    r"light|sign|terrain|tile|roads?(?=_(?:road|marking|sidewalk|curb|gutter))", re.IGNORECASE
)
_LONGEST = 32
_LETTERS = str.maketrans({"ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "Ae", "ł": "l", "Ł": "L"})


def folder_of(asset: str) -> str | None:
    """Return the folder to which ``make import`` moves a mesh; ``None`` if it is not placed."""
    name = asset.lower()
    if any(word in name for word in _NOT_PLACED):
        return None
    return next((folder for key, folder in _SORTED if key in name), "Terrain")


def map_name(name: str, latitude: float, longitude: float) -> str:
    """Return a map's name for CARLA: letters, digits and ``_``, without special substrings.

    Special substrings are split: ``perth_lights`` becomes ``perth_li_ghts``. A name without Latin
    letters is replaced by the position: ``Map_25p0330_121p5654``.
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
