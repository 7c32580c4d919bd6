"""Speed limits: from ``maxspeed``, else the law's default."""

from __future__ import annotations

import re
from collections.abc import Mapping

__all__ = ["speed_limit", "speed_of"]

KM_H, MPH, KNOT = 1 / 3.6, 0.44704, 0.514444
#: Walking pace (Germany, StVO section 42 with sign 325.1: 4 to 7 km/h).
WALK = 7 * KM_H
#: Where there is no limit, people drive the advisory speed (Germany: 130 km/h).
UNLIMITED = 130 * KM_H
#: Speeds of the law in km/h: urban, rural, divided rural or trunk, motorway, living street.
#: Source: OSM wiki, "Default speed limits" (the countries' road traffic acts).
LAW: dict[str, tuple[float, float, float, float, float]] = {
    "AT": (50, 100, 100, 130, 7), "AU": (50, 100, 100, 110, 10), "BE": (50, 70, 90, 120, 20),
    "BR": (60, 80, 100, 110, 20), "CA": (50, 80, 90, 100, 20), "CH": (50, 80, 100, 120, 20),
    "CN": (50, 70, 100, 120, 20), "CZ": (50, 90, 110, 130, 20), "DE": (50, 100, 130, 130, 7),
    "DK": (50, 80, 80, 130, 15), "EE": (50, 90, 90, 110, 20), "ES": (50, 90, 90, 120, 20),
    "FI": (50, 80, 100, 120, 20), "FR": (50, 80, 110, 130, 20), "GR": (50, 90, 110, 130, 20),
    "HR": (50, 90, 110, 130, 20), "HU": (50, 90, 110, 130, 20), "IE": (50, 80, 100, 120, 20),
    "IN": (50, 70, 80, 100, 20), "IT": (50, 90, 110, 130, 20), "JP": (40, 60, 60, 100, 20),
    "KR": (50, 80, 90, 100, 20), "LT": (50, 90, 90, 130, 20), "LU": (50, 90, 90, 130, 20),
    "LV": (50, 90, 90, 110, 20), "NL": (50, 80, 100, 100, 15), "NO": (50, 80, 80, 100, 15),
    "NZ": (50, 100, 100, 100, 10), "PL": (50, 90, 100, 140, 20), "PT": (50, 90, 100, 120, 20),
    "RO": (50, 90, 100, 130, 20), "RS": (50, 80, 100, 130, 10), "RU": (60, 90, 90, 110, 20),
    "SE": (50, 70, 90, 110, 7), "SG": (50, 60, 70, 90, 20), "SI": (50, 90, 110, 130, 10),
    "SK": (50, 90, 90, 130, 20), "TR": (50, 90, 110, 120, 20), "TW": (50, 60, 80, 100, 20),
    "UA": (50, 90, 110, 130, 20), "ZA": (60, 100, 100, 120, 20),
}  # fmt: skip
LAW_MPH: dict[str, tuple[float, float, float, float, float]] = {
    "GB": (30, 60, 70, 70, 20), "US": (30, 55, 55, 65, 15),
}  # fmt: skip
ELSEWHERE = (50.0, 80.0, 100.0, 120.0, 20.0)
CONTEXTS = {
    "urban": 0, "rural": 1, "nsl_single": 1, "nsl": 1, "nsl_restricted": 0, "trunk": 2,
    "nsl_dual": 2, "express": 2, "expressway": 2, "motorroad": 2, "motorway": 3,
    "living_street": 4, "pedestrian_zone": 4,
}  # fmt: skip
NUMBER = re.compile(r"(\d+(?:\.\d+)?)\s*(km/h|kmh|kph|mph|knots)?")
ZONE = re.compile(r"zone:?\s*(\d+)|^(\d+)$")


def speed_of(value: str, country: str = "") -> float | None:
    """Return a value of ``maxspeed`` in m/s.

    Args:
        value: such as ``50``, ``20 mph``, ``walk``, ``none``, ``DE:urban``, ``DE:zone30``.
        country: whose law applies to a value that names none.

    Returns:
        m/s; ``None`` where the value states no number, as ``signals`` and ``variable`` do.
    """
    # Of several values (``50;30``) the lowest is safe.
    if ";" in value:
        found = [speed_of(part, country) for part in value.split(";")]
        return min((speed for speed in found if speed is not None), default=None)
    text = value.strip()
    plain = NUMBER.fullmatch(text.lower())
    if plain:
        unit = {"mph": MPH, "knots": KNOT}.get(plain[2] or "", KM_H)
        speed = float(plain[1]) * unit
        return speed if 0.2 < speed < 100.0 else None
    if text.lower() == "walk":
        return WALK
    if text.lower() in ("none", "no", "unlimited"):
        return UNLIMITED
    code, _, context = text.partition(":")
    if not context:
        code, context = country, text
    code = {"UK": "GB"}.get(code.upper()[:2], code.upper()[:2])
    zone = ZONE.search(context)
    if zone:
        speed = float(zone[1] or zone[2]) * (MPH if code in LAW_MPH else KM_H)
        return speed if 0.0 < speed < 100.0 else None
    known = CONTEXTS.get(context.removeprefix("zone:"))
    return None if known is None else _law(code)[known]


def speed_limit(tags: Mapping[str, str], direction: str, country: str) -> float:
    """Return the limit of one direction of a way, m/s.

    Args:
        tags: the way's tags.
        direction: ``forward`` or ``backward``.
        country: ISO 3166-1 alpha-2, for the law where nothing is mapped.
    """
    for key in (
        f"maxspeed:{direction}",
        "maxspeed",
        "zone:maxspeed",
        f"maxspeed:type:{direction}",
        "maxspeed:type",
        "source:maxspeed",
        "zone:traffic",
    ):
        speed = speed_of(tags[key], country) if key in tags else None
        if speed is not None:
            return speed
    return default_speed(tags.get("highway", ""), country)


def default_speed(highway: str, country: str) -> float:
    """Return the law's limit of a class of road within a town, m/s."""
    urban, _, trunk, motorway, living = _law(country)
    if highway == "motorway":
        return motorway
    if highway == "living_street":
        return living
    if highway in ("trunk", "motorway_link"):
        return min(trunk, 80 * KM_H)
    return urban


def _law(country: str) -> tuple[float, ...]:
    if country in LAW_MPH:
        return tuple(speed * MPH for speed in LAW_MPH[country])
    return tuple(speed * KM_H for speed in LAW.get(country, ELSEWHERE))
