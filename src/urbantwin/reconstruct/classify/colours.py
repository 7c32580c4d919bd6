"""Material of a surface from its colour (table: ``colours.csv``)."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.classify.names import table
from urbantwin.taxonomy import material_id

__all__ = ["default_material", "hsv", "is_green", "material_of_colour"]

_DEFAULT = {"roof": "roofing", "wall": "plaster", "plant": "foliage", "thing": "metal-painted"}


def default_material(where: str) -> int:
    """Return the material of a surface without colour."""
    return material_id(_DEFAULT[where])


@cache
def _rows(where: str) -> tuple[tuple[tuple[float, ...], int], ...]:
    bounds = ("hue_from", "hue_to", "saturation_from", "saturation_to", "value_from", "value_to")
    return tuple(
        (tuple(float(row[name]) for name in bounds), material_id(row["material"]))
        for row in table("colours.csv")
        if row["where"] == where
    )


def hsv(colour: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return hue (degrees), saturation and value (0..1) of (N, 3) sRGB colours."""
    rgb = colour.astype(np.float64) / 255
    high, low = rgb.max(axis=1), rgb.min(axis=1)
    span = np.where(high > low, high - low, 1.0)
    r, g, b = rgb.T
    hue = np.select(
        [high == r, high == g], [(g - b) / span % 6, (b - r) / span + 2], (r - g) / span + 4
    )
    saturation = np.where(high > 0, (high - low) / np.where(high > 0, high, 1.0), 0.0)
    return np.column_stack([60 * hue, saturation, high])


def is_green(colour: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the mask of green colours (N, 3), by the excess green of Woebbecke (1995)."""
    total = np.maximum(colour.sum(axis=1, dtype=np.float64), 1.0)
    r, g, b = (colour[:, k] / total for k in range(3))
    return np.asarray((2 * g - r - b > 0.06) & (g >= r) & (total > 30))


def material_of_colour(where: str, colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the material (N,) of surfaces of colours (N, 3).

    Args:
        where: ``roof``, ``wall``, ``plant`` or ``thing``.
        colour: sRGB.
    """
    hue, saturation, value = hsv(colour).T
    out = np.full(len(colour), default_material(where), np.uint8)
    free = np.ones(len(colour), bool)
    for (h0, h1, s0, s1, v0, v1), material in _rows(where):
        within = (hue >= h0) & (hue <= h1) if h0 <= h1 else (hue >= h0) | (hue <= h1)
        fits = free & within & (saturation >= s0) & (saturation < s1)
        fits &= (value >= v0) & (value < v1)
        out[fits] = material
        free &= ~fits
    return out
