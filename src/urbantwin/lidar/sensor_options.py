"""Sensor options: model, columns, rate and return mode as a rig asks and the maker offers them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.lidar.catalogue import Sensor, sensor
from urbantwin.lidar.rig import ReturnMode
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import MOST_COLUMNS
from urbantwin.site.rig import RigSpec, SensorSpec

__all__ = [
    "SLOWEST_HZ",
    "check_models",
    "columns_at",
    "columns_of",
    "returns_of",
    "spin_of",
    "turns_per_second_of",
    "window_of",
]

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


#: Return mode of a sensor that names none: the first of these that its maker offers.
_MODES: tuple[ReturnMode, ...] = ("strongest", "first", "last", "dual")

#: Turns per second that a sensor may be asked for whatever its maker offers.
_SPIN_HZ = (SLOWEST_HZ, 20.0)


def check_models(spec: RigSpec, *, file: str | Path | None = None) -> tuple[Sensor, ...]:
    """Return the catalogue's sensors of a rig, which needs no site.

    Raises:
        InputError: an unknown model, or something that it does not offer. Names file and field.
    """
    return tuple(
        _checked_model(one, spec.rate_hz, file, f"sensors[{index}]")
        for index, one in enumerate(spec.sensors)
    )


def _checked_model(one: SensorSpec, rate_hz: float, file: str | Path | None, field: str) -> Sensor:
    def error(problem: str, name: str, expected: str) -> InputError:
        return InputError(problem, file=file, place=f"{field}.{name}", expected=expected)

    model = _model(one.model, file, f"{field}.model")
    columns = columns_of(model, one, rate_hz)
    if model.pattern is not None:
        if one.columns is not None:
            raise error(
                f"{model.name} scans a pattern, not columns",
                "columns",
                "no columns; points_per_second in the sensor's file",
            )
        if not 1 <= columns <= MOST_COLUMNS:
            raise error(
                f"{model.name} has {columns} points per line and frame",
                "columns",
                f"1 to {MOST_COLUMNS}: another rate_hz or points_per_second",
            )
    elif one.columns is not None and columns not in model.columns_options:
        options = ", ".join(map(str, model.columns_options))
        raise error(
            f"{model.name} does not offer {columns} columns", "columns", f"one of {options}"
        )
    low, high = min(*_SPIN_HZ, *model.rate_options), max(*_SPIN_HZ, *model.rate_options)
    if one.rate_hz is None and model.pattern is None and rate_hz > high:
        raise InputError(
            f"{model.name} does not turn {rate_hz:g} times a second",
            file=file,
            place="rate_hz",
            expected=f"at most {high:g}, or a rate_hz of {field} itself: {low:g} to {high:g}",
        )
    if one.rate_hz is not None:
        if model.pattern is not None:
            raise error(f"{model.name} does not turn", "rate_hz", "none; the rig's rate_hz")
        if not low <= one.rate_hz <= high:
            raise error(
                f"{model.name} does not turn {one.rate_hz:g} times a second",
                "rate_hz",
                f"{low:g} to {high:g}",
            )
    modes = model.return_modes
    if modes is not None and one.returns is not None and one.returns not in modes:
        raise error(
            f"{model.name} does not report {one.returns!r}", "returns", f"one of {', '.join(modes)}"
        )
    for number, outage in enumerate(one.outages):
        highest = max(outage.channels or [0])
        if highest >= model.channels:
            raise error(
                f"{model.name} has no channel {highest}",
                f"outages[{number}].channels",
                f"0 to {model.channels - 1}",
            )
    return model


def returns_of(model: Sensor, one: SensorSpec) -> ReturnMode:
    """Return which echoes of a beam a sensor reports."""
    if one.returns is not None:
        return one.returns
    offered = model.return_modes
    return next((mode for mode in _MODES if offered is None or mode in offered), "strongest")


def columns_of(model: Sensor, one: SensorSpec, rate_hz: float) -> int:
    """Return the columns per turn, or the points per line and frame of a pattern."""
    if model.pattern is not None:
        return round((model.points_per_second or 0.0) / model.channels / rate_hz)
    if one.columns is not None:
        return one.columns
    return columns_at(model, turns_per_second_of(model, one, rate_hz))


def turns_per_second_of(model: Sensor, one: SensorSpec, rate_hz: float) -> float:
    """Return how fast a sensor turns in a rig of so many frames per second."""
    return spin_of(model, rate_hz) if one.rate_hz is None else one.rate_hz


def window_of(spec: RigSpec, models: Sequence[Sensor]) -> float:
    """Return how long a frame collects: to the next frame, or one turn now and then."""
    if spec.window_s is not None:
        return spec.window_s
    between_s = 1.0 / spec.rate_hz
    if all(spin_of(model, spec.rate_hz) == spec.rate_hz for model in models):
        return between_s
    turns = (
        1.0 / turns_per_second_of(model, one, spec.rate_hz)
        for one, model in zip(spec.sensors, models, strict=True)
    )
    return min(between_s, max(turns))


def _model(name: str, file: str | Path | None, place: str) -> Sensor:
    try:
        return sensor(name, folder=None if file is None else Path(file).parent)
    except InputError as error:
        if error.file is not None:  # The fault is inside a person's own sensor file.
            raise
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None
