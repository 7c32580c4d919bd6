"""The response of one sensor to echoes, with its effects and the rig's weather and light.

**Detection.** ``p = 1 / (1 + (half / strength)^k)``: `DETECTION_AT_REFERENCE` at strength 1, as
Ouster's datasheets define range, and one half at `HALF_STRENGTH`: the OS1 datasheet has both, 90 %
at 100 m and 50 % at 120 m (80 % target), 90 % at 45 m and 50 % at 55 m (10 % target; cited as
published, page not at hand to re-check): 1.2 times the range, ``1.2^-2 = 0.69`` in strength.

**Range noise.** The timing error of a pulse has a part independent of the light (jitter, clock
steps) and one inverse to the signal-to-noise ratio: the Cramer-Rao bound (Van Trees 1968,
Detection, Estimation, and Modulation Theory I, section 4.2.3; Richmond and Cain 2010,
Direct-Detection LADAR Systems, SPIE TT85, chapter 6). Both add in squares: ``sigma = range_sigma_m
x sqrt(1 + (KNEE_SNR / snr)^2)``. The datasheet of the first OS1 has both ends: 1.5 cm above an SNR
of 250 and 10 cm at 12, so the parts are equal at `KNEE_SNR` (at 100 it says 3 cm, we 1.9). Strength
1 is taken as the weakest of the three, `REFERENCE_SNR`. If the datasheet gives the scatter of a 10
% target at its range (``weak_sigma_m``), the knee follows from it: newer OS1 are two to three times
as precise there (roads of real scans: `notebook/real_lidar.md`).

**Intensity.** Sensors report strength corrected for range, i.e. backscatter (times the transmission
of the air, which no sensor knows). Diffuse white gives ``intensity_of_white``; below, the scale is
linear. Above: if ``intensity_scale`` mentions retroreflectors (Velodyne, Ouster: codes above 100),
codes grow with the logarithm up to ``intensity_max`` at `BEST_RETRO` (Ouster calls its scale
logarithmic there, Velodyne only says that 255 is an ideal retroreflector); else the scale stays
linear and saturates at ``intensity_max`` (Hesai: 255 %). Near some sensors (``overlap_m``) codes
are too low, because the receiver sees only part of the lit spot: ``1 / (1 + (overlap_m /
range)^4)`` on two Ousters that report asphalt at 1 % next to them and at 5 % farther on; detection
is not affected, light being abundant. Uncalibrated units have a factor (``measured_code_scale``).
Points carry the code divided by the greatest, 0 to 1; on an unknown scale white is the greatest,
255.

**Pulse stretching.** A beam of divergence d at range R covers ``R d tan(a)`` of range on a surface
at incidence angle a: the pulse is longer and lower (Wagner et al. 2006, ISPRS J. Photogramm. 60(2),
section 3; Baltsavias 1999, ISPRS J. Photogramm. 54, 199-214). Pulse and beam are Gaussian, so
widths add in squares; a receiver matched to its own pulse of length `CELL_M` sees of the peak ``1 /
sqrt(1 + (R d tan(a) / CELL_M)^2 / 2)`` and detects accordingly. The energy, and so the reported
reflectivity, is unchanged: real OS1-128 report asphalt as bright at 4 degrees as at 8, but lose it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.response import Response, answers, probabilities, strengths
from urbantwin.lidar.returns.clutter import CELL_M, Clutter, clutter_of, extinction
from urbantwin.lidar.returns.draws import LEVELS
from urbantwin.lidar.returns.scatter import Scatter, scatter_of_materials
from urbantwin.lidar.returns.sunlight import daylight, sun_noise
from urbantwin.lidar.returns.swallowed import FAINTEST
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sensor import Sensor
from urbantwin.site.rig import Conditions

__all__ = [
    "BEST_RETRO",
    "DETECTION_AT_REFERENCE",
    "HALF_STRENGTH",
    "KNEE_SNR",
    "KNEE_STRENGTH",
    "REFERENCE_SNR",
    "STEEPNESS",
    "IntensityScale",
    "ReturnModel",
    "divergence",
    "intensity_scale",
    "knee_of",
    "peak_left",
]

#: Probability of a return from the reference target at the reference range.
DETECTION_AT_REFERENCE = 0.9
#: Strength at which the probability of a return is one half.
HALF_STRENGTH = 0.69
#: Steepness k of the detection curve.
STEEPNESS = float(
    np.log(DETECTION_AT_REFERENCE / (1 - DETECTION_AT_REFERENCE)) / -np.log(HALF_STRENGTH)
)


#: Signal-to-noise ratio at which both parts of the noise are equal.
KNEE_SNR = 12 * float(np.sqrt((10 / 1.5) ** 2 - 1))
#: Signal-to-noise ratio of the datasheet's target.
REFERENCE_SNR = 12.0
#: `KNEE_SNR` as a strength.
KNEE_STRENGTH = KNEE_SNR / REFERENCE_SNR


def knee_of(sensor: Sensor) -> float:
    """Return the strength at which both parts of a sensor's range noise are equal."""
    if sensor.weak_sigma_m is None:
        return KNEE_STRENGTH
    ratio = sensor.weak_sigma_m / sensor.assumed_range_sigma_m
    return float(np.sqrt(max(ratio**2 - 1, 0.0)))


