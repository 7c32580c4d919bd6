"""Signs by the German catalogue's numbers, which CARLA knows."""

from __future__ import annotations

import math
from dataclasses import replace

from urbantwin.roads.model import LaneModel, RoadSignal
from urbantwin.roads.signals import meaning_of

__all__ = ["numbered_for_carla"]

#: CARLA 0.9.16, ``carla.LandmarkType``: MaximumSpeed, StopSign, YieldSign.
NUMBERS = {"limit": "274", "stop": "206", "yield": "205"}
KM_H = {"mph": 1.609344, "m/s": 3.6}


def numbered_for_carla(model: LaneModel) -> LaneModel:
    """Return a lane model whose signs have German numbers, and whose limits are in km/h."""
    return replace(model, signals=tuple(map(_german, model.signals)))


def _german(signal: RoadSignal) -> RoadSignal:
    meaning = None if signal.dynamic else meaning_of(signal)
    if meaning is None:
        return signal
    value, unit = signal.value, signal.unit
    if unit in KM_H and math.isfinite(value):
        value, unit = float(round(value * KM_H[unit])), "km/h"
    return replace(
        signal, country="DE", type=NUMBERS[meaning], subtype="-1", value=value, unit=unit
    )
