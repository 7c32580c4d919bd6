"""Echoes of the air: drops, flakes and fog that a sensor takes for a target.

**Drops and flakes.** Along a beam those that are detected are a Poisson process: per metre there
are ``beam's cross-section x integral of N(D) p(strength of D there) dD`` of them, with the
sensor's own p. The nearest of them is what we draw.

**Fog** answers in every length of pulse, `CELL_M`. What a sensor measures of a strength scatters
about it as its detection says (p of a threshold is the chance to lie above it); the length that it
measures as the strongest is what we draw, where in it is by chance.

**Near the sensor** what it collects does not go on growing with 1/range^2: the image of something
near is larger than the detector of a receiver that is focused far away, and only
``range^2 / (range^2 + focus^2)`` of it is collected (geometric form factor of coaxial lidars,
Measures 1984, Laser Remote Sensing, section 7.3; here with soft edges). A target is so much
stronger that it does not matter; drops and fog would all be seen without it. No maker publishes
it: we take the focus at which even next to the sensor nothing fainter than `FAINTEST` of white
reaches strength 1. Then fog covers the sensor itself from visibilities of about 40 m down, which is
where sensors in a fog chamber went blind (Bijelic et al. 2018, IEEE IV, "A benchmark for lidar
sensors in fog").

A beam is `EXIT_M` wide where it leaves the sensor (the OS1's datasheet) and widens by its
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

#: What is left of a beam at the visibility.
CONTRAST = 0.05
#: Visibility in metres where a weather is named without one: a shower of 9 mm/h as
#: `particles.rain` has it, fog and snow of the middle of their usual span.
DEFAULT_VISIBILITY_M = {"rain": 2000.0, "fog": 150.0, "snow": 700.0}


def visibility(conditions: Conditions) -> float | None:
    """Return the visibility in metres; ``None`` in clear air of which none is given."""
    if conditions.visibility_m is not None:
        return conditions.visibility_m
    return DEFAULT_VISIBILITY_M.get(conditions.weather)


def haze_exponent(visibility_m: float) -> float:
    """Return Kim's q."""
    km = visibility_m / 1000
    ends = [0.0, 0.5, 1.0, 6.0]
    if km > ends[-1]:
        return 1.6 if km > 50 else 1.3
    return float(np.interp(km, ends, [0.0, 0.0, 0.5, 1.3]))


def extinction(conditions: Conditions, wavelength_nm: float) -> float:
    """Return the extinction in 1/m; 0 in clear air of which no visibility is given.

    The datasheets' ranges are measured in clear air: what that takes is in them.
    """
    seen = visibility(conditions)
    if seen is None:
        return 0.0
    visible = -np.log(CONTRAST) / seen
    if conditions.weather != "clear":
        return float(visible)
    return float(visible * (wavelength_nm / 550.0) ** -haze_exponent(seen))


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


#: Length of beam that comes back as one echo: half of a pulse of 5 ns.
CELL_M = 0.75
#: Width of a beam where it leaves the sensor, metres.
EXIT_M = 0.0095
#: Amplitude that is as strong as the datasheet's target, right before the sensor.
FAINTEST = 0.01

_STEP_M = 0.02
_FARTHEST_M = 100.0
_SIZES = 256
_SHARES = 64

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clutter:
    """Where a beam detects the air.

    Attributes:
        range_m: (G,) distances, in equal steps.
        nearer: (G,) how probable it is that a beam detects the air nearer than that.
        amplitude: (G, Q) of the echo there, by equal shares of its distribution.
        range_of_draw: (65536,) where it is by draw; ``inf``: nowhere.
    """

    range_m: Doubles
    nearer: Doubles
    amplitude: Floats
    range_of_draw: Floats

    @classmethod
    def of(cls, range_m: Doubles, nearer: Doubles, amplitude: Floats) -> Clutter:
        """Return clutter of that distribution."""
        # Only where it grows can it be read backwards.
        grows = np.concatenate([[True], np.diff(nearer) > 0])
        wanted = (np.arange(LEVELS) + 0.5) / LEVELS
        found = np.interp(wanted, nearer[grows], range_m[grows], right=np.inf)
        return cls(range_m, nearer, amplitude, found.astype(np.float32))

    def draw(self, draws: Draws, limit_m: Floats) -> tuple[NDArray[np.int32], Floats, Floats]:
        """Return the beams (C,) that detect the air before they end, where and how bright.

        Args:
            draws: of the purpose ``CLUTTER``.
            limit_m: (N,) where each beam ends; ``inf`` where it meets nothing.

        Returns:
            Beam (C,) int32, range (C,) float32 and amplitude (C,) float32 of echoes that are
            detected already: whether they are reported is a matter of what else is.
        """
        found = self.range_of_draw.take(draws.detection)
        beam = np.flatnonzero(found < limit_m).astype(np.int32)
        range_m = found.take(beam)
        step = np.float32(self.range_m[1] - self.range_m[0])
        at = np.ceil((range_m - np.float32(self.range_m[0])) / step).astype(np.int32)
        at = np.clip(at, 0, len(self.range_m) - 1)
        share = draws.noise.take(beam).astype(np.int64) * self.amplitude.shape[1] // LEVELS
        return beam, range_m, self.amplitude[at, share]


def clutter_of(sensor: Sensor, conditions: Conditions, response: Response) -> Clutter | None:
    """Return what the air gives back; ``None`` in clear air.

    Args:
        sensor: whose beam it is.
        conditions: the weather; its extinction is the response's.
        response: of the sensor.
    """
    if conditions.weather == "clear" or response.extinction <= 0:
        return None
    nearest = response.range_min_m
    # Beyond a few times the visibility nothing comes back.
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
    """Return the share (G,) of the light that the detector collects from distances (G,)."""
    return range_m**2 / (range_m**2 + FAINTEST * response.per_amplitude)


def _fog(nearest: float, farthest: float, response: Response) -> Clutter:
    """Return which length of pulse is measured as the strongest, and detected.

    The chance that length k is measured at x and all others below is ``pdf_k(x) x product of
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
    """Return the distance of the nearest particle that is detected."""
    area = beam_area(sensor, range_m)
    # Sizes at the middles of equal steps, up to 20 mean ones: 1 in 5e8 is larger.
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
    # The echoes there in equal shares, from the smallest drops to the largest.
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
