"""Semantic classes of city objects and of their surfaces."""

from __future__ import annotations

from functools import cache

from urbantwin.taxonomy import semantic_id

__all__ = ["semantic_number"]

#: Type of a city object (CityGML 3.0 modules) -> semantic class; the longest beginning wins.
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
#: Semantic surface -> class, where it says more than the object.
_SURFACES = {
    "TrafficArea": "road",
    "AuxiliaryTrafficArea": "other-ground",
    "TransportationMarking": "road",
    "TransportationHole": "other-ground",
}


@cache
def semantic_number(kind: str, surface: str) -> int:
    """Return the number of the semantic class, 0 where nothing is known.

    Args:
        kind: type of the city object.
        surface: type of the semantic surface, or empty.
    """
    name = _SURFACES.get(surface)
    if name is None:
        begins = [key for key in _OBJECTS if kind.startswith(key)]
        name = _OBJECTS[max(begins, key=len)] if begins else None
    return 0 if name is None else semantic_id(name)
