"""The default spin rate of a sensor, and its columns per turn at a rate."""

from __future__ import annotations

from urbantwin.lidar.sensor import Sensor

__all__ = ["SLOWEST_HZ", "columns_at", "spin_of"]

#: Turns per second below which no sensor turns; one whose maker offers less does.
SLOWEST_HZ = 5.0
_SAME = 1e-6


def spin_of(model: Sensor, frames_per_second: float) -> float:
    """Return the turns per second of a sensor that is asked for some frames per second.

    As many as frames, but where it cannot turn so slowly: there its own default, and a frame is
    one of its turns now and then.
    """
    if model.pattern is not None:
        return frames_per_second
    slowest = min(SLOWEST_HZ, *model.rate_options)
    return frames_per_second if frames_per_second >= slowest - _SAME else model.rate_hz


def columns_at(model: Sensor, turns_per_second: float) -> int:
    """Return the columns per turn that a sensor has by default when it turns at some rate.

    Most sensors fire at a steady rate, so that a faster turn has fewer columns: the maker's modes
    say how many, and between them the time of a firing sequence does where it is fixed. Others
    keep their default, or, where they would have to fire faster than in any mode, take the next
    lower number that the maker offers.
    """
    modes = model.modes or ((model.columns, model.rate_hz),)
    at_rate = [columns for columns, rate in modes if abs(rate - turns_per_second) < _SAME]
    if at_rate:
        return model.columns if model.columns in at_rate else max(at_rate)
    if model.firing_sequence_us is not None:
        return max(1, round(1e6 / (model.firing_sequence_us * turns_per_second)))
    most = max(columns * rate for columns, rate in modes) * (1 + _SAME)
    offered = [columns for columns in (model.columns, *sorted(model.columns_options, reverse=True))
               if columns * turns_per_second <= most]  # fmt: skip
    return offered[0] if offered else min(model.columns_options)
