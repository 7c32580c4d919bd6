"""Vehicles that bend on roads: tractor and semi-trailer, road train, articulated bus.

Each body is an asset of its own with a box of its own, as annotators draw them: a trailer is a
class apart from what pulls it, and each section of a bus has its box (nuScenes, instructions for
annotators, *vehicle.trailer* and *vehicle.bus.bendy*).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from urbantwin.traffic.assets.body import Body
from urbantwin.traffic.assets.car import axle_wheels, body, plates, seats, side_reflectors
from urbantwin.traffic.assets.parts import parts
from urbantwin.traffic.assets.solid import Solid

__all__ = ["bodies_of", "bus_section", "trailer"]


def bodies_of(entry: Mapping[str, Any], lengths: Mapping[str, float]) -> tuple[Body, ...]:
    """Return the bodies of a vehicle that bends, from its nose.

    Args:
        entry: of the catalogue.
        lengths: of its bodies by their names, metres.
    """
    return tuple(
        Body(one["asset"], one["nose"] + lengths[one["asset"]] / 2, tuple(one["guides"]))
        for one in entry["bodies"]
    )


def trailer(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a trailer of the catalogue."""
    return axle_wheels(entry) + parts(entry)


def bus_section(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of one section of an articulated bus: its shell, and half the bellows."""
    ahead = "front" in entry["ends"]
    inner = {**entry, "size": entry["shell"]}
    # The bellows lie behind the front section, and before the rear one.
    shift = (entry["size"][0] - entry["shell"][0]) / 2 * (1 if ahead else -1)
    if not ahead:
        before = entry["size"][0] - entry["shell"][0]
        inner["wheels"] = {
            **entry["wheels"],
            "axles": [behind - before for behind in entry["wheels"]["axles"]],
        }
    shell, outline = body(inner)
    signs = plates(inner, outline, plate_z=(0.5, 0.7))
    signs = signs[:1] if ahead else signs[1:]
    inside = [*shell, *signs, *side_reflectors(inner), *seats(inner)]
    solids = [solid.moved([shift, 0.0, 0.0]) for solid in inside]
    return solids + axle_wheels(entry) + parts(entry)
