"""Trucks and buses: a shell (of the cab, or of the whole bus) with blocks, tanks and a drum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.traffic.assets.car import axle_wheels, body, plates, seats
from urbantwin.traffic.assets.loft import loft, superellipse
from urbantwin.traffic.assets.primitive import box, cylinder
from urbantwin.traffic.assets.solid import Solid

__all__ = ["bus", "truck"]


def bus(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a bus of the catalogue."""
    solids, outline = body(entry)
    solids += axle_wheels(entry)
    solids += plates(entry, outline, plate_z=(0.5, 0.7))
    solids += blocks(entry)
    return solids + seats(entry)


def truck(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a truck of the catalogue."""
    wheels = entry["wheels"]
    cab = {**entry["cab"], "wheels": {**wheels, "axles": wheels["axles"][:1]}}
    shell, outline = body(cab)
    front_plate = plates(cab, outline, plate_z=(0.52, 1.2))[:1]
    ahead = [(entry["size"][0] - cab["size"][0]) / 2, 0.0, 0.0]
    solids = [solid.moved(ahead) for solid in [*shell, *front_plate, *seats(cab)]]
    solids += axle_wheels(entry)
    solids += blocks(entry)
    if "drum" in entry:
        solids.append(_drum(entry["size"][0], entry["drum"]))
    return solids


def blocks(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the blocks and tanks of an entry."""
    half = entry["size"][0] / 2
    solids = []
    for (start, end), (right, left), (low, high), material in entry.get("blocks", ()):
        size = [end - start, left - right, high - low]
        centre = np.array([half - (start + end) / 2, (left + right) / 2, (low + high) / 2])
        block = box(size, centre, material)
        solids += [block, block.mirrored()] if right > 0 else [block]
    for (start, end), y, z, radius, material in entry.get("tanks", ()):
        tank = cylinder([half - end, y, z], [half - start, y, z], radius, material, sides=14)
        solids += [tank, tank.mirrored()]
    return solids


def _drum(length: float, stations: Sequence[Sequence[float]]) -> Solid:
    """Return a drum through circles: metres behind the nose, height of the axis, radius."""
    sections = []
    for behind, z, radius in stations[::-1]:
        circle = superellipse(radius, radius, sides=24)
        x = np.full(len(circle), length / 2 - behind)
        sections.append(np.column_stack([x, circle[:, 0], z + circle[:, 1]]))
    return loft(sections, "metal-painted")
