"""Returns: from what a ray hits to what a sensor reports.

Strength. A diffuse (Lambertian) surface that fills the beam returns power in proportion to
``backscatter / range^2`` with ``backscatter = reflectivity x (1 - transmission) x cos(incidence)``
(Wagner et al. 2006, ISPRS J. Photogramm. 60(2), eq. 14), with the reflectivity at the sensor's own
wavelength. Glass beads in road paint send light back wherever it comes from: they add the
material's ``retro`` at every angle, up to what a white target faced squarely would return. We give
strength relative to the sensor's reference target: 1 is a target of the datasheet's reflectivity,
faced squarely, at the datasheet's range. Glass passes most of the light, so a ray that hits it
mostly finds no return; what stands behind glass is not looked for.

Detection. ``p = 1 / (1 + (half / strength)^k)``: `DETECTION_AT_REFERENCE` at strength 1 and one
half at strength `HALF_STRENGTH`. We read a datasheet's range as the one with 90 % of returns, and
assume half of them at 1.2 times that range: ``1.2^-2 = 0.69`` in strength.

Range noise. Ouster's OS1 datasheet gives one standard deviation of 1.5, 3 and 10 cm at a
signal-to-noise ratio above 250, of 100 and of 12. We take that shape for every sensor: strength
1 is the weakest of the three, and the sensor's own ``range_sigma_m`` is the strongest's.
Between them, straight lines in the logarithms.

Intensity is what sensors report as calibrated reflectivity: strength corrected for range, which
is ``backscatter``, from 0 to 1 in 255 steps.

Random numbers are counter-based: ray n of a sensor in a frame draws the same two numbers whatever
else is computed, in whatever order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from urbantwin.lidar.rig import MountedSensor
from urbantwin.taxonomy import materials

__all__ = [
    "DETECTION_AT_REFERENCE",
    "HALF_STRENGTH",
    "Draws",
    "ReturnModel",
    "Scatter",
    "draw",
    "scatter_of_materials",
    "standard_noise",
    "standard_quantiles",
    "truncated_noise",
]

#: Probability of a return from the reference target at the reference range.
DETECTION_AT_REFERENCE = 0.9
#: Strength at which the probability of a return is one half.
HALF_STRENGTH = 0.69
_STEEPNESS = float(
    np.log(DETECTION_AT_REFERENCE / (1 - DETECTION_AT_REFERENCE)) / -np.log(HALF_STRENGTH)
)
_SIGMA_STRENGTH = np.array([1.0, 100 / 12, 250 / 12])
_SIGMA_RATIO = np.array([10 / 1.5, 3 / 1.5, 1.0])
#: Every draw is one of so many equally likely levels.
_LEVELS = 1 << 16

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Draws:
    """Two numbers for each of N rays.

    Attributes:
        detection: (N,) uint16, uniform; a ray returns where it is below 65,536 p.
        noise: (N,) uint16, uniform; number of one of 65,536 equally likely levels.
    """

    detection: NDArray[np.uint16]
    noise: NDArray[np.uint16]


def draw(seed: int, sensor: int, frame: int, rays: int) -> Draws:
    """Return the draws of one sensor in one frame, by Philox keyed with all three numbers."""
    key = np.array([seed % 2**64, (sensor << 48) | frame], np.uint64)
    words = np.random.Philox(key=key).random_raw((rays + 1) // 2)
    levels = words.astype("<u8", copy=False).view("<u2")
    return Draws(levels[:rays], levels[rays : 2 * rays])


def standard_noise(noise: NDArray[np.uint16]) -> Floats:
    """Return standard normal numbers (N,) of draws: the middles of 65,536 equal shares."""
    return standard_quantiles().take(noise)


def truncated_noise(
    noise: NDArray[np.uint16], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return standard normal numbers (N,) given that they lie within [low, high].

    A draw that lies within is kept. One that lies outside is as good as a fresh uniform number
    of its tail, and is mapped to the inside by the inverse distribution: the result has exactly
    the distribution of drawing again until the number lies within.

    Args:
        noise: (N,) draws.
        low: (N,) not above 0.
        high: (N,) not below 0.
    """
    uniform = (noise.astype(np.float64) + 0.5) / _LEVELS
    below, above = ndtr(low), ndtr(high)
    left, right = uniform < below, uniform > above
    tail = np.divide(uniform, below, out=np.zeros_like(uniform), where=left)
    np.divide(uniform - above, 1 - above, out=tail, where=right)
    chosen = np.where(left | right, below + tail * (above - below), uniform)
    return np.asarray(np.clip(ndtri(chosen), low, high))


