"""A sensor from the angle-correction file of a real Hesai unit.

The file is the CSV that PandarView and the unit's web page export and that Hesai's drivers read: a
heading ``Channel,Elevation,Azimuth`` (or ``Laser id``), then a line per channel
(HesaiLidar_SDK_2.0, ``correction/angle_correction``). It holds angles only; the rest is inherited
from a catalogue model.
"""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import MOST_CHANNELS
from urbantwin.number_text import plain_number, whole_number

__all__ = ["hesai_sensor", "is_hesai_heading"]

_EXPECTED = "lines of channel, elevation and azimuth (a Hesai angle correction)"
#: Some exports have a line or two before the heading.
_LINES_BEFORE_HEADING = 4


def is_hesai_heading(cells: list[str]) -> bool:
    """Return whether a line is the heading of an angle-correction file."""
    words = [cell.strip().lower().replace(" ", "").replace("_", "") for cell in cells[:3]]
    return len(words) == 3 and words[0] in _CHANNEL and words[1:] == ["elevation", "azimuth"]


_CHANNEL = ("channel", "laserid", "channelid", "laser")


def hesai_sensor(text: str, file: Path, model: Sensor) -> Sensor:
    """Return a model with the angles of one unit.

    Args:
        text: text of the file, CSV.
        file: the file, for errors and sources.
        model: catalogue model that supplies everything else.

    Raises:
        InputError: not such a file, wrong numbers, or another number of channels than the model's;
            names the line.
    """
    try:
        rows = list(csv.reader(text.splitlines()))
    except csv.Error as error:
        raise InputError(f"is not CSV ({error})", file=file, expected=_EXPECTED) from None
    heading = next(
        (n for n, row in enumerate(rows[: _LINES_BEFORE_HEADING + 1]) if is_hesai_heading(row)),
        None,
    )
    if heading is None:
        raise InputError("has no heading Channel,Elevation,Azimuth", file=file, expected=_EXPECTED)
    table: dict[int, tuple[float, float]] = {}
    for number, row in enumerate(rows[heading + 1 :], heading + 2):
        cells = [cell.strip() for cell in row]
        if not any(cells[1:]):  # an empty line, or the checksum at the end of some files
            continue
        channel, angles = _channel(cells, file, number)
        if channel > MOST_CHANNELS:  # before missing channels are listed
            raise InputError(
                f"has channel {channel}, more than {MOST_CHANNELS}",
                file=file,
                place=f"line {number}",
                expected=f"1 to {MOST_CHANNELS}",
            )
        if channel in table:
            raise InputError(f"channel {channel} comes twice", file=file, place=f"line {number}")
        table[channel] = angles
        if len(table) > MOST_CHANNELS:
            raise InputError(f"has more than {MOST_CHANNELS} channels", file=file)
    if not table:
        raise InputError("has 0 channels", file=file, expected=_EXPECTED)
    missing = sorted(set(range(1, max(table) + 1)) - set(table))
    if missing or min(table) < 1:
        wrong = f"channel {missing[0]} is missing" if missing else f"channel {min(table)}"
        raise InputError(wrong, file=file, expected="channels numbered from 1 without a gap")
    if len(table) != model.channels:
        raise InputError(
            f"has {len(table)} channels",
            file=file,
            expected=f"the {model.channels} of {model.name}",
        )
    angle = np.array([table[channel] for channel in sorted(table)], np.float64)
    here = f"angle correction {file.name}"
    return replace(
        model,
        name=model.name,
        aliases=(),
        elevation_deg=angle[:, 0],
        # Hesai's azimuth grows clockwise.
        azimuth_offset_deg=(180.0 - angle[:, 1]) % 360.0 - 180.0,
        sources={**model.sources, "elevation_deg": here, "azimuth_offset_deg": here},
    )


def _channel(cells: list[str], file: Path, line: int) -> tuple[int, tuple[float, float]]:
    place = f"line {line}"
    try:
        up, clockwise = plain_number(cells[1]), plain_number(cells[2])
        channel = whole_number(cells[0])
        if channel is None:
            raise ValueError(cells[0])
    except (ValueError, IndexError):
        raise InputError(
            f"{','.join(cells)!r:.40} is not a channel and its angles",
            file=file,
            place=place,
            expected="as in 1,14.882,-1.042",
        ) from None
    if not (math.isfinite(up) and -90 <= up <= 90):
        raise InputError(f"elevation {up:g}", file=file, place=place, expected="-90 to 90 degrees")
    if not (math.isfinite(clockwise) and -360 <= clockwise <= 360):
        raise InputError(
            f"azimuth {clockwise:g}",
            file=file,
            place=f"line {line}",
            expected="-360 to 360 degrees",
        )
    return channel, (up, clockwise)
