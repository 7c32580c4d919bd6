"""Files beside a model that say where it is, as photogrammetry programs write them.

- Pix4D: ``NAME_offset.xyz`` (x y z to add) and ``NAME_wkt.prj`` (WKT) beside ``NAME_*.obj``.
- Metashape and others: ``NAME.prj`` (WKT) beside the model.
- ContextCapture, DJI Terra, Metashape: ``metadata.xml`` with ``SRS`` and ``SRSOrigin``.
- OpenDroneMap: ``coords.txt`` or ``odm_georeferencing_model_geo.txt``.
- OBJ comments: ``# offset x y z`` and ``# crs EPSG:32632``.
- RealityCapture, RealityScan: ``reality_capture.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.number_text import plain_number
from urbantwin.reconstruct.formats.coordinate_system import crs_of
from urbantwin.reconstruct.model import Geotag

__all__ = ["Placement", "placement_beside"]

#: A sidecar longer than this is none, bytes.
LONGEST = 1 << 20
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_OFFSET = re.compile(
    rf"#\s*(?:global\s+|coordinate\s+)?(?:offset|shift|origin)\s*[:=]?\s*({_NUMBER})[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})",
    re.IGNORECASE,
)
_COMMENTED_CRS = re.compile(r"#.*\b((?:EPSG|epsg)\s*:\s*\d+(?:\s*\+\s*\d+)?)")
_ENU = re.compile(rf"ENU:\s*({_NUMBER})\s*,\s*({_NUMBER})", re.IGNORECASE)
#: Endings that programs add to the project's name.
_ADDED = re.compile(
    r"_(?:simplified_3d_mesh|3d_mesh|mesh|model|densified_point_cloud|group1.*)$", re.IGNORECASE
)


@dataclass(frozen=True)
class Placement:
    """Where a model is, as a file beside it says.

    Attributes:
        offset: (3,) added to its coordinates, in the unit of ``crs``.
        crs: the system that they then are in, or ``None``.
        geotag: where its origin lies, for local coordinates east, north, up; or ``None``.
        files: the files that say so.
    """

    offset: NDArray[np.float64]
    crs: CRS | None = None
    geotag: Geotag | None = None
    files: tuple[Path, ...] = ()


def placement_beside(path: Path) -> Placement | None:
    """Return where a model is by the files beside it, ``None`` where they say nothing.

    Raises:
        InputError: such a file is wrong.
    """
    for rule in (_pix4d, _metadata, _open_drone_map, _projection, _comments):
        found = rule(path)
        if found is not None:
            return found
    return None


def _pix4d(path: Path) -> Placement | None:
    offset = _named(path, ("_offset.xyz", "_offset.txt"), ("offset.xyz", "offset.txt"))
    if offset is None:
        return None
    words = _text(offset).replace(",", " ").split()
    try:
        values = np.array([float(word) for word in words[:3]])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InputError("is not an offset", file=offset, expected="three numbers: x y z")
    projection = _named(path, ("_wkt.prj", ".prj"), ())
    crs = None if projection is None else _projected(projection)
    files = (offset,) if projection is None else (offset, projection)
    return Placement(values, crs, files=files)


def _projection(path: Path) -> Placement | None:
    projection = _named(path, ("_wkt.prj", ".prj"), ())
    if projection is None:
        return None
    return Placement(np.zeros(3), _projected(projection), files=(projection,))


def _projected(path: Path) -> CRS:
    crs = crs_of(_text(path))
    if crs is None:
        raise InputError("is not a CRS", file=path, expected="WKT or a code")
    return crs


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
    words = re.split(r"[\s,]+", (root.findtext("SRSOrigin") or "0,0,0").strip())
    try:
        origin = np.array([plain_number(word) for word in words])
    except ValueError:
        origin = np.zeros(0)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise InputError("is not a place", file=file, place="SRSOrigin", expected="x,y,z")
    local = _ENU.match(system)
    if local:
        tag = Geotag(float(local[1]), float(local[2]), 0.0)
        return Placement(origin, geotag=tag, files=(file,))
    crs = crs_of(system)
    if crs is None:
        if system and not system.lower().startswith("local"):
            raise InputError(f"is {system[:40]!r}", file=file, place="SRS", expected="a known CRS")
        return None
    return Placement(origin, crs, files=(file,))


def _open_drone_map(path: Path) -> Placement | None:
    folders = [path.parent, path.parent.parent / "odm_georeferencing"]
    for name in ("coords.txt", "odm_georeferencing_model_geo.txt"):
        for folder in folders:
            file = folder / name
            if not file.is_file():
                continue
            lines = _text(file).splitlines()
            crs = crs_of(lines[0]) if lines else None
            try:
                east, north = (plain_number(word) for word in lines[1].split()[:2])
            except (IndexError, ValueError):
                crs = None
            if crs is None or not math.isfinite(east + north):
                raise InputError(
                    "is not an origin", file=file, expected="WGS84 UTM 32N, then east and north"
                )
            return Placement(np.array([east, north, 0.0]), crs, files=(file,))
    return None


def _comments(path: Path) -> Placement | None:
    """Return what the first comments of an OBJ say."""
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
    return Placement(values, crs, files=())


def _named(path: Path, added: tuple[str, ...], alone: tuple[str, ...]) -> Path | None:
    """Return the file in the model's folder that is named after it, or alone is named so."""
    stem = path.name[: -len(path.suffix)] if path.suffix else path.name
    stems = {stem.lower(), path.name.lower(), _ADDED.sub("", stem).lower()}
    there = {file.name.lower(): file for file in _files(path.parent)}
    for name in (*(s + ending for ending in added for s in sorted(stems)), *alone):
        if name in there and there[name] != path:
            return there[name]
    return None


def _files(folder: Path) -> Iterator[Path]:
    yield from sorted(file for file in folder.iterdir() if file.is_file())


def _text(path: Path) -> str:
    if path.stat().st_size > LONGEST:
        raise InputError("is too long", file=path, expected="a few lines beside the model")
    return path.read_bytes().decode("utf-8-sig", "replace").strip()
