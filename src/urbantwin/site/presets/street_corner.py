"""Where streets meet that are known by their names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract, Way
from urbantwin.site.junction_proposal import STREETS

__all__ = ["street_corner"]

#: Carriageways of two streets that come so near to each other meet, metres.
_MEET_M = 20.0
#: Tags that name a street.
_NAMES = ("name", "name:en", "int_name", "official_name", "alt_name", "old_name", "name:zh")


def street_corner(
    extract: Extract, site: SiteFrame, streets: Sequence[Sequence[str]], within_m: float
) -> tuple[float, float] | None:
    """Return latitude and longitude of the middle of where named streets meet.

    Args:
        extract: the map.
        site: its origin is where the streets are said to meet, about.
        streets: of each street, the beginnings of names that it may have.
        within_m: how far from the origin they may meet, metres.

    Returns:
        ``None`` where a street is missing, or they do not meet so near.
    """
    lines = [_lines(extract, site, names, within_m) for names in streets]
    if len(lines) < 2 or not all(lines):
        return None
    first, *rest = (shapely.union_all(one) for one in lines)
    near, crossed = first, first
    for other in rest:
        near = near.buffer(_MEET_M).intersection(other)
        crossed = crossed.intersection(other)
    # Of streets that lie on two levels, or end before each other, there is no point in common.
    meeting = near if crossed.is_empty else crossed
    parts = [part for part in shapely.get_parts(meeting) if not part.is_empty]
    if not parts:
        return None
    # Where two carriageways cross two others there are several: those around the nearest are one.
    middles = np.array([shapely.get_coordinates(part.centroid)[0] for part in parts])
    nearest = middles[np.argmin(np.linalg.norm(middles, axis=1))]
    middle = middles[np.linalg.norm(middles - nearest, axis=1) <= 2 * _MEET_M].mean(axis=0)
    if float(np.linalg.norm(middle)) > within_m:
        return None
    longitude, latitude = site.lonlat_from_site(middle)[0]
    return round(float(latitude), 7), round(float(longitude), 7)


def _lines(
    extract: Extract, site: SiteFrame, names: Sequence[str], within_m: float
) -> list[shapely.Geometry]:
    """Return the lines of a street near the origin."""
    wanted = [_plain(name) for name in names]
    disc = shapely.Point(0.0, 0.0).buffer(within_m + _MEET_M)
    found = []
    for way in extract.highways():
        if way.tags["highway"] in STREETS and _is_named(way, wanted):
            points = extract.way_line(way, site)
            if len(points) >= 2:
                found.append(shapely.intersection(shapely.LineString(points), disc))
    return [line for line in found if not line.is_empty]


def _is_named(way: Way, wanted: Sequence[str]) -> bool:
    given = [_plain(way.tags[key]) for key in _NAMES if key in way.tags]
    return any(name.startswith(start) for name in given for start in wanted)


def _plain(name: str) -> str:
    """Return a name without case, accents, dots and blanks."""
    letters = unicodedata.normalize("NFKD", name).casefold()
    return re.sub(r"[\s.\-'’]|[\u0300-\u036f]", "", letters)
