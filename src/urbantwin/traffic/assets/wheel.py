"""Wheels: a tyre with rounded shoulders and a dished rim, as one closed solid."""

from __future__ import annotations

import numpy as np

from urbantwin.geometry import rotation_from_ypr
from urbantwin.traffic.assets.primitive import turned
from urbantwin.traffic.assets.solid import Solid

__all__ = ["wheel"]


def wheel(
    diameter: float,
    width: float,
    *,
    rim: float = 0.66,
    dish: float = 0.15,
    sides: int = 20,
) -> Solid:
    """Return a wheel that stands on z = 0, its axle along y through x = y = 0, outside at +y.

    Args:
        diameter: of the tyre, metres.
        width: of the tyre, metres.
        rim: the rim's diameter as part of the tyre's.
        dish: depth of the rim's face behind the sidewall, as part of the width.
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
    # z (the axle) goes to +y; the corner on +x goes to +x, those of +-y to -+z.
    return lying.rotated(rotation_from_ypr(0, 0, -np.pi / 2)).moved([0, 0, r])
