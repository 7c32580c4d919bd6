"""Pieces of furniture in a local frame: x in the direction of their front, z up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.scene.solids import Assembly, Solid, box, columns

__all__ = ["Piece", "add_pieces", "block", "drum", "moved", "turned"]

#: Depth of objects in the ground, metres.
BURIED_M = 0.3


@dataclass(frozen=True, eq=False)
class Piece:
    """A solid with its labels."""

    solid: Solid
    semantic: str
    material: str


def block(
    centre: ArrayLike,
    size: ArrayLike,
    material: str,
    semantic: str = "other-object",
    yaw: float = 0.0,
) -> Piece:
    """Return a box; ``centre`` is its middle in plan and its lower end in height.

    A box on the ground (lower end at 0) extends into it.
    """
    x, y, low = np.asarray(centre, np.float64)
    long, wide, tall = np.asarray(size, np.float64)
    if low <= 0:
        low, tall = low - BURIED_M, tall + BURIED_M
    return Piece(box([x, y, low + tall / 2], [long, wide, tall], yaw), semantic, material)


def drum(
    foot: ArrayLike,
    height: float,
    radius: float,
    material: str,
    semantic: str = "other-object",
    top: float | None = None,
    sides: int = 10,
) -> Piece:
    """Return a vertical cylinder or cone; if its lower end is on the ground it extends into it."""
    x, y, low = np.asarray(foot, np.float64)
    if low <= 0:
        low, height = low - BURIED_M, height + BURIED_M
    over = radius if top is None else top
    return Piece(columns([x, y, low], height, radius, over, sides), semantic, material)


def moved(piece: Piece, by: ArrayLike) -> Piece:
    """Return a piece shifted in its own frame."""
    solid = Solid(piece.solid.vertices + np.asarray(by, np.float64), piece.solid.faces)
    return Piece(solid, piece.semantic, piece.material)


def turned(piece: Piece, yaw: float) -> Piece:
    """Return a piece rotated about the vertical axis of its own frame, radians."""
    return Piece(_placed(piece.solid, np.zeros(3), yaw), piece.semantic, piece.material)


def add_pieces(
    assembly: Assembly, pieces: list[Piece], foot: NDArray[np.float64], yaw: float
) -> int:
    """Add an object of several pieces at a point (3,) with the heading ``yaw``; return its part."""
    part = assembly.new_part()
    for piece in pieces:
        assembly.add(_placed(piece.solid, foot, yaw), piece.semantic, piece.material, part)
    return part


def _placed(solid: Solid, foot: NDArray[np.float64], yaw: float) -> Solid:
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Solid(solid.vertices @ turn + foot, solid.faces)
