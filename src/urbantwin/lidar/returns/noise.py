"""Range noise from strength.

The error of a pulse's time of arrival has a part that more light does not reduce (jitter, steps of
the clock) and one that goes with the inverse of the signal-to-noise ratio: the Cramer-Rao bound
(Van Trees 1968, Detection, Estimation, and Modulation Theory I, section 4.2.3; Richmond and Cain
2010, Direct-Detection LADAR Systems, SPIE TT85, chapter 6). Both add in squares:
``sigma = range_sigma_m x sqrt(1 + (KNEE_SNR / snr)^2)``.

The OS1's datasheet of the first generation has both ends: 1.5 cm above an SNR of 250 and 10 cm at
12, so that the two parts are equal at `KNEE_SNR` (at 100 it says 3 cm, we 1.9). Strength 1 is taken
to be the weakest of the three, `REFERENCE_SNR`. Where the datasheet of a model says how much ranges
of a 10 % target at its range scatter (``weak_sigma_m``), the knee follows from that: newer OS1 are
two to three times as precise there (roads of real scans: `notebook/real_lidar.md`).
"""

from __future__ import annotations

import numpy as np

from urbantwin.lidar.sensor import Sensor

__all__ = ["KNEE_SNR", "KNEE_STRENGTH", "REFERENCE_SNR", "knee_of"]

#: Signal-to-noise ratio at which both parts of the noise are equal.
KNEE_SNR = 12 * float(np.sqrt((10 / 1.5) ** 2 - 1))
#: Signal-to-noise ratio of the datasheet's target.
REFERENCE_SNR = 12.0
#: The first in strength.
KNEE_STRENGTH = KNEE_SNR / REFERENCE_SNR


def knee_of(sensor: Sensor) -> float:
    """Return the strength at which both parts of a sensor's noise are equal."""
    if sensor.weak_sigma_m is None:
        return KNEE_STRENGTH
    ratio = sensor.weak_sigma_m / sensor.assumed_range_sigma_m
    return float(np.sqrt(max(ratio**2 - 1, 0.0)))
