"""Values of tags: lengths with units, counts, lists with a value for each lane."""

from __future__ import annotations

import re
from collections.abc import Mapping

__all__ = ["count", "lane_list", "metres"]

#: Metres of a unit (OSM wiki, "Map features/Units"; metres where none is given).
UNITS = {"": 1.0, "m": 1.0, "cm": 0.01, "ft": 0.3048, "'": 0.3048, "in": 0.0254, '"': 0.0254}
LENGTH = re.compile(r"^\s*(\d+(?:[.,]\d+)?)\s*(m|cm|ft|in|'|\")?\s*$")
FEET_AND_INCHES = re.compile(r"^\s*(\d+)\s*'\s*(\d+(?:\.\d+)?)\s*\"?\s*$")
#: Longest length and largest count that a road can have; larger values are mapping errors.
LONGEST_M, MOST = 100.0, 12


def metres(text: str | None) -> float | None:
    """Return a length in metres; ``None`` where it is missing, zero or no length."""
    if text is None:
        return None
    feet = FEET_AND_INCHES.match(text)
    if feet:
        value = float(feet[1]) * 0.3048 + float(feet[2]) * 0.0254
    else:
        plain = LENGTH.match(text)
        if not plain:
            return None
        value = float(plain[1].replace(",", ".")) * UNITS[plain[2] or ""]
    return value if 0.0 < value <= LONGEST_M else None


def count(text: str | None) -> int | None:
    """Return a number of lanes; the smallest of several (``2;3``), ``None`` if it is invalid."""
    if text is None:
        return None
    words = [word.strip() for word in text.split(";")]
    numbers = [int(float(w)) for w in words if re.fullmatch(r"\d{1,3}(\.\d{1,3})?", w)]
    return min(numbers) if numbers and len(numbers) == len(words) and min(numbers) <= MOST else None


def lane_list(tags: Mapping[str, str], key: str, direction: str = "") -> list[str] | None:
    """Return the values of a tag with one value for each lane, left to right.

    Args:
        tags: a way's tags.
        key: the tag without its direction, such as ``turn:lanes``.
        direction: ``forward``, ``backward`` or empty.
    """
    text = tags.get(f"{key}:{direction}" if direction else key)
    return None if text is None else [value.strip() for value in text.split("|")]
