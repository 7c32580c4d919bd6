"""The side of driving of a country."""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files

import tzfpy

__all__ = ["country_of", "driving_side"]

#: Countries and territories that drive on the left (ISO 3166-1 alpha-2).
#: Source: Wikipedia, "Left- and right-hand traffic", table of countries.
LEFT = frozenset(
    "AG AI AU BB BD BM BN BS BT BW CC CK CX CY DM FJ FK GB GD GG GY HK ID IE IM IN JE JM JP KE KI "
    "KN KY LC LK LS MO MS MT MU MV MW MY MZ NA NF NR NU NZ PG PK PN SB SC SG SH SR SZ TC TH TK TL "
    "TO TT TV TZ UG VC VG VI WS ZA ZM ZW".split()
)


@cache
def _country_of_zone() -> dict[str, str]:
    """Return time zone -> country (the first that ``zone.tab`` of the tz database names)."""
    text = files("tzdata").joinpath("zoneinfo", "zone.tab").read_text()
    rows = csv.reader(
        (line for line in text.splitlines() if not line.startswith("#")), delimiter="\t"
    )
    return {row[2]: row[0] for row in rows}


def country_of(latitude: float, longitude: float) -> str:
    """Return the country of a place in degrees (ISO 3166-1 alpha-2); empty where none is known.

    By the place's time zone, offline; where countries share a zone, the largest is taken.
    """
    return _country_of_zone().get(tzfpy.get_tz(longitude, latitude), "")


def driving_side(latitude: float, longitude: float) -> str:
    """Return ``left`` or ``right`` for a place in degrees; ``right`` where no country is known."""
    return "left" if country_of(latitude, longitude) in LEFT else "right"
