"""Files of sensors (YAML): their schema, and sensors with a scan pattern."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from urbantwin.errors import InputError
from urbantwin.lidar.scan_pattern import load_scan_pattern
from urbantwin.lidar.sensor import Sensor

__all__ = [
    "FORM",
    "MOST_CHANNELS",
    "MOST_COLUMNS",
    "checked_sensor",
    "parse_sensor",
    "pattern_sensor",
    "read_text",
    "sensor_document",
    "yaml_value",
]

#: Most points of a line in a frame: labels store the column in 16 bits.
MOST_COLUMNS = 0xFFFF
_OF_THE_PATTERN = ("channels", "columns", "columns_options", "modes", "firing_time_us")


def pattern_sensor(value: dict[str, Any], path: Path) -> Sensor:
    """Return the sensor of a file with ``pattern: FILE`` and ``points_per_second``.

    The pattern is in the same folder. Without ``points_per_second`` the point rate is the
    pattern's; ``rate_hz`` is 10 by default.

    Raises:
        InputError: invalid form, pattern or point rate; names the field.
    """
    given = dict(value)
    for name in _OF_THE_PATTERN:
        if name in given:
            raise InputError("is not for a sensor with a pattern", file=path, place=name)
    named = given.pop("pattern")
    if not isinstance(named, str) or not named:
        raise InputError("is not a file's name", file=path, place="pattern", expected=FORM)
    pattern = load_scan_pattern(path.parent / named)
    points = given.pop("points_per_second", pattern.points_per_second)
    if not _is_positive(points):
        raise InputError(
            f"{points!r:.40} is not a rate",
            file=path,
            place="points_per_second",
            expected="points per second, of all lines",
        )
    rate_hz = given.setdefault("rate_hz", 10.0)
    given.setdefault("rate_options", [rate_hz])
    columns = round(points / pattern.lines / rate_hz) if _is_positive(rate_hz) else 1
    if not 1 <= columns <= MOST_COLUMNS:
        raise InputError(
            f"{columns} points per line and frame",
            file=path,
            place="points_per_second",
            expected=f"1 to {MOST_COLUMNS}",
        )
    given |= {"columns": columns, "columns_options": [columns]}
    given["channels"] = [[float(np.mean(line)), 0.0] for line in pattern.elevation_deg]
    return replace(
        checked_sensor(given, path, FORM), pattern=pattern, points_per_second=float(points)
    )


def _is_positive(value: Any) -> bool:  # noqa: ANN401
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and value > 0
    )


#: Limit of channels; no sensor has as many.
MOST_CHANNELS = 4096
_MOST_BYTES = 8_000_000
_DEEPEST = 32
#: Expectation in errors of the schema.
FORM = "the form of a sensor's file"

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Columns = Annotated[int, Field(ge=1, le=65536)]
_Elevation = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
_Offset = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
_Divergence = Annotated[float, Field(gt=0, le=10, allow_inf_nan=False)]


class _SensorFile(BaseModel):
    """Schema of a sensor's file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1)]
    maker: str
    aliases: tuple[str, ...] = ()
    spin: Literal["cw", "ccw"] = "cw"
    columns: _Columns
    columns_options: tuple[_Columns, ...]
    rate_hz: _Positive
    rate_options: tuple[_Positive, ...]
    modes: tuple[tuple[_Columns, _Positive], ...] | None = None
    range_min_m: _NotNegative | None
    range_max_m: _Positive | None
    reference_reflectivity: Annotated[float, Field(gt=0, le=1)] | None
    reference_range_m: _Positive | None
    detection_range_10_m: _Positive | None = None
    detection_range_80_m: _Positive | None = None
    range_sigma_m: _NotNegative | None
    range_resolution_m: _NotNegative | None
    azimuth_step_deg: _Positive | None = None
    wavelength_nm: _Positive | None
    beam_divergence_deg: tuple[_Divergence, _Divergence] | None = None
    beam_origin_m: _NotNegative | None = None
    measured_light: _Positive | None = None
    measured_sigma_m: _NotNegative | None = None
    measured_faintest: Annotated[float, Field(gt=0, lt=0.1)] | None = None
    measured_divergence_deg: tuple[_Divergence, _Divergence] | None = None
    weak_sigma_m: _Positive | None = None
    overlap_m: _Positive | None = None
    measured_code_scale: _Positive | None = None
    return_modes: tuple[str, ...] | None = None
    intensity_scale: str | None = None
    intensity_of_white: _Positive | None = None
    intensity_max: _Positive | None = None
    firing_sequence_us: _Positive | None = None
    firing_time_us: tuple[Annotated[float, Field(allow_inf_nan=False)], ...] | None = None
    sources: dict[str, str] = Field(default_factory=dict)
    unknown: dict[str, str] = Field(default_factory=dict)
    channels: Annotated[
        tuple[tuple[_Elevation, _Offset], ...], Field(min_length=1, max_length=MOST_CHANNELS)
    ]

    @model_validator(mode="after")
    def _agree(self) -> _SensorFile:
        if self.columns not in self.columns_options:
            raise ValueError(f"columns: {self.columns} is not among columns_options")
        if self.rate_hz not in self.rate_options:
            raise ValueError(f"rate_hz: {self.rate_hz} is not among rate_options")
        if None not in (self.range_min_m, self.range_max_m) and (
            (self.range_min_m or 0) >= (self.range_max_m or 0)
        ):
            raise ValueError("range_min_m: is not below range_max_m")
        if (self.reference_reflectivity is None) != (self.reference_range_m is None):
            raise ValueError("reference_range_m: needs reference_reflectivity, and the reverse")
        if self.firing_time_us is not None and len(self.firing_time_us) != len(self.channels):
            raise ValueError(
                f"firing_time_us: has {len(self.firing_time_us)} times "
                f"for {len(self.channels)} channels"
            )
        return self

    def sensor(self) -> Sensor:
        values = self.model_dump(exclude={"channels", "sources", "unknown", "firing_time_us"})
        table = np.array(self.channels, np.float64)
        table.setflags(write=False)
        times = None
        if self.firing_time_us is not None:
            times = np.array(self.firing_time_us, np.float64)
            times.setflags(write=False)
        return Sensor(
            **values,
            elevation_deg=table[:, 0],
            azimuth_offset_deg=table[:, 1],
            firing_time_us=times,
            sources=dict(self.sources),
            unknown=dict(self.unknown),
        )


