"""Trucks, buses and trams: a shell, and parts given explicitly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from urbantwin.traffic.assets.car import axle_wheels, body, plates, seats, side_reflectors
from urbantwin.traffic.assets.solid import Solid, box, parts

__all__ = [
    "TRAMS",
    "Body",
    "bodies_of",
    "bus",
    "bus_section",
    "trailer",
    "tram_bodies",
    "tram_entries",
    "tram_section",
    "truck",
]


@dataclass(frozen=True)
class Body:
    """A rigid body of an articulated vehicle.

    Attributes:
        asset: name of its mesh.
        middle_m: distance of its centre behind the vehicle's nose when straight, metres.
        guides_m: two guided points on its long axis, metres behind the vehicle's nose when
            straight. On rails: the centres of bogies, or the joints above them. On roads: the joint
            to the towing body (for the first body its front axle), and its rear axle.
    """

    asset: str
    middle_m: float
    guides_m: tuple[float, float]


def bodies_of(entry: Mapping[str, Any], lengths: Mapping[str, float]) -> tuple[Body, ...]:
    """Return the bodies of an articulated vehicle, from its nose.

    Args:
        entry: entry of the catalogue.
        lengths: lengths of its bodies by name, metres.
    """
    return tuple(
        Body(
            body_entry["asset"],
            body_entry["nose"] + lengths[body_entry["asset"]] / 2,
            tuple(body_entry["guides"]),
        )
        for body_entry in entry["bodies"]
    )


def trailer(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of a trailer of the catalogue."""
    return axle_wheels(entry) + parts(entry)


