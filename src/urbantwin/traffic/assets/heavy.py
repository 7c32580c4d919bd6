"""Trucks and buses: a shell, and what is spelled out of what stands behind or on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from urbantwin.traffic.assets.car import axle_wheels, body, plates, seats, side_reflectors
from urbantwin.traffic.assets.parts import parts
from urbantwin.traffic.assets.solid import Solid

__all__ = ["bus", "truck"]


def bus(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a bus of the catalogue."""
    solids, outline = body(entry)
    solids += axle_wheels(entry)
    solids += plates(entry, outline, plate_z=(0.5, 0.7)) + side_reflectors(entry)
    return solids + parts(entry) + seats(entry)


def truck(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a truck of the catalogue: a cab's shell and parts behind it."""
    wheels = entry["wheels"]
    cab = {**entry["cab"], "wheels": {**wheels, "axles": wheels["axles"][:1]}}
    shell, outline = body(cab)
    front_plate = plates(cab, outline, plate_z=(0.52, 1.2))[:1]
    ahead = [(entry["size"][0] - cab["size"][0]) / 2, 0.0, 0.0]
    solids = [solid.moved(ahead) for solid in [*shell, *front_plate, *seats(cab)]]
    return solids + axle_wheels(entry) + parts(entry)
