"""Tables of counts over time: by approach and turn, road, crossing, or origin and destination."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.recorded.csv_rows import numbers_of, read_csv, texts_of

__all__ = ["Counted", "by_road", "read_counts", "read_detectors", "read_sumo_counts"]

_SUMO_FILES = (
    "SUMO's output of induction loops (nVehContrib), edge data (entered or count) or turn counts "
    "(edgeRelation)"
)
#: Elements of detectors in SUMO's additional files, of old and new versions.
_DETECTOR_ELEMENTS = (
    "inductionLoop",
    "e1Detector",
    "instantInductionLoop",
    "detectorDefinition",
    "detector",
)
_MAX_FILE_BYTES = 64 << 20
#: Columns of DFROUTER's tables -> classes; their times are minutes.
_DFROUTER_COLUMNS = {"qpkw": "car", "qlkw": "truck"}


@dataclass(frozen=True)
class Counted:
    """A counted number of actors.

    Attributes:
        where: fields of ``traffic.counts``: approach and turn, road or crossing, and junction; or
            lane, or detector.
        actor_class: class; empty for motor traffic.
        begin_s: begin of the interval, seconds of the day.
        length_s: length of the interval, seconds; ``None`` if not given.
        count: number of actors.
        line: line in the file, for errors.
    """

    where: Mapping[str, str]
    actor_class: str
    begin_s: float
    length_s: float | None
    count: float
    line: str


def read_detectors(path: Path) -> dict[str, str]:
    """Return the lane of each detector of a SUMO additional file, by detector id.

    Raises:
        InputError: the file is missing, damaged or has no detectors.
    """
    expected = 'detectors such as <inductionLoop id="north" lane="12_0" pos="-10" .../>'
    root = _parsed(path, expected)
    lane_of = {
        str(element.get("id")): str(element.get("lane"))
        for name in _DETECTOR_ELEMENTS
        for element in root.iter(name)
        if element.get("id") and element.get("lane")
    }
    if not lane_of:
        raise InputError("has no detectors", file=path, expected=expected)
    return lane_of


def read_sumo_counts(path: Path) -> list[Counted] | None:
    """Return the counts of a SUMO file; ``None`` if it is another kind of table.

    Raises:
        InputError: the file is damaged.
    """
    if path.suffix.lower() == ".xml":
        return list(_of_xml(path))
    return list(_of_dfrouter(path)) if _is_dfrouter(path) else None


def by_road(
    rows: Iterable[Counted], places: Mapping[str, str] | None, path: Path
) -> Iterator[Counted]:
    """Yield counts, those of detectors and lanes converted to roads.

    Detectors of one lane are averaged, and lanes of one road are added up.

    Args:
        rows: counts; ``where`` may name a detector or a lane.
        places: lane of each detector.
        path: the file, for errors.

    Raises:
        InputError: the lane of a detector is unknown.
    """
    groups: dict[tuple[str, str, float], dict[str, list[Counted]]] = defaultdict(dict)
    for row in rows:
        lane = row.where.get("lane", "")
        if name := row.where.get("detector"):
            if name not in (places or {}):
                raise InputError(
                    f"there is no position of the detector {name[:60]!r}",
                    file=path,
                    place=row.line,
                    expected="its lane in the file of detectors (--detectors FILE)",
                )
            lane = (places or {})[name]
        if not lane:
            yield row
            continue
        lanes = groups[lane.rpartition("_")[0] or lane, row.actor_class, row.begin_s]
        lanes.setdefault(lane, []).append(row)
    for (road, kind, begin_s), lanes in groups.items():
        first = next(iter(lanes.values()))[0]
        count = sum(
            float(np.mean([row.count for row in rows_of_lane])) for rows_of_lane in lanes.values()
        )
        yield Counted({"road": road}, kind, begin_s, first.length_s, count, first.line)


def _of_xml(path: Path) -> Iterator[Counted]:
    for interval in _parsed(path, _SUMO_FILES).iter("interval"):
        for item in (interval, *interval.iter("edge"), *interval.iter("edgeRelation")):
            name = str(item.get("id"))
            where, counts = {"road": name}, ["count", "entered"]
            if item.tag == "edgeRelation":
                where = {"approach": str(item.get("from")), "turn": str(item.get("to"))}
            elif item is interval:
                where, counts = {"detector": name}, ["nVehContrib"]
            field = next((key for key in counts if item.get(key) is not None), None)
            if field is None and item is not interval:
                raise InputError(
                    f"has no {' or '.join(counts)}",
                    file=path,
                    place=_line(item),
                    expected=_SUMO_FILES,
                )
            if field is not None:
                begin, end = (_number(interval, key, path) for key in ("begin", "end"))
                count = _number(item, field, path)
                yield Counted(where, "", begin, end - begin, count, _line(item))


def _is_dfrouter(path: Path) -> bool:
    """Return whether a table has the columns that DFROUTER reads."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            names = file.readline().lower().replace(" ", "").strip().split(";")
    except OSError:
        return False  # the reader reports the error
    return {"detector", "time", "qpkw"} <= set(names)


