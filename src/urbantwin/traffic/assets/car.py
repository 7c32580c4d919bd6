"""Cars: a shell from the catalogue's profile, wheels, mirrors, plates, reflectors and seats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.geometry import rotation_from_ypr
from urbantwin.traffic.assets.shell import Outline, Panel, Section, arched_outline, shell
from urbantwin.traffic.assets.solid import Solid, box, ellipsoid, turned

__all__ = [
    "axle_wheels",
    "body",
    "car",
    "contact_points",
    "plates",
    "seats",
    "side_reflectors",
    "wheel",
]


def wheel(
    diameter: float,
    width: float,
    *,
    rim: float = 0.66,
    dish: float = 0.15,
    sides: int = 20,
) -> Solid:
    """Return a wheel on z = 0, its axle along y through x = y = 0, its outer face at +y.

    Args:
        diameter: diameter of the tyre, metres.
        width: width of the tyre, metres.
        rim: diameter of the rim as a share of the tyre's.
        dish: depth of the rim's face behind the sidewall, as a share of the width.
        sides: corners of the circle, a multiple of 4, so that one of them touches the ground.
    """
    r, half = diameter / 2, width / 2
    shoulder = min(0.12 * r, 0.3 * half)
    profile = [
        [0, -half],
        [0.92 * r, -half],
        [r, -half + shoulder],
        [r, half - shoulder],
        [0.92 * r, half],
        [rim * r, half - 0.02 * width],
        [0.9 * rim * r, half - dish * width],
        [0.25 * rim * r, half - 0.5 * dish * width],
        [0, half - 0.4 * dish * width],
    ]
    names = ["rubber"] * 5 + ["metal-painted"] * 3
    lying = turned(profile, names, sides=sides)
    # z (the axle) goes to +y; the corner on +x stays on +x, those on +-y go to -+z.
    return lying.rotated(rotation_from_ypr(0, 0, -np.pi / 2)).moved([0, 0, r])


#: Keys of an entry with panels: material, corner radius in metres, sides.
PANELS = (
    ("windows", "glass", 0.03, "both"),
    ("windows_left", "glass", 0.05, "left"),
    ("windows_right", "glass", 0.05, "right"),
    ("doors", "glass", 0.05, "right"),
    ("trim", "metal-dark", 0.0, "both"),
)


#: Width and height of plates, metres: ISO 7591, and SAE J686 of North America.
PLATE_M, AMERICAN_PLATE_M = (0.52, 0.11), (0.305, 0.152)
#: Width and height of tail lamps, and of their lenses, metres.
LAMP_M, LAMP_LENS_M = (0.24, 0.20), (0.20, 0.14)
#: Width and height of a reflector, metres: 40 cm2, as ``reflex-reflector`` of the materials.
REFLECTOR_M = (0.10, 0.04)
#: Length above which vehicles have side reflectors, metres (UN Regulation 48, 6.17).
LONG_M = 6.0
#: Height of the middle of a car's roof above its edges, metres.
CROWN_M = 0.08


def car(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a car of the catalogue."""
    solids, outline = body({"crown": CROWN_M, **entry})
    solids += axle_wheels(entry)
    solids += plates(entry, outline, plate_z=(0.42, 0.62))
    solids += tail_lamps(entry, outline) + side_reflectors(entry)
    length, width, _ = entry["size"]
    x, z = length / 2 - entry["mirror"][0], entry["mirror"][1]
    for side in (1, -1):
        housing = ellipsoid([0.07, 0.10, 0.075], [0, 0, 0], "metal-painted", sides=10, rings=4)
        solids.append(housing.moved([x, side * (width / 2 - 0.10), z]))
        face = box([0.012, 0.13, 0.09], [x - 0.062, side * (width / 2 - 0.10), z], "glass")
        solids.append(face)
    return solids + seats(entry)


