"""How a sensor answers an echo: strength, detection, noise and intensity of one at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from urbantwin.geometry.compiled import per_ray

__all__ = [
    "Response",
    "answers",
    "intensity_of",
    "level_of",
    "probabilities",
    "probability_of",
    "shown_of",
    "sigma_of",
    "strength_of",
    "strengths",
]


class Response(NamedTuple):
    """What of a sensor, its effects and the air decides how it answers.

    Attributes:
        per_amplitude: strength per amplitude at 1 m, with the datasheet's sun on the target.
        gain: of this unit: times the strength of every echo.
        fall: exponent of range by which strength falls.
        extinction: of the air, 1/m.
        sun_noise: variance that the datasheet's light on a white target adds.
        floor: noise under the datasheet's target, in the same unit.
        light: light on the targets, relative to the datasheet's.
        range_min_m: nothing nearer is reported.
        range_max_m: nothing farther is reported.
        dropout: whether weak echoes may be missed.
        half: strength of which half is detected.
        steepness: exponent of detection.
        faintest: amplitude of surfaces of which half is detected however near.
        sigma_m: standard deviation of the range of strong echoes; 0 without noise.
        knee: strength at which that and the noise of the light are equal.
        white: code of intensity of a white surface.
        greatest: greatest code.
        overlap_m: distance at which half of what a near target sends back is collected; 0: all.
        code_scale: times the backscatter that codes are of.
        per_log: codes per logarithm of what is above white; 0: linear.
        whole_codes: whether codes are rounded.
    """

    per_amplitude: float
    gain: float
    fall: float
    extinction: float
    sun_noise: float
    floor: float
    light: float
    range_min_m: float
    range_max_m: float
    dropout: bool
    half: float
    steepness: float
    faintest: float
    sigma_m: float
    knee: float
    white: float
    greatest: float
    overlap_m: float
    code_scale: float
    per_log: float
    whole_codes: bool


@per_ray
def strength_of(r, amplitude, range_m, light):
    """Return signal to noise relative to the datasheet's target."""
    if not (amplitude > 0.0 and 0.0 < range_m < np.inf):
        return 0.0
    if r.fall == 2.0:
        signal = r.gain * r.per_amplitude * amplitude / (range_m * range_m)
    else:
        signal = r.gain * r.per_amplitude * amplitude * range_m**-r.fall
    if r.extinction > 0.0:
        signal *= np.exp(-2.0 * r.extinction * range_m)
    lit = 1.0 + r.sun_noise * light * min(amplitude, 1.0)
    return signal * r.floor / np.sqrt(lit)


@per_ray
def probability_of(r, strength):
    """Return how probable an echo of that strength is to be detected."""
    # Beyond a thousandfold the result is 0 or 1 to seven digits; most echoes are strong.
    if strength > 16.0 * r.half:
        return 1.0
    if strength < 0.0625 * r.half:
        return 0.0
    power = (strength / r.half) ** r.steepness
    return power / (1.0 + power)


@per_ray
def level_of(r, strength, range_m):
    """Return the level of 65,536 below which a draw means that an echo is detected."""
    if not (range_m >= r.range_min_m and range_m <= r.range_max_m):
        return 0
    if not r.dropout:
        return 65536
    return int(np.rint(probability_of(r, strength) * 65536.0))


@per_ray
def sigma_of(r, strength):
    """Return the standard deviation of an echo's range."""
    light = r.knee / max(strength, 0.1)
    return r.sigma_m * np.sqrt(1.0 + light * light)


@per_ray
def intensity_of(r, amplitude, range_m):
    """Return the reported intensity, 0 to 1."""
    if not amplitude > 0.0:
        return 0.0
    left = amplitude * r.code_scale
    if r.extinction > 0.0:
        left *= np.exp(-2.0 * r.extinction * range_m)
    if r.overlap_m > 0.0 and range_m > 0.0:
        near = range_m / r.overlap_m
        left *= near**4 / (1.0 + near**4)
    code = r.white * left
    if left > 1.0 and r.per_log > 0.0:
        code = r.white + r.per_log * np.log(left)
    code = min(code, r.greatest)
    if r.whole_codes:
        code = np.rint(code)
    return code / r.greatest


@per_ray
def shown_of(r, amplitude, strength):
    """Return the strength that decides whether an echo of that strength is detected."""
    # However near, a faint surface is no easier to detect than this.
    most = r.half * amplitude / r.faintest
    if 0.0 < most < 8.0 * strength:
        return strength / np.sqrt(np.sqrt(1.0 + (strength / most) ** 4))
    return strength


@per_ray
def answers(r, amplitude, range_m, light, peak, level, sigma, intensity, strength):
    """Fill level, sigma, intensity and strength (N,) of echoes (N,).

    Light on the targets, and what is left of the pulses' peaks, are (N,) or (1,) for all.
    """
    for i in range(len(amplitude)):
        left = peak[i if len(peak) > 1 else 0]
        one = strength_of(r, amplitude[i], range_m[i], light[i if len(light) > 1 else 0])
        strength[i] = np.float32(one) * left
        one *= left
        level[i] = level_of(r, shown_of(r, amplitude[i], one), range_m[i])
        sigma[i] = sigma_of(r, one)
        intensity[i] = intensity_of(r, amplitude[i], range_m[i])


@per_ray
def strengths(r, amplitude, range_m, light, strength):
    """Fill strength (N,) of echoes (N,)."""
    for i in range(len(amplitude)):
        one = light[i if len(light) > 1 else 0]
        strength[i] = strength_of(r, amplitude[i], range_m[i], one)


@per_ray
def probabilities(r, strength, probability):
    """Fill how probable echoes (N,) of strengths (N,) are to be detected."""
    for i in range(len(strength)):
        probability[i] = probability_of(r, strength[i])
