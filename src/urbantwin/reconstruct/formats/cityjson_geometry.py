"""Geometries of CityJSON as surfaces: rings of points, semantic surface, material."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Surface", "surfaces_of"]

#: A number, or lists of them as deep as the boundaries.
Nested = int | list[Any] | None
#: How deep the surfaces of a geometry lie in its ``boundaries``.
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
        rings: (N, 3) corners of its outside, counter-clockwise from the front, and of its holes.
        semantic: type of the semantic surface (``RoofSurface``), or empty.
        material: number of its material, or ``None``.
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
    """Yield the surfaces of a geometry, those of a template at their place.

    Raises:
        KeyError, IndexError, TypeError, ValueError: the geometry is not as CityJSON has it.
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
    """Yield polygons with their semantic and material number from nested lists of equal shape."""
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
