"""Pulses stretched by ground that is met at a grazing angle.

A beam of divergence d at range R lies on a surface that is turned away by the angle a over
``R d tan(a)`` of range: its near and its far end come back one after the other, and the pulse is
longer and lower (Wagner et al. 2006, ISPRS J. Photogramm. 60(2), section 3; Baltsavias 1999, ISPRS
J. Photogramm. 54, 199-214). Pulse and beam are Gaussians, so the widths add in squares. A receiver
whose filter is matched to its own pulse, of length `CELL_M`, sees of its peak

    1 / sqrt(1 + (R d tan(a) / CELL_M)^2 / 2)

and detects it accordingly; the energy, and with it the reflectivity that it reports, is what it
was: real OS1-128 report asphalt as bright at 4 degrees as at 8, but lose it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.clutter import CELL_M
from urbantwin.lidar.sensor import Sensor

__all__ = ["divergence", "peak_left"]

#: Surfaces are not seen more edge on than this (cosine).
_LEAST = 1e-3


def divergence(sensor: Sensor) -> float:
    """Return the full width at half maximum of a beam, radians; 0 where it is not published."""
    if sensor.beam_divergence_deg is None:
        return 0.0
    return float(np.sqrt(np.prod(np.radians(sensor.beam_divergence_deg))))


def peak_left(
    divergence_rad: float, range_m: NDArray[np.floating], cosine: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return what is left (N,) of a pulse's peak, 0 to 1.

    Args:
        divergence_rad: of the beam.
        range_m: (N,) of the surface.
        cosine: (N,) of the angle of incidence.
    """
    if divergence_rad == 0:
        return np.ones(len(range_m), np.float32)
    faced = np.maximum(cosine, _LEAST)
    longer = range_m * divergence_rad / CELL_M * np.sqrt(np.maximum(1 - faced**2, 0)) / faced
    return np.asarray(1 / np.sqrt(1 + longer**2 / 2), np.float32)
