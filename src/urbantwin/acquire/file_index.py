"""Which files of a source cover a place: address templates, and lists of features.

Lists are GeoJSON in longitude and latitude (RFC 7946), as tile indexes, answers of WFS and
searches of STAC (https://stacspec.org) are: the addresses of files stand in the features.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import shapely
import shapely.geometry

from urbantwin.acquire.area import Area
from urbantwin.acquire.source import MARGIN_M
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, NothingThereError, Server
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["addresses_of", "filled", "located_files"]

#: Files that one place may need.
MOST_FILES = 24
#: How deep addresses may stand in a feature.
_DEEPEST = 6


def filled(template: str, values: Mapping[str, object]) -> str:
    """Return an address with its braces filled in; ``{south_deg:02}`` has two digits at least."""

    def one(found: re.Match[str]) -> str:
        name, _, digits = found[1].partition(":")
        if name not in values:
            return found[0]
        return str(values[name]).zfill(int(digits or 0))

    return re.sub(r"\{(-?[A-Za-z_]+(?::[0-9]+)?)\}", one, template)


def located_files(server: Server, spec: SourceSpec, area: Area) -> list[str]:
    """Return the addresses of the files that meet an area, the best first.

    Raises:
        NotAcquiredError: the list is none, names none there, or too many.
        DownloadError: the list cannot be had.
    """
    west, south, east, north = area.box(MARGIN_M)
    box = {name: f"{value:.6f}" for name, value in
           (("west", west), ("south", south), ("east", east), ("north", north))}  # fmt: skip
    if spec.index is None:
        found = [filled(spec.address, {**box, **tile}) for tile in _degree_tiles(area)]
        return list(dict.fromkeys(found))
    told = server.get(filled(spec.index.url, box))
    try:
        value = parse_json(told.data)
    except NotJsonError:
        raise NotAcquiredError("the list of its files is not JSON") from None
    features = value.get("features") if isinstance(value, dict) else None
    if not isinstance(features, list):
        raise NotAcquiredError("the list of its files is no GeoJSON")
    place = shapely.box(west, south, east, north)
    pattern = re.compile(spec.index.address)
    meeting: list[tuple[str, float, list[str]]] = []
    for feature in features:
        if not isinstance(feature, Mapping):
            continue
        shape = _shape(feature.get("geometry"))
        addresses = list(addresses_of(feature, pattern))
        if shape is None or not addresses or not shape.intersects(place):
            continue
        properties = feature.get("properties")
        newest = spec.index.newest
        age = properties.get(newest) if newest and isinstance(properties, Mapping) else ""
        share = shapely.intersection(shape, place).area / place.area
        meeting.append((str(age), share, addresses))
    if not meeting:
        raise NothingThereError()
    meeting.sort(key=lambda one: (one[0], one[1]), reverse=True)
    found = list(dict.fromkeys(address for *_, listed in meeting for address in listed))
    if len(found) > MOST_FILES:
        found = found[:MOST_FILES]
    return found


def addresses_of(value: object, pattern: re.Pattern[str], deep: int = 0) -> Iterator[str]:
    """Yield the strings in a feature that are addresses of files; STAC's links are none."""
    if isinstance(value, str):
        if pattern.fullmatch(value):
            yield value
    elif deep < _DEEPEST and isinstance(value, Mapping):
        for name, one in value.items():
            if name not in ("links", "geometry", "bbox"):
                yield from addresses_of(one, pattern, deep + 1)
    elif deep < _DEEPEST and isinstance(value, list):
        for one in value:
            yield from addresses_of(one, pattern, deep + 1)


def _degree_tiles(area: Area) -> Iterator[dict[str, object]]:
    """Yield what names the squares of one degree that an area meets."""
    for south, west in area.degrees(MARGIN_M):
        yield {
            "south_deg": abs(south),
            "west_deg": abs(west),
            "north_deg": abs(south + 1),
            "NS": "S" if south < 0 else "N",
            "EW": "W" if west < 0 else "E",
            "ns": "s" if south < 0 else "n",
            "ew": "w" if west < 0 else "e",
        }


def _shape(geometry: Any) -> shapely.Geometry | None:  # noqa: ANN401
    """Return a geometry of GeoJSON that is in degrees and valid, or ``None``."""
    if not isinstance(geometry, Mapping):
        return None
    try:
        shape = shapely.geometry.shape(dict(geometry))
        if not shape.is_valid:
            shape = shapely.make_valid(shape)
    except Exception:
        return None
    west, south, east, north = shape.bounds if not shape.is_empty else (0, 0, 0, 0)
    inside = -181 <= west <= east <= 181 and -91 <= south <= north <= 91
    return shape if inside and not shape.is_empty else None
