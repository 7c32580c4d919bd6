"""CityGML 1.0 to 3.0 (OGC 08-007r1, 12-019, 20-010), also compressed, as labelled triangles."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, cast

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.io.cities.citygml_objects import (
    CityObject,
    GeometryReader,
    Polygon,
    Surface,
    city_objects,
    local_name,
)
from urbantwin.io.cities.surfaces import CitySurfaces
from urbantwin.io.model import ImportedModel
from urbantwin.io.systems import east_first, named_system, plan_of
from urbantwin.io.trust import MOST_TRIANGLES, content_of, count_within
from urbantwin.strict_xml import child_elements, root_name

__all__ = ["within_archive"]

#: Maximum decompressed size, bytes (1 GB of CityGML takes minutes, one object at a time).
LARGEST = 2_000_000_000
_EXPECTED = "CityGML"
#: Suffixes of CityGML files within an archive.
_ENDINGS = (".gml", ".citygml", ".xml")
#: Elements of the root that hold a city object.
_MEMBERS = ("cityObjectMember", "featureMember")


class _Bounded:
    """A stream with a limited number of readable bytes."""

    def __init__(self, stream: IO[bytes], path: Path) -> None:
        self._stream, self._path, self._read = stream, path, 0

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes.

        Raises:
            InputError: there are too many, or they cannot be decompressed.
        """
        try:
            data = self._stream.read(min(size, 1 << 20) if size >= 0 else 1 << 20)
        except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError) as error:
            problem = f"cannot be unpacked ({error})"
            raise InputError(problem, file=self._path, expected="a whole archive") from None
        self._read += len(data)
        if self._read > LARGEST:
            raise InputError(
                f"holds more than {LARGEST / 1e9:.0f} GB",
                file=self._path,
                expected="CityGML cut to the site",
            )
        return data


