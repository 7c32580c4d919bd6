"""Geocoding: intersections as ``street and street, town``, other places by name.

Names are resolved by Nominatim (https://operations.osmfoundation.org/policies/nominatim: at most
one request a second, responses cached); intersections by Overpass, from shared nodes of two
streets.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import numpy as np
from pyproj import Geod

from urbantwin.acquire.overpass import overpass_answer
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, Web
from urbantwin.download import DownloadError
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold
from urbantwin.site.extract_file import LonLatBox
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["NamedPlace", "find_place"]

#: Most matches that are examined, and that are listed.
_MATCHES, _LISTED = 10, 5
#: Matches closer than this are the same (metres): a town and its centre; nodes of one junction.
_ONE_TOWN_M, _ONE_JUNCTION_M = 15_000.0, 120.0
#: Most towns of one name in which two streets are searched.
_TOWNS = 4
#: A larger bounding box is not a town, degrees.
_LARGEST_DEG = 2.0

_MEETING = """[out:json][timeout:60];
way({box})[highway][~"^(name|name:en|alt_name|official_name|ref)$"~"^{first}",i]->.first;
way({box})[highway][~"^(name|name:en|alt_name|official_name|ref)$"~"^{second}",i]->.second;
node(w.first)(w.second);
out;
"""


@dataclass(frozen=True)
class NamedPlace:
    """A named place.

    Attributes:
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        name: full name in the map.
        box: west, south, east, north, degrees.
    """

    latitude: float
    longitude: float
    name: str
    box: LonLatBox


def find_place(
    text: str, sources: Sequence[SourceSpec], web: Web, progress: Progress = untold
) -> NamedPlace:
    """Return the one place with a name.

    Args:
        text: ``street and street, town`` (or with ``&`` or ``/``), or any name or address.
        sources: sources; those of names and of the map are used.
        web: access to servers.
        progress: called with the fraction done and a description.

    Raises:
        InputError: no place, several places (listed), or no server.
    """
    text = " ".join(text.split())
    if not 2 <= len(text) <= 200:
        raise _error(text, "is no name of a place", "'street and street, town'")
    streets, _, town = text.partition(",")
    pair = re.split(r"\s+(?:and|und|et|y|e|en)\s+|\s*[&/]\s*", streets, flags=re.IGNORECASE)
    try:
        if len(pair) == 2 and all(pair) and town.strip():
            return _junction(text, pair, town.strip(), sources, web, progress)
        return _only(text, _apart(_matches(text, sources, web, progress), _ONE_JUNCTION_M * 4))
    except (DownloadError, NotAcquiredError) as error:
        raise _error(text, f"cannot be looked up ({error})", "a network, or --at LAT,LON") from None


def _junction(
    text: str,
    streets: list[str],
    town: str,
    sources: Sequence[SourceSpec],
    web: Web,
    progress: Progress,
) -> NamedPlace:
    """Return the intersection of two streets in the one town of a name that has it."""
    towns = _apart(_matches(town, sources, web, progress), _ONE_TOWN_M)
    towns = [one for one in towns if max(np.subtract(one.box[2:], one.box[:2])) < _LARGEST_DEG]
    if not towns:
        raise _error(
            text, f"is nowhere: no town {town!r} is known", "a town in full, or --at LAT,LON"
        )
    met: list[NamedPlace] = []
    for one in towns[:_TOWNS]:
        progress(0.5, f"where {streets[0]} meets {streets[1]}")
        found = _meetings(streets, one, sources, web, progress)
        met += [NamedPlace(*place, f"{text.partition(',')[0]}, {one.name}", one.box)
                for place in found]  # fmt: skip
    if not met:
        names = " nor ".join(one.name for one in towns[:_TOWNS])
        raise _error(
            text,
            f"is no junction: {streets[0]!r} and {streets[1]!r} do not meet in {names}",
            "streets as the map writes them, or --at LAT,LON",
        )
    return _only(text, met)


def _meetings(
    streets: list[str],
    town: NamedPlace,
    sources: Sequence[SourceSpec],
    web: Web,
    progress: Progress,
) -> list[tuple[float, float]]:
    """Return latitude and longitude of every intersection of two streets: the mean of its nodes."""
    box = f"{town.box[1]:.5f},{town.box[0]:.5f},{town.box[3]:.5f},{town.box[2]:.5f}"
    first, second = (_as_pattern(one) for one in streets)
    query = _MEETING.format(box=box, first=first, second=second)
    spec = _of_kind(sources, "map")
    told = overpass_answer(spec, query, web, b"json", progress)[2]
    rows = _rows(told.data, "elements")
    points = [(row["lat"], row["lon"]) for row in rows if _is_point(row.get("lat"), row.get("lon"))]
    groups: list[list[tuple[float, float]]] = []
    for point in points:
        near = [one for one in groups if any(_away_m(point, it) < _ONE_JUNCTION_M for it in one)]
        joined = [point, *(it for one in near for it in one)]
        groups = [one for one in groups if one not in near] + [joined]
    return [(float(np.mean([p[0] for p in one])), float(np.mean([p[1] for p in one])))
            for one in groups]  # fmt: skip


def _matches(
    text: str, sources: Sequence[SourceSpec], web: Web, progress: Progress
) -> list[NamedPlace]:
    """Return Nominatim's matches of a name, in descending order of importance."""
    spec = _of_kind(sources, "names")
    progress(0.1, f"looking up {text}")
    asked = {"q": text, "format": "jsonv2", "limit": _MATCHES, "accept-language": "en"}
    told = web.server(spec).get(f"{spec.address}?{urlencode(asked)}")
    found = []
    for row in _rows(told.data, None):
        try:
            latitude, longitude = float(row["lat"]), float(row["lon"])
            south, north, west, east = (float(one) for one in row["boundingbox"])
        except (KeyError, TypeError, ValueError):
            continue
        if _is_point(latitude, longitude) and south <= north and west <= east:
            name = str(row.get("display_name", text))
            found.append(NamedPlace(latitude, longitude, name, (west, south, east, north)))
    return found


