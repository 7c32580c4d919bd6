"""Offset and CRS of a model in the files beside it.

- ``NAME_offset.xyz`` (x y z to add), and ``NAME_wkt.prj`` or ``NAME.prj`` (a code or WKT);
- ``metadata.xml`` with ``SRS`` (a code or WKT) and ``SRSOrigin`` (x,y,z to add), up to three
  folders above;
- ``coords.txt`` of OpenDroneMap: a CRS (``WGS84 UTM 32N``), then east and north to add;
- comments of an OBJ: ``# offset x y z`` and ``# crs EPSG:32632``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.io.systems import crs_of
from urbantwin.number_text import plain_number

__all__ = ["Placement", "placement_beside"]

#: Maximum file size, bytes.
LONGEST = 1 << 20
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_OFFSET = re.compile(
    rf"#\s*(?:global\s+|coordinate\s+)?(?:offset|shift|origin)\s*[:=]?\s*({_NUMBER})[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})",
    re.IGNORECASE,
)
_COMMENTED_CRS = re.compile(r"#.*\b((?:EPSG|epsg)\s*:\s*\d+(?:\s*\+\s*\d+)?)")
#: Suffixes that programs add to the project's name.
_ADDED = re.compile(
    r"_(?:simplified_3d_mesh|3d_mesh|mesh|model|densified_point_cloud|group1.*)$", re.IGNORECASE
)


@dataclass(frozen=True)
class Placement:
    """Placement of a model.

    Attributes:
        offset: (3,) to be added to its coordinates, in the unit of ``crs``.
        crs: CRS of the result, or ``None``.
        files: the files that define them.
    """

    offset: NDArray[np.float64]
    crs: CRS | None = None
    files: tuple[Path, ...] = ()


def placement_beside(path: Path) -> Placement | None:
    """Return the placement of a model by files beside it, ``None`` if there is none.

    Raises:
        InputError: such a file is invalid.
    """
    offset = _named(path, ("_offset.xyz", "_offset.txt"), ("offset.xyz", "offset.txt"))
    projection = _named(path, ("_wkt.prj", ".prj"), ())
    if offset is None:
        for rule in (_metadata, _open_drone_map):
            placement = rule(path)
            if placement is not None:
                return placement
    if offset is None and projection is None:
        return _comments(path)
    values = np.zeros(3) if offset is None else _numbers(_text(offset)[:1000], offset, "an offset")
    crs = None
    if projection is not None:
        crs = crs_of(_text(projection))
        if crs is None:
            raise InputError("is not a CRS", file=projection, expected="WKT or a code")
    return Placement(values, crs, tuple(file for file in (offset, projection) if file))


def _numbers(text: str, file: Path, what: str, place: str | None = None) -> NDArray[np.float64]:
    """Return the first three numbers of a text."""
    try:
        values = np.array([plain_number(word) for word in re.split(r"[\s,]+", text.strip())[:3]])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError(f"is not {what}", file=file, place=place, expected="three numbers: x y z")
    return values


def _metadata(path: Path) -> Placement | None:
    for folder in list(path.resolve().parents)[:4]:
        file = folder / "metadata.xml"
        if file.is_file():
            break
    else:
        return None
    try:
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        root = etree.fromstring(_text(file).encode(), parser)
    except (etree.XMLSyntaxError, ValueError):
        raise InputError("is not XML", file=file, expected="SRS and SRSOrigin") from None
    if root.tag != "ModelMetadata":
        return None
    system = (root.findtext("SRS") or "").strip()
    origin = _numbers(root.findtext("SRSOrigin") or "0,0,0", file, "a place", "SRSOrigin")
    crs = crs_of(system)
    if crs is None:
        if system and not system.lower().startswith("local"):
            raise InputError(
                f"is {system[:40]!r}", file=file, place="SRS", expected="a code such as EPSG:25832"
            )
        return None
    return Placement(origin, crs, (file,))


def _open_drone_map(path: Path) -> Placement | None:
    for folder in (path.parent, path.parent.parent / "odm_georeferencing"):
        file = folder / "coords.txt"
        if not file.is_file():
            continue
        lines = [*_text(file).splitlines(), "", ""]
        crs = crs_of(lines[0])
        values = _numbers(f"{' '.join(lines[1].split()[:2])} 0", file, "an origin")
        if crs is None:
            raise InputError(
                "is not an origin", file=file, expected="WGS84 UTM 32N, then east and north"
            )
        return Placement(values, crs, (file,))
    return None


def _comments(path: Path) -> Placement | None:
    """Return the offset and CRS in the first comments of an OBJ."""
    if path.suffix.lower() != ".obj":
        return None
    with path.open("rb") as stream:
        start = stream.read(1 << 14).decode("utf-8", "replace")
    comments = "\n".join(line for line in start.splitlines() if line.startswith("#"))
    offset, named = _OFFSET.search(comments), _COMMENTED_CRS.search(comments)
    crs = crs_of(named[1]) if named else None
    if offset is None and crs is None:
        return None
    values = np.array([float(v) for v in offset.groups()]) if offset else np.zeros(3)
    return Placement(values, crs)


def _named(path: Path, added: tuple[str, ...], alone: tuple[str, ...]) -> Path | None:
    """Return the file in the model's folder with its name and a suffix, or a generic name."""
    stem = path.name[: -len(path.suffix)] if path.suffix else path.name
    stems = {stem.lower(), path.name.lower(), _ADDED.sub("", stem).lower()}
    there = {file.name.lower(): file for file in sorted(path.parent.iterdir()) if file.is_file()}
    for name in (*(s + ending for ending in added for s in sorted(stems)), *alone):
        if name in there and there[name] != path:
            return there[name]
    return None


def _text(path: Path) -> str:
    if path.stat().st_size > LONGEST:
        raise InputError("is too long", file=path, expected="a few lines beside the model")
    return path.read_bytes().decode("utf-8-sig", "replace").strip()
