"""The atmosphere: extinction, and echoes of rain, snow and fog that a sensor takes for a target.

**Extinction.** Visibility V is the meteorological optical range of the WMO (Guide to Instruments
and Methods of Observation, WMO-No. 8, chapter 9): the distance at which a collimated beam falls to
5 %, so that by Koschmieder's law the extinction of visible light is ``-ln(0.05) / V = 3.0 / V``.
Drops of fog, rain and snow are larger than the wavelength and attenuate all LiDARs alike. Haze
attenuates less at longer wavelengths: ``(wavelength / 550 nm)^-q`` with the q of Kim, McArthur and
Korevaar 2001 (Proc. SPIE 4214, 26-37, eq. 4): 0 below 0.5 km of visibility, V - 0.5 up to 1 km,
0.16 V + 0.34 up to 6 km, 1.3 up to 50 km, 1.6 beyond.

**Rain.** Drop sizes are exponential (Marshall and Palmer 1948, J. Meteorol. 5, 165-166): ``N0
exp(-L D)`` with N0 = 8000 per m3 and mm, L = 4.1 R^-0.21 per mm at R mm/h. A drop much larger than
the wavelength removes twice its cross-section (Van de Hulst 1957, Light Scattering by Small
Particles, section 8.1), so the extinction is ``2 pi/4 x integral of D^2 N = pi N0 / L^3``:
visibility gives L, and L the rate. Backwards a drop returns what its front reflects and its rear
reflects and focuses: ``F + F (1 - F)^2 (n / (2 - n))^2`` times an isotropic sphere, with Fresnel's
F and the refractive index n of water (Van de Hulst, section 12.22): 0.095.

**Snow.** Gunn and Marshall 1958 (J. Meteorol. 15, 452-461): N0 = 3800 R^-0.87, L = 2.55 R^-0.48, D
of the melted drop; a flake of a tenth of water's density is ``10^(1/3)`` times as wide. It is a
white sphere: two thirds of snow's reflectivity in backscatter (Lambert's sphere; Hapke 2012, Theory
of Reflectance and Emittance Spectroscopy, 2nd edition, section 6.2).

**Fog** backscatters, per metre and steradian, its extinction divided by 18.8 sr (O'Connor et al.
2004, J. Atmos. Ocean. Technol. 21, 777-786: water clouds at 905 nm).

**Detection.** Detected drops and flakes along a beam are a Poisson process with rate per metre
``cross-section of the beam x integral of N(D) p(strength of D) dD``, with the sensor's detection
probability p; the nearest is drawn. Fog returns in every pulse length `CELL_M`. The measured
strength of each scatters as the detection curve says (p of a threshold is the probability to exceed
it); the length with the highest measured strength is drawn, and a uniform position within it.

**Near range.** Collected power does not keep growing with 1/range^2: the image of a near object is
larger than the detector of a receiver focused far away, which collects only ``range^2 / (range^2 +
focus^2)`` (geometric form factor of coaxial lidars, Measures 1984, Laser Remote Sensing, section
7.3; here with soft edges). This matters for drops and fog only. No maker publishes the focus: we
take the one at which nothing below `FAINTEST` of white reaches strength 1 at any range. Then fog
blinds the sensor below visibilities of about 40 m, as in a fog chamber (Bijelic et al. 2018, IEEE
IV, "A benchmark for lidar sensors in fog").

A beam is `EXIT_M` wide where it leaves the sensor (datasheet of the OS1) and widens by its
divergence.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.response import Response, probabilities, strengths
from urbantwin.lidar.returns.draws import LEVELS, Draws
from urbantwin.lidar.returns.scatter import N_WATER, mirrored
from urbantwin.lidar.sensor import Sensor
from urbantwin.site.rig import Conditions
from urbantwin.taxonomy import materials

__all__ = [
    "CELL_M",
    "CONTRAST",
    "DEFAULT_VISIBILITY_M",
    "EXIT_M",
    "FAINTEST",
    "FOG_RATIO_SR",
    "Clutter",
    "Particles",
    "beam_area",
    "clutter_of",
    "collected",
    "extinction",
    "fog_amplitude",
    "haze_exponent",
    "rain",
    "snow",
    "snow_rate_mm_h",
    "visibility",
]

#: Transmission at the visibility (WMO).
CONTRAST = 0.05
#: Default visibility by weather, metres: a shower of 9 mm/h (`rain`), and typical fog and snow.
DEFAULT_VISIBILITY_M = {"rain": 2000.0, "fog": 150.0, "snow": 700.0}


def visibility(conditions: Conditions) -> float | None:
    """Return the visibility in metres; ``None`` in clear air without a given one."""
    if conditions.visibility_m is not None:
        return conditions.visibility_m
    return DEFAULT_VISIBILITY_M.get(conditions.weather)


def haze_exponent(visibility_m: float) -> float:
    """Return Kim's exponent q."""
    km = visibility_m / 1000
    ends = [0.0, 0.5, 1.0, 6.0]
    if km > ends[-1]:
        return 1.6 if km > 50 else 1.3
    return float(np.interp(km, ends, [0.0, 0.0, 0.5, 1.3]))


