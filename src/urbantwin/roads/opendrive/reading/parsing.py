"""Parsing of numbers and words of an OpenDRIVE file, with errors and remarks by place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from lxml import etree

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number, plain_number, whole_number
from urbantwin.roads.model import Profile
from urbantwin.strict_xml import child_elements, root_name

__all__ = [
    "Header",
    "Log",
    "Spot",
    "id_number",
    "read_header",
    "station_on_road",
    "top_elements",
    "user_data",
]

#: Larger numbers are invalid on a map.
LARGEST = 1e12
#: Maximum number of places that a remark lists.
LISTED = 5
#: Maximum file size, bytes (26,000 roads in 53 MB take 17 s and 0.4 GB).
LARGEST_BYTES = 200_000_000
#: Distance beyond a road up to which an object or a signal is moved to its end silently, metres.
BEYOND_M = 1.0
#: Top-level elements that are read.
_TOP_ELEMENTS = ("header", "road", "junction", "controller", "junctionGroup", "station")


@dataclass
class Log:
    """Remarks on a file.

    Attributes:
        path: the file.
        remarks: assumption or omission -> places.
        dropped: errors of the dropped elements, in the order of reading.
    """

    path: Path
    remarks: dict[str, list[str]] = field(default_factory=dict)
    dropped: list[InputError] = field(default_factory=list)

    def at(self, place: str) -> Spot:
        """Return a place in the file, for errors and remarks."""
        return Spot(self, place)

    def lines(self) -> list[str]:
        """Return the remarks, each with its first places."""
        lines = []
        for text, places in self.remarks.items():
            unique = list(dict.fromkeys(place for place in places if place))
            listed = ", ".join(unique[:LISTED])
            if len(unique) > LISTED:
                listed += f" and {len(unique) - LISTED} more"
            lines.append(f"{text} ({listed})" if listed else text)
        return lines

    def dropped_lines(self) -> list[str]:
        """Return the dropped elements, each with its id and its place in the map."""
        return list(dict.fromkeys(f"{error.place}: {error.problem}" for error in self.dropped))


@dataclass(frozen=True)
class Spot:
    """A place in a file: ``road 12``, ``road 12, lane -1``."""

    log: Log
    place: str

    def within(self, part: str) -> Spot:
        """Return a place within this one."""
        return Spot(self.log, f"{self.place}, {part}")

    def error(self, problem: str, expected: str | None = None) -> InputError:
        """Return an error at this place."""
        return InputError(problem, file=self.log.path, place=self.place, expected=expected)

    def remark(self, text: str) -> None:
        """Add a remark for the user of the map."""
        self.log.remarks.setdefault(text, []).append(self.place.partition(",")[0])

    def drop(self, problem: str) -> None:
        """Report that the element at this place is not used, and why."""
        self.log.dropped.append(self.error(problem))

    @contextmanager
    def dropping(self) -> Iterator[None]:
        """Drop and report an element whose reading raises `InputError`; reading continues."""
        try:
            yield
        except InputError as error:
            self.log.dropped.append(error)

    def number(self, item: etree._Element, key: str, default: float | None = None) -> float:
        """Return an attribute as a number.

        Raises:
            InputError: it is missing and has no default, or is not a valid number.
        """
        text = item.get(key)
        if text is None and default is not None:
            return default
        value = finite_number(text)
        if value is None or abs(value) > LARGEST:
            name = f"<{item.tag}> {key}"
            problem = f"{name} is missing" if text is None else f"{name} is {text[:40]!r}"
            raise self.error(problem, expected="a number")
        return value

    def whole(self, item: etree._Element, key: str) -> int:
        """Return an attribute as a whole number.

        Raises:
            InputError: it is missing or not a whole number.
        """
        text = item.get(key)
        value = whole_number(text)
        if value is None:
            problem = f"<{item.tag}> {key} is {'missing' if text is None else repr(text[:40])}"
            raise self.error(problem, expected="a whole number")
        return value

    def profile(self, items: Sequence[etree._Element], key: str = "s") -> Profile:
        """Return records of cubics as a profile, zero if there are none.

        Args:
            items: elements with ``a``, ``b``, ``c``, ``d``.
            key: attribute of the start of each: ``s``, ``sOffset``, or ``t`` across.
        """
        if not items:
            return Profile.constant(0.0)
        rows: dict[float, list[float]] = {}
        for item in items:
            try:
                row = [plain_number(item.get(k)) for k in (key, *"abcd")]
            except (TypeError, ValueError):
                row = [math.nan]
            if not all(-LARGEST <= value <= LARGEST for value in row):
                with self.dropping():
                    row = [self.number(item, k) for k in (key, *"abcd")]
                    rows[row[0]] = row[1:]
                continue
            rows[row[0]] = row[1:]
        if not rows:
            return Profile.constant(0.0)
        starts = np.array(sorted(rows))
        table = np.array([rows[s] for s in starts])
        if starts[0] > 1e-6 and key != "t":
            # The standard does not define values before the first record: its value is used.
            starts = np.concatenate([[0.0], starts])
            table = np.vstack([[table[0, 0], 0.0, 0.0, 0.0], table])
        return Profile(starts, table)


@dataclass(frozen=True)
class Header:
    """The content of the header.

    Attributes:
        version: such as ``1.4``; empty if missing.
        vendor: producer of the file.
        projection: CRS of its coordinates, as PROJ or WKT; ``None`` if missing.
        offset: x, y, z, heading to apply to its coordinates.
    """

    version: str = ""
    vendor: str = ""
    projection: str | None = None
    offset: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def id_number(text: str) -> int | None:
    """Return an id as a whole number; ``None`` if it is not one or is too long."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 16 else None


