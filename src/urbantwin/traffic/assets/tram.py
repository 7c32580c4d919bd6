"""Trams: stiff bodies in a row, joined over bogies that they share.

The bodies follow each other over the rails (`traffic.articulation`); each is a mesh of its own. A
tram's entry in the catalogue is made here from a few measures.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from urbantwin.traffic.assets.body import Body
from urbantwin.traffic.assets.car import axle_wheels, body, seats
from urbantwin.traffic.assets.primitive import box
from urbantwin.traffic.assets.solid import Solid

__all__ = ["TRAMS", "tram_bodies", "tram_entries", "tram_section"]

#: Name -> lengths of the bodies from the front, width and height without pantograph, metres. A
#: low-floor tram of 30 m by 2.40 m is what most European networks run (RET Rotterdam, series 2101
#: to 2153: 30 m by 2.40 m; Essen: three bodies, 30 m; Berlin: 2.40 m). How it is divided and its
#: height are assumed.
TRAMS: dict[str, dict[str, Any]] = {
    "tram-three-bodies": {"bodies": (10.4, 8.0, 10.4), "width": 2.40, "height": 3.45},
}
#: Between the ends of two bodies' bellows; how long those are; where the wheels at an end are.
GAP_M, BELLOWS_M, END_AXLE_M = 0.6, 0.18, 0.62
#: Axles of the bogie under a cab, metres behind the nose; standard gauge's wheels; floor's edge.
CAB_AXLES_M = (2.3, 4.1)
WHEEL_M, WHEEL_WIDTH_M, GAUGE_M, SKIRT_M = 0.60, 0.13, 1.435, 0.26
ROOF_M = 0.30  # what stands on the roof
WINDOW_M, PILLAR_M = 1.35, 0.22


def tram_entries() -> dict[str, dict[str, Any]]:
    """Return the catalogue's entries of trams and of their bodies."""
    found: dict[str, dict[str, Any]] = {}
    for name, tram in TRAMS.items():
        lengths, height = tram["bodies"], tram["height"]
        size = [sum(lengths) + GAP_M * (len(lengths) - 1), tram["width"], height]
        found[name] = {"class": "tram", "builder": "tram", "size": size}
        for number, length in enumerate(lengths):
            ends = number == 0, number == len(lengths) - 1
            found[_part(name, number)] = {
                **_entry([length, tram["width"], height], *ends),
                "class": "tram",
                "builder": "tram-body",
                "part_of": name,
            }
    return found


def tram_bodies(name: str) -> tuple[Body, ...]:
    """Return the bodies of a tram, from its nose."""
    lengths = TRAMS[name]["bodies"]
    starts = np.concatenate([[0.0], np.cumsum(np.add(lengths, GAP_M))])
    found = []
    for number, length in enumerate(lengths):
        first, last = starts[number] - GAP_M / 2, starts[number] + length + GAP_M / 2
        if number == 0:
            first = float(np.mean(CAB_AXLES_M))
        if number == len(lengths) - 1:
            last = starts[number] + length - float(np.mean(CAB_AXLES_M))
        middle = float(starts[number] + length / 2)
        found.append(Body(_part(name, number), middle, (float(first), float(last))))
    return tuple(found)


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
    """Return the measures of one body: its shell lies between its bellows."""
    length, width, height = size
    ahead, behind = (0.0 if front else BELLOWS_M), (0.0 if rear else BELLOWS_M)
    inner, roof = length - ahead - behind, height - ROOF_M
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
    # A point's tag is that of the edge which leaves it.
    upper = first + [[x, z, tag] for (x, z), tag in zip(last, [*tags[1:], "under"], strict=True)]
    begin, end = (1.5 if front else 0.35), inner - (1.5 if rear else 0.35)
    count = max(1, round((end - begin) / (WINDOW_M + PILLAR_M)))
    step = (end - begin) / count
    windows, doors = [], []
    for k in range(count):
        x0, x1 = begin + k * step + PILLAR_M / 2, begin + (k + 1) * step - PILLAR_M / 2
        if k % 3 == 1 and not any(x0 - 0.5 < x - ahead < x1 + 0.5 for x in axles):
            doors.append([[x0, 0.48], [x0, 2.55], [x1, 2.55], [x1, 0.48]])
        else:
            windows.append([[x0, 1.15], [x0, 2.55], [x1, 2.55], [x1, 1.15]])
    clear = np.arange(1.9, inner - 1.0, 1.7).tolist()
    shell = {
        "size": [inner, width, roof],
        "wheels": {**wheels, "axles": [x - ahead for x in axles]},
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
        "shift": (behind - ahead) / 2,
        "cabs": (front, rear),
    }
