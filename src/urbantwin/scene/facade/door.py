"""Doors: the mapped ones, and one for every building without."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import shapely
from shapely import Point

from urbantwin.scene.face import DOOR, GLASS
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["Door", "mapped_doors"]

#: Width, height and pane by ``entrance`` value, metres.
SIZES = {
    "main": (1.4, 2.3, DOOR),
    "shop": (1.6, 2.4, GLASS),
    "garage": (2.6, 2.2, DOOR),
    "delivery": (2.0, 2.3, DOOR),
    "emergency": (1.0, 2.1, DOOR),
    "exit": (1.2, 2.1, DOOR),
}
OTHER = (1.1, 2.1, DOOR)


@dataclass(frozen=True)
class Door:
    """A door: where it is in plan, its size in metres, and the kind of its pane."""

    place: Point
    width: float
    height: float
    kind: int


def mapped_doors(features: Iterable[OsmFeature]) -> list[Door]:
    """Return the doors that the map has: nodes with ``entrance`` or ``door``."""
    doors = []
    for feature in features:
        tags = feature.tags
        if not isinstance(feature.geometry, Point) or not tags.keys() & {"entrance", "door"}:
            continue
        if tags.get("entrance") == "no" or tags.get("level", "0").startswith("-"):
            continue
        width, height, kind = SIZES.get(tags.get("entrance", ""), OTHER)
        width = length_m_of(tags.get("door:width", tags.get("width"))) or width
        height = length_m_of(tags.get("door:height")) or height
        doors.append(
            Door(
                shapely.force_2d(feature.geometry),
                min(max(width, 0.6), 6.0),
                min(max(height, 1.8), 5.0),
                kind,
            )
        )
    return doors
