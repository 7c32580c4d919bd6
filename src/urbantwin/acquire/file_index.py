"""Files of a source that cover a place: address templates, and lists of features.

Lists are GeoJSON in longitude and latitude (RFC 7946): tile indexes, WFS responses and STAC
searches (https://stacspec.org), whose features hold the addresses of files.
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

#: Most files of a place.
MOST_FILES = 24
#: Largest nesting depth of addresses in a feature.
_DEEPEST = 6


def filled(template: str, values: Mapping[str, object]) -> str:
    """Return an address with its placeholders filled in; ``{south_deg:02}`` has two digits."""

    def one(found: re.Match[str]) -> str:
        name, _, digits = found[1].partition(":")
        if name not in values:
            return found[0]
        return str(values[name]).zfill(int(digits or 0))

    return re.sub(r"\{(-?[A-Za-z_]+(?::[0-9]+)?)\}", one, template)


def located_files(server: Server, spec: SourceSpec, area: Area) -> list[str]:
    """Return the addresses of files that intersect an area, the best first.

    Raises:
        NotAcquiredError: the list is invalid, or lists no file there.
        DownloadError: the download of the list failed.
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
    """Yield the strings in a feature that are file addresses; STAC's links are skipped."""
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
    """Yield the placeholder values of the one-degree squares that an area intersects."""
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
    """Return a valid geometry of GeoJSON in degrees, or ``None``."""
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