def extinction(conditions: Conditions, wavelength_nm: float) -> float:
    """Return the extinction in 1/m; 0 in clear air without a given visibility.

    Datasheets' ranges are measured in clear air and include its extinction.
    """
    visibility_m = visibility(conditions)
    if visibility_m is None:
        return 0.0
    visible = -np.log(CONTRAST) / visibility_m
    if conditions.weather != "clear":
        return float(visible)
    return float(visible * (wavelength_nm / 550.0) ** -haze_exponent(visibility_m))


#: Extinction-to-backscatter ratio of fog, sr.
FOG_RATIO_SR = 18.8
_RAIN_N0 = 8000.0
_FLAKE_WIDTH = 10 ** (1 / 3)


class Particles(NamedTuple):
    """Spheres with exponentially distributed diameters.

    Attributes:
        n0: number density at diameter 0, per m3 and m.
        slope: decay of the number with diameter, 1/m.
        white: reflectivity of a surface as bright as a sphere that fills the beam.
    """

    n0: float
    slope: float
    white: float

    @property
    def extinction(self) -> float:
        """Extinction, 1/m."""
        return np.pi * self.n0 / self.slope**3


def rain(extinction: float) -> Particles:
    """Return the drops of rain with an extinction in 1/m."""
    n0 = _RAIN_N0 * 1e3
    front = float(mirrored(np.ones(1), N_WATER)[0])
    gain = front + front * (1 - front) ** 2 * (N_WATER / (2 - N_WATER)) ** 2
    return Particles(n0, (np.pi * n0 / extinction) ** (1 / 3), gain / 4)


def snow_rate_mm_h(extinction: float) -> float:
    """Return the rate of snowfall with an extinction in 1/m, mm of water per hour."""
    # pi (N0 / w) / (L / w)^3 with w the width of flakes, in mm2 per m3.
    at_1_mm_h = np.pi * 3800.0 / 2.55**3 * _FLAKE_WIDTH**2 * 1e-6
    return float((extinction / at_1_mm_h) ** (1 / (3 * 0.48 - 0.87)))


def snow(extinction: float, wavelength_nm: float) -> Particles:
    """Return the flakes of snow with an extinction in 1/m."""
    rate = snow_rate_mm_h(extinction)
    n0 = 3800.0 * rate**-0.87 / _FLAKE_WIDTH * 1e3
    slope = 2.55 * rate**-0.48 / _FLAKE_WIDTH * 1e3
    return Particles(n0, slope, 2 / 3 * materials()["snow"].reflectivity_at(wavelength_nm))


def fog_amplitude(extinction: float, cell_m: float) -> float:
    """Return the amplitude of fog in a length of beam that returns as one echo."""
    return np.pi * extinction / FOG_RATIO_SR * cell_m


#: Length of beam that returns as one echo, metres: half of a pulse of 5 ns.
CELL_M = 0.75
#: Width of a beam where it leaves the sensor, metres.
EXIT_M = 0.0095
#: Amplitude that has the strength of the datasheet's target at zero range.
FAINTEST = 0.01

_STEP_M = 0.02
_FARTHEST_M = 100.0
_SIZES = 256
_SHARES = 64

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clutter:
    """Distribution of the range at which a beam detects the atmosphere.

    Attributes:
        range_m: (G,) ranges, equally spaced.
        nearer: (G,) probability of a detection at a smaller range.
        amplitude: (G, Q) quantiles of the echo's amplitude at each range.
        range_of_draw: (65536,) range by uniform draw; ``inf`` for no detection.
    """

    range_m: Doubles
    nearer: Doubles
    amplitude: Floats
    range_of_draw: Floats

    @classmethod
    def of(cls, range_m: Doubles, nearer: Doubles, amplitude: Floats) -> Clutter:
        """Return clutter with that distribution."""
        # The inverse exists only where the distribution grows.
        grows = np.concatenate([[True], np.diff(nearer) > 0])
        wanted = (np.arange(LEVELS) + 0.5) / LEVELS
        inverse = np.interp(wanted, nearer[grows], range_m[grows], right=np.inf)
        return cls(range_m, nearer, amplitude, inverse.astype(np.float32))

    def draw(self, draws: Draws, limit_m: Floats) -> tuple[NDArray[np.int32], Floats, Floats]:
        """Draw the beams (C,) that detect the atmosphere before they hit a surface.

        Args:
            draws: draws of the purpose ``CLUTTER``.
            limit_m: (N,) range of the surface in each beam; ``inf`` for none.

        Returns:
            Beam (C,) int32, range (C,) float32 and amplitude (C,) float32 of detected echoes; the
            return mode decides whether they are reported.
        """
        drawn_m = self.range_of_draw.take(draws.detection)
        beam = np.flatnonzero(drawn_m < limit_m).astype(np.int32)
        range_m = drawn_m.take(beam)
        step = np.float32(self.range_m[1] - self.range_m[0])
        cell = np.ceil((range_m - np.float32(self.range_m[0])) / step).astype(np.int32)
        cell = np.clip(cell, 0, len(self.range_m) - 1)
        share = draws.noise.take(beam).astype(np.int64) * self.amplitude.shape[1] // LEVELS
        return beam, range_m, self.amplitude[cell, share]


