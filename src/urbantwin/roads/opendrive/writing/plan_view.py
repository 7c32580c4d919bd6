"""Writing reference lines and profiles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from lxml import etree

from urbantwin.roads.model import Curve, ModelRoad, Piece, Profile
from urbantwin.roads.opendrive.writing.number_format import abcd, number, numbers, records

__all__ = ["write_plan", "write_profiles"]

#: Lines whose headings differ less are one line (ASAM's rule ``performance.avoid_redundant_info``).
COLLINEAR = 1e-6
#: Largest error of a crown that is interpolated between its cross sections, metres.
CROWN_M = 0.0005


def write_plan(road_item: etree._Element, curve: Curve) -> None:
    """Write ``<planView>``: lines, arcs, and cubics over a parameter from 0 to 1."""
    view = etree.SubElement(road_item, "planView")
    start = 0.0
    for piece in _joined(curve.pieces):
        item = etree.SubElement(
            view,
            "geometry",
            **numbers(s=start, x=piece.x, y=piece.y, hdg=piece.heading, length=piece.length),
        )
        start += piece.length
        if piece.u:
            cubic = {
                letter + axis: number(value)
                for axis, values in (("U", piece.u), ("V", piece.v))
                for letter, value in zip("abcd", values, strict=True)
            }
            etree.SubElement(item, "paramPoly3", **cubic, pRange="normalized")
        elif piece.curvature:
            etree.SubElement(item, "arc", curvature=number(piece.curvature))
        else:
            etree.SubElement(item, "line")


def write_profiles(road_item: etree._Element, road: ModelRoad, version: str) -> None:
    """Write the elevation, the superelevation and the crown of a road.

    The crown is the ``crossfall`` of 1.4, and ``shape`` in 1.8: of what 1.8 offers (the other is
    ``crossSectionSurface``) that is what older readers know too.
    """
    elevation = etree.SubElement(road_item, "elevationProfile")
    for start, row in records(road.elevation, road.length):
        etree.SubElement(elevation, "elevation", s=number(start), **abcd(row))
    banked, crowned = not road.bank.is_zero, not road.crown.is_zero
    if not (banked or crowned):
        return
    lateral = etree.SubElement(road_item, "lateralProfile")
    if banked:
        for start, row in records(road.bank, road.length):
            etree.SubElement(lateral, "superelevation", s=number(start), **abcd(row))
    if not crowned:
        return
    if version == "1.4":
        # The angle of a fall of 4 % differs from 0.04 by 2e-5: 0.2 mm at 10 m.
        for start, row in records(road.crown, road.length):
            etree.SubElement(lateral, "crossfall", side="both", s=number(start), **abcd(row))
        return
    reach = _reach(road)
    for s in _stations(road.crown, road.length, reach):
        fall = float(road.crown.at(s)[0])
        for t, a, b in ((-reach, -fall * reach, fall), (0.0, 0.0, -fall)):
            etree.SubElement(lateral, "shape", **numbers(s=s, t=t), **abcd((a, b, 0, 0)))


def _reach(road: ModelRoad) -> float:
    """Return how far lanes reach from the reference line, rounded up."""
    furthest = 1.0
    for section, end in zip(road.sections, road.section_ends, strict=True):
        s = np.linspace(section.s, end, 9)
        outer = (section.lanes[0], section.lanes[-1]) if section.lanes else ()
        for lane in outer:
            furthest = max(furthest, np.abs(road.border(section, lane, s, outer=True)).max())
    return float(math.ceil(furthest + 1.0))


def _stations(crown: Profile, length: float, reach: float) -> Iterator[float]:
    """Return where a crown is written: between, it is interpolated linearly."""
    ends = np.append(crown.start[1:], length)
    for start, row, end in zip(crown.start, crown.abcd, ends, strict=True):
        extent = min(end, length) - start
        if extent <= 0:
            continue
        bend = 2 * max(abs(row[2]), abs(row[2] + 3 * row[3] * extent))
        count = max(1, math.ceil(extent * math.sqrt(bend * reach / (8 * CROWN_M))))
        flat = not row[1:].any()
        yield from (float(start + extent * k / count) for k in range(1 if flat else count))
    if crown.abcd[-1, 1:].any():
        yield length


def _joined(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Return pieces, lines that go straight on made one."""
    held: Piece | None = None
    for piece in pieces:
        straight = not (piece.u or piece.curvature)
        if held is not None and straight and abs(held.heading - piece.heading) < COLLINEAR:
            held = Piece(held.x, held.y, held.heading, held.length + piece.length)
            continue
        if held is not None:
            yield held
        held = piece if straight else None
        if held is None:
            yield piece
    if held is not None:
        yield held