def read_text(path: Path, kind: str) -> str:
    """Read a text file of the user.

    Raises:
        InputError: missing, too large, or not text; names the file.
    """
    try:
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError(f"is larger than {_MOST_BYTES / 1e6:g} MB", file=path, expected=kind)
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=kind) from None
    except UnicodeDecodeError:
        raise InputError("is not text", file=path, expected=kind) from None
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot be read ({reason})", file=path, expected=kind) from None


def parse_sensor(text: str, origin: Path | str) -> Sensor:
    """Return the sensor of a YAML text.

    Raises:
        InputError: not YAML, or not the schema; names the file and the field.
    """
    return checked_sensor(yaml_value(text, origin), origin, FORM)


def yaml_value(text: str, origin: Path | str) -> Any:  # noqa: ANN401
    """Parse a YAML text.

    Raises:
        InputError: not YAML; names the file and the line.
    """
    # The C loader is five times as fast; not every build has it.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        if not isinstance(origin, str):
            _check_depth(text, loader, origin)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise InputError(
            f"is not YAML ({getattr(error, 'problem', error)})",
            file=origin,
            place=None if mark is None else f"line {mark.line + 1}",
        ) from None


def _check_depth(text: str, loader: Any, origin: Path) -> None:  # noqa: ANN401
    """Reject a file that is nested deeper than the C loader's stack allows."""
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise InputError(
                f"is nested deeper than {_DEEPEST} levels",
                file=origin,
                expected=FORM,
            )


def checked_sensor(value: Any, origin: Path | str, expected: str) -> Sensor:  # noqa: ANN401
    """Return the sensor of parsed values.

    Raises:
        InputError: not the schema; names the file and the field.
    """
    if not isinstance(value, dict):
        raise InputError("is not a table of keys", file=origin, expected=expected)
    try:
        return _SensorFile.model_validate(value).sensor()
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(problem, file=origin, place=place or None, expected=expected) from None


def sensor_document(sensor: Sensor) -> dict[str, Any]:
    """Return a sensor in the form of its file, the inverse of `checked_sensor`.

    Args:
        sensor: a sensor with channels, not a scan pattern.
    """
    others = _SensorFile.model_fields.keys() - {"channels", "firing_time_us"}
    times, table = sensor.firing_time_us, (sensor.elevation_deg, sensor.azimuth_offset_deg)
    form = _SensorFile(
        **{name: getattr(sensor, name) for name in others},
        firing_time_us=None if times is None else tuple(times.tolist()),
        channels=tuple(zip(*(column.tolist() for column in table), strict=True)),
    )
    return form.model_dump(mode="json", exclude_defaults=True)
