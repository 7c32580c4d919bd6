"""Coordinate reference systems as files write them."""

from __future__ import annotations

import re

from pyproj import CRS
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError

__all__ = ["compound", "crs_of"]

#: ``urn:ogc:def:crs:EPSG::7415``, ``https://www.opengis.net/def/crs/EPSG/0/7415``,
#: ``epsg:32653 - WGS 84 / UTM zone 53N``, ``EPSG:32632+5773``.
_CODE = re.compile(
    r"(?:urn:ogc:def:crs:|https?://(?:www\.)?opengis\.net/def/crs/)?"
    r"(epsg|esri|ogc)\s*[:/]\s*(?:[\d.]*[:/])?([0-9a-z]+)((?:\s*\+\s*(?:epsg:)?\d+)?)(?:$|[\s-])",
    re.IGNORECASE,
)
_UTM = re.compile(r"WGS\s*84[\s/]+UTM(?:\s+zone)?\s+(\d{1,2})\s*([NS])", re.IGNORECASE)


def crs_of(text: str) -> CRS | None:
    """Return the system that a file names by code, WKT or PROJ string, ``None`` if it names none.

    ``epsg:28992+5709`` is the compound of a horizontal and a vertical one.
    """
    text = text.strip()
    if not text or text.upper() == "NONE" or text.lower().startswith("local"):
        return None
    match = _CODE.match(text)
    if match:
        authority, code, vertical = match.groups()
        found = _known(f"{authority.upper()}:{code}")
        if found is not None and vertical:
            return compound(found, _known("EPSG:" + re.sub(r"\D", "", vertical)))
        return found
    match = _UTM.match(text)
    if match:
        zone, half = int(match[1]), match[2].upper()
        return _known(f"EPSG:{(32600 if half == 'N' else 32700) + zone}") if zone <= 60 else None
    return _known(text)


def compound(horizontal: CRS, vertical: CRS | None) -> CRS:
    """Return a horizontal system with a vertical one; alone where there is no vertical one."""
    if vertical is None or not vertical.is_vertical:
        return horizontal
    both = CompoundCRS(f"{horizontal.name} + {vertical.name}", [horizontal, vertical])
    return CRS.from_wkt(both.to_wkt())  # its own class cannot be made two-dimensional


def _known(text: str) -> CRS | None:
    try:
        return CRS.from_user_input(text)
    except (CRSError, UnicodeError):
        return None
