"""Geometry of GML 3.1 and 3.2 (ISO 19136), and the finest geometry of each city object."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from lxml import etree
from numpy.typing import NDArray

__all__ = ["CityObject", "GeometryReader", "Polygon", "Surface", "city_objects", "local_name"]

#: Elements that are flat surfaces; containers are traversed.
_FLAT = {"Polygon", "PolygonPatch", "Triangle", "Rectangle"}
_HREF = "{http://www.w3.org/1999/xlink}href"
_SRS = "srsName"
#: Attributes with an element's id: of GML 3.1, 3.2 and, without a namespace, of files in between.
_ID = ("{http://www.opengis.net/gml}id", "{http://www.opengis.net/gml/3.2}id", "id")
#: Maximum nesting of surfaces.
_DEEPEST = 60


def local_name(element: etree._Element) -> str:
    """Return an element's name without its namespace."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""


class WrongGeometryError(ValueError):
    """Geometry that violates GML; the text states the problem."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """A flat surface.

    Attributes:
        rings: (N, 3) corners of its exterior and of its holes, without the repeated first one.
        id: its ``gml:id``, or empty.
        turned: whether it is used with reversed orientation (``OrientableSurface``).
    """

    rings: tuple[NDArray[np.float64], ...]
    id: str = ""
    turned: bool = False

    def corners(self) -> list[NDArray[np.float64]]:
        """Return its rings in the orientation of use."""
        return [ring[::-1] if self.turned else ring for ring in self.rings]


@dataclass
class GeometryReader:
    """Reads surfaces, and stores those that others may refer to.

    Attributes:
        known: ``gml:id`` of a surface -> its polygons.
        systems: names of CRS, and the number of elements that use each.
        virtual: ids of surfaces that only close openings.
    """

    known: dict[str, list[Polygon]] = field(default_factory=dict)
    systems: dict[str, int] = field(default_factory=dict)
    virtual: set[str] = field(default_factory=set)

    def surfaces(self, element: etree._Element, depth: int = 0) -> Iterator[Polygon | str]:
        """Yield the surfaces under an element: polygons, and ids of referenced surfaces.

        Raises:
            WrongGeometryError: a ring is invalid.
        """
        if depth > _DEEPEST:
            raise WrongGeometryError("its surfaces hold each other too deep")
        system = element.get(_SRS)
        if system:
            self.systems[system] = self.systems.get(system, 0) + 1
        href = element.get(_HREF)
        if href is not None:
            if href.startswith("#"):
                yield href[1:]
            else:
                raise WrongGeometryError(f"it refers to {href[:60]!r}, outside the file")
            return
        name = local_name(element)
        if name in _FLAT:
            found: list[Polygon | str] = [_polygon(element)]
        else:
            turned = name == "OrientableSurface" and element.get("orientation") == "-"
            found = [
                replace(one, turned=not one.turned) if turned and isinstance(one, Polygon) else one
                for child in element
                if isinstance(child.tag, str)
                for one in self.surfaces(child, depth + 1)
            ]
        identity = identity_of(element)
        if identity and all(isinstance(item, Polygon) for item in found):
            self.known[identity] = [item for item in found if isinstance(item, Polygon)]
        yield from found


def identity_of(element: etree._Element) -> str:
    """Return an element's ``gml:id``, or the empty text."""
    return next((found for name in _ID if (found := element.get(name))), "")


def _polygon(element: etree._Element) -> Polygon:
    outside: list[NDArray[np.float64]] = []
    holes: list[NDArray[np.float64]] = []
    for child in element:
        name = local_name(child)
        if name in ("exterior", "outerBoundaryIs"):
            outside += [_ring(one, element) for one in child]
        elif name in ("interior", "innerBoundaryIs"):
            holes += [_ring(one, element) for one in child]
    if len(outside) != 1:
        raise WrongGeometryError(f"a surface has {len(outside)} outlines")
    return Polygon((outside[0], *holes), identity_of(element))


