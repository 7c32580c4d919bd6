"""Values of tags: lengths, counts and directions in the formats used in the map."""

from __future__ import annotations

import math
import re

from PIL import ImageColor

__all__ = ["angle_deg_of", "colour_of", "count_of", "length_m_of", "yaw_of_direction"]

_NUMBER = r"(\d+(?:[.,]\d+)?|[.,]\d+)"
_METRIC = re.compile(rf"^~?\s*{_NUMBER}\s*(m|metres?|meters?|mtrs?|cm|mm)?\.?$", re.IGNORECASE)
_FEET = re.compile(
    rf"^~?\s*{_NUMBER}\s*(?:'|′|ft\.?|feet|foot)\s*(?:{_NUMBER}\s*(?:\"|″|''|in\.?|inch(?:es)?))?$",
    re.IGNORECASE,
)
_COUNT = re.compile(rf"^{_NUMBER}$")
_HEX = re.compile(r"^[0-9a-f]{6}$")
#: Larger values are mapping errors.
LONGEST_M, MOST = 1000.0, 1000.0
_METRES = {"cm": 0.01, "mm": 0.001}
_COMPASS = ["N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE"]
_COMPASS += ["S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"]


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def length_m_of(text: str | None) -> float | None:
    """Return the metres that a tag's value means, or ``None`` if it is not a length.

    Understands the forms of https://wiki.openstreetmap.org/wiki/Map_features/Units and other common
    ones: ``12``, ``12.5``, ``12,5``, ``12 m``, ``120 cm``, ``40'``, ``40 ft``, ``5'6"``. Zero and
    negative values, ranges and words give ``None``.
    """
    if text is None:
        return None
    text = text.strip()
    if match := _METRIC.match(text):
        length = _number(match[1]) * _METRES.get((match[2] or "m").lower(), 1.0)
    elif match := _FEET.match(text):
        length = _number(match[1]) * 0.3048 + (_number(match[2]) * 0.0254 if match[2] else 0.0)
    else:
        return None
    return length if 0 < length <= LONGEST_M else None


def count_of(text: str | None) -> float | None:
    """Return a number of storeys (``3``, ``2.5``, the largest of ``2;3``), or ``None``."""
    if text is None:
        return None
    matches = [_COUNT.match(piece.strip()) for piece in text.split(";")]
    counts = [_number(match[1]) for match in matches if match]
    sound = counts and len(counts) == len(matches) and max(counts) <= MOST
    return max(counts) if sound else None


def yaw_of_direction(text: str | None) -> float | None:
    """Return the yaw (radians, counter-clockwise from east) of a compass direction, or ``None``.

    Understands degrees clockwise from north and the sixteen points of the compass.
    """
    if text is None:
        return None
    text = text.strip().upper().removesuffix("°")
    if text in _COMPASS:
        degrees = _COMPASS.index(text) * 22.5
    elif match := _COUNT.match(text):
        degrees = _number(match[1])
    else:
        return None
    return math.radians(90.0 - degrees) if degrees <= MOST else None


def angle_deg_of(text: str | None) -> float | None:
    """Return the degrees that a tag's value means (``30``, ``30°``, ``30 deg``), or ``None``."""
    if text is None:
        return None
    plain = text.strip().lower().removesuffix("degrees").removesuffix("deg").rstrip(" °")
    match = _COUNT.match(plain)
    degrees = _number(match[1]) if match else math.inf
    return degrees if degrees <= MOST else None


def colour_of(text: str | None) -> tuple[int, int, int] | None:
    """Return the sRGB (0..255) of a colour (``#a05``, ``#aa0055``, CSS names), or ``None``."""
    if text is None:
        return None
    plain = text.strip().lower().replace("_", "").replace(" ", "")
    if _HEX.match(plain):
        plain = "#" + plain
    try:
        red, green, blue = ImageColor.getrgb(plain)[:3]
    except ValueError:
        return None
    return red, green, blue