def within_archive(path: Path) -> str | None:
    """Return the name of the only CityGML file in a zip archive; ``None`` if there is not one."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [
                member.filename
                for member in archive.infolist()
                if member.filename.lower().endswith(_ENDINGS) and "__MACOSX" not in member.filename
            ]
    except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
        return None
    return names[0] if len(names) == 1 else None


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file, or the CityGML file in a gzip file or a zip archive.

    Raises:
        InputError: it cannot be read, or an archive has no or several CityGML files.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(4)
        if start.startswith(b"\x1f\x8b"):
            with gzip.open(path) as packed:
                yield cast(IO[bytes], _Bounded(cast(IO[bytes], packed), path))
        elif start.startswith(b"PK\x03\x04"):
            name = within_archive(path)
            if name is None:
                raise InputError(
                    "is an archive without one file of CityGML",
                    file=path,
                    expected=f"a zip of one {', '.join(_ENDINGS)}",
                )
            with zipfile.ZipFile(path) as archive, archive.open(name) as packed:
                yield cast(IO[bytes], _Bounded(packed, path))
        else:
            with path.open("rb") as stream:
                yield cast(IO[bytes], _Bounded(stream, path))
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"cannot be read ({error})", file=path) from None
    except (NotImplementedError, RuntimeError) as error:  # unsupported compression or password
        raise InputError(f"cannot be unpacked ({error})", file=path) from None


def members(path: Path) -> Iterator[etree._Element]:
    """Yield the envelope of the model (``boundedBy``) and each complete city object.

    Only one object is in memory at a time. Document types are rejected, entities are never
    expanded, and nothing is fetched.

    Raises:
        InputError: it is not CityGML, or damaged.
    """
    with opened(path) as stream:
        root = root_name(stream, path, _EXPECTED)
    if root != "CityModel":
        raise InputError(
            f"is not CityGML: its root is <{root[:40]}>", file=path, expected="<CityModel>"
        )
    with opened(path) as stream:
        for item in child_elements(stream, (*_MEMBERS, "boundedBy"), path):
            if local_name(item) == "boundedBy":
                yield item
            else:
                yield from item


#: Length of a degree, for triangulating surfaces, metres.
DEGREE_M = 111_000.0
_NAMESPACE = "http://www.opengis.net/citygml/"


def read_citygml(path: Path) -> ImportedModel:
    """Read the finest geometry of every city object, of levels of detail 1 to 4.

    Triangles are named ``Building ID / RoofSurface``; surfaces and object types determine their
    semantic classes. Surfaces shared by reference are built once; interiors and virtual surfaces
    that close openings are left out. Coordinates are z up, east before north, in the CRS of
    ``srsName``. Textures and materials (``app:``) are not read.

    Args:
        path: the file, also as ``.gz`` or alone in a ``.zip``.

    Raises:
        InputError: it is not CityGML, is damaged, or holds no surface.
    """
    reader = GeometryReader()
    objects: list[CityObject] = []
    unknown: dict[str, int] = {}
    version, textures, polygons = "", 0, 0
    for element in members(path):
        version = version or _version(element)
        if local_name(element) == "boundedBy":
            _note_system(element, reader)
            continue
        textures += _counted(element, "ParameterizedTexture", "X3DMaterial")
        found = city_objects(element, reader)
        if found is None:
            name = local_name(element)
            unknown[name] = unknown.get(name, 0) + 1
            continue
        objects.append(found)
        polygons += sum(len(one) for one in found.levels.values())
        count_within(polygons, MOST_TRIANGLES, "surfaces", path)
    gathered = CitySurfaces(objects=len(objects))
    missing = _add(objects, reader, gathered)
    gathered.problems += _problems(unknown, missing, textures)
    name, crs = _system(reader, path)
    if crs is None and name:
        gathered.problems.append(f"names the system {name[:80]!r}, which is unknown: give crs")
    angles = crs is not None and plan_of(crs).is_geographic
    unit_m = (DEGREE_M, DEGREE_M, 1.0) if angles else (1.0, 1.0, 1.0)
    mesh, dropped = gathered.mesh(path, "CityGML", unit_m)
    turned = False
    if crs is not None:
        vertices, turned = east_first(mesh.vertices, crs, name)
        mesh = replace(mesh, vertices=vertices)
    return ImportedModel(
        mesh,
        crs=crs,
        up="z",
        unit_m=None if crs is not None else 1.0,
        problems=tuple(gathered.problems),
        notes={
            "triangles": len(mesh.faces),
            "faces_without_area_dropped": dropped,
            "city_objects": gathered.objects,
            "levels_of_detail": dict(sorted(gathered.lods.items())),
            "virtual_surfaces_left_out": sum(item.virtual for item in objects),
            "version": version,
            "system": name if crs is None else crs.name,
            "north_before_east": turned,
        },
        files=content_of(path),
    )


def _version(element: etree._Element) -> str:
    spaces = [uri for uri in element.nsmap.values() if uri and uri.startswith(_NAMESPACE)]
    return max((uri.rpartition("/")[2] for uri in spaces), default="")


def _note_system(element: etree._Element, reader: GeometryReader) -> None:
    for one in element.iter():
        if name := one.get("srsName"):
            # The CRS of the model's envelope applies to geometry without one.
            reader.systems[name] = reader.systems.get(name, 0) + 1


def _counted(element: etree._Element, *names: str) -> int:
    return sum(local_name(one) in names for one in element.iter())


def _problems(unknown: dict[str, int], missing: int, textures: int) -> list[str]:
    told = [f"{count} x {name} is of no kind that is read" for name, count in unknown.items()
            if name != "Appearance"]  # fmt: skip
    if missing:
        told.append(f"{missing} references lead to surfaces that are not in the file")
    if textures or "Appearance" in unknown:
        told.append("its textures and materials are not read: colours are those of the classes")
    return told


def _add(objects: list[CityObject], reader: GeometryReader, gathered: CitySurfaces) -> int:
    """Add every object's finest surfaces, each once; return the number of dangling references."""
    missing = 0
    for top in objects:
        gathered.problems += top.told()
        used: set[tuple[bytes, ...]] = set()
        for one, level, surfaces in top.whole():
            name = f"{one.kind} {one.id or top.id}".strip()
            gathered.lods[str(level)] = gathered.lods.get(str(level), 0) + 1
            # Labelled surfaces come before solids that refer to the same ones.
            for surface in sorted(surfaces, key=lambda one: not one.semantic):
                polygons = _resolved(surface, reader)
                missing += polygons is None
                for polygon in polygons or ():
                    corners = _corners(polygon, surface.matrix)
                    key = _key(corners)
                    if key not in used and polygon.id not in reader.virtual:
                        used.add(key)
                        gathered.add(corners, name, one.kind, surface.semantic)
    return missing


def _resolved(surface: Surface, reader: GeometryReader) -> list[Polygon] | None:
    if isinstance(surface.polygon, Polygon):
        return [surface.polygon]
    return reader.known.get(surface.polygon)


def _corners(polygon: Polygon, matrix: NDArray[np.float64] | None) -> list[NDArray[np.float64]]:
    rings = polygon.corners()
    if matrix is None:
        return rings
    return [ring @ matrix[:3, :3].T + matrix[:3, 3] for ring in rings]


def _key(corners: list[NDArray[np.float64]]) -> tuple[bytes, ...]:
    """Return a key of a surface, independent of its first corner and of its orientation."""
    return tuple(np.unique(ring, axis=0).tobytes() for ring in corners)


def _system(reader: GeometryReader, path: Path) -> tuple[str, CRS | None]:
    """Return the name of the CRS in the file, and the CRS.

    Raises:
        InputError: the file names several.
    """
    name, crs = next(iter(reader.systems), ""), None
    for other in reader.systems:
        known = named_system(other)
        if known is None or (known.is_vertical and not known.is_compound):
            continue
        if crs is not None and plan_of(known).to_2d() != plan_of(crs).to_2d():
            raise InputError(
                f"names several systems ({name[:60]}, {other[:60]})",
                file=path,
                expected="one system",
            )
        # prefer a CRS with heights over one in plan
        if crs is None or len(known.axis_info) > len(crs.axis_info):
            name, crs = other, known
    return name, crs
