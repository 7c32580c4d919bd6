"""Fresnel reflection and transmission of smooth water and glass.

Fresnel's equations for unpolarised light (Born and Wolf 1999, Principles of Optics, 7th edition,
section 1.5.2). Refractive indices: water 1.33 at 905 nm and 1.32 at 1550 nm (Hale and Querry 1973,
Appl. Opt. 12, 555-563), glass 1.51 (Schott N-BK7).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["N_GLASS", "N_WATER", "mirrored", "pane"]

N_WATER = 1.33
N_GLASS = 1.51

Floats = NDArray[np.float64]


def mirrored(cosine: Floats, index: float) -> Floats:
    """Return the share (N,) of light that a boundary of air mirrors.

    Args:
        cosine: (N,) of the angle of incidence in air, 0..1.
        index: refractive index of what lies behind the boundary.
    """
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return np.asarray((across**2 + along**2) / 2)


def pane(cosine: Floats, index: float = N_GLASS) -> Floats:
    """Return the share (N,) of light that passes both faces of a pane that absorbs nothing.

    With the light that goes to and fro inside: ``(1 - r) / (1 + r)`` of each polarisation's r.
    """
    inside = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = ((cosine - index * inside) / (cosine + index * inside)) ** 2
    along = ((index * cosine - inside) / (index * cosine + inside)) ** 2
    return np.asarray(((1 - across) / (1 + across) + (1 - along) / (1 + along)) / 2)
