"""CityJSON 1.0 to 2.0 (OGC 20-072r5) and CityJSONSeq, as labelled triangles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.io.cities.surfaces import CitySurfaces
from urbantwin.io.model import ImportedModel
from urbantwin.io.systems import crs_of
from urbantwin.io.trust import check_coordinates, content_of
from urbantwin.strict_json import parse_json

__all__ = ["read_cityjson"]

#: Maximum text size that fits into memory as objects, bytes.
LONGEST = 400_000_000


def read_cityjson(path: Path) -> ImportedModel:
    """Read the finest geometry of every city object.

    Triangles are named ``Building ID / RoofSurface``; semantic surfaces and object types determine
    their semantic classes. Coordinates are z up, in the CRS of ``metadata.referenceSystem``.

    Raises:
        InputError: it is not CityJSON, or holds no surface.
    """
    documents = list(_documents(path))
    head = documents[0]
    crs = _system(head, path)
    found = CitySurfaces()
    for document in documents:
        vertices = _vertices(document, head, path)
        _take(document, vertices, _templates(head, path), head, found)
    mesh, dropped = found.mesh(path, "CityJSON")
    notes: dict[str, object] = {
        "triangles": len(mesh.faces),
        "faces_without_area_dropped": dropped,
        "city_objects": found.objects,
        "levels_of_detail": dict(sorted(found.lods.items())),
        "version": str(head.get("version", "")),
    }
    return ImportedModel(
        mesh,
        crs=crs,
        up="z",
        unit_m=None if crs is not None else 1.0,
        problems=tuple(found.problems),
        notes=notes,
        files=content_of(path),
    )


def _documents(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the document, or for CityJSONSeq that of the first line and of every feature."""
    if path.stat().st_size > LONGEST:
        raise InputError(
            "is larger than 400 MB", file=path, expected="CityJSON cut to the site, or CityJSONSeq"
        )
    try:
        text = path.read_bytes().decode("utf-8-sig")
        try:
            documents = [parse_json(text)]
        except ValueError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2 or not lines[0].rstrip().endswith("}"):
                raise
            documents = [parse_json(line) for line in lines]
    except ValueError as error:
        why = "not text" if isinstance(error, UnicodeDecodeError) else str(error)
        raise InputError(f"is not JSON ({why})", file=path, expected="CityJSON") from None
    kinds = [document.get("type") if isinstance(document, dict) else None for document in documents]
    if kinds[0] != "CityJSON" or any(kind != "CityJSONFeature" for kind in kinds[1:]):
        raise InputError("is not CityJSON", file=path, expected='"type": "CityJSON"')
    yield from documents


def _system(head: dict[str, Any], path: Path) -> CRS | None:
    metadata = head.get("metadata")
    if not isinstance(metadata, dict):
        return None
    named = metadata.get("referenceSystem")
    if named is None and isinstance(metadata.get("crs"), dict):  # before 1.0
        named = f"EPSG:{metadata['crs'].get('epsg')}"
    if not named:
        return None
    crs = crs_of(str(named))
    if crs is None:
        raise InputError(
            f"is {named!r}", file=path, place="metadata.referenceSystem", expected="a known CRS"
        )
    return crs


def _vertices(document: dict[str, Any], head: dict[str, Any], path: Path) -> NDArray[np.float64]:
    vertices = _array(document.get("vertices", []), path, "vertices")
    transform = head.get("transform")
    if transform is None:
        return vertices
    try:
        scale = np.array(transform["scale"], np.float64).reshape(3)
        translate = np.array(transform["translate"], np.float64).reshape(3)
    except (KeyError, TypeError, ValueError):
        raise InputError(
            "is not a scale and a translate", file=path, place="transform", expected="3 + 3 numbers"
        ) from None
    return np.asarray(vertices * scale + translate)


def _templates(head: dict[str, Any], path: Path) -> tuple[list[Any], NDArray[np.float64]]:
    given = head.get("geometry-templates")
    if not isinstance(given, dict):
        return [], np.zeros((0, 3))
    place = "geometry-templates.vertices-templates"
    templates = given.get("templates")
    return templates if isinstance(templates, list) else [], _array(
        given.get("vertices-templates", []), path, place
    )


def _array(value: object, path: Path, place: str) -> NDArray[np.float64]:
    try:
        points = np.array(value, np.float64).reshape(-1, 3)
    except (TypeError, ValueError):
        raise InputError(
            "are not triples of numbers", file=path, place=place, expected="[[x, y, z], ...]"
        ) from None
    check_coordinates(points, path)
    return points


def _take(
    document: dict[str, Any],
    vertices: NDArray[np.float64],
    templates: tuple[list[Any], NDArray[np.float64]],
    head: dict[str, Any],
    found: CitySurfaces,
) -> None:
    objects = document.get("CityObjects")
    if not isinstance(objects, dict):
        return
    colours = _material_colours(document if "appearance" in document else head)
    for name, one in objects.items():
        if not isinstance(one, dict):
            continue
        found.objects += 1
        geometries = _finest(one)
        if not geometries or _left_to_parts(one, objects, geometries):
            continue
        for geometry in geometries:
            try:
                surfaces = list(surfaces_of(geometry, vertices, templates))
            except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError):
                found.problems.append(f"{name}: its geometry is wrong and was left out")
                continue
            lod = str(geometry.get("lod", "?"))
            found.lods[lod] = found.lods.get(lod, 0) + 1
            for surface in surfaces:
                kind = str(one.get("type", ""))
                known = surface.material is not None and 0 <= surface.material < len(colours)
                colour = colours[surface.material or 0] if known else None
                found.add(surface.rings, f"{kind} {name}", kind, surface.semantic, colour)