def clutter_of(sensor: Sensor, conditions: Conditions, response: Response) -> Clutter | None:
    """Return the clutter of the atmosphere; ``None`` in clear air.

    Args:
        sensor: the sensor.
        conditions: the weather; its extinction is in the response.
        response: response of the sensor.
    """
    if conditions.weather == "clear" or response.extinction <= 0:
        return None
    nearest = response.range_min_m
    # Nothing returns from beyond a few times the visibility.
    farthest = min(response.range_max_m, _FARTHEST_M, nearest + 10 / response.extinction)
    if farthest <= nearest:
        return None
    if conditions.weather == "fog":
        return _fog(nearest, farthest, response)
    range_m = np.linspace(nearest, farthest, max(2, int((farthest - nearest) / _STEP_M)))
    particles = (
        rain(response.extinction)
        if conditions.weather == "rain"
        else snow(response.extinction, sensor.assumed_wavelength_nm)
    )
    return _drops(sensor, range_m, response, particles)


def beam_area(sensor: Sensor, range_m: Doubles) -> Doubles:
    """Return the cross-section of a beam (G,) at distances (G,), m2."""
    across, up = np.radians(sensor.assumed_divergence_deg)
    return np.asarray(np.pi / 4 * (EXIT_M + across * range_m) * (EXIT_M + up * range_m))


def collected(response: Response, range_m: Doubles) -> Doubles:
    """Return the share (G,) of the light that the detector collects from ranges (G,)."""
    return range_m**2 / (range_m**2 + FAINTEST * response.per_amplitude)


def _fog(nearest: float, farthest: float, response: Response) -> Clutter:
    """Return the range of the pulse length that is measured as the strongest, and detected.

    The probability that length k is measured at x and all others below is ``pdf_k(x) x product of
    cdf_j(x)``, with ``cdf_j(x) = 1 / (1 + (strength_j / x)^steepness)``.
    """
    edges = np.arange(nearest, farthest + CELL_M, CELL_M)
    middle = (edges[1:] + edges[:-1]) / 2
    amplitude = fog_amplitude(response.extinction, CELL_M) * collected(response, middle)
    strength = _strength(response, amplitude.astype(np.float32), middle.astype(np.float32))
    top = np.log(max(response.half, float(strength.max()))) + 14 / response.steepness
    level = np.linspace(np.log(response.half), top, 2000)  # logarithms
    above = np.log(np.maximum(strength, 1e-6))[:, None] - level
    below = -np.log1p(np.exp(response.steepness * above))  # ln cdf
    density = response.steepness * -np.expm1(below)  # of the logarithm, over its cdf
    chance = np.trapezoid(density * np.exp(below.sum(axis=0)), level, axis=1)
    nearer = np.minimum(np.concatenate([[0.0], np.cumsum(chance)]), 1.0)
    bright = np.concatenate([amplitude[:1], amplitude]).astype(np.float32)
    return Clutter.of(edges, nearer, bright[:, None])


def _drops(sensor: Sensor, range_m: Doubles, response: Response, particles: Particles) -> Clutter:
    """Return the distribution of the range of the nearest detected particle."""
    area = beam_area(sensor, range_m)
    # Diameters at the centres of equal steps, up to 20 mean ones: 1 in 5e8 is larger.
    edges = np.linspace(0, 20 / particles.slope, _SIZES + 1)
    size = (edges[1:] + edges[:-1]) / 2
    number = particles.n0 / particles.slope * -np.diff(np.exp(-particles.slope * edges))
    fills = np.minimum(np.pi / 4 * size**2 / area[:, None], 1.0)
    amplitude = particles.white * fills * collected(response, range_m)[:, None]
    bright = amplitude.astype(np.float32)
    where = np.broadcast_to(range_m[:, None], bright.shape).astype(np.float32)
    seen = np.empty(bright.size)
    probabilities(response, _strength(response, bright.ravel(), where.ravel()), seen)
    per_metre = area[:, None] * number * seen.reshape(bright.shape)
    rate = per_metre.sum(axis=1)
    # Quantiles of the echo's amplitude, from the smallest drops to the largest.
    below = np.cumsum(per_metre, axis=1)
    wanted = (np.arange(_SHARES) + 0.5) / _SHARES * rate[:, None]
    chosen = np.stack([np.searchsorted(*row) for row in zip(below, wanted, strict=True)])
    bright = np.take_along_axis(bright, np.minimum(chosen, _SIZES - 1), axis=1)
    expected = np.concatenate([[0.0], np.cumsum(np.diff(range_m) * (rate[1:] + rate[:-1]) / 2)])
    return Clutter.of(range_m, -np.expm1(-expected), bright)


def _strength(response: Response, amplitude: Floats, range_m: Floats) -> Floats:
    strength = np.empty(len(amplitude), np.float32)
    strengths(response, amplitude, range_m, np.array([response.light], np.float32), strength)
    return strength
