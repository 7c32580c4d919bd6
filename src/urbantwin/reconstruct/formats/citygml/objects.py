"""City objects: which of their geometries is the finest, and what their surfaces are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.reconstruct.formats.citygml.file import local_name
from urbantwin.reconstruct.formats.citygml.geometry import (
    GeometryReader,
    Polygon,
    WrongGeometryError,
    identity_of,
)

__all__ = ["CityObject", "Surface", "city_objects"]

#: Kinds of city objects that are read, and what CityJSON (and the semantic classes) call them.
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
#: Surfaces of them that say what they are.
_SURFACES = frozenset(
    "RoofSurface WallSurface GroundSurface OuterFloorSurface OuterCeilingSurface Window Door "
    "WindowSurface DoorSurface TrafficArea AuxiliaryTrafficArea Marking WaterSurface "
    "WaterGroundSurface".split()
)
#: What is inside, or is not there at all: virtual surfaces that close an opening.
_NOT_OUTSIDE = frozenset(
    "InteriorWallSurface FloorSurface CeilingSurface Room BuildingRoom BuildingFurniture "
    "BridgeRoom BridgeFurniture HollowSpace TunnelFurniture IntBuildingInstallation interiorRoom "
    "interiorFurniture interiorBuildingInstallation buildingRoom storey Storey buildingUnit".split()
)
_VIRTUAL = frozenset({"ClosureSurface", "WaterClosureSurface"})
#: Properties that hold geometry: ``lod2Solid``, ``lod1MultiSurface``, ``lod3Geometry``.
_LEVEL = re.compile(
    r"lod([0-4])(Solid|MultiSurface|MultiSolid|Geometry|Surface|CompositeSurface|ImplicitRepresentation)"
)
#: Relief without levels in its properties.
_PLAIN = {"tin": 1}


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface of an object: what it is, and its polygon, or the id of one elsewhere."""

    semantic: str
    polygon: Polygon | str
    matrix: NDArray[np.float64] | None = None


@dataclass
class CityObject:
    """A city object.

    Attributes:
        kind: its type, as CityJSON calls it.
        id: its ``gml:id``, or empty.
        levels: level of detail -> its surfaces.
        parts: the objects that it consists of.
        problems: what could not be read of it.
        virtual: how many virtual surfaces were left out.
    """

    kind: str
    id: str
    levels: dict[int, list[Surface]] = field(default_factory=dict)
    parts: list[CityObject] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    virtual: int = 0

    def finest(self) -> int | None:
        """Return the highest level of detail that has surfaces; 0, a footprint, is none."""
        return max((level for level, found in self.levels.items() if found and level), default=None)

    def told(self) -> Iterator[str]:
        """Yield what could not be read of it and of its parts, a line each."""
        name = f"{self.kind} {self.id}".strip()
        yield from (f"{name}: {text}" for text in dict.fromkeys(self.problems))
        for part in self.parts:
            yield from part.told()

    def whole(self) -> Iterator[tuple[CityObject, int, list[Surface]]]:
        """Yield it and its parts with their finest surfaces.

        Where parts have its shape as fine as itself it is left to them.
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
    """Return a city object with all its parts; ``None`` where it is of no kind that is read."""
    kind = _OBJECTS.get(local_name(element))
    if kind is None:
        return None
    found = CityObject(kind, identity_of(element))
    _gather(element, found, "", reader)
    return found


def _gather(
    element: etree._Element, found: CityObject, semantic: str, reader: GeometryReader
) -> None:
    """Take the geometries below an element, down to its parts."""
    for child in element:
        name = local_name(child)
        if not name or name in _NOT_OUTSIDE:
            continue
        if name in _VIRTUAL:
            found.virtual += 1
            apart = CityObject("", "")
            _gather(child, apart, name, reader)
            # Solids may refer to it all the same.
            reader.virtual |= {
                one.polygon.id
                for surfaces in apart.levels.values()
                for one in surfaces
                if isinstance(one.polygon, Polygon) and one.polygon.id
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
    """Take the geometry of one property."""
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
    """Return where an implicit geometry stands, (4, 4); ``None`` where it is in another file."""
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
