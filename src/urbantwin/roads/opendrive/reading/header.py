"""The header of an OpenDRIVE file."""

from __future__ import annotations

from dataclasses import dataclass

from lxml import etree

from urbantwin.roads.opendrive.reading.parsing import Log

__all__ = ["Header", "read_header"]


@dataclass(frozen=True)
class Header:
    """The header's content.

    Attributes:
        version: ``1.4``; empty if it does not say.
        vendor: who made it.
        projection: what its coordinates are, as PROJ or WKT; ``None`` if it does not say.
        offset: x, y, z and heading by which its coordinates are to be moved.
    """

    version: str = ""
    vendor: str = ""
    projection: str | None = None
    offset: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def read_header(item: etree._Element, log: Log) -> Header:
    """Return the header.

    Raises:
        InputError: the file is of another major version, or its offset is not a number.
    """
    spot = log.at("header")
    major, minor = item.get("revMajor"), item.get("revMinor") or ""
    if major is not None and major.strip() != "1":
        raise spot.error(f"is of version {major[:10]}.{minor[:10]}", expected="1.1 to 1.8")
    text = " ".join((item.findtext("geoReference") or "").split())
    if text.startswith("+") and "+proj" not in text and "+lat_0" in text:
        # Maps of CARLA give the origin only: CARLA takes it for that of a transverse Mercator
        # projection.
        text = f"+proj=tmerc {text}" + ("" if "+datum" in text else " +datum=WGS84")
        spot.remark("a georeference of an origin only: a transverse Mercator is taken")
    offset = item.find("offset")
    keys = ("x", "y", "z", "hdg")
    moved = (0.0,) * 4 if offset is None else tuple(spot.number(offset, k, 0.0) for k in keys)
    return Header(
        f"1.{minor}" if minor else "",
        item.get("vendor") or "",
        text or None,
        (moved[0], moved[1], moved[2], moved[3]),
    )
