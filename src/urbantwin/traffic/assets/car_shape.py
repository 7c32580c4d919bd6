"""Cars and vans generated from a few measures: outline, windows, widths, wheels and seats.

A shape is a list of measures of the side view, ordered from nose to tail: lengths in metres behind
the nose, and heights in metres; see `CarShape`. The result is a complete entry of the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

__all__ = ["CarShape", "drawn"]

#: Distance from the roof's outline to the windows, and between windows, metres.
_FRAME_M, _PILLAR_M = 0.075, 0.11
#: Distance from the belt line up to the windows, and of the bonnet's front edge behind the nose,
#: metres.
_SEAL_M, _BONNET_M = 0.02, 0.16
#: Least area of a window, square metres.
_LEAST_WINDOW_M2 = 0.03


@dataclass(frozen=True)
class CarShape:
    """The side view of a car. Lengths are metres behind the nose.

    Attributes:
        axles: front and rear.
        wheel: diameter.
        clearance: height of the sills.
        nose: height of the bonnet's front edge.
        cowl: foot of the windscreen: behind the nose, height.
        header: top of the windscreen.
        roof: highest point of the roof, behind the nose; its height is the car's.
        rear: end of the roof.
        glass: foot of the rear window, where the tail or the boot begins.
        deck: end of the boot, or of a pickup's bed; ``None``: the tail begins at ``glass``.
        back: material of the rear window: ``windscreen`` for glass, ``paint`` for a closed back.
        pillars: pillars between the side windows.
        windows: begin and end of the side windows, behind the nose; ``None``: the whole cabin.
        rows: rows of seats.
        tumblehome: width of the roof as a share of the largest width.
        round: length of the rounding of nose and tail in plan.
        roofless: whether the top is folded: the roof is the windows' upper edge.
    """

    axles: tuple[float, float]
    wheel: float
    cowl: tuple[float, float]
    header: tuple[float, float]
    roof: float
    rear: tuple[float, float]
    glass: tuple[float, float]
    nose: float = 0.72
    clearance: float = 0.19
    deck: tuple[float, float] | None = None
    back: str = "windscreen"
    pillars: tuple[float, ...] = ()
    windows: tuple[float, float] | None = None
    rows: tuple[float, ...] = ()
    tumblehome: float = 0.66
    round: float = 0.25


def drawn(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry completed from its ``shape``; entries without a shape are copied."""
    if "shape" not in entry:
        return dict(entry)
    length, _, height = entry["size"]
    measures: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in entry["shape"].items()
    }
    shape = CarShape(**measures)
    upper = _upper(shape, length, height)
    sill, cowl_z = shape.clearance, shape.cowl[1]
    tyre = 0.14 + 0.13 * shape.wheel
    wheels = {
        "axles": list(shape.axles),
        "diameter": shape.wheel,
        "width": round(tyre, 3),
        "arch": round(shape.wheel / 2 + 0.045, 3),
    }
    square = shape.tumblehome > 0.82
    return {
        "wheels": wheels,
        "upper": upper,
        "windows": _windows(shape, upper),
        "section": [
            [sill, 0.91],
            [sill + 0.22, 0.985],
            [max(0.42 * height, sill + 0.3), 1.0],
            [max(0.92 * cowl_z, 0.42 * height + 0.15), 0.985],
            [max(cowl_z + 0.04, 0.42 * height + 0.25), 0.96 if square else 0.91],
            [height, shape.tumblehome],
        ],
        "plan": [
            [0, 0.85],
            [shape.round, 0.94],
            [3 * shape.round, 1.0],
            [length - (0.4 if square else 3) * shape.round, 1.0],
            [length - (0.2 if square else 1.2) * shape.round, 0.985 if square else 0.95],
            [length, 0.96 if square else 0.87],
        ],
        "edge": 0.085,
        "bulge": [0.11, 0.03 if square else 0.06],
        "mirror": [shape.cowl[0] + 0.6 * (shape.header[0] - shape.cowl[0]), cowl_z + 0.08],
        "seats": list(shape.rows),
        **entry,
    }


