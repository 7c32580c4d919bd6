"""Options of sensors in a rig (model, columns, rotation rate, return mode) and their defaults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.lidar.catalogue import sensor
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

#: Least turns per second, unless the maker offers fewer.
SLOWEST_HZ = 5.0
_SAME = 1e-6


def spin_of(model: Sensor, frames_per_second: float) -> float:
    """Return the rotation rate of a sensor for a frame rate, turns per second.

    The frame rate; if the sensor cannot turn so slowly, its own default, with one turn per frame.
    """
    if model.pattern is not None:
        return frames_per_second
    slowest = min(SLOWEST_HZ, *model.rate_options)
    return frames_per_second if frames_per_second >= slowest - _SAME else model.rate_hz


def columns_at(model: Sensor, turns_per_second: float) -> int:
    """Return the default number of columns per turn at a rotation rate.

    Most sensors fire at a constant rate, so faster turns have fewer columns: the maker's modes say
    how many, and between them the firing sequence if it is fixed. Other sensors keep their default,
    or take the next lower offered number if they would fire faster than in any mode.
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


#: Default return mode: the first of these that the maker offers.
_MODES: tuple[ReturnMode, ...] = ("strongest", "first", "last", "dual")

#: Rotation rates that are accepted for every sensor.
_SPIN_HZ = (SLOWEST_HZ, 20.0)


def check_models(spec: RigSpec, *, file: str | Path | None = None) -> tuple[Sensor, ...]:
    """Return the catalogue's sensors of a rig; needs no site.

    Raises:
        InputError: unknown model, or an option that it does not offer. Names file and field.
    """
    return tuple(
        _checked_model(written, spec.rate_hz, file, f"sensors[{index}]")
        for index, written in enumerate(spec.sensors)
    )


def _checked_model(
    written: SensorSpec, rate_hz: float, file: str | Path | None, field: str
) -> Sensor:
    def error(problem: str, name: str, expected: str) -> InputError:
        return InputError(problem, file=file, place=f"{field}.{name}", expected=expected)

    model = _model(written.model, file, f"{field}.model")
    columns = columns_of(model, written, rate_hz)
    if model.pattern is not None:
        if written.columns is not None:
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
    elif written.columns is not None and columns not in model.columns_options:
        options = ", ".join(map(str, model.columns_options))
        raise error(
            f"{model.name} does not offer {columns} columns", "columns", f"one of {options}"
        )
    low, high = min(*_SPIN_HZ, *model.rate_options), max(*_SPIN_HZ, *model.rate_options)
    if written.rate_hz is None and model.pattern is None and rate_hz > high:
        raise InputError(
            f"{model.name} does not turn {rate_hz:g} times a second",
            file=file,
            place="rate_hz",
            expected=f"at most {high:g}, or a rate_hz of {field} itself: {low:g} to {high:g}",
        )
    if written.rate_hz is not None:
        if model.pattern is not None:
            raise error(f"{model.name} does not turn", "rate_hz", "none; the rig's rate_hz")
        if not low <= written.rate_hz <= high:
            raise error(
                f"{model.name} does not turn {written.rate_hz:g} times a second",
                "rate_hz",
                f"{low:g} to {high:g}",
            )
    modes = model.return_modes
    if modes is not None and written.returns is not None and written.returns not in modes:
        raise error(
            f"{model.name} does not report {written.returns!r}",
            "returns",
            f"one of {', '.join(modes)}",
        )
    for number, outage in enumerate(written.outages):
        highest = max(outage.channels or [0])
        if highest >= model.channels:
            raise error(
                f"{model.name} has no channel {highest}",
                f"outages[{number}].channels",
                f"0 to {model.channels - 1}",
            )
    return model


def returns_of(model: Sensor, one: SensorSpec) -> ReturnMode:
    """Return the return mode of a sensor."""
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
    """Return the rotation rate of a sensor at the rig's frame rate."""
    return spin_of(model, rate_hz) if one.rate_hz is None else one.rate_hz


def window_of(spec: RigSpec, models: Sequence[Sensor]) -> float:
    """Return the duration of a frame, seconds: until the next frame, or one turn if shorter."""
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
        if error.file is not None:  # the error is inside the user's sensor file
            raise
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None
