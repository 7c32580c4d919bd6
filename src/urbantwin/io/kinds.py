"""The format of a file, and the files of an exported folder with its model."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.io.cities.citygml import within_archive
from urbantwin.io.colmap import sparse_folder
from urbantwin.strict_json import parse_json

__all__ = ["holds_model", "kind_of", "model_files"]

#: Readable suffixes, in order of preference.
MODELS = (
    ".glb",
    ".gltf",
    ".obj",
    ".fbx",
    ".ply",
    ".stl",
    ".json",
    ".jsonl",
    ".gml",
    ".citygml",
    ".laz",
    ".las",
    ".e57",
    ".pts",
    ".xyz",
)
#: Closed formats, and the export to use instead.
CLOSED = {
    ".rcp": "ReCap's project; export it as PTS from ReCap Pro, or its mesh as OBJ or FBX",
    ".rcs": "ReCap's scan; export it as PTS from ReCap Pro",
    ".rcm": "ReCap's mesh; export it as OBJ or FBX from ReCap Photo",
    ".rcproj": "RealityCapture's project; export the model as OBJ, FBX, GLB, PLY or LAS",
    ".rsproj": "RealityScan's project; export the model as OBJ, FBX, GLB, PLY or LAS",
    ".psx": "Metashape's project; export the model as OBJ, FBX, GLB, PLY or LAS",
    ".zip": "an archive; unpack it first",
    ".7z": "an archive; unpack it first",
    ".skp": "SketchUp's; export it as OBJ or glTF",
    ".blend": "Blender's; export it as glTF",
    ".3ds": "3ds; export it as OBJ, FBX or glTF",
    ".dae": "COLLADA; export it as OBJ, FBX or glTF",
    ".ifc": "IFC; export it as OBJ or glTF",
    ".osgb": "OSGB; export it as OBJ or 3D Tiles",
}
#: COLMAP's dense results, meshes first.
_COLMAP = (
    "meshed-poisson.ply",
    "meshed-delaunay.ply",
    "fused.ply",
)
_DEEPEST, _MOST_FILES = 4, 20_000
#: Levels of detail of a tile: ``Tile_+000_+001_L17_0.obj``.
_LEVEL = re.compile(r"^(.*)_L(\d+)((?:_\w+)?)$")
_NOT_MODELS = ("offset", "coords", "metadata", "cameras", "images", "points3d", "project")


def model_files(folder: Path) -> list[Path]:
    """Return the files of an exported folder with its model: one file, or all of its parts.

    Of several formats the first of ``MODELS`` is used; of levels of detail the finest.

    Raises:
        InputError: there is none.
    """
    files = sorted(_files(folder))
    for name in _COLMAP:
        for below in ("", "dense", "dense/0", "0"):
            if (folder / below / name).is_file():
                return [folder / below / name]
    for ending in MODELS:
        own = [f for f in files if f.suffix.lower() == ending and _may_be_model(f)]
        if ending == ".json":
            own = [f for f in own if f.name.lower().endswith((".city.json", ".cityjson.json"))]
        if own:
            return _finest(own)
    if sparse_folder(folder) is not None:
        return []
    closed = next((f for f in files if f.suffix.lower() in CLOSED), None)
    if closed is not None:
        raise InputError(
            f"holds {closed.name}, {CLOSED[closed.suffix.lower()]}",
            file=folder,
            expected="a model that others can read",
        )
    raise InputError(
        "holds no model", file=folder, expected=f"a file that ends in {', '.join(MODELS)}"
    )


def holds_model(folder: Path) -> bool:
    """Return whether an exported folder contains a readable model."""
    try:
        return bool(model_files(folder)) or sparse_folder(folder) is not None
    except InputError:
        return False


def _may_be_model(file: Path) -> bool:
    stem = file.stem.lower()
    return not any(stem == word or stem.endswith(f"_{word}") for word in _NOT_MODELS)


def _finest(files: list[Path]) -> list[Path]:
    finest: dict[tuple[Path, str], tuple[int, list[Path]]] = {}
    for file in files:
        match = _LEVEL.match(file.stem)
        key = (file.parent, match[1] if match else f"{file.stem}\0")
        level = int(match[2]) if match else 0
        known, group = finest.get(key, (-1, []))
        if level > known:
            finest[key] = (level, [file])
        elif level == known:
            group.append(file)
    return sorted(file for _, group in finest.values() for file in group)


def _files(folder: Path, depth: int = 0, seen: list[int] | None = None) -> Iterator[Path]:
    """Yield files of a folder and below, without following links out of it."""
    count = seen if seen is not None else [0]
    for item in sorted(folder.iterdir()):
        count[0] += 1
        if count[0] > _MOST_FILES:
            raise InputError("holds too many files", file=folder, expected="an export's folder")
        if item.name.startswith(".") or item.is_symlink():
            continue
        if item.is_file():
            yield item
        elif item.is_dir() and depth < _DEEPEST:
            yield from _files(item, depth + 1, count)


#: First bytes -> kind.
_BEGINNINGS = (
    (b"glTF", "gltf"),
    (b"LASF", "las"),
    (b"Kaydara FBX Binary", "fbx"),
    (b"; FBX", "fbx"),
    (b"ply\n", "ply"),
    (b"ply\r", "ply"),
    (b"ASTM-E57", "e57"),
)
_ENDINGS = {
    ".glb": "gltf",
    ".gltf": "gltf",
    ".obj": "obj",
    ".ply": "ply",
    ".stl": "stl",
    ".fbx": "fbx",
    ".las": "las",
    ".laz": "las",
    ".json": "json",
    ".jsonl": "cityjson",
    ".cityjson": "cityjson",
    ".city": "cityjson",
    ".xyz": "points",
    ".pts": "points",
    ".asc": "points",
    ".txt": "points",
    ".csv": "points",
    ".gml": "citygml",
    ".citygml": "citygml",
    ".e57": "e57",
}
#: Suffixes of gzipped CityGML.
_PACKED = (".gml.gz", ".citygml.gz", ".xml.gz")
_TILE = (b"b3dm", b"i3dm", b"pnts", b"cmpt")
_PEEK = 1 << 16


def kind_of(path: Path) -> str:
    """Return the format of a file.

    One of ``gltf``, ``obj``, ``ply``, ``stl``, ``fbx``, ``cityjson``, ``citygml``, ``las``,
    ``e57``, ``points`` and ``tiles``.

    Raises:
        InputError: it is of another format, missing or empty.
    """
    if path.exists() and not path.is_file():
        raise InputError("is not a file", file=path, expected="a model")
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            start = stream.read(_PEEK)
    except FileNotFoundError:
        raise InputError("not found", file=path, expected="a model") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    if not size:
        raise InputError("is empty", file=path, expected="a model")
    ending = path.suffix.lower()
    for beginning, kind in _BEGINNINGS:
        if start.startswith(beginning):
            return kind
    if start[:4] in _TILE or ending == ".3tz":
        return "tiles"
    if _is_packed_citygml(path, start):
        return "citygml"
    if start.startswith(b"PK\x03\x04") or ending in CLOSED:
        known = CLOSED.get(ending, CLOSED[".zip"])
        raise InputError(f"is {known}", file=path, expected="a model that others can read")
    found = _text_kind(path, start, ending)
    if found is not None:
        return found
    raise InputError(
        f"ends in {ending or 'nothing'} and holds nothing known",
        file=path,
        expected=f"a tileset.json or {', '.join(MODELS)}",
    )


def _is_packed_citygml(path: Path, start: bytes) -> bool:
    if start.startswith(b"\x1f\x8b"):
        return path.name.lower().endswith(_PACKED)
    return start.startswith(b"PK\x03\x04") and within_archive(path) is not None


def _text_kind(path: Path, start: bytes, ending: str) -> str | None:
    """Return the format of a text by content, otherwise by its suffix, otherwise ``None``."""
    text = start.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text[:1] == b"{":
        return _json_kind(path, start)
    if text[:1] == b"<" and re.search(rb"<(?:[\w.-]+:)?CityModel\b", text):
        return "citygml"
    return _ENDINGS.get(ending) if ending != ".json" else None


def _json_kind(path: Path, start: bytes) -> str:
    text = start.decode("utf-8-sig", "replace")
    if path.suffix.lower() == ".gltf":
        return "gltf"
    if re.search(r'"type"\s*:\s*"CityJSON"', text) or ".city" in path.name.lower():
        return "cityjson"
    try:
        value = parse_json(path.read_bytes()) if path.stat().st_size < 1 << 28 else {}
    except ValueError as error:
        raise InputError(
            f"is not JSON ({error})", file=path, expected="a tileset, CityJSON or glTF"
        ) from None
    if isinstance(value, dict):
        if value.get("type") == "CityJSON":
            return "cityjson"
        if "root" in value and "asset" in value:
            return "tiles"
        if "asset" in value:
            return "gltf"
    raise InputError("is JSON of another kind", file=path, expected="a tileset, CityJSON or glTF")
