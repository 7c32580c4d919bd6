"""Coordinate reference systems named in files, and the order of their axes."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.crs import CompoundCRS
from pyproj.exceptions import CRSError, ProjError

__all__ = ["crs_of", "east_first", "named_system", "plan_of"]

#: ``urn:ogc:def:crs:EPSG::7415``, ``https://www.opengis.net/def/crs/EPSG/0/7415``,
#: ``epsg:32653 - WGS 84 / UTM zone 53N``, ``EPSG:32632+5773``.
_CODE = re.compile(
    r"(?:urn:ogc:def:crs:|https?://(?:www\.)?opengis\.net/def/crs/)?"
    r"(epsg|esri|ogc)\s*[:/]\s*(?:[\d.]*[:/])?([0-9a-z]+)((?:\s*\+\s*(?:epsg:)?\d+)?)(?:$|[\s-])",
    re.IGNORECASE,
)
_UTM = re.compile(r"WGS\s*84[\s/]+UTM(?:\s+zone)?\s+(\d{1,2})\s*([NS])", re.IGNORECASE)


def crs_of(text: str) -> CRS | None:
    """Return the CRS that a text names by code, WKT or PROJ string, ``None`` if it names none.

    ``epsg:28992+5709`` is a compound of a horizontal and a vertical one.
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
    """Return a compound of a horizontal CRS and a vertical one, if there is one."""
    if vertical is None or not vertical.is_vertical:
        return horizontal
    both = CompoundCRS(f"{horizontal.name} + {vertical.name}", [horizontal, vertical])
    return CRS.from_wkt(both.to_wkt())  # its own class cannot be reduced to two dimensions


def _known(text: str) -> CRS | None:
    try:
        return CRS.from_user_input(text)
    except (CRSError, UnicodeError):
        return None


#: ``urn:ogc:def:crs,crs:EPSG:6.12:3068,crs:EPSG:6.12:5783``: one code for each part.
_PARTS = re.compile(r"crs:EPSG:[\d.]*:(\d+)", re.IGNORECASE)
#: ``http://www.opengis.net/gml/srs/epsg.xml#25832``
_GML2 = re.compile(r"epsg\.xml#(\d+)$", re.IGNORECASE)
#: Systems of German survey offices (GeoInfoDok): ``urn:adv:crs:ETRS89_UTM32*DE_DHHN92_NH``.
_ADV = re.compile(r"urn:adv:crs:([A-Z0-9_]+)(?:\*([A-Z0-9_]+))?", re.IGNORECASE)
_ADV_PLANS = {
    "ETRS89_UTM31": 25831,
    "ETRS89_UTM32": 25832,
    "ETRS89_UTM33": 25833,
    "DE_DHDN_3GK2": 31466,
    "DE_DHDN_3GK3": 31467,
    "DE_DHDN_3GK4": 31468,
    "DE_DHDN_3GK5": 31469,
}
_ADV_HEIGHTS = {"DE_DHHN92_NH": 5783, "DE_DHHN2016_NH": 7837, "DE_DHHN85_NOH": 5784}


def named_system(name: str) -> CRS | None:
    """Return the CRS of a ``srsName``, ``None`` if it is unknown."""
    name = name.strip()
    parts = _PARTS.findall(name) if "crs," in name.lower() else []
    if len(parts) in (1, 2):
        return crs_of(f"EPSG:{'+'.join(parts)}")
    if match := _GML2.search(name):
        return crs_of(f"EPSG:{match[1]}")
    if match := _ADV.fullmatch(name):
        plan = _ADV_PLANS.get(match[1].upper())
        height = _ADV_HEIGHTS.get((match[2] or "").upper())
        if plan is None:
            return None
        found = CRS.from_epsg(plan)
        return compound(found, CRS.from_epsg(height)) if height else found
    return crs_of(name)


def east_first(
    points: NDArray[np.float64], crs: CRS, name: str
) -> tuple[NDArray[np.float64], bool]:
    """Return points with east before north, and whether their axes were swapped for it.

    Names as URN or URL imply the axis order of the CRS definition (OGC 09-048r5), which many files
    ignore. The order is used in which the points are in the CRS's area of use; if both are, that of
    the definition, or east first for short names (``EPSG:``).

    Args:
        points: (N, 3) as in the file.
        crs: their CRS.
        name: name of the CRS in the file.
    """
    plan = plan_of(crs)
    first = plan.axis_info[0].direction.lower() if plan.axis_info else "east"
    north_first = first in ("north", "south")
    turned = points[:, [1, 0, 2]]
    as_defined = north_first and name.strip().lower().startswith(("urn:", "http"))
    orders = [True, False] if as_defined else [False, True]
    for swapped in orders:
        if _holds(turned if swapped else points, plan):
            return (turned if swapped else points), swapped
    return (turned if as_defined else points), as_defined


def plan_of(crs: CRS) -> CRS:
    """Return the horizontal part of a CRS."""
    return crs.sub_crs_list[0] if crs.is_compound else crs


def _holds(points: NDArray[np.float64], plan: CRS) -> bool:
    """Return whether points are in a CRS's area of use."""
    area = plan.area_of_use
    if area is None:
        return True
    middle = np.median(points, axis=0)
    if plan.is_geographic:
        lon, lat = float(middle[0]), float(middle[1])
    else:
        try:
            change = Transformer.from_crs(plan, "EPSG:4326", always_xy=True)
            lon, lat = change.transform(float(middle[0]), float(middle[1]))
        except (CRSError, ProjError):
            return False
    within = area.south - 1 <= lat <= area.north + 1
    if area.west <= area.east:
        return within and area.west - 1 <= lon <= area.east + 1
    return within and (lon >= area.west - 1 or lon <= area.east + 1)