def _finest(one: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the surface geometries of the highest level of detail."""
    given = one.get("geometry")
    known = [
        geometry
        for geometry in (given if isinstance(given, list) else [])
        if isinstance(geometry, dict)
        and geometry.get("type") not in ("MultiPoint", "MultiLineString", None)
    ]
    if not known:
        return []
    finest = max(_level(geometry) for geometry in known)
    return [geometry for geometry in known if _level(geometry) == finest]


def _level(geometry: dict[str, Any]) -> float:
    try:
        return float(geometry.get("lod", -1))
    except (TypeError, ValueError):
        return -1.0


def _left_to_parts(
    one: dict[str, Any], objects: dict[str, Any], geometries: list[dict[str, Any]]
) -> bool:
    """Return whether an object's parts have the same level of detail, to avoid duplicates."""
    children = one.get("children")
    parts = [objects.get(str(k)) for k in children] if isinstance(children, list) else []
    levels = [
        _level(geometry)
        for part in parts
        if isinstance(part, dict) and str(part.get("type", "")).endswith("Part")
        for geometry in _finest(part)
    ]
    return bool(levels) and max(levels) >= _level(geometries[0])


def _material_colours(document: dict[str, Any]) -> list[tuple[int, int, int] | None]:
    appearance = document.get("appearance")
    listed = appearance.get("materials") if isinstance(appearance, dict) else None
    given = listed if isinstance(listed, list) else []
    found: list[tuple[int, int, int] | None] = []
    for item in given:
        try:
            r, g, b = (round(255 * min(max(float(v), 0.0), 1.0)) for v in item["diffuseColor"])
            found.append((r, g, b))
        except (KeyError, TypeError, ValueError):
            found.append(None)
    return found


#: A number, or lists nested as deep as the boundaries.
Nested = int | list[Any] | None
#: Nesting depth of surfaces in ``boundaries`` by geometry type.
_DEPTH = {
    "MultiSurface": 1,
    "CompositeSurface": 1,
    "Solid": 2,
    "MultiSolid": 3,
    "CompositeSolid": 3,
}


@dataclass(frozen=True, eq=False)
class Surface:
    """A flat surface.

    Attributes:
        rings: (N, 3) corners of its exterior, counter-clockwise from the front, and of its holes.
        semantic: type of the semantic surface (``RoofSurface``), or empty.
        material: index of its material, or ``None``.
    """

    rings: list[NDArray[np.float64]]
    semantic: str
    material: int | None


def surfaces_of(
    geometry: dict[str, Any],
    vertices: NDArray[np.float64],
    templates: tuple[list[Any], NDArray[np.float64]],
    *,
    nested: bool = False,
) -> Iterator[Surface]:
    """Yield the surfaces of a geometry, those of a template transformed to their position.

    Raises:
        KeyError, IndexError, TypeError, ValueError: the geometry violates CityJSON.
    """
    kind = geometry["type"]
    if kind == "GeometryInstance":
        if nested:
            raise ValueError("a template of a template")
        matrix = np.array(geometry["transformationMatrix"], np.float64).reshape(4, 4)
        place = _points(vertices, [geometry["boundaries"][0]])[0]
        number = int(geometry["template"])
        if number < 0:
            raise IndexError("a template before the first")
        for surface in surfaces_of(templates[0][number], templates[1], ([], vertices), nested=True):
            rings = [ring @ matrix[:3, :3].T + matrix[:3, 3] + place for ring in surface.rings]
            yield Surface(rings, surface.semantic, surface.material)
        return
    depth = _DEPTH[kind]
    semantics = geometry.get("semantics") or {}
    types = [str(one.get("type", "")) for one in semantics.get("surfaces", [])]
    values = semantics.get("values")
    themes = geometry.get("material") or {}
    first: object = next(iter(themes.values()), {}) if isinstance(themes, dict) else {}
    material: dict[str, Any] = first if isinstance(first, dict) else {}
    for polygon, semantic, paint in _walk(
        geometry["boundaries"], values, material.get("values"), depth
    ):
        rings = [_points(vertices, ring) for ring in polygon if len(ring) >= 3]
        if not rings or len(polygon[0]) < 3:
            continue
        name = types[semantic] if isinstance(semantic, int) and 0 <= semantic < len(types) else ""
        tint = paint if isinstance(paint, int) else material.get("value")
        yield Surface(rings, name, tint if isinstance(tint, int) else None)


def _walk(
    boundaries: list[Any],
    semantics: Nested,
    paint: Nested,
    depth: int,
) -> Iterator[tuple[list[list[int]], Nested, Nested]]:
    """Yield polygons with their semantic and material index from nested lists of equal shape."""
    for number, item in enumerate(boundaries):
        own = semantics[number] if isinstance(semantics, list) and number < len(semantics) else None
        tint = paint[number] if isinstance(paint, list) and number < len(paint) else None
        if depth == 1:
            yield item, own, tint
        else:
            yield from _walk(item, own, tint, depth - 1)


def _points(vertices: NDArray[np.float64], ring: list[int]) -> NDArray[np.float64]:
    index = np.array(ring)
    if index.dtype.kind not in "iu" or index.ndim != 1 or (index < 0).any():
        raise ValueError("a ring that is not a list of vertices")
    return np.asarray(vertices[index])