@cache
def standard_quantiles() -> Floats:
    """Return the standard normal number of each of the 65,536 draws."""
    return np.asarray(ndtri((np.arange(_LEVELS) + 0.5) / _LEVELS), np.float32)


@dataclass(frozen=True, eq=False)
class Scatter:
    """What materials send back, by material number.

    Attributes:
        diffuse: (M,) ``reflectivity x (1 - transmission)``.
        retro: (M,) what glass beads add at every angle of incidence.
    """

    diffuse: Floats
    retro: Floats

    def backscatter(self, material: NDArray[np.uint8], cosine: NDArray[np.floating]) -> Floats:
        """Return the backscatter (N,) of materials (N,) met at some cosine of incidence (N,)."""
        found = self.diffuse[material] * cosine + self.retro[material]
        return np.asarray(np.minimum(found, 1.0), np.float32)


@cache
def scatter_of_materials(wavelength_nm: float) -> Scatter:
    """Return what every material sends back of a laser's light."""
    table = materials().values()
    return Scatter(
        np.array([m.reflectivity_at(wavelength_nm) * (1 - m.transmission) for m in table], "f4"),
        np.array([m.retro for m in table], np.float32),
    )


class ReturnModel:
    """How one sensor answers: a function of backscatter (N,) and range (N,) in metres."""

    def __init__(self, mounted: MountedSensor) -> None:
        entry = mounted.sensor
        self._dropout = mounted.effects.dropout
        self._noise = mounted.effects.noise
        self._sigma_m = entry.assumed_range_sigma_m
        self._resolution_m = entry.assumed_range_resolution_m
        self._range_m = (entry.assumed_range_min_m, entry.assumed_range_max_m)
        reflectivity, range_m = entry.assumed_reference
        self._scale = np.float32(range_m**2 / reflectivity)

    def strength(self, backscatter: Floats, range_m: Floats) -> Floats:
        """Return strength relative to the reference target; 0 where nothing was hit."""
        return self._scale * backscatter / (range_m * range_m)

    def detection(self, backscatter: Floats, range_m: Floats) -> NDArray[np.float64]:
        """Return the probability of a return; 0 outside the sensor's span of ranges.

        Without drop-out it is 1 within.
        """
        low, high = self._range_m
        seen = (range_m >= low) & (range_m <= high)
        if not self._dropout:
            return seen.astype(np.float64)
        strength = self.strength(backscatter[seen], range_m[seen]).astype(np.float64)
        power = strength**_STEEPNESS
        probability = np.zeros(len(range_m))
        probability[seen] = power / (power + HALF_STRENGTH**_STEEPNESS)
        return probability

    def detection_level(self, backscatter: Floats, range_m: Floats) -> NDArray[np.int32]:
        """Return the level below which a ray's ``Draws.detection`` means a return."""
        return np.rint(self.detection(backscatter, range_m) * _LEVELS).astype(np.int32)

    def sigma(self, backscatter: Floats, range_m: Floats) -> Floats:
        """Return the standard deviation of the range, metres; 0 without noise."""
        if not self._noise:
            return np.zeros(len(range_m), np.float32)
        strength = np.maximum(self.strength(backscatter, range_m), np.float32(1e-6))
        ratio = np.interp(np.log(strength), np.log(_SIGMA_STRENGTH), np.log(_SIGMA_RATIO))
        return np.asarray(self._sigma_m * np.exp(ratio), np.float32)

    @property
    def step_m(self) -> np.float32:
        """The step that ranges are rounded to; 0 without noise."""
        return np.float32(self._resolution_m if self._noise else 0.0)

    def quantised(self, range_m: Floats) -> Floats:
        """Return ranges in the sensor's steps; unchanged without noise."""
        if self.step_m == 0:
            return range_m
        return np.asarray(np.rint(range_m / self.step_m) * self.step_m)

    @staticmethod
    def intensity(backscatter: Floats) -> Floats:
        """Return the reported intensity, 0 to 1 in steps of 1/255."""
        return (np.rint(np.clip(backscatter, 0, 1) * 255) / 255).astype(np.float32)
