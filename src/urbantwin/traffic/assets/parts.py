"""The parts that the catalogue spells out in its entries: blocks, tubes, hulls and balls.

Places are [metres behind the nose, metres to the left, metres above the ground]. A part that lies
to the left of the middle (its first y is positive) also stands on the right, mirrored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.assets.loft import loft, superellipse
from urbantwin.traffic.assets.primitive import box, cylinder, ellipsoid
from urbantwin.traffic.assets.solid import Solid

__all__ = ["parts", "place"]

#: Corners of a hull's sections.
HULL_SIDES = 16


def parts(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the parts of an entry.

    Its keys, each a list:

    - ``blocks``: [x from, to], [y from, to], [z from, to], material;
    - ``tubes``: place, place, radius, material: a cylinder between two places;
    - ``hulls``: material, power of the section's superellipse (2 an ellipse, 4 a rounded
      rectangle), then the stations from the nose backwards: metres behind the nose, height of
      the middle, half-height, half-width;
    - ``balls``: place, half axes [x, y, z], material.
    """
    length = entry["size"][0]
    solids = []
    for (start, end), (right, left), (low, high), material in entry.get("blocks", ()):
        size = [end - start, left - right, high - low]
        middle = [(start + end) / 2, (left + right) / 2, (low + high) / 2]
        solids += _both(box(size, place(middle, length), material), right)
    for start, end, radius, material in entry.get("tubes", ()):
        sides = 6 if radius < 0.03 else 12
        ends = place(start, length), place(end, length)
        solids += _both(cylinder(*ends, radius, material, sides=sides), start[1])
    for material, power, *stations in entry.get("hulls", ()):
        solids.append(_hull(stations, power, material, length))
    for middle, radii, material in entry.get("balls", ()):
        ball = ellipsoid(radii, place(middle, length), material, sides=10, rings=5)
        solids += _both(ball, middle[1])
    return solids


def place(behind_left_up: Sequence[float], length: float) -> NDArray[np.float64]:
    """Return a place (3,) of the catalogue in the asset frame."""
    behind, left, up = behind_left_up
    return np.array([length / 2 - behind, left, up])


def _both(solid: Solid, y: float) -> list[Solid]:
    return [solid, solid.mirrored()] if y > 0 else [solid]


def _hull(stations: Sequence[Sequence[float]], power: float, material: str, length: float) -> Solid:
    sections = []
    for behind, z, half_height, half_width in stations[::-1]:
        oval = superellipse(half_width, half_height, sides=HULL_SIDES, power=power)
        x = np.full(len(oval), length / 2 - behind)
        sections.append(np.column_stack([x, oval[:, 0], z + oval[:, 1]]))
    return loft(sections, material)
