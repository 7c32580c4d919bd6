"""Surfaces of city models as one mesh of labelled triangles, and their semantic classes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.model import TriangleMesh
from urbantwin.io.polygons import triangulated
from urbantwin.io.trust import (
    MOST_TRIANGLES,
    check_coordinates,
    count_within,
    valid_faces,
)
from urbantwin.taxonomy import semantic_id

__all__ = ["CitySurfaces"]

#: Type of a city object (CityGML 3.0 modules) -> semantic class; the longest prefix wins.
_OBJECTS = {
    "Building": "building",
    "Bridge": "other-structure",
    "Tunnel": "other-structure",
    "OtherConstruction": "other-structure",
    "CityFurniture": "other-object",
    "LandUse": "terrain",
    "TINRelief": "terrain",
    "PlantCover": "vegetation",
    "SolitaryVegetationObject": "vegetation",
    "Road": "road",
    "TransportSquare": "road",
    "Railway": "other-ground",
    "Waterway": "other-ground",
    "WaterBody": "other-ground",
}
#: Semantic surface -> class, if more specific than the object's.
_SURFACES = {
    "TrafficArea": "road",
    "AuxiliaryTrafficArea": "other-ground",
    "TransportationMarking": "road",
    "TransportationHole": "other-ground",
}


@cache
def semantic_number(kind: str, surface: str) -> int:
    """Return the id of the semantic class, 0 if unknown.

    Args:
        kind: type of the city object.
        surface: type of the semantic surface, or empty.
    """
    name = _SURFACES.get(surface)
    if name is None:
        begins = [key for key in _OBJECTS if kind.startswith(key)]
        name = _OBJECTS[max(begins, key=len)] if begins else None
    return 0 if name is None else semantic_id(name)


_GREY = 128


@dataclass
class CitySurfaces:
    """The rings of all surfaces, and their city objects.

    Attributes:
        names: names of the surfaces -> index.
        problems: omissions, a line each.
        objects: number of city objects.
        lods: level of detail -> number of geometries used.
    """

    names: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    objects: int = 0
    lods: dict[str, int] = field(default_factory=dict)
    _points: list[NDArray[np.float64]] = field(default_factory=list)
    _ring: list[NDArray[np.int64]] = field(default_factory=list)
    _polygon: list[int] = field(default_factory=list)
    _number: list[int] = field(default_factory=list)
    _semantic: list[int] = field(default_factory=list)
    _colour: list[tuple[int, int, int] | None] = field(default_factory=list)

    def add(
        self,
        rings: Sequence[NDArray[np.float64]],
        name: str,
        kind: str,
        surface: str,
        colour: tuple[int, int, int] | None = None,
    ) -> None:
        """Add a flat surface.

        Args:
            rings: (N, 3) corners of its exterior, counter-clockwise from the front, and of its
                holes.
            name: name of its city object.
            kind: the object's type.
            surface: type of the semantic surface, or empty.
            colour: sRGB, if known.
        """
        for ring in rings:
            self._points.append(ring)
            self._ring.append(np.full(len(ring), len(self._polygon), np.int64))
            self._polygon.append(len(self._number))
        label = f"{name} / {surface}" if surface else name
        self._number.append(self.names.setdefault(label, len(self.names)))
        self._semantic.append(semantic_number(kind, surface))
        self._colour.append(colour)

    def mesh(
        self, path: Path, expected: str, unit_m: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[TriangleMesh, int]:
        """Return all surfaces as triangles, and the number of triangles without area.

        Args:
            path: the file, for errors.
            expected: its format: ``CityJSON``.
            unit_m: approximate lengths of the units of the three coordinates, for triangulation:
                degrees are not metres.

        Raises:
            InputError: there is no surface, none with an area, or one with invalid coordinates.
        """
        if not self._polygon:
            raise InputError("holds no surface", file=path, expected=f"{expected} with geometry")
        points = np.concatenate(self._points)
        check_coordinates(points, path)
        count_within(len(points), MOST_TRIANGLES, "corners of surfaces", path)
        triangles, owner = triangulated(
            points * np.array(unit_m), np.concatenate(self._ring), np.array(self._polygon)
        )
        vertices, index = np.unique(points + 0.0, axis=0, return_inverse=True)
        faces, kept = valid_faces(index.ravel()[triangles], len(vertices), path)
        if not len(faces):
            raise InputError(
                "holds no surface with an area", file=path, expected=f"{expected} surfaces"
            )
        owner = owner[kept]
        colour = None
        if any(one is not None for one in self._colour):
            table = np.array([one or (_GREY,) * 3 for one in self._colour], np.uint8)
            colour = table[owner]
        number = np.array(self._number, np.int32)[owner]
        semantic = np.array(self._semantic, np.uint16)[owner]
        mesh = TriangleMesh(vertices, faces, colour, number, tuple(self.names), semantic)
        return mesh, int((~kept).sum())