def body(entry: Mapping[str, Any]) -> tuple[list[Solid], Outline]:
    """Return the shell of an entry, closed between its wheels."""
    length, width, height = entry["size"]
    wheels = entry["wheels"]
    axles = [length / 2 - from_nose for from_nose in wheels["axles"]]
    radius = wheels["diameter"] / 2
    outline = arched_outline(
        [(length / 2 - from_nose, z, tag) for from_nose, z, tag in entry["upper"]],
        axles,
        arch_centre_z=radius,
        arch_radius=wheels["arch"],
    )
    section = _section(entry)
    panels = [
        Panel(
            tuple((length / 2 - from_nose, z) for from_nose, z in corners), material, corner, side
        )
        for key, material, corner, side in PANELS
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


def _section(entry: Mapping[str, Any]) -> Section:
    length, width, _ = entry["size"]
    return Section(
        half_width=width / 2,
        by_height=tuple((z, factor) for z, factor in entry["section"]),
        by_length=tuple(
            (length / 2 - from_nose, factor) for from_nose, factor in entry["plan"][::-1]
        ),
        edge_radius=entry["edge"],
        nose_bulge=entry["bulge"][0],
        tail_bulge=entry["bulge"][1],
        crown=entry.get("crown", 0.04),
    )


def axle_wheels(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the wheels of an entry, outer faces slightly inside the body's sides."""
    length = entry["size"][0]
    wheels = entry["wheels"]
    solids = []
    for number, from_nose in enumerate(wheels["axles"]):
        tyre = wheel(wheels["diameter"], _tyre_width(entry, number))
        left = tyre.moved([length / 2 - from_nose, _wheel_y(entry, number), 0])
        solids += [left, left.mirrored()]
    return solids


def contact_points(entry: Mapping[str, Any]) -> list[list[float]]:
    """Return the wheels' contact points (K, 3), metres: axles from the front, left then right."""
    length = entry["size"][0]
    return [
        [length / 2 - from_nose, side * _wheel_y(entry, number), 0.0]
        for number, from_nose in enumerate(entry["wheels"]["axles"])
        for side in (1, -1)
    ]


def plates(entry: Mapping[str, Any], outline: Outline, *, plate_z: Sequence[float]) -> list[Solid]:
    """Return licence plates, and the two rear reflectors (UN Regulation 48)."""
    width = entry["size"][1]
    plate_m = AMERICAN_PLATE_M if entry.get("american") else PLATE_M
    tall = np.array([-0.5, 0.0, 0.5]) * plate_m[1]
    lowest = float(outline.points[:, 1].min()) + plate_m[1] / 2 + 0.01
    plate_z = [max(z, lowest) for z in plate_z]
    # In front of the profile's foremost and behind its rearmost point, where it slopes.
    front = max(outline.reach(plate_z[0] + up)[1] for up in tall) - 0.002
    rear = min(outline.reach(plate_z[1] + up)[0] for up in tall) + 0.002
    solids = [
        box([0.02, *plate_m], [x, 0, z], "retroreflector")
        for x, z in zip((front, rear), plate_z, strict=True)
    ]
    z = min(0.5, plate_z[1])
    x = min(outline.reach(z + up)[0] for up in (-0.02, 0.02)) + entry["bulge"][1] * 0.7**2
    for side in (1, -1):
        place = [x + 0.012, side * 0.35 * width, z]
        solids.append(box([0.04, REFLECTOR_M[0], REFLECTOR_M[1]], place, "reflex-reflector"))
    return solids


def tail_lamps(entry: Mapping[str, Any], outline: Outline) -> list[Solid]:
    """Return the tail lamps of a car: bright housings, and retroreflective lenses.

    Height and size are fitted to half of PandaSet's cars, whose lamps have a median intensity of a
    third of white, with a fifth of the points beyond 1.5 times white (notebook/real_lidar.md).
    """
    _, width, height = entry["size"]
    z = min(0.53 * height, 0.83)
    low, middle, high = (outline.reach(z + up * LAMP_M[1])[0] for up in (-0.5, 0.0, 0.5))
    x = min(middle, (low + high) / 2) + entry["bulge"][1] * 0.6
    lean = np.arctan2(high - low, LAMP_M[1])  # slope of the tail
    turn = np.array([[np.cos(lean), 0, np.sin(lean)], [0, 1, 0], [-np.sin(lean), 0, np.cos(lean)]])
    solids = []
    for size_m, deep, material in ((LAMP_M, 0.015, "plastic"), (LAMP_LENS_M, 0.012, "lamp-lens")):
        lamp = box([0.04, *size_m], [deep, 0, 0], material).rotated(turn)
        lamp = lamp.moved([x, 0.8 * width / 2, z])
        solids += [lamp, lamp.mirrored()]
    return solids


def side_reflectors(entry: Mapping[str, Any]) -> list[Solid]:
    """Return reflectors that face sideways, if the vehicle has them.

    Beyond 6 m UN Regulation 48 (6.17) requires them: one at most 3 m behind the nose, others at
    most 3 m apart (4 m without room), the last 1 m before the end. Otherwise only bodies sold in
    North America have them (`catalogue.american_body`): FMVSS 108 requires one as near to the nose
    as possible, and one as near to the tail.
    """
    length, section = entry["size"][0], _section(entry)
    if length > LONG_M:
        count = int(np.ceil((length - 2.0) / 3.0)) + 1
        places = np.linspace(1.0, length - 1.0, count)
    elif entry.get("american"):
        places = np.array([0.30, length - 0.25])
    else:
        return []
    z = 0.7 if length > LONG_M else 0.45 * entry["size"][2]
    axles = np.asarray(entry["wheels"]["axles"])
    arch = entry["wheels"]["arch"] + REFLECTOR_M[0]
    solids = []
    for place in places:
        near_axles = axles[np.abs(axles - place) < arch]
        beside = near_axles + np.copysign(arch, place - near_axles)
        low = len(near_axles) and z < entry["wheels"]["diameter"] / 2 + arch
        x = length / 2 - float(beside[0] if low else place)
        y = float(section.at(np.array([[x, z]]))[0]) - 0.012
        solid = box([REFLECTOR_M[0], 0.04, REFLECTOR_M[1]], [x, y, z], "reflex-reflector")
        solids += [solid, solid.mirrored()]
    return solids


def _tyre_width(entry: Mapping[str, Any], axle: int) -> float:
    """Return a tyre's width; twin tyres of a driven axle count as one."""
    wheels = entry["wheels"]
    steered = axle < wheels.get("steered", 1)
    return float(wheels["width"] if steered else wheels.get("rear_width", wheels["width"]))


def _wheel_y(entry: Mapping[str, Any], axle: int) -> float:
    """Return the y of the middle of an axle's left tyre."""
    inset = entry["wheels"].get("inset", 0.03)
    return float(entry["size"][1] / 2 - inset - _tyre_width(entry, axle) / 2)


def seats(entry: Mapping[str, Any]) -> list[Solid]:
    """Return two seats per row of an entry: cushion, back and head rest."""
    length, width, height = entry["size"]
    floor, top = entry.get("seat_heights", (0.30, 0.78 * height))
    solids = []
    for from_nose in entry["seats"]:
        x = length / 2 - from_nose
        for y in (0.2 * width, -0.2 * width):
            back = top - floor - 0.2
            solids += [
                box([0.48, 0.46, 0.22], [x + 0.14, y, floor + 0.11], "cloth"),
                box([0.14, 0.46, back], [x - 0.12, y, floor + back / 2 + 0.01], "cloth"),
                box([0.09, 0.24, 0.18], [x - 0.14, y, top - 0.08], "cloth"),
            ]
    return solids
