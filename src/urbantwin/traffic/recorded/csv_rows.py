"""Tracks as CSV: a row per actor and time."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv

from urbantwin.errors import InputError
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["SECONDS", "csv_rows", "numbers_of", "read_csv", "time_unit_of"]

#: Unit of time -> seconds.
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

#: Field -> usual names of its column, in lower case, without separators.
_COLUMN_NAMES: dict[str, tuple[str, ...]] = {
    "track": ("trackid", "track", "id", "objectid", "vehicleid", "agentid", "trackingid"),
    "time": (
        "timestampms",
        "timems",
        "times",
        "time",
        "t",
        "timestamp",
        "timestampns",
        "timestampus",
    ),
    "frame": ("frame", "frameid", "framenumber"),
    "class": ("class", "agenttype", "type", "category", "objecttype", "label", "vehicletype"),
    "x": ("x", "xcenter", "xm", "centerx", "localx", "posx"),
    "y": ("y", "ycenter", "ym", "centery", "localy", "posy"),
    "z": ("z", "zcenter", "zm"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "lng"),
    "yaw": ("yaw", "psirad", "heading", "yawrad", "theta", "yawdeg", "headingdeg", "rotationz"),
    "length": ("length", "lengthm", "l"),
    "width": ("width", "widthm", "w"),
    "height": ("height", "heightm", "h"),
}
_OPTIONAL_FIELDS = ("z", "yaw", "length", "width", "height")


def csv_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks from CSV.

    Raises:
        InputError: the file is missing or damaged, or a column is missing or not numeric; the
            message names the line.
    """
    table = read_csv(path, "tracks as CSV")
    named = _columns(table, spec, path)
    count = table.num_rows
    places = ("longitude", "latitude") if "x" not in named else ("x", "y")
    wanted = [*places, *(name for name in _OPTIONAL_FIELDS if name in named)]
    values = {
        name: numbers_of(table, named[name], path, empty=name in _OPTIONAL_FIELDS)
        for name in wanted
    }
    nothing = np.full(count, np.nan)
    yaw = values.get("yaw", nothing)
    if "yaw" in values and _in_degrees(spec, named["yaw"]):
        yaw = np.radians(yaw)
    kind = texts_of(table, named["class"]) if "class" in named else np.full(count, "car", object)
    return RecordedRows(
        path,
        texts_of(table, named["track"]),
        _seconds(table, named, spec, path),
        kind,
        np.column_stack([values[places[0]], values[places[1]], values.get("z", nothing)]),
        yaw,
        np.column_stack([values.get(name, nothing) for name in ("length", "width", "height")]),
        lambda row: f"line {row + 2}",
        geographic=places[0] == "longitude",
    )


def read_csv(path: Path, expected: str) -> pa.Table:
    """Read a CSV file, every column as text.

    Raises:
        InputError: missing, damaged, or without rows.
    """
    try:
        with path.open("rb") as file:
            header = file.readline(65536).decode("utf-8-sig").strip()
        mark = max(",;\t", key=header.count)
        names = [name.strip().strip('"') for name in header.split(mark)]
        if len(set(names)) < len(names):
            raise InputError("has a column twice", file=path, place="line 1", expected=expected)
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(column_names=names, skip_rows=1, use_threads=False),
            parse_options=csv.ParseOptions(delimiter=mark, ignore_empty_lines=False),
            convert_options=csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=False
            ),
        )
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror or error})"
        raise InputError(problem, file=path, expected=expected) from None
    except UnicodeDecodeError:
        raise InputError("is not text", file=path, expected=expected) from None
    except pa.ArrowInvalid as error:
        match = re.search(r"Row #(\d+): (.*?)(?:: |$)", str(error))
        line = f"line {match[1]}" if match else None
        problem = f"is no table ({match[2] if match else str(error)[:80]})"
        raise InputError(problem, file=path, place=line, expected=expected) from None
    if not table.num_rows:
        raise InputError("has no rows", file=path, expected=expected)
    return table.combine_chunks()