def _apart(found: list[NamedPlace], least_m: float) -> list[NamedPlace]:
    """Return places, without those close to an earlier one."""
    kept: list[NamedPlace] = []
    for one in found:
        here = (one.latitude, one.longitude)
        if not any(_away_m(here, (it.latitude, it.longitude)) < least_m for it in kept):
            kept.append(one)
    return kept


def _only(text: str, found: list[NamedPlace]) -> NamedPlace:
    """Return the only place found.

    Raises:
        InputError: no place, or several; lists them.
    """
    if not found:
        raise _error(text, "is not found", "a name as the map writes it, or --at LAT,LON")
    if len(found) == 1:
        return found[0]
    listed = "; ".join(
        f"{one.latitude:.5f},{one.longitude:.5f} ({one.name:.70})" for one in found[:_LISTED]
    )
    more = f"; and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
    raise _error(text, f"means {len(found)} places: {listed}{more}", "one of them: --at LAT,LON")


def _rows(data: bytes, key: str | None) -> list[dict[str, Any]]:
    """Return the objects of a JSON list.

    Raises:
        NotAcquiredError: the data are not such a list.
    """
    try:
        value = parse_json(data)
    except NotJsonError:
        raise NotAcquiredError("the answer is not JSON") from None
    if key is not None:
        value = value.get(key) if isinstance(value, dict) else None
    if not isinstance(value, list):
        raise NotAcquiredError("the answer is no list of places")
    return [one for one in value if isinstance(one, dict)]


def _of_kind(sources: Sequence[SourceSpec], kind: str) -> SourceSpec:
    for one in sources:
        if one.kind == kind:
            return one
    raise NotAcquiredError(f"no source of {kind} is among the enabled sources")


def _as_pattern(street: str) -> str:
    """Return a street's name as a regular expression in a string of Overpass QL."""
    pattern = re.sub(r"([.^$*+?()\[\]{}|\\])", r"\\\1", street.strip())
    return json.dumps(pattern, ensure_ascii=False)[1:-1]


def _is_point(latitude: object, longitude: object) -> bool:
    return (
        isinstance(latitude, int | float)
        and isinstance(longitude, int | float)
        and abs(latitude) <= 90
        and abs(longitude) <= 180
    )


def _away_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    return float(Geod(ellps="WGS84").inv(one[1], one[0], other[1], other[0])[2])


def _error(text: str, problem: str, expected: str) -> InputError:
    return InputError(f"{text!r:.100} {problem}", place="--place", expected=expected)
