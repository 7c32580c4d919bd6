"""The file of an Argoverse 2 vector map: JSON with lane segments, crossings, drivable areas.

Source: argoverse/av2-api, ``src/av2/map/README.md`` ("Vector Map: Lane Graph and Lane Segments",
"Vector Map: Pedestrian Crossings", "Vector Map: Drivable Area") and
``src/av2/map/lane_segment.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.strict_json import parse_json

__all__ = [
    "EXPECTED",
    "Crossing",
    "MapFile",
    "Segment",
    "anchor_of",
    "city_of",
    "is_argoverse",
    "is_placed",
    "lonlat_of",
    "places_in",
    "read_file",
]

EXPECTED = "an Argoverse 2 vector map: log_map_archive_....json with lane_segments"
LANE_TYPES = ("VEHICLE", "BIKE", "BUS")
#: Maximum size of the map of a log, bytes.
MOST_BYTES = 200_000_000
#: Maximum coordinate in a city, metres.
FAR_M = 1e6
#: City -> UTM zone, latitude and longitude of its origin, degrees.
CITIES = {
    "ATX": (14, 30.27464237939507, -97.7404457407424),
    "DTW": (17, 42.29993066912924, -83.17555750783717),
    "MIA": (17, 25.77452579915163, -80.19656914449405),
    "PAO": (10, 37.416065, -122.13571963362166),
    "PIT": (17, 40.44177902989321, -80.01294377242584),
    "WDC": (18, 38.889377, -77.0355047439081),
}
#: ``log_map_archive_<log>____PIT_city_47896.json``.
_NAME = re.compile(r"_([A-Z]{3})(?:_city_[0-9]+)?\.json$")


@dataclass(frozen=True)
class Segment:
    """A lane segment.

    Attributes:
        id: unique within the map.
        within: whether it lies within an intersection.
        kind: ``VEHICLE``, ``BIKE`` or ``BUS``.
        left: (N, 3) left boundary in the direction of travel, city frame, metres.
        right: (M, 3) right boundary.
        marks: paint of the left and of the right boundary (``SOLID_WHITE``, ``NONE``, ...).
        successors: ids of the following segments; some may lie outside the map.
    """

    id: int
    within: bool
    kind: str
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    marks: tuple[str, str]
    successors: tuple[int, ...]


@dataclass(frozen=True)
class Crossing:
    """A pedestrian crossing between two edges (N, 3) in walking direction."""

    id: int
    edges: tuple[NDArray[np.float64], NDArray[np.float64]]


_Item = TypeVar("_Item")


_Numbered = TypeVar("_Numbered", Segment, Crossing)


@dataclass(frozen=True)
class MapFile:
    """A complete map, by id.

    Attributes:
        path: the file.
        segments, crossings: by id.
        drivable: outlines (N, 3) of drivable areas.
        dropped: errors of the dropped elements, in the order of the file.
    """

    path: Path
    segments: dict[int, Segment]
    crossings: dict[int, Crossing]
    drivable: tuple[NDArray[np.float64], ...] = ()
    dropped: tuple[InputError, ...] = ()


def is_argoverse(path: Path) -> bool:
    """Return whether a ``.json`` file contains lane segments, by a search for the key."""
    if path.suffix.lower() != ".json":
        return False
    try:
        return b'"lane_segments"' in path.read_bytes()[:MOST_BYTES]
    except OSError:
        return False


def read_file(path: Path) -> MapFile:
    """Read lane segments, pedestrian crossings and drivable areas.

    Elements without required fields or with a repeated id are dropped.

    Raises:
        InputError: the file is missing, not JSON, or has no readable lane segment.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError("is too large for the map of a log", file=path, expected=EXPECTED)
        data = parse_json(path.read_bytes())
    except OSError:
        problem = "is a folder" if path.is_dir() else "not found"
        raise InputError(problem, file=path, expected=EXPECTED) from None
    except ValueError as error:
        raise InputError(f"is not JSON ({error})", file=path, expected=EXPECTED) from None
    rows = data.get("lane_segments") if isinstance(data, dict) else None
    if not isinstance(rows, dict) or not rows:
        raise InputError("has no lane segments", file=path, expected=EXPECTED)
    crossings = data.get("pedestrian_crossings") or {}
    if not isinstance(crossings, dict):
        raise InputError("pedestrian_crossings is not an object", file=path, expected=EXPECTED)
    areas = data.get("drivable_areas") or {}
    if not isinstance(areas, dict):
        raise InputError("drivable_areas is not an object", file=path, expected=EXPECTED)
    dropped: list[InputError] = []
    segments = _by_id(path, "lane segment", _read(path, rows, _segment, dropped), dropped)
    walks = _by_id(path, "pedestrian crossing", _read(path, crossings, _crossing, dropped), dropped)
    outlines = tuple(_read(path, areas, _outline, dropped))
    if not segments:
        raise dropped[0]
    return MapFile(path, segments, walks, outlines, tuple(dropped))


def _read(
    path: Path,
    rows: Mapping[str, object],
    reader: Callable[[Path, str, object], _Item],
    dropped: list[InputError],
) -> Iterator[_Item]:
    """Yield the readable rows; errors of the others are appended to ``dropped``."""
    for key, row in rows.items():
        try:
            yield reader(path, key, row)
        except InputError as error:
            place = f"{error.place}{_where(row)}"
            dropped.append(InputError(error.problem, file=path, place=place))