def _of_dfrouter(path: Path) -> Iterator[Counted]:
    table = read_csv(path, _SUMO_FILES)
    plain = {name.strip().lower(): name for name in table.column_names}
    detector = texts_of(table, plain["detector"])
    minute = numbers_of(table, plain["time"], path)
    for flow, kind in _DFROUTER_COLUMNS.items():
        if flow not in plain:
            continue
        for k, count in enumerate(numbers_of(table, plain[flow], path).tolist()):
            where = {"detector": str(detector[k])}
            yield Counted(where, kind, 60 * float(minute[k]), None, count, f"line {k + 2}")


def _parsed(path: Path, expected: str) -> etree._Element:
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise InputError("is too large", file=path, expected="64 MB at most")
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        return etree.fromstring(path.read_bytes(), parser)
    except OSError:
        raise InputError("not found", file=path, expected=expected) from None
    except etree.XMLSyntaxError as error:
        raise InputError(f"is no XML ({error})", file=path, expected=expected) from None


def _number(item: etree._Element, name: str, path: Path) -> float:
    """Return an attribute's value; raise an error unless it is a number of at least 0."""
    try:
        value = float(item.get(name, ""))
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise InputError(
            f"{name} is {item.get(name, '')[:40]!r}",
            file=path,
            place=_line(item),
            expected="a number, 0 or more",
        )
    return value


def _line(item: etree._Element) -> str:
    return f"line {item.sourceline}"


_EXPECTED = (
    "a table of counts: approach and turn, or road, or crossing; begin; count, and class if there "
    "are several, or a column for each class"
)
_COLUMN_NAMES = {
    "junction": ("junction", "intersection", "node"),
    "approach": ("approach", "origin", "from"),
    "turn": ("turn", "destination", "to", "exit"),
    "road": ("road", "edge", "street"),
    "lane": ("lane",),
    "detector": ("detector", "loop"),
    "crossing": ("crossing", "crosswalk"),
    "class": ("class", "type", "vehicle"),
    "begin": ("begin", "start", "time"),
    "count": ("count", "vehicles", "number"),
}
_SINGLE_PLACE_FIELDS = ("road", "lane", "detector", "crossing")
_PLACE_FIELDS = ("junction", "approach", "turn", *_SINGLE_PLACE_FIELDS)
_QUARTER_S, _DAY_S = 900, 86400
#: Least length of intervals, seconds; they divide a quarter of an hour or are multiples of it.
_MIN_INTERVAL_S = 60


def read_counts(path: Path, detectors: Path | None = None) -> list[dict[str, Any]]:
    """Return ``traffic.counts`` from a table (CSV) or the output of SUMO's detectors (XML).

    Columns are approach and turn (or origin and destination), or road, or crossing; junction if it
    is not the main one; begin (``07:15``, or seconds); and count with class, or a column of counts
    for each class. All intervals have one length: the least difference between begins, or an hour
    if there is only one.

    Args:
        path: the file; ``.xml``, and CSV with columns Detector, Time and qPKW, are SUMO's formats.
        detectors: SUMO's additional file with the lanes of detectors.

    Raises:
        InputError: the file is missing or wrong; the message names the line.
    """
    places = None if detectors is None else read_detectors(detectors)
    counted = read_sumo_counts(path)
    if counted is None:
        counted = list(_rows(path))
    counted = list(by_road(counted, places, path))
    if not counted:
        raise InputError("counts nothing", file=path, expected=_EXPECTED)
    return _by_quarter(counted, path)


