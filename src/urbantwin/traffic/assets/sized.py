"""Sized assets: a mesh of the catalogue stretched to the size of one actor.

An asset of another size is named ``car-sedan_black@4.70x1.85x1.45``: length, width and height in
metres, in centimetres' steps, so that actors of the same size share a mesh.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from urbantwin.geometry import LabelledMesh

__all__ = ["bare_of_sized", "sized_mesh", "sized_name"]

_SIZED = re.compile(r"(.+)@(\d+\.\d\d)x(\d+\.\d\d)x(\d+\.\d\d)")


def sized_name(name: str, length: float, width: float, height: float) -> str:
    """Return the name of an asset with another size, metres; at least a centimetre each way."""
    sides = (max(side, 0.01) for side in (length, width, height))
    return f"{name}@{'x'.join(f'{side:.2f}' for side in sides)}"


def bare_of_sized(name: str) -> tuple[str, tuple[float, float, float] | None]:
    """Return an asset's name without its size, and the size; ``None`` for one without."""
    found = _SIZED.fullmatch(name)
    if found is None:
        return name, None
    return found[1], (float(found[2]), float(found[3]), float(found[4]))


def sized_mesh(mesh: LabelledMesh, factors: tuple[float, float, float]) -> LabelledMesh:
    """Return a mesh stretched along its axes by factors."""
    return replace(mesh, vertices=mesh.vertices * np.array(factors))
