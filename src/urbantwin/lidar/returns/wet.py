"""Wet ground: a film of water darkens it, and mirrors more the flatter the beam.

Inside the film light that was scattered is thrown back at the surface and hits the ground again,
so a wet surface of reflectivity r has ``r / (r + n^2 (1 - r))`` (Angstrom 1925, Geogr. Ann. 7,
323-342; Lekner and Dorf 1988, Appl. Opt. 27(7), 1278-1280, discuss it). What the beam loses at the
film's face on its way in and out by Fresnel's equations, relative to facing it squarely, is
mirrored away to where no receiver looks. At 1550 nm water absorbs as well: 10.6 per cm (Hale and
Querry 1973, Appl. Opt. 12, 555-563: k of 1.3e-4), at 905 nm less than 0.1 per cm.

Glass beads that lie under water do not retroreflect: EN 1436 wants 25 mcd/m2/lx of wet lines
(class RW1) where dry ones have 100 (R2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.fresnel import N_WATER, mirrored

__all__ = ["FILM_M", "WET_BEADS", "film_passes", "wet_reflectivity"]

#: Thickness of a full film of water.
FILM_M = 3e-4
#: Share of their retroreflection that beads keep in it.
WET_BEADS = 0.25

_K_NM = np.array([800.0, 905.0, 1064.0, 1300.0, 1550.0])
_K = np.array([1.25e-7, 4.9e-7, 1.2e-6, 1.1e-5, 1.3e-4])

Floats = NDArray[np.float64]


def wet_reflectivity(dry: Floats, wavelength_nm: float) -> Floats:
    """Return the diffuse reflectivity (N,) under a full film, of dry reflectivities (N,)."""
    k = float(np.exp(np.interp(wavelength_nm, _K_NM, np.log(_K))))
    absorbed = np.exp(-2 * FILM_M * 4 * np.pi * k / (wavelength_nm * 1e-9))
    return np.asarray(dry / (dry + N_WATER**2 * (1 - dry)) * absorbed)


def film_passes(cosine: Floats) -> Floats:
    """Return what of a beam passes the film's face in and out, relative to facing it squarely."""
    passes = 1 - mirrored(cosine, N_WATER)
    return np.asarray((passes / (1 - mirrored(np.ones(1), N_WATER))) ** 2)
