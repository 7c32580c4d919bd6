"""Detection from strength.

``p = 1 / (1 + (half / strength)^k)``: `DETECTION_AT_REFERENCE` at strength 1, as Ouster's
datasheets state their ranges, and one half at strength `HALF_STRENGTH`: the OS1 datasheet has both,
90 % at 100 m and 50 % at 120 m (80 % target), 90 % at 45 m and 50 % at 55 m (10 % target; cited as
published, page not at hand to re-check): 1.2 times the range, ``1.2^-2 = 0.69`` in strength.
"""

from __future__ import annotations

import numpy as np

__all__ = ["DETECTION_AT_REFERENCE", "HALF_STRENGTH", "STEEPNESS"]

#: Probability of a return from the reference target at the reference range.
DETECTION_AT_REFERENCE = 0.9
#: Strength at which the probability of a return is one half.
HALF_STRENGTH = 0.69
#: k.
STEEPNESS = float(
    np.log(DETECTION_AT_REFERENCE / (1 - DETECTION_AT_REFERENCE)) / -np.log(HALF_STRENGTH)
)
