"""What ``make import`` and the editor's commandlets ask of a package's files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

import numpy as np

from urbantwin.artefact.document import read_bytes
from urbantwin.exports.carla.check.finding import Problems
from urbantwin.exports.carla.check.read import Package
from urbantwin.exports.carla.names import OBJECTS, folder_of
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["document", "materials", "meshes", "settings"]

#: Names go unquoted through a shell and into Unreal's paths (``Import.py``, invoke_commandlet).
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: Versions that the FBX SDK of Unreal Engine 4.26 reads (2020.1): FBX 2011 to 2020.
_VERSIONS = (7100, 7700)
#: No more than that is addressed by RecastBuilder: 128 x 128 tiles of 51.2 m.
LARGEST_M = 6553.0
#: CARLA's own objects stand there instead (``PrepareAssetsForCookingCommandlet.cpp``).
_OWN = ("TrafficLight", "TrafficSign")


def document(package: Package) -> Problems:
    """The document: ``Import.py`` takes every ``.json`` for a package, and the files it names."""
    found = sorted(
        path for path in package.import_folder.rglob("*.json")
        if path.name != "roadpainter_decals.json"
    )  # fmt: skip
    name = package.import_folder.name
    if [path.name for path in found] != [f"{name}.json"]:
        names = ", ".join(path.name for path in found) or "no .json"
        yield f"{name}/ holds {names}: make import reads every one as a package"
        return
    if not _PLAIN.fullmatch(name):
        yield f"the package's name {name!r} is more than letters, digits and _"
    try:
        content = parse_json(read_bytes(found[0], "the package's document"))
    except NotJsonError as error:
        yield f"{found[0].name} is not JSON: {error}"
        return
    if not isinstance(content, dict) or {"maps", "props"} - content.keys():
        yield f"{found[0].name} is not a mapping with maps and props"
        return
    if content["props"] or not isinstance(content["maps"], list) or len(content["maps"]) != 1:
        yield f"{found[0].name} has props, or other than one map"
        return
    (entry,) = content["maps"]
    yield from _map(package, entry if isinstance(entry, dict) else {})


def _map(package: Package, entry: Mapping[str, object]) -> Problems:
    title = str(entry.get("name"))
    if not _PLAIN.fullmatch(title) or title != package.name:
        yield f"the map's name {title!r} is not {package.name!r}, in letters, digits and _"
    if "tiles" in entry:
        yield f"{title} has tiles: it would get no navigation for pedestrians"
    if entry.get("use_carla_materials") not in (True, False):
        yield f"{title}: use_carla_materials is neither true nor false"
    for key, ending in (("source", ".fbx"), ("xodr", ".xodr")):
        path = package.import_folder / str(entry.get(key, ""))
        if not path.is_file():
            yield f"{title}: {key} names no file"
        elif path.name != f"{title}{ending}":
            yield f"{title}: {key} is not called {title}{ending}, as CARLA calls the map"


def settings(package: Package) -> Problems:
    """The FBX's version, unit and size; ``Import.py`` has Unreal convert unit and axes."""
    mesh = package.mesh
    if not _VERSIONS[0] <= mesh.version <= _VERSIONS[1]:
        yield f"its version is {mesh.version or 'not binary'}"
    if abs(mesh.unit_m - 0.01) > 1e-9:
        yield f"its unit is {mesh.unit_m} m instead of a centimetre"
    if not len(mesh.corners):
        yield "it has no triangle"
        return
    corners = mesh.corners.reshape(-1, 3)
    extent = float(np.ptp(corners, axis=0)[:2].max())
    if extent > LARGEST_M:
        yield f"it is {extent:.0f} m wide, RecastBuilder takes {LARGEST_M:.0f} m"
    far = float(np.abs(corners).max())
    if far > 10_000.0:
        yield f"it reaches {far:.0f} m from the origin, where Unreal counts in centimetres"


def meshes(package: Package) -> Problems:
    """Names of meshes: unique, Unreal's letters, and sorted to the folder of their tag."""
    counted = Counter(name.lower() for name in package.mesh.nodes)
    for name, count in counted.items():
        if count > 1:
            yield f"{count} meshes are called {name}: Unreal keeps one"
    kinds = set()
    for name in package.mesh.nodes:
        kind = name.rsplit("_", 1)[0]
        kinds.add(kind)
        if not re.fullmatch(r"[A-Za-z0-9_]+", name):
            yield f"{name!r} is more than letters, digits and _"
        elif kind not in OBJECTS:
            yield f"{name} is none of {', '.join(OBJECTS)}"
        else:
            folder = folder_of(f"{package.name}_{name}")
            wanted = None if kind in _OWN else folder_of(f"M_{kind}_0")
            if folder != wanted:
                yield f"{name} is sorted to {folder or 'nowhere'} instead of {wanted or 'nowhere'}"
    for kind in ("Road_Road", "Road_Marking", "Terrain"):
        if kind not in kinds:
            yield f"there is no {kind}"


def materials(package: Package) -> Problems:
    """Materials: one called light or sign keeps its mesh out (``ValidateStaticMesh``)."""
    for name, used in zip(package.mesh.nodes, package.mesh.materials, strict=True):
        if name.rsplit("_", 1)[0] in _OWN:
            continue
        for material in used:
            if re.search("light|sign", material, re.IGNORECASE):
                yield f"{name} has the material {material}: it would not be placed"
            elif not re.fullmatch(r"[A-Za-z0-9_]+", material):
                yield f"{name} has the material {material!r}: more than letters, digits and _"
        if name.startswith("Road_Road") and len(used) != 1:
            yield f"{name} has {len(used)} materials, of which CARLA replaces the first"
