"""A sensor whose YAML file names a scan pattern in place of channels and columns."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.lidar.scan_pattern import load_scan_pattern
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import FORM, checked_sensor

__all__ = ["MOST_COLUMNS", "pattern_sensor"]

#: Most points of a line in a frame: labels number them in 16 bits.
MOST_COLUMNS = 0xFFFF
_OF_THE_PATTERN = ("channels", "columns", "columns_options", "modes", "firing_time_us")


def pattern_sensor(value: dict[str, Any], path: Path) -> Sensor:
    """Return the sensor of a file with ``pattern: FILE`` (beside it) and ``points_per_second``.

    Without ``points_per_second`` it fires as often as the pattern has points; without ``rate_hz``
    it gives 10 frames per second by default.

    Raises:
        InputError: the form, the pattern or the point rate is wrong; names the field.
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