def _upper(shape: CarShape, length: float, height: float) -> list[list[Any]]:
    """Return the upper outline: distance behind the nose, height, and tag of the next edge."""
    sill, (cx, cz), (hx, hz) = shape.clearance, shape.cowl, shape.header
    (rx, rz), (gx, gz) = shape.rear, shape.glass
    bumper = min(0.40, 0.5 * shape.nose)
    # Nose and tail are cut back below, but not as far as the wheel arches.
    arch = 0.5 * shape.wheel + 0.08
    front = min(0.09, shape.axles[0] - arch)
    tail_cut = min(0.08, length - shape.axles[1] - arch)
    points: list[list[Any]] = [
        [front, sill, "dark"],
        [0.02, sill + 0.4 * (bumper - sill) + 0.04, "grille"],
        [0.00, bumper + 0.08, "grille"],
        [0.055, bumper + 0.6 * (shape.nose - bumper) + 0.03, "grille-lamps"],
        [_BONNET_M, shape.nose, "paint"],
    ]
    # The bonnet bulges slightly between its front edge and the foot of the windscreen.
    for share in (0.35, 0.7):
        z = shape.nose + (cz - shape.nose) * share**0.7
        points.append([_BONNET_M + (cx - _BONNET_M) * share, z, "paint"])
    points.append([cx, cz, "windscreen"])
    points.append([(cx + hx) / 2, (cz + hz) / 2 + 0.025, "windscreen"])
    points.append([hx, hz, "paint"])
    points.append([(hx + shape.roof) / 2, hz + 0.78 * (height - hz), "paint"])
    points.append([shape.roof, height, "paint"])
    middle = (shape.roof + rx) / 2
    points.append([middle, height - 0.30 * (height - rz), "paint"])
    points.append([rx, rz, shape.back])
    end = shape.deck or (gx, gz)
    if shape.deck is not None:
        points.append([gx, gz, "paint"])
    points.append([*end, "lamps"])
    low = min(end[1] - 0.15, 0.62)
    points.append([(end[0] + length) / 2, (end[1] + low) / 2, "paint"])
    # The bumper protrudes most, near the height of the impactor of UN Regulation 42 (0.445 m).
    points.append([length - 0.045, low, "paint"])
    points.append([length, min(max(sill + 0.22, 0.30 * height), low - 0.12), "dark"])
    points.append([length - 0.015, sill + 0.10, "dark"])
    points.append([length - tail_cut, sill + 0.02, "under"])
    return points


def _windows(shape: CarShape, upper: list[list[Any]]) -> list[list[list[float]]]:
    """Return the side windows: the cabin above its belt line, within a frame, between pillars."""
    outline = shapely.Polygon([(x, z) for x, z, _ in upper]).buffer(0)
    (cx, cz), (gx, gz) = shape.cowl, shape.glass
    belt_rear = max(gz, cz) if shape.deck is None else min(gz, cz + 0.06)
    left, right = cx - 1.0, gx + 1.0
    slope = (belt_rear - cz) / (gx - cx)
    above = shapely.Polygon(
        [
            (left, cz + _SEAL_M + slope * (left - cx)),
            (right, cz + _SEAL_M + slope * (right - cx)),
            (right, 9.0),
            (left, 9.0),
        ]
    )
    # A curved pillar beside the windscreen, and an equally wide one beside the rear window.
    first, last = shape.windows or (cx, gx)
    cabin = outline.buffer(-_FRAME_M, join_style="mitre") & above
    cabin &= shapely.box(first + 0.02, 0.0, last - 0.02, 9.0)
    cut = [shapely.box(x - _PILLAR_M / 2, 0.0, x + _PILLAR_M / 2, 9.0) for x in shape.pillars]
    glass = cabin - shapely.union_all(cut) if cut else cabin
    # Remove slivers beside a pillar.
    glass = glass.buffer(-0.03, join_style="mitre").buffer(0.03, join_style="mitre")
    windows = []
    for piece in shapely.get_parts(glass):
        if piece.geom_type == "Polygon" and piece.area > _LEAST_WINDOW_M2:
            corners = np.round(shapely.get_coordinates(piece.exterior.simplify(0.012))[:-1], 3)
            windows.append(corners.tolist())
    return sorted(windows)
