"""Folders that photogrammetry programs export: which of their files is the model."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.reconstruct.formats.colmap import sparse_folder

__all__ = ["CLOSED", "MODELS", "holds_model", "model_files"]

#: Endings that are read, the most telling first.
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
#: Formats that only their own programs read, and what to export instead.
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
    """Return the files of an exported folder that hold its model: one, or all of its parts.

    Of several formats the one that says most is taken; of levels of detail the finest.

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
    """Return whether an exported folder holds a model that is read."""
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
