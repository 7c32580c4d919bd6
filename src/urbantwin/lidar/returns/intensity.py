"""Reported intensity, on the sensor's own scale.

Sensors report strength corrected for range, which is backscatter (times what the air left of it:
no sensor knows the weather). A diffuse white surface gives the catalogue's ``intensity_of_white``,
and below it the scale is linear. Above it:

- where ``intensity_scale`` speaks of retroreflectors (Velodyne, Ouster: codes above 100), codes go
  up to ``intensity_max`` with the logarithm, which is reached at `BEST_RETRO`: Ouster calls its
  scale logarithmic there, Velodyne only says that 255 is an ideal retroreflector;
- else the scale stays linear, and is cut off at ``intensity_max`` (Hesai: 255 %).

Near some sensors (``overlap_m``) codes fall short: the receiver sees only part of what the laser
lights. Of two Ousters that report asphalt at 1 % next to them and at 5 % farther on that part is
``1 / (1 + (overlap_m / range)^4)``. Light abounds there, so detection is as it is.

Units that the maker did not calibrate report on a scale of their own (``measured_code_scale``): the
backscatter is multiplied before it becomes a code.

Points carry the code divided by the greatest, 0 to 1. Of a sensor whose scale is unknown, white is
the greatest, 255.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from urbantwin.lidar.sensor import Sensor

__all__ = ["BEST_RETRO", "IntensityScale", "intensity_scale"]

#: Backscatter of the best retroreflective sheeting: pi times 700 cd per lx and m2 (ASTM D4956,
#: type VIII, white, at 0.2 and -4 degrees).
BEST_RETRO = 700 * np.pi


class IntensityScale(NamedTuple):
    """How backscatter becomes a code.

    Attributes:
        white: code of a white surface.
        greatest: code of the brightest return.
        per_log: codes per unit of the logarithm of backscatter above white; 0: linear.
    """

    white: float
    greatest: float
    per_log: float


def intensity_scale(sensor: Sensor) -> IntensityScale:
    """Return a sensor's scale."""
    greatest = 255.0 if sensor.intensity_max is None else float(sensor.intensity_max)
    white = greatest if sensor.intensity_of_white is None else float(sensor.intensity_of_white)
    has_retro = "retroreflector" in (sensor.intensity_scale or "") and greatest > white
    return IntensityScale(
        white, greatest, (greatest - white) / np.log(BEST_RETRO) if has_retro else 0.0
    )
