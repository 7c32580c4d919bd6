"""Outages: which beams of a sensor report nothing, and when."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.pattern import beam_azimuths, pattern_directions
from urbantwin.lidar.rig import MountedSensor

__all__ = ["dead_beams"]

#: Azimuths this near to the border of a sector are on it, degrees: they are binary fractions.
_ON_THE_BORDER_DEG = 1e-9


def dead_beams(mounted: MountedSensor, time_s: float) -> NDArray[np.bool_] | None:
    """Return which beams (C, K) report nothing; ``None`` where all work.

    Args:
        mounted: the sensor.
        time_s: of the frame, seconds from the motion's start; an outage that is under way then
            lasts for the whole frame.
    """
    active = tuple(
        number
        for number, one in enumerate(mounted.outages)
        if one.start_s <= time_s and (one.stop_s is None or time_s < one.stop_s)
    )
    if not active:
        return None
    # The beams of a pattern that does not repeat are others in every frame.
    frame = round(time_s * mounted.rate_hz) if mounted.sensor.pattern is not None else 0
    return _dead(mounted, active, frame)


@lru_cache(maxsize=16)
def _dead(mounted: MountedSensor, active: tuple[int, ...], frame: int) -> NDArray[np.bool_]:
    azimuth_deg = np.degrees(_azimuths(mounted, frame))
    dead = np.zeros(azimuth_deg.shape, bool)
    for number in active:
        outage = mounted.outages[number]
        hit = np.ones(azimuth_deg.shape, bool)
        if outage.sector_deg is not None:
            first, last = outage.sector_deg
            width = 360.0 if abs(last - first) >= 360.0 else (last - first) % 360.0
            past = (azimuth_deg - first + _ON_THE_BORDER_DEG) % 360.0
            hit &= past <= width + 2 * _ON_THE_BORDER_DEG
        if outage.channels is not None:
            broken = np.zeros(len(azimuth_deg), bool)
            broken[outage.channels] = True
            hit &= broken[:, None]
        dead |= hit
    dead.flags.writeable = False
    return dead


def _azimuths(mounted: MountedSensor, frame: int) -> NDArray[np.float64]:
    """Return the azimuth (C, K) of every beam in a frame, radians."""
    pattern = mounted.sensor.pattern
    if pattern is None:
        return beam_azimuths(mounted.sensor, mounted.columns)
    beams = pattern_directions(pattern, mounted.columns, frame, mounted.rate_hz)
    return np.asarray(np.arctan2(beams[..., 1], beams[..., 0]))
