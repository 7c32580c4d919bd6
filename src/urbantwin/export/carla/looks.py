"""How the materials of the map look."""

from __future__ import annotations

from collections.abc import Sequence

from urbantwin.export.mesh import Look, MeshObject

__all__ = ["colour_of", "looks_of"]

#: Colours of materials by what their names contain, linear RGB.
_COLOURS = (
    ("LaneMarking", (0.85, 0.85, 0.85)),
    ("Asphalt", (0.10, 0.10, 0.11)),
    ("asphalt", (0.10, 0.10, 0.11)),
    ("Sidewalk", (0.42, 0.40, 0.37)),
    ("Concrete", (0.45, 0.45, 0.43)),
    ("Grass", (0.14, 0.28, 0.09)),
    ("Rural", (0.25, 0.20, 0.13)),
    ("Apartment", (0.30, 0.28, 0.26)),
    ("foliage", (0.07, 0.22, 0.05)),
    ("bark", (0.16, 0.11, 0.07)),
    ("wood", (0.30, 0.20, 0.11)),
    ("brick", (0.38, 0.15, 0.10)),
    ("roofing", (0.22, 0.12, 0.10)),
    ("glass", (0.15, 0.20, 0.24)),
    ("metal", (0.28, 0.29, 0.31)),
    ("plaster", (0.62, 0.58, 0.50)),
)
_GREY = (0.5, 0.5, 0.5)


def colour_of(material: str) -> tuple[float, float, float]:
    """Return a material's colour, linear RGB from 0 to 1."""
    return next((colour for key, colour in _COLOURS if key in material), _GREY)


def looks_of(objects: Sequence[MeshObject]) -> dict[str, Look]:
    """Return how every material of the objects looks."""
    return {name: Look(colour_of(name)) for one in objects for name in one.materials}
