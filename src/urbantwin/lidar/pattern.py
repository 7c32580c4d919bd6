"""Directions of the beams of a spinning sensor.

Column k of K fires when the encoder is at 2 pi k / K from the forward axis, clockwise from above
for a clockwise sensor. A channel points ``azimuth_offset`` counter-clockwise of the encoder and
``elevation`` up. Rows are in the maker's numbering of channels; sort by ``elevation_deg`` for an
image. All beams leave from the sensor's origin: the few centimetres between emitters and axis are
neglected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.scan_pattern import ScanPattern
from urbantwin.lidar.sensor import Sensor

__all__ = [
    "beam_azimuths",
    "beam_directions",
    "beam_elevations",
    "pattern_directions",
    "pattern_times",
]


def beam_elevations(sensor: Sensor) -> NDArray[np.float64]:
    """Return the elevation (C,) of every channel, radians, positive up."""
    return np.radians(sensor.elevation_deg)


def beam_azimuths(
    sensor: Sensor, columns: int | None = None, *, turns_per_second: float = 0.0
) -> NDArray[np.float64]:
    """Return the azimuth (C, K) of every beam, radians in [-pi, pi), counter-clockwise from x.

    Args:
        sensor: the sensor.
        columns: firings per turn, K; the sensor's default if not given.
        turns_per_second: rotation rate of the head, which turns on while the channels of a column
            fire one after another; 0: all fire at the column's azimuth.
    """
    count = sensor.columns if columns is None else columns
    if count < 1:
        raise ValueError(f"columns must be 1 or more, not {count}")
    turn = -1.0 if sensor.spin == "cw" else 1.0
    encoder_deg = turn * 360.0 * np.arange(count) / count
    offset_deg = sensor.azimuth_offset_deg
    if sensor.firing_time_us is not None:
        offset_deg = offset_deg + turn * 360.0 * turns_per_second * sensor.firing_time_us * 1e-6
    angle_deg = encoder_deg[None, :] + offset_deg[:, None]
    return np.radians((angle_deg + 180.0) % 360.0 - 180.0)


def beam_directions(
    sensor: Sensor, columns: int | None = None, *, turns_per_second: float = 0.0
) -> NDArray[np.float64]:
    """Return the unit vectors (C, K, 3) of every beam in the sensor frame (x forward, y left).

    Args:
        sensor: the sensor.
        columns: firings per turn, K; the sensor's default when not given.
        turns_per_second: see `beam_azimuths`.
    """
    azimuth = beam_azimuths(sensor, columns, turns_per_second=turns_per_second)
    elevation = beam_elevations(sensor)[:, None]
    flat = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), azimuth.shape)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)


def pattern_times(columns: int, frame: int, rate_hz: float) -> NDArray[np.float64]:
    """Return the firing times (K,) of a frame's columns, seconds from the start of frame 0.

    Columns are equally spaced, across frames too.
    """
    if columns < 1 or rate_hz <= 0:
        raise ValueError(f"columns {columns} and rate {rate_hz} must be positive")
    count = float(frame) * columns + np.arange(columns, dtype=np.float64)
    return np.asarray(count / (columns * rate_hz), np.float64)


def pattern_directions(
    pattern: ScanPattern, columns: int, frame: int, rate_hz: float
) -> NDArray[np.float64]:
    """Return the beams of one frame of a non-repeating pattern.

    Args:
        pattern: directions of its L lines over one period.
        columns: points per line and frame, K: point rate over lines and frames.
        frame: number of the frame, from 0; the next frame continues the pattern.
        rate_hz: frames per second.

    Returns:
        (L, K, 3) unit vectors in the sensor frame (x forward, y left, z up).
    """
    return pattern.directions_at(pattern_times(columns, frame, rate_hz))