def _rows(path: Path) -> Iterator[Counted]:
    """Yield the counts of each line of a table."""
    table = read_csv(path, _EXPECTED)
    plain = {name.strip().lower(): name for name in table.column_names}
    column = {
        what: next((plain[name] for name in names if name in plain), None)
        for what, names in _COLUMN_NAMES.items()
    }
    by_class = {name: plain[name] for name in ACTOR_CLASSES if name in plain}
    if column["count"] is not None:
        by_class = {"": column["count"]}
    missing = [] if any(column[what] for what in _SINGLE_PLACE_FIELDS) else ["approach", "turn"]
    missing = [what for what in missing if column[what] is None] + ([] if by_class else ["count"])
    if missing:
        problem = f"has no column {missing[0]}"
        raise InputError(problem, file=path, place="line 1", expected=_EXPECTED)
    nothing = np.full(table.num_rows, "", object)
    texts = {
        what: nothing if (name := column[what]) is None else texts_of(table, name)
        for what in (*_PLACE_FIELDS, "class", "begin")
    }
    for kind, name in by_class.items():
        count = numbers_of(table, name, path)
        if (count < 0).any():
            place = f"line {int(np.argmax(count < 0)) + 2}"
            raise InputError("counts less than none", file=path, place=place, expected="0 or more")
        for k, number in enumerate(count.tolist()):
            line = f"line {k + 2}"
            where = {what: str(texts[what][k]) for what in _PLACE_FIELDS}
            where = {what: value for what, value in where.items() if value}
            if (
                not where.keys() & set(_SINGLE_PLACE_FIELDS)
                and not {"approach", "turn"} <= where.keys()
            ):
                problem = "names no approach or turn"
                raise InputError(problem, file=path, place=line, expected=_EXPECTED)
            begin = _seconds(texts["begin"][k], path, line)
            yield Counted(where, kind or str(texts["class"][k]), begin, None, number, line)


@dataclass
class _Row:
    counts: NDArray[np.float64]
    line: str


def _by_quarter(counted: list[Counted], path: Path) -> list[dict[str, Any]]:
    """Return rows of ``traffic.counts``, one for each place and class."""
    begins = np.unique([row.begin_s for row in counted])
    lengths_s = {row.length_s for row in counted if row.length_s}
    length = int(np.diff(begins).min()) if len(begins) > 1 else 4 * _QUARTER_S
    length = int(min(lengths_s)) if lengths_s else length
    fits = length % _QUARTER_S == 0 or (length >= _MIN_INTERVAL_S and _QUARTER_S % length == 0)
    if not fits or ((begins - begins[0]) % length).any() or len(lengths_s) > 1:
        raise InputError(
            f"has intervals of {length} s, and not all of them",
            file=path,
            place="begin",
            expected="quarters of an hour, parts or multiples of them, all of one length",
        )
    slots = int((begins[-1] - begins[0]) // length) + 1
    rows: dict[tuple[tuple[tuple[str, str], ...], str], _Row] = {}
    for row in counted:
        if row.actor_class and row.actor_class not in ACTOR_CLASSES:
            raise InputError(
                f"unknown class {row.actor_class[:40]!r}",
                file=path,
                place=row.line,
                expected=f"one of {', '.join(ACTOR_CLASSES)}",
            )
        key = (tuple(row.where.items()), row.actor_class)
        counts_row = rows.setdefault(key, _Row(np.zeros(slots), row.line))
        counts_row.counts[int((row.begin_s - begins[0]) // length)] += row.count
    first = int(begins[0]) % _DAY_S // 60
    return [
        {
            **dict(where),
            "actor_class": kind or None,
            "per_hour": None,
            "per_quarter": _quarters(row.counts, length),
            "begin": f"{first // 60:02}:{first % 60:02}",
            "row": f"{path.name} {row.line}",
        }
        for (where, kind), row in rows.items()
    ]


def _quarters(counts: np.ndarray[Any, Any], length_s: int) -> list[float]:
    """Return counts resampled to quarters of an hour."""
    if length_s >= _QUARTER_S:
        times = length_s // _QUARTER_S
        return [float(rate) for rate in np.repeat(counts / times, times)]
    parts = _QUARTER_S // length_s
    padded = np.pad(counts, (0, -len(counts) % parts))
    return [float(rate) for rate in padded.reshape(-1, parts).sum(axis=1)]


def _seconds(text: object, path: Path, line: str) -> int:
    """Return a time of day in seconds; 0 for an empty text."""
    time_text = str(text)
    if not time_text:
        return 0
    match = re.fullmatch(r"(\d{1,2}):(\d{2})(?::(\d{2}))?", time_text)
    if match:
        hours, minutes, seconds = (int(group or 0) for group in match.groups())
        whole = 3600 * hours + 60 * minutes + seconds
    elif re.fullmatch(r"\d{1,6}(\.0*)?", time_text):
        whole = int(float(time_text))
    else:
        whole = -1
    if not 0 <= whole <= _DAY_S:
        raise InputError(
            f"begins at {time_text[:40]!r}",
            file=path,
            place=line,
            expected="07:15, or seconds",
        )
    return whole
