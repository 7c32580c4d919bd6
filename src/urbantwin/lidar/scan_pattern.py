"""Scan patterns that do not repeat with a turn, such as Livox' rosettes.

A pattern file gives the direction of the beam over one period, as a table of ``time_s``,
``azimuth_deg`` (counter-clockwise from x), ``elevation_deg`` (up) and, if several lasers fire
together, ``line``: CSV with these names as heading, or NPZ with arrays of these names. The pattern
then repeats. Its period is ``period_s`` (a number in the NPZ; in a CSV a line ``# period_s: 4.0``
before the heading), or by default the last time plus one step.

Livox publishes such tables for its simulators (azimuth and zenith by time). A frame is the part of
the pattern within its own time, so consecutive frames have different beams.
"""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import read_arrays
from urbantwin.errors import InputError
from urbantwin.number_text import plain_number

__all__ = ["ScanPattern", "load_scan_pattern"]

_COLUMNS = ("time_s", "azimuth_deg", "elevation_deg")
_EXPECTED = "a table of time_s, azimuth_deg, elevation_deg (and line) of one period"
_MOST_POINTS = 4_000_000
_MOST_LINES = 4096
_MOST_BYTES = 400_000_000


@dataclass(frozen=True, eq=False)
class ScanPattern:
    """Beam directions of a sensor over one period.

    Attributes:
        name: name of the file.
        period_s: duration after which the pattern repeats.
        time_s: for each of L lines, (N_l,) float64, ascending within [0, period).
        azimuth_deg: for each line, (N_l,) float64, counter-clockwise from x.
        elevation_deg: for each line, (N_l,) float64, positive up.
        sha256: hash of all the above, for a dataset's manifest.
    """

    name: str
    period_s: float
    time_s: tuple[NDArray[np.float64], ...]
    azimuth_deg: tuple[NDArray[np.float64], ...]
    elevation_deg: tuple[NDArray[np.float64], ...]
    sha256: str

    @property
    def lines(self) -> int:
        """Number of lines, L: lasers that fire together."""
        return len(self.time_s)

    @property
    def points_per_second(self) -> float:
        """Point rate of the file."""
        return sum(len(line) for line in self.time_s) / self.period_s

    def directions_at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the directions of the lines at times (T,): unit vectors (L, T, 3), sensor frame.

        Linear interpolation of the unit vectors, normalised; cyclic at the end of the period.
        """
        return np.stack([self._line_at(line, time_s) for line in range(self.lines)])

    def _line_at(self, line: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        sample_s = self.time_s[line]
        azimuth, up = np.radians(self.azimuth_deg[line]), np.radians(self.elevation_deg[line])
        flat = np.cos(up)
        beam = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up)], axis=-1)
        phase = np.mod(time_s - sample_s[0], self.period_s)
        before = np.searchsorted(sample_s - sample_s[0], phase, side="right") - 1
        after = (before + 1) % len(sample_s)
        start = sample_s[before] - sample_s[0]
        step = np.where(after > 0, sample_s[after] - sample_s[0], self.period_s) - start
        part = ((phase - start) / step)[:, None]
        between = beam[before] * (1 - part) + beam[after] * part
        length = np.linalg.norm(between, axis=1, keepdims=True)
        # Opposite directions have no mean: the first one is kept.
        aim = np.where(length > 1e-6, between / np.maximum(length, 1e-6), beam[before])
        return np.asarray(aim, np.float64)


def load_scan_pattern(path: Path) -> ScanPattern:
    """Read a pattern file.

    Raises:
        InputError: not a pattern file, or invalid numbers; names the column and the row.
    """
    table, period_s = _npz(path) if path.suffix.lower() == ".npz" else _csv(path)
    columns = {name: _column(table, name, path) for name in (*_COLUMNS, "line") if name in table}
    missing = [name for name in _COLUMNS if name not in columns]
    if missing:
        raise InputError(f"has no {missing[0]}", file=path, expected=_EXPECTED)
    time_s = columns["time_s"]
    count = len(time_s)
    if any(len(values) != count for values in columns.values()):
        raise InputError("has columns of unequal length", file=path, expected=_EXPECTED)
    if not 2 <= count <= _MOST_POINTS:
        raise InputError(f"has {count} points", file=path, expected=f"2 to {_MOST_POINTS}")
    for name, most in (("azimuth_deg", 360.0), ("elevation_deg", 90.0)):
        _within(columns[name], -most, most, name, path)
    _within(time_s, 0.0, np.inf, "time_s", path)
    line = columns.get("line", np.zeros(count))
    _within(line, 0, _MOST_LINES - 1, "line", path)
    if (line != np.rint(line)).any():
        raise InputError("is not a whole number", file=path, place="line")
    numbers = np.unique(line)
    parts = [np.flatnonzero(line == number) for number in numbers]
    for number, rows in zip(numbers, parts, strict=True):
        back = np.flatnonzero(np.diff(time_s[rows]) <= 0)
        if len(back):
            raise InputError(
                f"{time_s[rows[back[0] + 1]]:g} s is not after the time before it",
                file=path,
                place=f"time_s[{rows[back[0] + 1]}]",
                expected=f"ascending times in line {number:g}",
            )
    last = float(time_s.max())
    if period_s is None:
        steps = np.concatenate([np.diff(time_s[rows]) for rows in parts])
        if not len(steps):
            raise InputError("has one time only", file=path, expected=_EXPECTED)
        period_s = last - float(time_s.min()) + float(np.median(steps))
    if not np.isfinite(period_s) or period_s <= last - float(time_s.min()):
        raise InputError(
            f"{period_s:g} s is shorter than the pattern",
            file=path,
            place="period_s",
            expected=f"more than {last - float(time_s.min()):g} s",
        )
    digest = hashlib.sha256(np.float64(period_s).tobytes())
    for values in (time_s, columns["azimuth_deg"], columns["elevation_deg"], line):
        digest.update(np.ascontiguousarray(values).tobytes())
    return ScanPattern(
        path.name,
        period_s,
        tuple(time_s[rows] for rows in parts),
        tuple(columns["azimuth_deg"][rows] for rows in parts),
        tuple(columns["elevation_deg"][rows] for rows in parts),
        digest.hexdigest(),
    )


def _within(values: NDArray[np.float64], low: float, high: float, name: str, path: Path) -> None:
    wrong = np.flatnonzero(~(np.isfinite(values) & (values >= low) & (values <= high)))
    if len(wrong):
        raise InputError(
            f"{values[wrong[0]]:g} is out of range",
            file=path,
            place=f"{name}[{wrong[0]}]",
            expected=f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more",
        )


def _column(table: dict[str, NDArray[np.generic]], name: str, path: Path) -> NDArray[np.float64]:
    values = table[name]
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        raise InputError("is not a list of numbers", file=path, place=name, expected=_EXPECTED)
    return values.astype(np.float64)


def _csv(path: Path) -> tuple[dict[str, NDArray[np.generic]], float | None]:
    period_s, heading, rows = None, None, []
    try:
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError(f"is larger than {_MOST_BYTES / 1e6:g} MB", file=path)
        with path.open(encoding="utf-8-sig", newline="") as stream:
            for number, line in enumerate(stream, 1):
                text = line.strip()
                if text.startswith("#"):
                    key, _, value = text.lstrip("# ").partition(":")
                    if key.strip() == "period_s":
                        period_s = _number(value, path, number)
                    continue
                if not text:
                    continue
                cells = [cell.strip() for cell in next(csv.reader([text]))]
                if heading is None:
                    heading = [cell.lower() for cell in cells]
                    continue
                if len(cells) != len(heading):
                    problem = f"has {len(cells)} values for {len(heading)} columns"
                    raise InputError(problem, file=path, place=f"line {number}", expected=_EXPECTED)
                rows.append([_number(cell, path, number) for cell in cells])
                if len(rows) > _MOST_POINTS:
                    raise InputError(f"has more than {_MOST_POINTS} points", file=path)
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=_EXPECTED) from None
    except UnicodeDecodeError:
        raise InputError("is not text", file=path, expected=_EXPECTED) from None
    except (OSError, csv.Error) as error:
        raise InputError(f"cannot be read ({error})", file=path, expected=_EXPECTED) from None
    if heading is None:
        raise InputError("is empty", file=path, expected=_EXPECTED)
    table = np.array(rows, np.float64).reshape(-1, len(heading))
    return {name: table[:, index] for index, name in enumerate(heading)}, period_s


def _number(text: str, path: Path, line: int) -> float:
    try:
        return plain_number(text)
    except ValueError:
        raise InputError(
            f"{text.strip()!r:.40} is not a number", file=path, place=f"line {line}"
        ) from None


def _npz(path: Path) -> tuple[dict[str, NDArray[np.generic]], float | None]:
    table = read_arrays(path, _EXPECTED, most=_MOST_BYTES)
    period = table.pop("period_s", None)
    if period is None:
        return table, None
    if period.size != 1 or period.dtype.kind not in "iuf":
        raise InputError("is not a number", file=path, place="period_s", expected="seconds")
    return table, float(period.reshape(-1)[0])
