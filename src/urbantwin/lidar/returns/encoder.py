"""Encoder resolution: azimuths in the steps that a sensor reports.

A sensor fires wherever its encoder stands, and says where that was in whole steps
(``azimuth_step_deg``: a hundredth of a degree of Velodyne's and Hesai's packets). Columns that
fall on a step, like those of 0.2 degrees or an Ouster's, are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.sensor import Sensor

__all__ = ["as_reported", "encoder_errors"]


def encoder_errors(sensor: Sensor, columns: int) -> NDArray[np.float64]:
    """Return how far counter-clockwise of the truth each column (K,) is reported, radians."""
    step = sensor.azimuth_step_deg
    if step is None or sensor.pattern is not None:
        return np.zeros(columns)
    step = 360.0 / round(360.0 / step)  # A turn has a whole number of them.
    true = 360.0 * np.arange(columns) / columns
    error = np.rint(true / step) * step - true
    error[np.abs(error) < 1e-9] = 0.0
    return np.radians(error if sensor.spin == "ccw" else -error)


def as_reported(
    directions: NDArray[np.float64], sensor: Sensor, columns: int
) -> NDArray[np.float64]:
    """Return the directions (C * K, 3) that a sensor says its beams (C * K, 3) have."""
    error = encoder_errors(sensor, columns)
    if not error.any():
        return directions
    fans = directions.reshape(-1, columns, 3)
    cosine, sine = np.cos(error), np.sin(error)
    x, y = fans[..., 0], fans[..., 1]
    turned = np.stack([x * cosine - y * sine, x * sine + y * cosine, fans[..., 2]], axis=-1)
    return np.ascontiguousarray(turned.reshape(-1, 3))
