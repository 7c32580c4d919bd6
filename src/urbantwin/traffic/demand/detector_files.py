"""What SUMO's detectors and counting tools write: flows by detector, edge or turn, by interval."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from urbantwin.errors import InputError
from urbantwin.traffic.recorded.csv_rows import numbers_of, read_csv, texts_of

__all__ = ["Counted", "by_road", "read_detectors", "read_sumo_counts"]

_EXPECTED = (
    "SUMO's output of induction loops (nVehContrib), edge data (entered or count) or turn counts "
    "(edgeRelation)"
)
#: Names of detectors in SUMO's additional files, of old and new ones.
_LOOPS = ("inductionLoop", "e1Detector", "instantInductionLoop", "detectorDefinition", "detector")
_LARGEST = 64 << 20
#: Flows of DFROUTER's tables -> classes; their times are minutes.
_FLOWS = {"qpkw": "car", "qlkw": "truck"}


@dataclass(frozen=True)
class Counted:
    """A number that was counted.

    Attributes:
        where: fields of ``traffic.counts``: approach and turn, road or crossing, and junction; or
            lane, or detector.
        actor_class: of whom; empty for motor traffic.
        begin_s: when the interval begins, seconds of the day.
        length_s: how long it is, if that is told.
        count: how many.
        line: where it was written.
    """

    where: Mapping[str, str]
    actor_class: str
    begin_s: float
    length_s: float | None
    count: float
    line: str


def read_detectors(path: Path) -> dict[str, str]:
    """Return the lane of each detector of a SUMO additional file, by its id.

    Raises:
        InputError: the file is missing, damaged or has none.
    """
    expected = 'detectors such as <inductionLoop id="north" lane="12_0" pos="-10" .../>'
    root = _parsed(path, expected)
    found = {
        str(one.get("id")): str(one.get("lane"))
        for name in _LOOPS
        for one in root.iter(name)
        if one.get("id") and one.get("lane")
    }
    if not found:
        raise InputError("has no detectors", file=path, expected=expected)
    return found


def read_sumo_counts(path: Path) -> list[Counted] | None:
    """Return what a file of SUMO counts; ``None`` where it is another table.

    Raises:
        InputError: the file is damaged.
    """
    if path.suffix.lower() == ".xml":
        return list(_of_xml(path))
    return list(_of_dfrouter(path)) if _is_dfrouter(path) else None


def by_road(
    rows: Iterable[Counted], places: Mapping[str, str] | None, path: Path
) -> Iterator[Counted]:
    """Yield counts, those of detectors and lanes as cross-sections of their roads.

    Detectors of one lane are averaged, and lanes of one road are added up.

    Args:
        rows: what was counted; ``where`` may name a detector or a lane.
        places: lane of each detector.
        path: the file, for errors.

    Raises:
        InputError: a detector is nowhere.
    """
    found: dict[tuple[str, str, float], dict[str, list[Counted]]] = defaultdict(dict)
    for row in rows:
        lane = row.where.get("lane", "")
        if name := row.where.get("detector"):
            if name not in (places or {}):
                raise InputError(
                    f"nobody says where the detector {name[:60]!r} is",
                    file=path,
                    place=row.line,
                    expected="its lane in the file of detectors (--detectors FILE)",
                )
            lane = (places or {})[name]
        if not lane:
            yield row
            continue
        lanes = found[lane.rpartition("_")[0] or lane, row.actor_class, row.begin_s]
        lanes.setdefault(lane, []).append(row)
    for (road, kind, begin_s), lanes in found.items():
        first = next(iter(lanes.values()))[0]
        count = sum(float(np.mean([one.count for one in ones])) for ones in lanes.values())
        yield Counted({"road": road}, kind, begin_s, first.length_s, count, first.line)


def _of_xml(path: Path) -> Iterator[Counted]:
    for interval in _parsed(path, _EXPECTED).iter("interval"):
        for item in (interval, *interval.iter("edge"), *interval.iter("edgeRelation")):
            name = str(item.get("id"))
            where, counts = {"road": name}, ["count", "entered"]
            if item.tag == "edgeRelation":
                where = {"approach": str(item.get("from")), "turn": str(item.get("to"))}
            elif item is interval:
                where, counts = {"detector": name}, ["nVehContrib"]
            field = next((one for one in counts if item.get(one) is not None), None)
            if field is None and item is not interval:
                raise InputError(
                    f"has no {' or '.join(counts)}",
                    file=path,
                    place=_line(item),
                    expected=_EXPECTED,
                )
            if field is not None:
                begin, end = (_number(interval, one, path) for one in ("begin", "end"))
                count = _number(item, field, path)
                yield Counted(where, "", begin, end - begin, count, _line(item))


def _is_dfrouter(path: Path) -> bool:
    """Return whether a table is one of detectors as DFROUTER reads it."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            names = file.readline().lower().replace(" ", "").strip().split(";")
    except OSError:
        return False  # whoever reads it says so
    return {"detector", "time", "qpkw"} <= set(names)


def _of_dfrouter(path: Path) -> Iterator[Counted]:
    table = read_csv(path, _EXPECTED)
    plain = {name.strip().lower(): name for name in table.column_names}
    detector = texts_of(table, plain["detector"])
    minute = numbers_of(table, plain["time"], path)
    for flow, kind in _FLOWS.items():
        if flow not in plain:
            continue
        for k, count in enumerate(numbers_of(table, plain[flow], path).tolist()):
            where = {"detector": str(detector[k])}
            yield Counted(where, kind, 60 * float(minute[k]), None, count, f"line {k + 2}")


def _parsed(path: Path, expected: str) -> etree._Element:
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError("is too large", file=path, expected="64 MB at most")
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        return etree.fromstring(path.read_bytes(), parser)
    except OSError:
        raise InputError("not found", file=path, expected=expected) from None
    except etree.XMLSyntaxError as error:
        raise InputError(f"is no XML ({error})", file=path, expected=expected) from None


def _number(item: etree._Element, name: str, path: Path) -> float:
    """Return an attribute that is 0 or more."""
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
