"""The info file that RealityCapture (``.rcInfo``) and RealityScan (``.rsInfo``) write.

It holds several XML elements one after the other. ``Model`` names the project's coordinate system
(``globalCoordinateSystem``: PROJ, ``...Wkt``, ``...Name``: ``epsg:32653 - WGS 84 / UTM zone 53N``)
and ``transformToModel``, 16 numbers in rows, each either as an attribute or as a child element;
``exportCoordinateSystemType`` 3 means that the vertices are geocentric, whatever is named. What
the matrix is from and to differs between versions and settings, so every reading of it is tried
and the one that leads to the site is taken; where none does, that is reported.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.number_text import plain_number
from urbantwin.reconstruct.formats.coordinate_system import crs_of

__all__ = ["RealityCaptureInfo", "info_beside", "reading_at"]

LONGEST = 1 << 20
#: A reading that puts the model further from the site than this is wrong, metres.
FARTHEST_M = 20_000.0
_ENDINGS = (".rcinfo", ".rsinfo")


@dataclass(frozen=True)
class RealityCaptureInfo:
    """What an info file says.

    Attributes:
        path: the file.
        crs: the project's coordinate system, or ``None``.
        transform: (4, 4) ``transformToModel``, or ``None``.
        geocentric: the vertices are earth-centred.
    """

    path: Path
    crs: CRS | None
    transform: NDArray[np.float64] | None
    geocentric: bool


def info_beside(path: Path) -> RealityCaptureInfo | None:
    """Return the info of a model, ``None`` where there is none.

    Raises:
        InputError: it is wrong.
    """
    names = {path.name.lower() + e for e in _ENDINGS} | {path.stem.lower() + e for e in _ENDINGS}
    found = [f for f in sorted(path.parent.iterdir()) if f.name.lower() in names and f.is_file()]
    return _read(found[0]) if found else None


def _read(path: Path) -> RealityCaptureInfo:
    if path.stat().st_size > LONGEST:
        raise InputError("is too long", file=path, expected="an info file")
    text = re.sub(r"<\?xml[^>]*\?>", "", path.read_bytes().decode("utf-8-sig", "replace"))
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    try:
        root = etree.fromstring(f"<all>{text}</all>".encode(), parser)
    except (etree.XMLSyntaxError, ValueError):
        raise InputError("is not XML", file=path, expected="an info file") from None
    model = root.find("Model")
    if model is None:
        raise InputError("has no Model", file=path, expected="an info file of a model")

    def said(name: str) -> str:
        return (model.get(name) or model.findtext(name) or "").strip()

    name = said("globalCoordinateSystemName")
    crs = None
    if not name.lower().startswith("local"):
        named = (name, said("globalCoordinateSystemWkt"), said("globalCoordinateSystem"))
        crs = next((known for text in named if (known := crs_of(text)) is not None), None)
    words = said("transformToModel").split()
    transform = None
    if words:
        try:
            transform = np.array([plain_number(word) for word in words]).reshape(4, 4)
        except ValueError:
            raise InputError(
                "is not a matrix", file=path, place="transformToModel", expected="16 numbers"
            ) from None
    return RealityCaptureInfo(path, crs, transform, said("exportCoordinateSystemType") == "3")


def reading_at(
    info: RealityCaptureInfo, points: NDArray[np.float64], frame: SiteFrame
) -> tuple[NDArray[np.float64], CRS] | None:
    """Return the matrix (4, 4) and the system that put a model nearest to the site.

    Args:
        info: what its info file says.
        points: (N, 3) its vertices, z up.
        frame: the site frame.

    Returns:
        ``None`` where no reading puts it within ``FARTHEST_M``.
    """
    middle = np.append((points.min(axis=0) + points.max(axis=0)) / 2, 1.0)
    best, least = None, FARTHEST_M
    for matrix, crs in _readings(info):
        distance = _distance(matrix @ middle, crs, frame)
        # The plainer reading wins unless another is much nearer.
        if distance < least:
            best, least = (matrix, crs), distance / 4
    return best


def _readings(info: RealityCaptureInfo) -> Iterator[tuple[NDArray[np.float64], CRS]]:
    geocentric = CRS.from_epsg(4978)
    systems = [geocentric] if info.geocentric else [crs for crs in (info.crs,) if crs is not None]
    systems += [geocentric] if not info.geocentric else []
    for crs in systems:
        yield np.eye(4), crs
        if info.transform is not None and abs(np.linalg.det(info.transform)) > 1e-12:
            yield info.transform, crs
            yield np.linalg.inv(info.transform).astype(np.float64), crs


def _distance(place: NDArray[np.float64], crs: CRS, frame: SiteFrame) -> float:
    """Distance in plan from the site's anchor, metres; infinite where it is nowhere."""
    try:
        if crs.is_geocentric:
            if not 6.2e6 < np.linalg.norm(place[:3]) < 6.5e6:
                return float("inf")
            transform = Transformer.from_crs(crs, "EPSG:4979", always_xy=True)
            lon, lat = transform.transform(*place[:3])[:2]
        else:
            transform = Transformer.from_crs(crs.to_2d(), "EPSG:4326", always_xy=True)
            lon, lat = transform.transform(place[0], place[1])
    except ProjError:
        return float("inf")
    if not (np.isfinite(lon) and np.isfinite(lat) and abs(lat) <= 90):
        return float("inf")
    xy = frame.site_from_lonlat(np.array([[lon, lat]]))
    distance = float(np.linalg.norm(xy))
    return distance if np.isfinite(distance) else float("inf")