def _where(row: object) -> str:
    """Return the first point of an element as text, in city metres; empty if there is none."""
    for line in row.values() if isinstance(row, dict) else ():
        for point in line if isinstance(line, list) else ():
            x, y = (point.get(key) if isinstance(point, dict) else None for key in "xy")
            if isinstance(x, (int, float)) and isinstance(y, (int, float)):
                return f" at x = {x:.1f}, y = {y:.1f}"
    return ""


def _by_id(
    path: Path, kind: str, items: Iterable[_Numbered], dropped: list[InputError]
) -> dict[int, _Numbered]:
    """Return items by id, the first of each."""
    by_id: dict[int, _Numbered] = {}
    for item in items:
        if item.id in by_id:
            place = f"{kind} {item.id}"
            dropped.append(InputError("has the id of another one", file=path, place=place))
        by_id.setdefault(item.id, item)
    return by_id


def places_in(read: MapFile) -> NDArray[np.float64]:
    """Return all points (N, 3) of boundaries, city frame, metres."""
    return np.vstack([line for s in read.segments.values() for line in (s.left, s.right)])


def _segment(path: Path, key: str, row: object) -> Segment:
    place = f"lane segment {key}"
    fields = _fields(path, place, row)
    kind = fields.get("lane_type")
    if kind not in LANE_TYPES:
        raise InputError(
            f"lane_type {kind!r} is unknown", file=path, place=place, expected=", ".join(LANE_TYPES)
        )
    following = fields.get("successors") or []
    if not isinstance(following, list) or not all(isinstance(i, int) for i in following):
        raise InputError("successors is not a list of ids", file=path, place=place)
    return Segment(
        _id(path, place, fields),
        bool(fields.get("is_intersection")),
        kind,
        _line(path, place, fields, "left_lane_boundary"),
        _line(path, place, fields, "right_lane_boundary"),
        (
            str(fields.get("left_lane_mark_type") or "NONE"),
            str(fields.get("right_lane_mark_type") or "NONE"),
        ),
        tuple(following),
    )


def _crossing(path: Path, key: str, row: object) -> Crossing:
    place = f"pedestrian crossing {key}"
    fields = _fields(path, place, row)
    edges = tuple(_line(path, place, fields, name) for name in ("edge1", "edge2"))
    return Crossing(_id(path, place, fields), (edges[0], edges[1]))


def _outline(path: Path, key: str, row: object) -> NDArray[np.float64]:
    place = f"drivable area {key}"
    outline = _line(path, place, _fields(path, place, row), "area_boundary")
    if len(outline) < 3:
        raise InputError("has fewer than three corners", file=path, place=place, expected=EXPECTED)
    return outline


def _fields(path: Path, place: str, row: object) -> dict[str, object]:
    if not isinstance(row, dict):
        raise InputError("is not an object", file=path, place=place, expected=EXPECTED)
    return row


def _id(path: Path, place: str, fields: dict[str, object]) -> int:
    identity = fields.get("id")
    if not isinstance(identity, int) or isinstance(identity, bool):
        raise InputError(f"has id {identity!r}", file=path, place=place, expected="a whole number")
    return identity


def _line(path: Path, place: str, fields: dict[str, object], name: str) -> NDArray[np.float64]:
    try:
        points = [[p["x"], p["y"], p.get("z", 0.0)] for p in fields.get(name) or []]  # type: ignore[attr-defined]
        line = np.array(points, dtype=float).reshape(-1, 3)
    except (TypeError, ValueError, KeyError, AttributeError):
        line = np.full((2, 3), np.nan)
    if len(line) < 2 or not (np.abs(line) < FAR_M).all():
        raise InputError(
            f"{name} is not a line of finite points",
            file=path,
            place=place,
            expected="a list of two or more x, y, z in metres",
        )
    return line


def city_of(path: Path) -> str | None:
    """Return the city in a map's file name; ``None`` if it names no known city."""
    match = _NAME.search(path.name)
    return match[1] if match and match[1] in CITIES else None


def is_placed(path: Path) -> bool:
    """Return whether a map's file name contains a known city."""
    return city_of(path) is not None


def lonlat_of(city: str, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return longitude and latitude (N, 2), degrees, for x, y (N, 2) in a city, metres."""
    transformer, origin = _projection(city)
    x, y = (np.asarray(xy, float) + origin).T
    return np.column_stack(transformer.transform(x, y, direction="INVERSE"))


def anchor_of(path: Path) -> tuple[float, float]:
    """Return latitude and longitude of the centre of a map, degrees.

    Raises:
        InputError: it is not a map of Argoverse 2, or its name contains no known city.
    """
    city = city_of(path)
    if city is None:
        raise InputError(
            "its name says no city of Argoverse 2", file=path, expected="..._PIT_city_47896.json"
        )
    xy = places_in(read_file(path))
    if not len(xy):
        raise InputError("has no lane segments", file=path, expected=EXPECTED)
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    longitude, latitude = lonlat_of(city, middle[None, :2])[0]
    return float(latitude), float(longitude)


@cache
def _projection(city: str) -> tuple[Transformer, NDArray[np.float64]]:
    zone, latitude, longitude = CITIES[city]
    transformer = Transformer.from_crs("EPSG:4326", f"EPSG:{32600 + zone}", always_xy=True)
    return transformer, np.array(transformer.transform(longitude, latitude))