def bus_section(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of one section of an articulated bus: its shell, and half the bellows."""
    ahead = "front" in entry["ends"]
    inner = {**entry, "size": entry["shell"]}
    # The bellows are behind the front section, and ahead of the rear one.
    shift = (entry["size"][0] - entry["shell"][0]) / 2 * (1 if ahead else -1)
    if not ahead:
        before = entry["size"][0] - entry["shell"][0]
        inner["wheels"] = {
            **entry["wheels"],
            "axles": [from_nose - before for from_nose in entry["wheels"]["axles"]],
        }
    shell, outline = body(inner)
    signs = plates(inner, outline, plate_z=(0.5, 0.7))
    signs = signs[:1] if ahead else signs[1:]
    inside = [*shell, *signs, *side_reflectors(inner), *seats(inner)]
    solids = [solid.moved([shift, 0.0, 0.0]) for solid in inside]
    return solids + axle_wheels(entry) + parts(entry)


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


#: Name -> lengths of the bodies from the front, width, and height without pantograph, metres.
#: Low-floor trams of 30 m by 2.40 m are usual in European networks (RET Rotterdam, series 2101 to
#: 2153: 30 m by 2.40 m; Essen: three bodies, 30 m; Berlin: 2.40 m). Division and height are
#: assumed.
TRAMS: dict[str, dict[str, Any]] = {
    "tram-three-bodies": {"bodies": (10.4, 8.0, 10.4), "width": 2.40, "height": 3.45},
}
#: Gap between the bellows of two bodies, their length, and position of the wheels at an end,
#: metres.
GAP_M, BELLOWS_M, END_AXLE_M = 0.6, 0.18, 0.62
#: Axles of the bogie under a cab, metres behind the nose; wheels of standard gauge; lower edge of
#: the body.
CAB_AXLES_M = (2.3, 4.1)
WHEEL_M, WHEEL_WIDTH_M, GAUGE_M, SKIRT_M = 0.60, 0.13, 1.435, 0.26
ROOF_M = 0.30  # equipment on the roof
WINDOW_M, PILLAR_M = 1.35, 0.22


def tram_entries() -> dict[str, dict[str, Any]]:
    """Return the catalogue's entries of trams and of their bodies."""
    entries: dict[str, dict[str, Any]] = {}
    for name, tram in TRAMS.items():
        lengths, height = tram["bodies"], tram["height"]
        size = [sum(lengths) + GAP_M * (len(lengths) - 1), tram["width"], height]
        entries[name] = {"class": "tram", "builder": "tram", "size": size}
        for number, length in enumerate(lengths):
            ends = number == 0, number == len(lengths) - 1
            entries[_part(name, number)] = {
                **_entry([length, tram["width"], height], *ends),
                "class": "tram",
                "builder": "tram-body",
                "part_of": name,
            }
    return entries


def tram_bodies(name: str) -> tuple[Body, ...]:
    """Return the bodies of a tram, from its nose."""
    lengths = TRAMS[name]["bodies"]
    starts = np.concatenate([[0.0], np.cumsum(np.add(lengths, GAP_M))])
    bodies = []
    for number, length in enumerate(lengths):
        first, last = starts[number] - GAP_M / 2, starts[number] + length + GAP_M / 2
        if number == 0:
            first = float(np.mean(CAB_AXLES_M))
        if number == len(lengths) - 1:
            last = starts[number] + length - float(np.mean(CAB_AXLES_M))
        middle = float(starts[number] + length / 2)
        bodies.append(Body(_part(name, number), middle, (float(first), float(last))))
    return tuple(bodies)


def tram_section(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the solids of one body of a tram."""
    length, width, height = entry["size"]
    cabs = entry["cabs"]
    solids, _ = body(entry["shell"])
    shift = entry["shift"]
    solids = [solid.moved([shift, 0, 0]) for solid in [*solids, *seats(entry["shell"])]]
    solids += axle_wheels(entry)
    for cab, sign in zip(cabs, (1, -1), strict=True):
        end = sign * length / 2
        if cab:
            for side in (1, -1):
                place = [end - sign * 0.25, side * 0.36 * width, 0.72]
                solids.append(box([0.5, 0.10, 0.10], place, "retroreflector"))
        else:
            tall = height - ROOF_M - SKIRT_M - 0.3
            place = [end - sign * (BELLOWS_M / 2 + 0.05), 0, SKIRT_M + 0.2 + tall / 2]
            solids.append(box([BELLOWS_M + 0.1, 0.86 * width, tall], place, "rubber"))
            for side in (1, -1):
                place = [end - sign * (BELLOWS_M + 0.02), side * 0.40 * width, 1.0]
                solids.append(box([0.06, 0.06, 0.06], place, "retroreflector"))
    for x in np.arange(-length / 2 + 1.8, length / 2 - 1.7, 2.6):
        place = [x, 0, height - ROOF_M / 2 - 0.02]
        solids.append(box([1.7, 0.62 * width, ROOF_M + 0.04], place, "metal-painted"))
    return solids


def _part(name: str, number: int) -> str:
    return f"{name}-{number + 1}"


def _entry(size: list[float], front: bool, rear: bool) -> dict[str, Any]:
    """Return the entry of one body: its shell lies between its bellows."""
    length, width, height = size
    front_bellows_m, rear_bellows_m = (0.0 if front else BELLOWS_M), (0.0 if rear else BELLOWS_M)
    inner, roof = length - front_bellows_m - rear_bellows_m, height - ROOF_M
    axles: list[float] = list(CAB_AXLES_M) if front else [END_AXLE_M]
    axles += [length - x for x in reversed(CAB_AXLES_M)] if rear else [length - END_AXLE_M]
    wheels: dict[str, Any] = {
        "axles": axles,
        "diameter": WHEEL_M,
        "width": WHEEL_WIDTH_M,
        "arch": 0.33,
        "inset": width / 2 - GAUGE_M / 2 - WHEEL_WIDTH_M,
    }
    nose: list[list[Any]] = [
        [0.10, SKIRT_M, "dark"],
        [0.0, 0.55, "lamps"],
        [0.02, 0.9, "paint"],
        [0.10, 1.15, "windscreen"],
        [0.75, 2.65, "paint"],
        [1.05, roof - 0.06, "paint"],
        [1.35, roof, "paint"],
    ]
    flat: list[list[Any]] = [
        [0.0, SKIRT_M, "dark"],
        [0.0, 0.5, "paint"],
        [0.0, roof - 0.1, "paint"],
        [0.1, roof, "paint"],
    ]
    first = nose if front else flat
    last = [[inner - x, z] for x, z, _ in (nose if rear else flat)][::-1]
    tags = [tag for _, _, tag in (nose if rear else flat)][::-1]
    # A point's tag is that of the edge that leaves it.
    upper = first + [[x, z, tag] for (x, z), tag in zip(last, [*tags[1:], "under"], strict=True)]
    begin, end = (1.5 if front else 0.35), inner - (1.5 if rear else 0.35)
    count = max(1, round((end - begin) / (WINDOW_M + PILLAR_M)))
    step = (end - begin) / count
    windows, doors = [], []
    for k in range(count):
        x0, x1 = begin + k * step + PILLAR_M / 2, begin + (k + 1) * step - PILLAR_M / 2
        if k % 3 == 1 and not any(x0 - 0.5 < x - front_bellows_m < x1 + 0.5 for x in axles):
            doors.append([[x0, 0.48], [x0, 2.55], [x1, 2.55], [x1, 0.48]])
        else:
            windows.append([[x0, 1.15], [x0, 2.55], [x1, 2.55], [x1, 1.15]])
    clear = np.arange(1.9, inner - 1.0, 1.7).tolist()
    shell = {
        "size": [inner, width, roof],
        "wheels": {**wheels, "axles": [x - front_bellows_m for x in axles]},
        "upper": upper,
        "windows": windows + doors,
        "section": [[SKIRT_M, 0.97], [0.6, 1.0], [1.4, 1.0], [roof, 0.94]],
        "plan": [
            [0.0, 0.80 if front else 1.0],
            [1.2, 0.97 if front else 1.0],
            [2.0, 1.0],
            [inner - 2.0, 1.0],
            [inner - 1.2, 0.97 if rear else 1.0],
            [inner, 0.80 if rear else 1.0],
        ],
        "edge": 0.10,
        "bulge": [0.25 if front else 0.0, 0.25 if rear else 0.0],
        "seats": clear,
        "seat_heights": [0.45, 1.45],
    }
    return {
        "size": size,
        "wheels": wheels,
        "shell": shell,
        "shift": (rear_bellows_m - front_bellows_m) / 2,
        "cabs": (front, rear),
    }
