"""A sensor from the metadata of a real Ouster unit.

Both layouts are read: the old one with all keys at the top, and that of firmware 2.2 and later with
``beam_intrinsics``, ``config_params``, ``lidar_data_format`` and ``sensor_info`` (Ouster sensor
documentation, HTTP API, ``metadata``; ouster-sdk, ``metadata.cpp``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import MOST_CHANNELS
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["ouster_sensor"]

_EXPECTED = "the metadata of an Ouster sensor"
_SECTIONS = ("beam_intrinsics", "config_params", "lidar_data_format", "data_format", "sensor_info")


def ouster_sensor(text: str, file: Path, known: Callable[[str], Sensor | None]) -> Sensor:
    """Return the sensor that a unit's metadata describes.

    Angles, mode and beam origin are the unit's; other values (ranges, wavelength, returns) are
    those of the product line, and unknown if the catalogue lacks it.

    Args:
        text: text of the file, JSON.
        file: the file, for errors and sources.
        known: returns the catalogue's sensor of a name, or ``None``.

    Raises:
        InputError: not JSON, or keys missing or wrong; names the key.
    """
    values = _flat(_json(text, file), file)
    up = _angles(values, "beam_altitude_angles", 90.0, file)
    clockwise = _angles(values, "beam_azimuth_angles", 180.0, file)
    if len(up) != len(clockwise):
        raise InputError(
            f"{len(up)} beam_altitude_angles but {len(clockwise)} beam_azimuth_angles",
            file=file,
            expected="one of each for every channel",
        )
    rows = values.get("pixels_per_column")
    if rows is not None and rows != len(up):
        raise InputError(f"{len(up)} beams, but pixels_per_column {rows}", file=file)
    columns, rate_hz = _mode(values, file)
    origin_m = _beam_origin(values, file)
    line = values.get("prod_line")
    line = line if isinstance(line, str) and line.strip() else None
    base = _of_product_line(line, len(up), known)

    here = f"metadata {file.name}"
    own = {"elevation_deg": here, "azimuth_offset_deg": here, "columns": here, "rate_hz": here}
    own |= {"columns_options": here, "rate_options": here, "modes": here}
    own |= {} if origin_m is None else {"beam_origin_m": here}
    options = set(base.columns_options) if base else set()
    rates = set(base.rate_options) if base else set()
    modes = {*(base.modes or () if base else ()), (columns, rate_hz)}
    reason = "not in the metadata" + (f", and {line} is not in the catalogue" if line else "")
    unknown = dict(base.unknown) if base else dict.fromkeys(_datasheet_fields(), reason)
    return replace(
        base or _blank(),
        name=line or file.stem,
        aliases=(),
        elevation_deg=up,
        azimuth_offset_deg=-clockwise + 0.0,
        columns=columns,
        columns_options=tuple(sorted(options | {columns})),
        rate_hz=rate_hz,
        rate_options=tuple(sorted(rates | {rate_hz})),
        modes=tuple(sorted(modes)),
        firing_time_us=np.zeros(len(up)) if base else None,
        beam_origin_m=origin_m,
        sources={**(base.sources if base else {}), **own},
        unknown={
            **{field: why for field, why in unknown.items() if field not in own},
            **({"beam_origin_m": "not in the metadata"} if origin_m is None else {}),
        },
    )


def _json(text: str, file: Path) -> dict[str, Any]:
    try:
        value = parse_json(text)
    except NotJsonError as error:
        problem = f"is not JSON ({error.problem})"
        raise InputError(problem, file=file, place=error.place, expected=_EXPECTED) from None
    if not isinstance(value, dict):
        raise InputError("is not a table of keys", file=file, expected=_EXPECTED)
    return value


def _flat(document: dict[str, Any], file: Path) -> dict[str, Any]:
    """Return all keys in one table, for both layouts."""
    values = dict(document)
    for section in _SECTIONS:
        nested = document.get(section)
        if nested is None:
            continue
        if not isinstance(nested, dict):
            raise InputError("is not a table of keys", file=file, place=section, expected=_EXPECTED)
        values |= nested
    return values


def _angles(values: dict[str, Any], key: str, most: float, file: Path) -> NDArray[np.float64]:
    angles = values.get(key)
    if not isinstance(angles, list):
        problem = "is missing" if angles is None else "is not a list"
        raise InputError(problem, file=file, place=key, expected=_EXPECTED)
    if not 1 <= len(angles) <= MOST_CHANNELS:
        raise InputError(
            f"has {len(angles)} channels", file=file, place=key, expected=f"1 to {MOST_CHANNELS}"
        )
    for index, angle in enumerate(angles):
        if not _is_number(angle) or not -most <= angle <= most:
            raise InputError(
                f"{angle!r:.40} is not an angle",
                file=file,
                place=f"{key}[{index}]",
                expected=f"-{most:g} to {most:g} degrees",
            )
    return np.array(angles, np.float64)


def _mode(values: dict[str, Any], file: Path) -> tuple[int, float]:
    mode = values.get("lidar_mode")
    if mode is None:
        columns = values.get("columns_per_frame", 1024)
        if not isinstance(columns, int) or not 1 <= columns <= 65536:
            raise InputError(f"{columns!r:.40} is not a number of columns", file=file)
        return columns, 10.0
    parts = re.fullmatch(r"(?:MODE_)?(\d{1,5})x(\d{1,3})", mode) if isinstance(mode, str) else None
    if parts is None or not 1 <= int(parts[1]) <= 65536 or int(parts[2]) < 1:
        raise InputError(
            f"{mode!r:.40} is not a mode", file=file, place="lidar_mode", expected="as in 1024x10"
        )
    return int(parts[1]), float(parts[2])


def _beam_origin(values: dict[str, Any], file: Path) -> float | None:
    key = "lidar_origin_to_beam_origin_mm"
    millimetres = values.get(key)
    if millimetres is None:
        return None
    if not _is_number(millimetres) or not 0 <= millimetres <= 1000:
        raise InputError(
            f"{millimetres!r:.40} is not an offset", file=file, place=key, expected="0 to 1000 mm"
        )
    return float(millimetres) / 1000


def _is_number(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _of_product_line(
    line: str | None, channels: int, known: Callable[[str], Sensor | None]
) -> Sensor | None:
    """Return the catalogue's sensor of a product line, such as ``OS-1-128`` or ``OS-0-32-U1``.

    Later units of 64 channels (with a suffix) differ from the first generation that a bare
    ``OS-1-64`` is: they take the values of the 128 channels of their own generation.
    """
    parts = re.match(r"OS-?([012])-?(\d+)(.*)", line or "")
    if parts is None:
        return None
    later = bool(parts[3]) and parts[1] == "1" and channels == 64
    exact = None if later else known(f"OS{parts[1]}-{channels}")
    return exact or known(f"OS{parts[1]}-128")


def _datasheet_fields() -> tuple[str, ...]:
    return tuple(field.name for field in fields(Sensor) if getattr(_blank(), field.name) is None)


def _blank() -> Sensor:
    """Return a sensor with all values unknown but the maker."""
    return Sensor.of_beams("Ouster", np.zeros(1), np.zeros(1), 1, 1.0)
