"""The walls of one building, as its facade is laid out on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from shapely import Geometry

from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.building_volume import Volume
from urbantwin.scene.facade.wall import Wall

__all__ = ["Front"]


@dataclass(frozen=True, eq=False)
class Front:
    """A building's walls, with what the map says of the bodies that they are of.

    Attributes:
        building: the building.
        volumes: of each body that ``Wall.body`` counts.
        walls: its walls.
        plan: its whole footprint.
        datum: height of its lowest ground, metres.
    """

    building: MappedBuilding
    volumes: Sequence[Volume]
    walls: Sequence[Wall]
    plan: Geometry
    datum: float