#: Backscatter of the best retroreflective sheeting: pi times 700 cd per lx and m2 (ASTM D4956,
#: type VIII, white, at 0.2 and -4 degrees).
BEST_RETRO = 700 * np.pi


class IntensityScale(NamedTuple):
    """Conversion of backscatter to an intensity code.

    Attributes:
        white: code of a white surface.
        greatest: largest code.
        per_log: codes per unit of the logarithm of backscatter above white; 0: linear.
    """

    white: float
    greatest: float
    per_log: float


def intensity_scale(sensor: Sensor) -> IntensityScale:
    """Return the intensity scale of a sensor."""
    greatest = 255.0 if sensor.intensity_max is None else float(sensor.intensity_max)
    white = greatest if sensor.intensity_of_white is None else float(sensor.intensity_of_white)
    has_retro = "retroreflector" in (sensor.intensity_scale or "") and greatest > white
    return IntensityScale(
        white, greatest, (greatest - white) / np.log(BEST_RETRO) if has_retro else 0.0
    )


#: Smallest cosine of incidence.
_LEAST_COSINE = 1e-3


def divergence(sensor: Sensor) -> float:
    """Return the full width at half maximum of a beam, radians; 0 if not published."""
    if sensor.beam_divergence_deg is None:
        return 0.0
    return float(np.sqrt(np.prod(np.radians(sensor.beam_divergence_deg))))


