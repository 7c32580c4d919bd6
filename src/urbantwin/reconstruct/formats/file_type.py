"""What a file is, by its first bytes and then by its name's ending."""

from __future__ import annotations

import re
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.reconstruct.formats.citygml.file import within_archive
from urbantwin.reconstruct.formats.photogrammetry import CLOSED, MODELS
from urbantwin.strict_json import parse_json

__all__ = ["kind_of"]

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
#: Endings of files of CityGML that gzip packed.
_PACKED = (".gml.gz", ".citygml.gz", ".xml.gz")
_TILE = (b"b3dm", b"i3dm", b"pnts", b"cmpt")
_PEEK = 1 << 16


def kind_of(path: Path) -> str:
    """Return what a file is.

    One of ``gltf``, ``obj``, ``ply``, ``stl``, ``fbx``, ``cityjson``, ``citygml``, ``las``,
    ``e57``, ``points`` and ``tiles``.

    Raises:
        InputError: it is of another type, missing or empty.
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
    """Return what a text is, else what its ending says, else ``None``."""
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
