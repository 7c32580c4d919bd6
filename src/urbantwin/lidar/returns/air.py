"""Extinction by air: visibility, fog, rain and snow.

Visibility V is the meteorological optical range of the WMO (Guide to Instruments and Methods of
Observation, WMO-No. 8, chapter 9): the distance at which a collimated beam falls to 5 %, so that
by Koschmieder's law the extinction of visible light is ``-ln(0.05) / V = 3.0 / V``.

Drops of fog, rain and snow are larger than the wavelength of any LiDAR and weaken all of them the
same. The particles of haze are not: towards longer wavelengths extinction falls with
``(wavelength / 550 nm)^-q`` and the q of Kim, McArthur and Korevaar 2001 (Proc. SPIE 4214, 26-37,
eq. 4): 0 below 0.5 km of visibility, V - 0.5 up to 1 km, 0.16 V + 0.34 up to 6 km, 1.3 up to 50
km, 1.6 beyond.
"""

from __future__ import annotations

import numpy as np

from urbantwin.site.rig import Conditions

__all__ = ["CONTRAST", "DEFAULT_VISIBILITY_M", "extinction", "haze_exponent", "visibility"]

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