def numbers_of(
    table: pa.Table, name: str, path: Path, *, empty: bool = False
) -> NDArray[np.float64]:
    """Return a column of numbers (N,); nan for empty values, if allowed.

    Raises:
        InputError: a row holds something else; the message names the line.
    """
    text = pc.utf8_trim_whitespace(table[name])
    usual = r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$"
    good = pc.match_substring_regex(text, usual)
    blank = pc.is_in(text, pa.array(["", "nan", "NaN", "NA", "null", "None"]))
    fine = pc.or_(good, blank) if empty else good
    if not pc.all(fine).as_py():
        row = int(np.argmin(fine.to_numpy(zero_copy_only=False)))
        raise InputError(
            f"{name} is {str(text[row])[:40]!r}",
            file=path,
            place=f"line {row + 2}",
            expected="a number",
        )
    filled = pc.if_else(good, text, pa.scalar("nan"))
    values = np.asarray(pc.cast(filled, pa.float64()).to_numpy(zero_copy_only=False))
    if np.isinf(values).any() or (np.abs(values[~np.isnan(values)]) > 1e20).any():
        row = int(np.argmax(np.isinf(values) | (np.abs(values) > 1e20)))
        raise InputError(
            f"{name} is {str(text[row])[:40]!r}",
            file=path,
            place=f"line {row + 2}",
            expected="a number that can be",
        )
    return values


def texts_of(table: pa.Table, name: str) -> NDArray[np.object_]:
    """Return a column of texts (N,)."""
    return np.array(pc.utf8_trim_whitespace(table[name]).to_pylist(), object)


def time_unit_of(column: str) -> str:
    """Return the unit of a column of times by its name (``timestamp_ms``), by default seconds."""
    match = re.search(r"[_ (\[](ns|us|ms|s)[)\]]?$", column.lower())
    return match[1] if match else "s"


def _columns(table: pa.Table, spec: TracksSpec, path: Path) -> dict[str, str]:
    """Return field -> column, as described or by the usual names."""
    plain = {re.sub(r"[^a-z]", "", name.lower()): name for name in reversed(table.column_names)}
    named: dict[str, str] = {}
    for what, usual in _COLUMN_NAMES.items():
        if what in spec.columns:
            if spec.columns[what] not in table.column_names:
                raise InputError(
                    f"has no column {spec.columns[what]!r} for {what}",
                    file=path,
                    place="line 1",
                    expected=f"one of {', '.join(table.column_names)}",
                )
            named[what] = spec.columns[what]
        elif column := next((plain[name] for name in usual if name in plain), None):
            named[what] = column
    have = set(named)
    for needed in ({"track"}, {"time", "frame"}, {"x", "longitude"}, {"y", "latitude"}):
        if not have & needed:
            names = " or ".join(sorted(needed))
            raise InputError(
                f"has no column of {names}: it has {', '.join(table.column_names)}",
                file=path,
                place="line 1",
                expected="its name under columns: in a description of the tracks",
            )
    return named


def _seconds(
    table: pa.Table, named: dict[str, str], spec: TracksSpec, path: Path
) -> NDArray[np.float64]:
    """Return the times (N,), seconds."""
    by_frames = "time" not in named or (spec.rate_hz is not None and "time" not in spec.columns)
    if by_frames and "frame" in named:
        if spec.rate_hz is None:
            raise InputError(
                "numbers its moments and does not say how fast they follow",
                file=path,
                place=named["frame"],
                expected="rate_hz: in a description of the tracks, or a column of time",
            )
        return numbers_of(table, named["frame"], path) / spec.rate_hz
    unit = spec.units.time or time_unit_of(named["time"])
    return numbers_of(table, named["time"], path) * SECONDS[unit]


def _in_degrees(spec: TracksSpec, column: str) -> bool:
    if spec.units.angle is not None:
        return spec.units.angle == "deg"
    return "deg" in column.lower()
