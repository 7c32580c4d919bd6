"""The OpenDRIVE document in the element order of ASAM's schema (1.8) or of 1.4H."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator

import numpy as np
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import (
    Curve,
    LaneModel,
    ModelJunction,
    ModelRoad,
    Piece,
    Profile,
    RoadSignal,
)
from urbantwin.roads.opendrive.vocabulary import ROAD_TYPES
from urbantwin.roads.opendrive.writing.lane_sections import lane_links, write_lanes
from urbantwin.roads.opendrive.writing.number_format import abcd, number, numbers, records, xml_text
from urbantwin.roads.opendrive.writing.objects import (
    with_signal_references,
    write_controller,
    write_objects,
    write_signals,
)

__all__ = ["document"]

#: Release date of the standard's version 1.8, as a fixed date: files are reproducible.
DATE = "2023-11-22T00:00:00"
#: Lines with a smaller difference in heading are merged, radians (ASAM's rule
#: ``performance.avoid_redundant_info``).
COLLINEAR = 1e-6
#: Maximum error of a crown interpolated between its cross sections, metres.
CROWN_M = 0.0005


def document(model: LaneModel, frame: SiteFrame, *, version: str, name: str) -> bytes:
    """Return a complete OpenDRIVE file.

    Args:
        model: the lane model; for version 1.4, of right-hand traffic.
        frame: the site frame.
        version: ``1.8`` or ``1.4``.
        name: name of the map.
    """
    root = etree.Element("OpenDRIVE")
    _header(root, model, frame, version, name)
    referred: tuple[RoadSignal, ...] = ()
    if version == "1.4":
        model, referred = with_signal_references(model)
    areas, signals, references = defaultdict(list), defaultdict(list), defaultdict(list)
    for area in model.areas:
        areas[area.road].append(area)
    for signal in model.signals:
        signals[signal.road].append(signal)
    for signal in referred:
        references[signal.road].append(signal)
    for road in model.roads:
        item = _road(root, road, model, version)
        write_plan(item, road.curve)
        write_profiles(item, road, version)
        write_lanes(item, model, road, version)
        write_objects(item, road, areas[road.id], version)
        write_signals(item, road, signals[road.id], references[road.id], version)
        _notes(item, road)
    for controller in model.controllers:
        if controller.signals:
            write_controller(root, controller)
    for junction in model.junctions:
        _junction(root, junction, model, version)
    etree.indent(root, space=" ")
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


def _header(
    root: etree._Element, model: LaneModel, frame: SiteFrame, version: str, name: str
) -> None:
    xy = np.vstack([road.curve.at(np.linspace(0, road.length, 20))[:, :2] for road in model.roads])
    west, south = np.floor(xy.min(axis=0)) - 20
    east, north = np.ceil(xy.max(axis=0)) + 20
    header = etree.SubElement(
        root,
        "header",
        revMajor="1",
        revMinor=version.split(".")[1],
        name=xml_text(name),
        version="1.00",
        date=DATE,
        **numbers(north=north, south=south, east=east, west=west),
        vendor="UrbanTwin",
    )
    etree.SubElement(header, "geoReference").text = etree.CDATA(frame.proj)
    if version != "1.4":
        etree.SubElement(header, "offset", **numbers(x=0, y=0, z=0, hdg=0))


def _road(root: etree._Element, road: ModelRoad, model: LaneModel, version: str) -> etree._Element:
    item = etree.SubElement(
        root,
        "road",
        name=xml_text(road.name),
        length=number(road.length),
        id=str(road.id),
        junction=str(road.junction),
    )
    if version != "1.4":
        item.set("rule", "LHT" if model.driving_side == "left" else "RHT")
    links = [
        (tag, link)
        for tag, link in (("predecessor", road.predecessor), ("successor", road.successor))
        if link is not None
    ]
    if links:
        parent = etree.SubElement(item, "link")
        for tag, link in links:
            child = etree.SubElement(parent, tag, elementType=link.element, elementId=str(link.id))
            if link.element == "road":
                child.set("contactPoint", link.contact)
    kind = etree.SubElement(item, "type", s="0", type=ROAD_TYPES.get(road.kind, "town"))
    speed = max((lane.speed_limit for s in road.sections for lane in s.lanes), default=0.0)
    if speed > 0:
        # 1.4H requires whole numbers here.
        etree.SubElement(kind, "speed", max=str(round(speed * 3.6)), unit="km/h")
    return item


def _notes(item: etree._Element, road: ModelRoad) -> None:
    """Write what the standard has no element for: class, OSM ways and level of a street."""
    if road.kind:
        etree.SubElement(item, "userData", code="class", value=xml_text(road.kind))
    if road.ways:
        etree.SubElement(item, "userData", code="ways", value=" ".join(map(str, road.ways)))
    if road.level:
        etree.SubElement(item, "userData", code="level", value=str(road.level))


def _junction(
    root: etree._Element, junction: ModelJunction, model: LaneModel, version: str
) -> None:
    roads = model.road_by_id
    is_connecting = [roads[c.connecting].junction == junction.id for c in junction.connections]
    # 1.7 on: roads that are linked without a road between them.
    direct = version != "1.4" and bool(is_connecting) and not any(is_connecting)
    item = etree.SubElement(root, "junction", name=xml_text(junction.name), id=str(junction.id))
    if direct:
        item.set("type", "direct")
    for index, connection in enumerate(junction.connections):
        child = etree.SubElement(
            item,
            "connection",
            {
                "id": str(index),
                "incomingRoad": str(connection.incoming),
                "linkedRoad" if direct else "connectingRoad": str(connection.connecting),
                "contactPoint": connection.contact,
            },
        )
        is_open = lane_links(
            roads[connection.incoming], roads[connection.connecting], connection.contact
        )
        for first, second in connection.links:
            if is_open.get((first, second), True):
                etree.SubElement(child, "laneLink", {"from": str(first), "to": str(second)})
    for controller in model.controllers:
        if controller.signals and junction.id in controller.junctions:
            etree.SubElement(item, "controller", id=str(controller.id), type="0")


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

    The crown is the ``crossfall`` of 1.4, and ``shape`` in 1.8, which older readers support, unlike
    ``crossSectionSurface``.
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
        # The angle of a 4 % fall differs from 0.04 by 2e-5: 0.2 mm at 10 m.
        for start, row in records(road.crown, road.length):
            etree.SubElement(lateral, "crossfall", side="both", s=number(start), **abcd(row))
        return
    reach = _lane_extent(road)
    for s in _stations(road.crown, road.length, reach):
        fall = float(road.crown.at(s)[0])
        for t, a, b in ((-reach, -fall * reach, fall), (0.0, 0.0, -fall)):
            etree.SubElement(lateral, "shape", **numbers(s=s, t=t), **abcd((a, b, 0, 0)))


def _lane_extent(road: ModelRoad) -> float:
    """Return the extent of lanes from the reference line, rounded up, metres."""
    furthest = 1.0
    for section, end in zip(road.sections, road.section_ends, strict=True):
        s = np.linspace(section.s, end, 9)
        outer = (section.lanes[0], section.lanes[-1]) if section.lanes else ()
        for lane in outer:
            furthest = max(furthest, np.abs(road.border(section, lane, s, outer=True)).max())
    return float(math.ceil(furthest + 1.0))


def _stations(crown: Profile, length: float, reach: float) -> Iterator[float]:
    """Yield the stations at which a crown is written; it is interpolated linearly between them."""
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
    """Yield pieces, with collinear consecutive lines merged."""
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
