"""The country of a place, offline."""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files

import tzfpy

__all__ = ["country_of"]


@cache
def _country_of_zone() -> dict[str, str]:
    """Return time zone -> country (the first in ``zone.tab`` of the tz database)."""
    text = files("tzdata").joinpath("zoneinfo", "zone.tab").read_text(encoding="utf-8")
    rows = csv.reader(
        (line for line in text.splitlines() if not line.startswith("#")), delimiter="\t"
    )
    return {row[2]: row[0] for row in rows}


def country_of(latitude: float, longitude: float) -> str:
    """Return the country of a place in degrees (ISO 3166-1 alpha-2); empty if unknown.

    Found offline by the place's time zone; of countries that share a zone, the largest is used.
    """
    return _country_of_zone().get(tzfpy.get_tz(longitude, latitude), "")
