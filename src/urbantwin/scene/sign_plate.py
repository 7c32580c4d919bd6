"""Plates of traffic signs, shaped by their meaning, one below the other."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from urbantwin.scene.solids import Assembly, Solid, box, sweep
from urbantwin.scene.tag_values import count_of

__all__ = ["add_plates", "stack_m"]

#: Sizes of urban streets (VwV-StVO size 2, MUTCD table 2B-1 rounded), metres.
DISC_M, OCTAGON_M, TRIANGLE_M, BOARD_M = 0.6, 0.75, 0.9, (0.6, 0.35)
HEIGHTS_M = {
    "disc": DISC_M,
    "octagon": OCTAGON_M,
    "up": 0.87 * TRIANGLE_M,
    "down": 0.87 * TRIANGLE_M,
    "board": BOARD_M[1],
}
MOST, GAP_M = 4, 0.03
#: No plate hangs lower than this, whatever the mapped height of its post.
LOWEST_M = 1.5


def add_plates(
    assembly: Assembly,
    foot: NDArray[np.float64],
    tags: Mapping[str, str],
    part: int,
    yaw: float,
    top: float,
    off: float,
) -> None:
    """Add the plates of ``traffic_sign``, ``traffic_sign:2``, ... to a pole.

    Args:
        assembly: where to.
        foot: (3,) the pole's, on the ground.
        tags: the node's.
        part: number of the pole's part.
        yaw: where the plates look, radians.
        top: height of the upper edge of the first, metres.
        off: how far they are from the pole's axis, metres.
    """
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    for number, said in enumerate(_signs(tags)):
        shape = _shape(said, number)
        tall = HEIGHTS_M[shape]
        if number and top - tall < LOWEST_M:
            return
        middle = foot + [0, 0, top - tall / 2] + off * ahead
        assembly.add(_plate(shape, middle, ahead, yaw), "traffic-sign", "retroreflector", part)
        top -= tall + GAP_M


def stack_m(tags: Mapping[str, str]) -> float:
    """Return how high all plates of a node are together, metres."""
    shapes = [_shape(said, number) for number, said in enumerate(_signs(tags))]
    return sum(HEIGHTS_M[shape] + GAP_M for shape in shapes)


def _signs(tags: Mapping[str, str]) -> list[str]:
    """Return what the plates say, the uppermost first."""
    first = re.split(r"[;,](?![^\[]*\])", tags.get("traffic_sign", ""))
    further = [tags[key] for key in sorted(tags) if re.fullmatch(r"traffic_sign:\d", key)]
    return [said for said in (*first, *further) if said][:MOST] or ["sign"]


def _shape(said: str, number: int) -> str:
    """Return a plate's shape; without a word for it discs, and boards under the first."""
    word = said.lower().split(":")[-1]
    if word in ("stop", "206", "r1-1") and not number:
        return "octagon"
    if word in ("give_way", "yield", "205", "r1-2"):
        return "down"
    if word in ("hazard", "warning") or re.fullmatch(r"1\d\d(\D.*)?", word):
        return "up"  # Vienna Convention numbering of DE, FI, AT and others: 1xx are warnings
    if word in ("city_limit", "maxspeed", "overtaking"):
        return "board" if word == "city_limit" else "disc"
    if re.fullmatch(r"([3-9]\d\d|10\d\d).*", word) and (number or not word.startswith("3")):
        return "board"
    return "board" if number and count_of(word) is None and ":" not in said else "disc"


def _plate(
    shape: str, middle: NDArray[np.float64], ahead: NDArray[np.float64], yaw: float
) -> Solid:
    if shape == "board":
        return box(middle, [0.02, *BOARD_M], yaw)
    corners, first, radius = {
        "disc": (12, 15.0, DISC_M / 2),
        "octagon": (8, 22.5, OCTAGON_M / 2),
        "up": (3, 90.0, TRIANGLE_M / 3**0.5),
        "down": (3, -90.0, TRIANGLE_M / 3**0.5),
    }[shape]
    angle = np.radians(first + np.arange(corners) * 360.0 / corners)
    outline = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    # Seen along the path the outline must run counter-clockwise: left is to the left.
    return sweep([middle - 0.01 * ahead, middle + 0.01 * ahead], -outline * [1, -1])