def _ring(element: etree._Element, polygon: etree._Element) -> NDArray[np.float64]:
    """Return the corners (N, 3) of a ring."""
    values: list[str] = []
    dimension = 0
    for one in element.iter():
        name = local_name(one)
        if name in ("posList", "pos"):
            values += (one.text or "").split()
            dimension = dimension or int(_said_dimension(one))
        elif name == "coordinates":  # GML 2
            decimal, between = one.get("decimal", "."), one.get("cs", ",")
            text = (one.text or "").replace(between, " ")
            values += (text if decimal == "." else text.replace(decimal, ".")).split()
    dimension = dimension or int(_said_dimension(polygon)) or 3
    if dimension != 3:
        raise WrongGeometryError(f"a ring has {dimension} coordinates a corner, not 3")
    try:
        points = np.array(values, np.float64).reshape(-1, 3)
    except ValueError:
        raise WrongGeometryError("a ring is not a list of corners of 3 numbers") from None
    if not np.isfinite(points).all():
        raise WrongGeometryError("a ring has a corner that is not a place")
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points):
        points = points[np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))]
    if len(points) < 3:
        raise WrongGeometryError(f"a ring has {len(points)} different corners")
    return np.asarray(points, np.float64)


def _said_dimension(element: etree._Element) -> str:
    here: etree._Element | None = element
    while here is not None:
        said = here.get("srsDimension") or here.get("dimension")
        if said:
            return said if said.isdecimal() and len(said) < 3 else "0"
        here = here.getparent()
    return "0"


