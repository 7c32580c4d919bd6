"""Geometry of GML 3.1 and 3.2 (ISO 19136): every kind of surface as rings of points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.reconstruct.formats.citygml.file import local_name

__all__ = ["GeometryReader", "Polygon", "WrongGeometryError"]

#: Elements that are flat surfaces; those that only hold others are walked through.
_FLAT = {"Polygon", "PolygonPatch", "Triangle", "Rectangle"}
_HREF = "{http://www.w3.org/1999/xlink}href"
_SRS = "srsName"
#: Names of an element's identity: of GML 3.2, 3.1 and, without a namespace, of files in between.
_ID = ("{http://www.opengis.net/gml}id", "{http://www.opengis.net/gml/3.2}id", "id")
#: How deep surfaces may hold surfaces.
_DEEPEST = 60


class WrongGeometryError(ValueError):
    """Geometry that is not as GML has it; its text says what is wrong."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """A flat surface.

    Attributes:
        rings: (N, 3) corners of its outside and of its holes, without the repeated first one.
        id: its ``gml:id``, or empty.
        turned: whether it is seen from behind where it is used (``OrientableSurface``).
    """

    rings: tuple[NDArray[np.float64], ...]
    id: str = ""
    turned: bool = False

    def corners(self) -> list[NDArray[np.float64]]:
        """Return its rings as they are used."""
        return [ring[::-1] if self.turned else ring for ring in self.rings]


@dataclass
class GeometryReader:
    """Reads surfaces, and remembers those that others may refer to.

    Attributes:
        known: ``gml:id`` of a surface -> what it consists of.
        systems: names of coordinate systems, and how many elements name each.
        virtual: ids of surfaces that only close openings.
    """

    known: dict[str, list[Polygon]] = field(default_factory=dict)
    systems: dict[str, int] = field(default_factory=dict)
    virtual: set[str] = field(default_factory=set)

    def surfaces(self, element: etree._Element, depth: int = 0) -> Iterator[Polygon | str]:
        """Yield the surfaces under an element: polygons, and ids of surfaces elsewhere.

        Raises:
            WrongGeometryError: a ring is not one.
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
        if identity and all(isinstance(one, Polygon) for one in found):
            self.known[identity] = [one for one in found if isinstance(one, Polygon)]
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
