"""Cars: a shell from the catalogue's profile, wheels, mirrors, plates, reflectors and seats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.traffic.assets.primitive import box, ellipsoid
from urbantwin.traffic.assets.shell import Outline, Panel, Section, arched_outline, shell
from urbantwin.traffic.assets.solid import Solid
from urbantwin.traffic.assets.wheel import wheel

__all__ = ["axle_wheels", "body", "car", "contact_points", "plates"]


def car(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a car of the catalogue."""
    solids, outline = body(entry)
    solids += axle_wheels(entry)
    solids += plates(entry, outline, plate_z=(0.42, 0.62))
    length, width, height = entry["size"]
    x, z = length / 2 - entry["mirror"][0], entry["mirror"][1]
    for side in (1, -1):
        housing = ellipsoid([0.07, 0.10, 0.075], [0, 0, 0], "metal-painted", sides=10, rings=4)
        solids.append(housing.moved([x, side * (width / 2 - 0.10), z]))
        face = box([0.012, 0.13, 0.09], [x - 0.062, side * (width / 2 - 0.10), z], "glass")
        solids.append(face)
    for behind in entry["seats"]:
        for side in (1, -1):
            solids += _seat(length / 2 - behind, side * 0.2 * width, height)
    return solids


def body(entry: Mapping[str, Any]) -> tuple[list[Solid], Outline]:
    """Return the shell of an entry with what closes the space between its wheels."""
    length, width, height = entry["size"]
    wheels = entry["wheels"]
    axles = [length / 2 - behind for behind in wheels["axles"]]
    radius = wheels["diameter"] / 2
    outline = arched_outline(
        [(length / 2 - behind, z, tag) for behind, z, tag in entry["upper"]],
        axles,
        arch_centre_z=radius,
        arch_radius=wheels["arch"],
    )
    section = Section(
        half_width=width / 2,
        by_height=tuple((z, factor) for z, factor in entry["section"]),
        by_length=tuple((length / 2 - behind, factor) for behind, factor in entry["plan"][::-1]),
        edge_radius=entry["edge"],
        nose_bulge=entry["bulge"][0],
        tail_bulge=entry["bulge"][1],
        crown=entry.get("crown", 0.04),
    )
    panels = [
        Panel(tuple((length / 2 - behind, z) for behind, z in corners), material, corner)
        for key, material, corner in (("windows", "glass", 0.03), ("trim", "metal-dark", 0.0))
        for corners in entry.get(key, ())
    ]
    solids = [shell(outline, section, panels, step=0.2 if height < 2.2 else 0.35)]
    floor = min(z for _, z, _ in entry["upper"]) + 0.02
    for axle in axles:
        tall = radius + wheels["arch"] + 0.02 - floor
        wide = width - 2 * wheels["width"] - 0.16
        solids.append(
            box([2 * wheels["arch"], wide, tall], [axle, 0, floor + tall / 2], "metal-dark")
        )
    return solids, outline


def axle_wheels(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the wheels of an entry, outer faces a little inside the body's sides."""
    length = entry["size"][0]
    wheels = entry["wheels"]
    one = wheel(wheels["diameter"], wheels["width"], sides=wheels.get("sides", 20))
    solids = []
    for behind in wheels["axles"]:
        left = one.moved([length / 2 - behind, _wheel_y(entry), 0])
        solids += [left, left.mirrored()]
    return solids


def contact_points(entry: Mapping[str, Any]) -> list[list[float]]:
    """Return where the wheels touch the ground (K, 3): axles from the front, left then right."""
    length = entry["size"][0]
    return [
        [length / 2 - behind, side * _wheel_y(entry), 0.0]
        for behind in entry["wheels"]["axles"]
        for side in (1, -1)
    ]


def plates(entry: Mapping[str, Any], outline: Outline, *, plate_z: Sequence[float]) -> list[Solid]:
    """Return licence plates (520 x 110 mm) and the two rear reflectors (UN Regulation 48)."""
    width = entry["size"][1]
    solids = []
    for z, end in zip(plate_z, (1, 0), strict=True):
        x = outline.reach(z)[end]
        solids.append(box([0.02, 0.52, 0.11], [x, 0, z], "retroreflector"))
    z = min(0.5, plate_z[1])
    for side in (1, -1):
        x = outline.reach(z)[0] + 0.8 * entry["bulge"][1] * 0.7**2
        solids.append(box([0.04, 0.10, 0.04], [x, side * 0.35 * width, z], "retroreflector"))
    return solids


def _wheel_y(entry: Mapping[str, Any]) -> float:
    inset = entry["wheels"].get("inset", 0.03)
    return float(entry["size"][1] / 2 - inset - entry["wheels"]["width"] / 2)


def _seat(x: float, y: float, height: float) -> list[Solid]:
    """Return a seat: cushion, back and head rest, sized to a cabin."""
    floor, top = 0.30, 0.78 * height
    return [
        box([0.48, 0.46, 0.22], [x + 0.14, y, floor + 0.11], "cloth"),
        box([0.14, 0.46, top - floor - 0.2], [x - 0.12, y, (top + floor) / 2 - 0.1], "cloth"),
        box([0.09, 0.24, 0.18], [x - 0.14, y, top - 0.08], "cloth"),
    ]


def fitted(solids: Sequence[Solid], size: Sequence[float]) -> list[Solid]:
    """Stretch solids to exact bounds: x and y centred on the origin, z from 0 up.

    Args:
        solids: of one asset.
        size: length, width, height, metres.
    """
    corners = np.concatenate([solid.vertices for solid in solids])
    low, high = corners.min(axis=0), corners.max(axis=0)
    factors = np.asarray(size) / (high - low)
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    return [solid.moved(-middle).scaled(factors) for solid in solids]