def user_data(item: etree._Element) -> dict[str, str]:
    """Return the ``<userData>`` of an element, by code."""
    return {note.get("code"): note.get("value") or "" for note in item.findall("userData")}


def station_on_road(item: etree._Element, length: float, spot: Spot) -> float:
    """Return the station of an object or a signal, clipped to its road, metres."""
    s = spot.number(item, "s")
    if not -BEYOND_M <= s <= length + BEYOND_M:
        spot.remark("objects and signals beyond their road: they are put at its end")
    return min(max(s, 0.0), length)


def top_elements(path: Path) -> Iterator[etree._Element]:
    """Yield the children of ``<OpenDRIVE>``, complete, with names without namespaces.

    Only one element is kept in memory at a time. Document types, and thereby entities, are rejected
    before any expansion, and nothing is downloaded.

    Raises:
        InputError: the file cannot be read, is too large, is not XML or not OpenDRIVE, has a
            document type, or is truncated.
    """
    root = _root_name(path)
    if root != "OpenDRIVE":
        raise InputError(
            f"is not OpenDRIVE: its root is <{root[:40]}>", file=path, expected="<OpenDRIVE>"
        )
    with path.open("rb") as stream:
        for item in child_elements(stream, _TOP_ELEMENTS, path):
            if "{" in item.tag:
                for element in item.iter("{*}*"):
                    element.tag = etree.QName(element).localname
            yield item


def _root_name(path: Path) -> str:
    """Return the name of the root element; raise an error for a file that is too large."""
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            raise InputError(
                f"is {size / 1e6:.0f} MB large",
                file=path,
                expected=f"{LARGEST_BYTES / 1e6:.0f} MB or less",
            )
        with path.open("rb") as stream:
            return root_name(stream, path, "OpenDRIVE")
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None


def read_header(item: etree._Element, log: Log) -> Header:
    """Return the header.

    Raises:
        InputError: the major version is unsupported, or the offset is not a number.
    """
    spot = log.at("header")
    major, minor = item.get("revMajor"), item.get("revMinor") or ""
    if major is not None and major.strip() != "1":
        raise spot.error(f"is of version {major[:10]}.{minor[:10]}", expected="1.1 to 1.8")
    text = " ".join((item.findtext("geoReference") or "").split())
    if text.startswith("+") and "+proj" not in text and "+lat_0" in text:
        # Maps of CARLA give the origin only: CARLA uses it as that of a transverse Mercator
        # projection.
        text = f"+proj=tmerc {text}" + ("" if "+datum" in text else " +datum=WGS84")
        spot.remark("a georeference of an origin only: a transverse Mercator is taken")
    offset = item.find("offset")
    keys = ("x", "y", "z", "hdg")
    shift = (0.0,) * 4 if offset is None else tuple(spot.number(offset, k, 0.0) for k in keys)
    return Header(
        f"1.{minor}" if minor else "",
        item.get("vendor") or "",
        text or None,
        (shift[0], shift[1], shift[2], shift[3]),
    )
