"""Lofts: a closed solid through cross-sections (torso, shoe, fuel tank, saddle)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.traffic.assets.solid import Solid

__all__ = ["loft", "superellipse"]


def superellipse(
    half_width: float, half_depth: float, *, sides: int, power: float = 2.0
) -> NDArray[np.float64]:
    """Return (sides, 2) corners of |u/a|^p + |v/b|^p = 1, counter-clockwise from +u.

    Power 2 is the ellipse, 4 a rounded rectangle.
    """
    angle = np.arange(sides) * (2 * np.pi / sides)
    cos, sin = np.cos(angle), np.sin(angle)
    radius = (np.abs(cos) ** power + np.abs(sin) ** power) ** (-1 / power)
    return np.column_stack([half_width * radius * cos, half_depth * radius * sin])


def loft(sections: Sequence[ArrayLike], material: str | Sequence[str]) -> Solid:
    """Return the solid through cross-sections of equally many corners, its ends closed.

    Args:
        sections: each (S, 3), metres, counter-clockwise seen from the last section's side.
        material: of the whole, or of each of the bands between sections; the ends take the
            first and the last band's.
    """
    rings = np.array([np.asarray(section, np.float64) for section in sections])
    count, sides, _ = rings.shape
    names = [material] * (count - 1) if isinstance(material, str) else list(material)
    here, after = np.arange(sides), np.roll(np.arange(sides), -1)
    centre_low, centre_high = count * sides, count * sides + 1
    faces = [np.column_stack([np.full(sides, centre_low), after, here])]
    labels = [names[0]] * sides
    for band, name in enumerate(names):
        below, above = band * sides, (band + 1) * sides
        faces.append(np.column_stack([below + here, below + after, above + after]))
        faces.append(np.column_stack([below + here, above + after, above + here]))
        labels += [name] * (2 * sides)
    last = (count - 1) * sides
    faces.append(np.column_stack([last + here, last + after, np.full(sides, centre_high)]))
    labels += [names[-1]] * sides
    middles = [rings[0].mean(axis=0), rings[-1].mean(axis=0)]
    return Solid.build(
        np.concatenate([rings.reshape(-1, 3), middles]), np.concatenate(faces), labels
    )