#: City object types that are read -> their CityJSON names (used by the semantic classes).
_OBJECTS = {
    "Building": "Building",
    "BuildingPart": "BuildingPart",
    "BuildingInstallation": "BuildingInstallation",
    "BuildingConstructiveElement": "BuildingConstructiveElement",
    "Bridge": "Bridge",
    "BridgePart": "BridgePart",
    "BridgeInstallation": "BridgeInstallation",
    "BridgeConstructionElement": "BridgeConstructiveElement",
    "BridgeConstructiveElement": "BridgeConstructiveElement",
    "Tunnel": "Tunnel",
    "TunnelPart": "TunnelPart",
    "TunnelInstallation": "TunnelInstallation",
    "OtherConstruction": "OtherConstruction",
    "CityFurniture": "CityFurniture",
    "SolitaryVegetationObject": "SolitaryVegetationObject",
    "PlantCover": "PlantCover",
    "Road": "Road",
    "Track": "Road",
    "Square": "TransportSquare",
    "Railway": "Railway",
    "TransportationComplex": "Road",
    "Waterway": "Waterway",
    "WaterBody": "WaterBody",
    "LandUse": "LandUse",
    "ReliefFeature": "TINRelief",
    "TINRelief": "TINRelief",
    "GenericCityObject": "GenericCityObject",
    "GenericOccupiedSpace": "GenericCityObject",
}
#: Surface types with a semantic meaning.
_SURFACES = frozenset(
    "RoofSurface WallSurface GroundSurface OuterFloorSurface OuterCeilingSurface Window Door "
    "WindowSurface DoorSurface TrafficArea AuxiliaryTrafficArea Marking WaterSurface "
    "WaterGroundSurface".split()
)
#: Interior elements, and virtual surfaces that close an opening.
_NOT_OUTSIDE = frozenset(
    "InteriorWallSurface FloorSurface CeilingSurface Room BuildingRoom BuildingFurniture "
    "BridgeRoom BridgeFurniture HollowSpace TunnelFurniture IntBuildingInstallation interiorRoom "
    "interiorFurniture interiorBuildingInstallation buildingRoom storey Storey buildingUnit".split()
)
_VIRTUAL = frozenset({"ClosureSurface", "WaterClosureSurface"})
#: Properties with geometry: ``lod2Solid``, ``lod1MultiSurface``, ``lod3Geometry``.
_LEVEL = re.compile(
    r"lod([0-4])(Solid|MultiSurface|MultiSolid|Geometry|Surface|CompositeSurface|ImplicitRepresentation)"
)
#: Relief properties without a level of detail.
_PLAIN = {"tin": 1}


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface of an object: its type, and its polygon or the id of a referenced one."""

    semantic: str
    polygon: Polygon | str
    matrix: NDArray[np.float64] | None = None


@dataclass
class CityObject:
    """A city object.

    Attributes:
        kind: its type, as in CityJSON.
        id: its ``gml:id``, or empty.
        levels: level of detail -> its surfaces.
        parts: its parts.
        problems: unreadable parts.
        virtual: number of omitted virtual surfaces.
    """

    kind: str
    id: str
    levels: dict[int, list[Surface]] = field(default_factory=dict)
    parts: list[CityObject] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    virtual: int = 0

    def finest(self) -> int | None:
        """Return the highest level of detail with surfaces, without level 0 (footprints)."""
        return max((level for level, found in self.levels.items() if found and level), default=None)

    def told(self) -> Iterator[str]:
        """Yield the problems of the object and of its parts, a line each."""
        name = f"{self.kind} {self.id}".strip()
        yield from (f"{name}: {text}" for text in dict.fromkeys(self.problems))
        for part in self.parts:
            yield from part.told()

    def whole(self) -> Iterator[tuple[CityObject, int, list[Surface]]]:
        """Yield the object and its parts with their finest surfaces.

        The object's own surfaces are omitted if its parts have the same level of detail.
        """
        own = self.finest()
        parts = [part for part in self.parts if part.kind.endswith("Part")]
        theirs = max((part.finest() or 0 for part in parts), default=0)
        if own is not None and own > theirs:
            yield self, own, self.levels[own]
        for part in self.parts:
            if part in parts and own is not None and own > theirs:
                continue
            yield from part.whole()


def city_objects(element: etree._Element, reader: GeometryReader) -> CityObject | None:
    """Return a city object with all its parts; ``None`` for unsupported types."""
    kind = _OBJECTS.get(local_name(element))
    if kind is None:
        return None
    found = CityObject(kind, identity_of(element))
    _gather(element, found, "", reader)
    return found


def _gather(
    element: etree._Element, found: CityObject, semantic: str, reader: GeometryReader
) -> None:
    """Add the geometries below an element, down to its parts."""
    for child in element:
        name = local_name(child)
        if not name or name in _NOT_OUTSIDE:
            continue
        if name in _VIRTUAL:
            found.virtual += 1
            apart = CityObject("", "")
            _gather(child, apart, name, reader)
            # solids may still refer to it
            reader.virtual |= {
                surface.polygon.id
                for surfaces in apart.levels.values()
                for surface in surfaces
                if isinstance(surface.polygon, Polygon) and surface.polygon.id
            }
        elif name in _OBJECTS:
            part = city_objects(child, reader)
            if part is not None:
                found.parts.append(part)
        elif name in _SURFACES:
            _gather(child, found, name, reader)
        elif (match := _LEVEL.fullmatch(name)) or name in _PLAIN:
            level = int(match[1]) if match else _PLAIN[name]
            _take(child, found, level, semantic, reader, implicit=name.endswith("Representation"))
        else:
            _gather(child, found, semantic, reader)


def _take(
    element: etree._Element,
    found: CityObject,
    level: int,
    semantic: str,
    reader: GeometryReader,
    *,
    implicit: bool,
) -> None:
    """Add the geometry of one property."""
    matrix = None
    try:
        if implicit:
            matrix = _placement(element)
            if matrix is None:
                found.problems.append("a shape from a library outside the file is left out")
                return
        surfaces = [Surface(semantic, one, matrix) for one in reader.surfaces(element)]
    except WrongGeometryError as error:
        found.problems.append(str(error))
        return
    found.levels.setdefault(level, []).extend(surfaces)


def _placement(element: etree._Element) -> NDArray[np.float64] | None:
    """Return the pose of an implicit geometry, (4, 4); ``None`` if it is in another file."""
    shape, matrix, point = False, np.eye(4), np.zeros(3)
    for one in element.iter():
        name = local_name(one)
        if name in ("relativeGMLGeometry", "relativeGeometry"):
            shape = True
        elif name == "transformationMatrix":
            values = (one.text or "").split()
            try:
                matrix = np.array(values, np.float64).reshape(4, 4)
            except ValueError:
                raise WrongGeometryError("a transformation is not 16 numbers") from None
        elif name == "referencePoint":
            text = " ".join(p.text or "" for p in one.iter() if local_name(p) == "pos")
            try:
                point = np.array(text.split(), np.float64).reshape(3)
            except ValueError:
                raise WrongGeometryError("a reference point is not 3 numbers") from None
    if not shape:
        return None
    placed = matrix.copy()
    placed[:3, 3] += point
    if not np.isfinite(placed).all():
        raise WrongGeometryError("a transformation is not finite")
    return placed