def peak_left(
    divergence_rad: float, range_m: NDArray[np.floating], cosine: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return the remaining peak (N,) of stretched pulses, 0 to 1.

    Args:
        divergence_rad: divergence of the beam.
        range_m: (N,) ranges of the surfaces.
        cosine: (N,) cosines of incidence.
    """
    if divergence_rad == 0:
        return np.ones(len(range_m), np.float32)
    faced = np.maximum(cosine, _LEAST_COSINE)
    longer = range_m * divergence_rad / CELL_M * np.sqrt(np.maximum(1 - faced**2, 0)) / faced
    return np.asarray(1 / np.sqrt(1 + longer**2 / 2), np.float32)


Floats = NDArray[np.float32]


class ReturnModel:
    """Response of one sensor: functions of amplitude (N,) and range (N,) of echoes.

    Amplitude is backscatter times the share of the beam that hits the surface times the two-way
    transmission of glass in front: 1 for a white surface at normal incidence that fills the beam.
    Range is in metres.

    Args:
        mounted: the sensor and its effects.
        conditions: weather and sun; by default clear air and the datasheet's light.

    Attributes:
        response: parameters for compiled code (`compiled.response`).
        scatter: backscatter of materials for this sensor, its effects and the weather.
        divergence_rad: divergence of its beams; 0 without the footprint effect.
        clutter: echoes of the atmosphere; ``None`` in clear air.
        offset_m: range offset of the unit, in whole steps.
    """

    def __init__(self, mounted: MountedSensor, conditions: Conditions | None = None) -> None:
        entry, effects = mounted.sensor, mounted.effects
        given = conditions or Conditions()
        # An effect that is off removes its part of the conditions.
        weather = given if effects.weather else Conditions()
        wet = weather.wet_ground
        if wet is None:
            wet = 1.0 if weather.weather == "rain" else 0.0
        wavelength = entry.assumed_wavelength_nm
        unit = mounted.calibration
        self.scatter: Scatter = scatter_of_materials(
            wavelength,
            wet,
            retroreflection=effects.retroreflection,
            glass=effects.glass,
            texture=effects.noise,
            swallows=effects.dropout,
            reflectivity=tuple(sorted(mounted.reflectivity.items())),
        )
        reflectivity, range_m = entry.assumed_reference
        if entry.detection_range_10_m is not None and entry.detection_range_80_m is not None:
            reflectivity, range_m = 0.1, entry.detection_range_10_m
        sun, fall = sun_noise(entry)
        scale = intensity_scale(entry)
        self.response = Response(
            per_amplitude=range_m**fall / reflectivity,
            gain=unit.light * (entry.measured_light or 1.0),
            fall=fall,
            extinction=extinction(weather, wavelength),
            sun_noise=sun,
            floor=float(np.sqrt(1 + sun * reflectivity)),
            light=daylight(given.sun_elevation_deg if effects.sun else None),
            range_min_m=entry.assumed_range_min_m,
            range_max_m=entry.assumed_range_max_m,
            dropout=effects.dropout,
            half=HALF_STRENGTH,
            steepness=STEEPNESS,
            faintest=entry.measured_faintest or FAINTEST,
            sigma_m=entry.assumed_range_sigma_m * unit.range_noise if effects.noise else 0.0,
            knee=knee_of(entry),
            white=scale.white * unit.intensity,
            greatest=scale.greatest,
            overlap_m=entry.overlap_m or 0.0,
            code_scale=entry.measured_code_scale or 1.0,
            per_log=scale.per_log * unit.intensity,
            whole_codes=effects.quantisation,
        )
        self.divergence_rad = divergence(entry) if effects.footprint else 0.0
        self.clutter: Clutter | None = clutter_of(entry, weather, self.response)
        self._step_m = entry.assumed_range_resolution_m if effects.quantisation else 0.0
        self.offset_m = self.quantised(np.array([unit.range_offset_m], np.float32))[0]

    def peak_left(self, range_m: Floats, cosine: Floats) -> Floats:
        """Return the remaining peak (N,) of stretched pulses, 0 to 1.

        Args:
            range_m: (N,) ranges of the surfaces.
            cosine: (N,) cosines of incidence.
        """
        return peak_left(self.divergence_rad, range_m, cosine)

    def strength(self, amplitude: Floats, range_m: Floats, light: Floats | None = None) -> Floats:
        """Return signal to noise relative to the datasheet's target; 0 without a hit.

        Args:
            amplitude: (N,) of the echoes.
            range_m: (N,) of the echoes.
            light: (N,) sunlight on the targets relative to 100 klx; that on level ground if not
                given.
        """
        strength = np.empty(len(amplitude), np.float32)
        strengths(self.response, amplitude, range_m, self._light(light), strength)
        return strength

    def answers(
        self,
        amplitude: Floats,
        range_m: Floats,
        light: Floats | None = None,
        peak: Floats | None = None,
    ) -> tuple[NDArray[np.int32], Floats, Floats, Floats]:
        """Return detection level, sigma, intensity and strength in one pass, each (N,).

        ``peak`` is the remaining peak (N,) of the pulses, 1 if not given.
        """
        peak = np.ones(1, np.float32) if peak is None else peak
        count = len(amplitude)
        level = np.empty(count, np.int32)
        sigma, intensity = np.empty(count, np.float32), np.empty(count, np.float32)
        strength = np.empty(count, np.float32)
        light = self._light(light)
        answers(self.response, amplitude, range_m, light, peak, level, sigma, intensity, strength)
        return level, sigma, intensity, strength

    def detection_level(
        self, amplitude: Floats, range_m: Floats, light: Floats | None = None
    ) -> NDArray[np.int32]:
        """Return the level, of 65,536, below which a ray's ``Draws.detection`` means a return.

        0 outside the sensor's range; 65,536 within it without the drop-out effect.
        """
        return self.answers(amplitude, range_m, light)[0]

    def noticed_level(self, amplitude: Floats, range_m: Floats) -> NDArray[np.int32]:
        """Return the detection level, of 65,536, of spurious echoes (N,).

        Weak ones are missed even without the drop-out effect.
        """
        chance = np.empty(len(amplitude))
        probabilities(self.response, self.strength(amplitude, range_m), chance)
        seen = (range_m >= self.response.range_min_m) & (range_m <= self.response.range_max_m)
        return np.where(seen, np.rint(chance * LEVELS), 0).astype(np.int32)

    def sigma(self, amplitude: Floats, range_m: Floats, light: Floats | None = None) -> Floats:
        """Return the standard deviation of the range, metres; 0 without noise."""
        return self.answers(amplitude, range_m, light)[1]

    def detection(
        self, amplitude: Floats, range_m: Floats, light: Floats | None = None
    ) -> NDArray[np.float64]:
        """Return the probability of a return, in steps of 1/65,536."""
        return self.detection_level(amplitude, range_m, light) / float(LEVELS)

    def detection_among(
        self, amplitude: Floats, range_m: Floats, spread: float, peak: Floats | None = None
    ) -> NDArray[np.float64]:
        """Return the probability of a return from places of varying brightness.

        Args:
            amplitude: (N,) median over the places.
            range_m: (N,) of the echoes.
            spread: standard deviation of the logarithm of the amplitude.
            peak: remaining peak (N,) of the pulses, 1 if not given.
        """
        # Gauss-Hermite quadrature.
        node, weight = np.polynomial.hermite_e.hermegauss(15 if spread else 1)
        chance = np.zeros(len(range_m))
        for deviation, share in zip(node, weight / weight.sum(), strict=True):
            brighter = np.asarray(amplitude * np.exp(spread * deviation), np.float32)
            level = self.answers(brighter, np.asarray(range_m, np.float32), peak=peak)[0]
            chance += share * level / LEVELS
        return chance

    def intensity(self, amplitude: Floats, range_m: Floats | None = None) -> Floats:
        """Return the reported intensity, 0 to 1: the sensor's code divided by its greatest.

        Args:
            amplitude: (N,) of the echoes.
            range_m: (N,) of the echoes; needed only in weather.
        """
        return self.answers(amplitude, np.zeros_like(amplitude) if range_m is None else range_m)[2]

    @property
    def step_m(self) -> np.float32:
        """Resolution of ranges; 0 without quantisation."""
        return np.float32(self._step_m)

    def quantised(self, range_m: Floats) -> Floats:
        """Round ranges to the sensor's resolution; unchanged without quantisation."""
        if self.step_m == 0:
            return range_m
        return np.asarray(np.rint(range_m / self.step_m) * self.step_m)

    def _light(self, light: Floats | None) -> Floats:
        return np.array([self.response.light], np.float32) if light is None else light
