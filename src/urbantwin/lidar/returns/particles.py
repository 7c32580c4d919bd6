"""Drops, flakes and fog between sensor and target: how many, and how bright.

**Rain.** Drops have the exponential sizes of Marshall and Palmer 1948 (J. Meteorol. 5, 165-166):
``N0 exp(-L D)`` with N0 = 8000 per m3 and mm, L = 4.1 R^-0.21 per mm at R mm/h. A drop much larger
than the wavelength takes twice its cross-section from a beam (Van de Hulst 1957, Light Scattering
by Small Particles, section 8.1), so the extinction is ``2 pi/4 x integral of D^2 N = pi N0 / L^3``:
the visibility gives L, and L gives the rate. Backwards a drop sends what its front mirrors and
what its rear mirrors and focuses: ``F + F (1 - F)^2 (n / (2 - n))^2`` times as much as a sphere
that scatters evenly, with Fresnel's F and the water's n (Van de Hulst, section 12.22): 0.095 of it.

**Snow.** Gunn and Marshall 1958 (J. Meteorol. 15, 452-461): N0 = 3800 R^-0.87, L = 2.55 R^-0.48, D
of the melted drop; a flake of a tenth of water's density is ``10^(1/3)`` times as wide. It is a
white ball: two thirds of snow's reflectivity, seen from the light (Lambert's sphere; Hapke 2012,
Theory of Reflectance and Emittance Spectroscopy, 2nd edition, section 6.2).

**Fog** has too many droplets to tell apart; its backscatter per metre and steradian is its
extinction divided by 18.8 sr (O'Connor et al. 2004, J. Atmos. Ocean. Technol. 21, 777-786: water
clouds at 905 nm).

Amplitude, as everywhere, is relative to a white surface that fills the beam.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from urbantwin.lidar.returns.fresnel import N_WATER, mirrored
from urbantwin.taxonomy import materials

__all__ = [
    "FOG_RATIO_SR",
    "Particles",
    "fog_amplitude",
    "rain",
    "snow",
    "snow_rate_mm_h",
]

#: Extinction of fog relative to its backscatter.
FOG_RATIO_SR = 18.8
_RAIN_N0 = 8000.0
_FLAKE_WIDTH = 10 ** (1 / 3)


class Particles(NamedTuple):
    """Spheres of exponential sizes.

    Attributes:
        n0: of diameter 0, per m3 and m.
        slope: by which numbers fall with diameter, 1/m.
        white: a sphere that fills the beam is as bright as a surface of this reflectivity.
    """

    n0: float
    slope: float
    white: float

    @property
    def extinction(self) -> float:
        """What they take from a beam, 1/m."""
        return np.pi * self.n0 / self.slope**3


def rain(extinction: float) -> Particles:
    """Return the drops of rain with an extinction in 1/m."""
    n0 = _RAIN_N0 * 1e3
    front = float(mirrored(np.ones(1), N_WATER)[0])
    gain = front + front * (1 - front) ** 2 * (N_WATER / (2 - N_WATER)) ** 2
    return Particles(n0, (np.pi * n0 / extinction) ** (1 / 3), gain / 4)


def snow_rate_mm_h(extinction: float) -> float:
    """Return the rate of snow with an extinction in 1/m, mm of water per hour."""
    # pi (N0 / w) / (L / w)^3 with w the width of flakes, in mm2 per m3.
    of_one = np.pi * 3800.0 / 2.55**3 * _FLAKE_WIDTH**2 * 1e-6
    return float((extinction / of_one) ** (1 / (3 * 0.48 - 0.87)))


def snow(extinction: float, wavelength_nm: float) -> Particles:
    """Return the flakes of snow with an extinction in 1/m."""
    rate = snow_rate_mm_h(extinction)
    n0 = 3800.0 * rate**-0.87 / _FLAKE_WIDTH * 1e3
    slope = 2.55 * rate**-0.48 / _FLAKE_WIDTH * 1e3
    return Particles(n0, slope, 2 / 3 * materials()["snow"].reflectivity_at(wavelength_nm))


def fog_amplitude(extinction: float, cell_m: float) -> float:
    """Return the amplitude of fog from a length of beam that comes back as one echo."""
    return np.pi * extinction / FOG_RATIO_SR * cell_m
