"""Range noise from strength.

Ouster's OS1 datasheet gives one standard deviation of 1.5, 3 and 10 cm at a signal-to-noise ratio
above 250, of 100 and of 12. We take that shape for every sensor: strength 1 is the weakest of the
three, and the sensor's own ``range_sigma_m`` is the strongest's. Between them, straight lines in
the logarithms; below the weakest, its line goes on.
"""

from __future__ import annotations

import numpy as np

__all__ = ["SIGMA_RATIO", "SIGMA_STRENGTH", "slopes"]

#: Strengths of the datasheet's three ratios.
SIGMA_STRENGTH = (1.0, 100 / 12, 250 / 12)
#: The standard deviation there, relative to the strongest's.
SIGMA_RATIO = (10 / 1.5, 3 / 1.5, 1.0)


def slopes() -> tuple[float, float]:
    """Return the exponents of strength by which the deviation falls, weak and strong."""
    weak, middle, strong = np.log(SIGMA_STRENGTH)
    high, mean, low = np.log(SIGMA_RATIO)
    return (high - mean) / (middle - weak), (mean - low) / (strong - middle)
