"""The OpenDRIVE document, in the order and the words of ASAM's schema (1.8) or of 1.4H."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model.curve import Curve
from urbantwin.roads.model.profile import Profile
from urbantwin.roads.opendrive.digits import abcd, number, numbers
from urbantwin.roads.opendrive.legacy_lanes import connecting_lane, street_lanes
from urbantwin.roads.streets.furniture import Area, Controller, Furniture, Signal
from urbantwin.roads.streets.manoeuvre import Manoeuvre
from urbantwin.roads.streets.street import Street

__all__ = ["Map", "document"]

#: The day that the standard's version 1.8 was released: files are the same on every day.
DATE = "2023-11-22T00:00:00"
#: Height of a signal's lights over the road, metres (clearance of US MUTCD 4D.15: 4.6 m and more).
LIGHTS_M = {"1000001": 5.0, "1000002": 2.2}


@dataclass(frozen=True)
class Map:
    """What goes into a document.

    Attributes:
        hand: ``RHT`` or ``LHT``.
        junctions: id of a junction of the lane model -> id in OpenDRIVE.
    """

    streets: Sequence[Street]
    manoeuvres: Sequence[Manoeuvre]
    furniture: Furniture
    hand: str
    junctions: dict[str, int]


def document(content: Map, frame: SiteFrame, *, version: str, name: str) -> bytes:
    """Return a whole OpenDRIVE file."""
    root = etree.Element("OpenDRIVE")
    _header(root, content, frame, version, name)
    areas, signals = defaultdict(list), defaultdict(list)
    for area in content.furniture.areas:
        areas[area.road].append(area)
    for signal in content.furniture.signals:
        signals[signal.road].append(signal)
    ends = _ends(content)
    for street in content.streets:
        road = _road(root, street.number, street.edge.name, street.curve, -1, content, version)
        _street_links(road, street, ends)
        speed = max(strip.lane.speed_limit for strip in street.strips)
        _shape(road, street.curve, street.elevation, street.bank, _type(street, speed))
        lanes = etree.SubElement(road, "lanes")
        street_lanes(lanes, street, version)
        _objects(road, areas[street.number], version)
        _signals(road, signals[street.number], version)
    for manoeuvre in content.manoeuvres:
        junction = content.junctions[manoeuvre.junction]
        road = _road(root, manoeuvre.number, "", manoeuvre.curve, junction, content, version)
        links = etree.SubElement(road, "link")
        for tag, street, strip, leaving in (
            ("predecessor", manoeuvre.entry, manoeuvre.start, True),
            ("successor", manoeuvre.exit, manoeuvre.end, False),
        ):
            contact = "end" if strip.forward == leaving else "start"
            etree.SubElement(
                links,
                tag,
                elementType="road",
                elementId=str(street.number),
                contactPoint=contact,
            )
        _shape(
            road,
            manoeuvre.curve,
            manoeuvre.elevation,
            manoeuvre.bank,
            _type(manoeuvre.entry, manoeuvre.speed_limit),
        )
        connecting_lane(etree.SubElement(road, "lanes"), manoeuvre, version)
        _objects(road, areas[manoeuvre.number], version)
        _signals(road, signals[manoeuvre.number], version)
    for controller in content.furniture.controllers:
        _controller(root, controller)
    for key, identity in content.junctions.items():
        _junction(root, key, identity, content)
    etree.indent(root, space=" ")
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


def _header(root: etree._Element, content: Map, frame: SiteFrame, version: str, name: str) -> None:
    xy = np.vstack(
        [road.curve.at(np.linspace(0, road.curve.length, 20))[:, :2] for road in _roads(content)]
    )
    west, south = np.floor(xy.min(axis=0)) - 20
    east, north = np.ceil(xy.max(axis=0)) + 20
    header = etree.SubElement(
        root,
        "header",
        revMajor="1",
        revMinor=version.split(".")[1],
        name=name,
        version="1.00",
        date=DATE,
        **numbers(north=north, south=south, east=east, west=west),
        vendor="UrbanTwin",
    )
    etree.SubElement(header, "geoReference").text = etree.CDATA(frame.proj)
    if version != "1.4":
        etree.SubElement(header, "offset", **numbers(x=0, y=0, z=0, hdg=0))


def _roads(content: Map) -> list[Street | Manoeuvre]:
    return [*content.streets, *content.manoeuvres]


def _ends(content: Map) -> dict[tuple[int, str], int]:
    """Return (road, ``start`` or ``end``) -> the junction there."""
    found = {}
    for m in content.manoeuvres:
        identity = content.junctions[m.junction]
        found[m.entry.number, "end" if m.start.forward else "start"] = identity
        found[m.exit.number, "start" if m.end.forward else "end"] = identity
    return found


def _road(
    root: etree._Element,
    identity: int,
    name: str,
    curve: Curve,
    junction: int,
    content: Map,
    version: str,
) -> etree._Element:
    values = {
        "name": name,
        "length": number(curve.length),
        "id": str(identity),
        "junction": str(junction),
    }
    if version != "1.4":
        values["rule"] = content.hand
    return etree.SubElement(root, "road", **values)


def _type(street: Street, speed: float) -> tuple[str, float]:
    return "motorway" if street.edge.kind.startswith("motorway") else "town", speed


def _shape(
    road: etree._Element,
    curve: Curve,
    elevation: Profile,
    bank: Profile,
    kind: tuple[str, float],
) -> None:
    item = etree.SubElement(road, "type", s="0", type=kind[0])
    # 1.4H has whole numbers here.
    etree.SubElement(item, "speed", max=str(round(kind[1] * 3.6)), unit="km/h")
    view = etree.SubElement(road, "planView")
    for piece, start in zip(curve.pieces, curve.starts, strict=False):
        geometry = etree.SubElement(
            view,
            "geometry",
            **numbers(s=start, x=piece.x, y=piece.y, hdg=piece.heading, length=piece.length),
        )
        if piece.u:
            cubic = {
                letter + axis: number(value)
                for axis, values in (("U", piece.u), ("V", piece.v))
                for letter, value in zip("abcd", values, strict=True)
            }
            etree.SubElement(geometry, "paramPoly3", **cubic, pRange="normalized")
        elif piece.curvature:
            etree.SubElement(geometry, "arc", curvature=number(piece.curvature))
        else:
            etree.SubElement(geometry, "line")
    _profile(etree.SubElement(road, "elevationProfile"), "elevation", elevation)
    if not bank.is_zero:
        _profile(etree.SubElement(road, "lateralProfile"), "superelevation", bank)


def _profile(parent: etree._Element, tag: str, profile: Profile) -> None:
    for start, values in zip(profile.start, profile.abcd, strict=True):
        etree.SubElement(parent, tag, s=number(start), **abcd(values))


def _street_links(road: etree._Element, street: Street, ends: dict[tuple[int, str], int]) -> None:
    """Link a road to its junctions; where it ends at the border of the map there is no link."""
    tags = (("predecessor", "start"), ("successor", "end"))
    found = [(tag, ends[street.number, at]) for tag, at in tags if (street.number, at) in ends]
    if found:
        links = etree.SubElement(road, "link")
        for tag, junction in found:
            etree.SubElement(links, tag, elementType="junction", elementId=str(junction))


def _objects(road: etree._Element, areas: Sequence[Area], version: str) -> None:
    if not areas:
        return
    parent = etree.SubElement(road, "objects")
    for area in areas:
        size = np.ptp(area.corners, axis=0)
        item = etree.SubElement(
            parent,
            "object",
            type=area.kind,
            name=area.name,
            id=str(area.number),
            **numbers(s=area.s, t=0, zOffset=0, hdg=0, pitch=0, roll=0),
            orientation="none",
            **numbers(length=size[0], width=size[1], height=0),
        )
        if version == "1.4":
            outline = etree.SubElement(item, "outline")
        else:
            outline = etree.SubElement(etree.SubElement(item, "outlines"), "outline", id="0")
        # CARLA draws outlines that come back to their first corner.
        for u, v, z in (*area.corners, area.corners[0]):
            etree.SubElement(outline, "cornerLocal", **numbers(u=u, v=v, z=z, height=0))


def _signals(road: etree._Element, signals: Sequence[Signal], version: str) -> None:
    if not signals:
        return
    parent = etree.SubElement(road, "signals")
    for signal in signals:
        item = etree.SubElement(
            parent,
            "signal",
            name="links " + " ".join(map(str, signal.links)),
            id=str(signal.number),
            **numbers(s=signal.s, t=signal.t, zOffset=LIGHTS_M[signal.type]),
            dynamic="yes",
            orientation=signal.orientation,
            country="OpenDRIVE",
            type=signal.type,
            subtype="-1",
            value="-1",
            **numbers(height=0.9, width=0.3, hOffset=0, pitch=0, roll=0),
        )
        for lane in signal.lanes:
            etree.SubElement(item, "validity", fromLane=str(lane), toLane=str(lane))


def _controller(root: etree._Element, controller: Controller) -> None:
    item = etree.SubElement(
        root, "controller", name=controller.program.id, id=str(controller.number), sequence="0"
    )
    for signal in controller.signals:
        etree.SubElement(item, "control", signalId=str(signal), type="0")
    # The standard knows which signals belong together, not when they change.
    phases = ", ".join(f"{number(seconds)} {state}" for seconds, state in controller.program.phases)
    etree.SubElement(item, "userData", code="phases", value=phases)
    etree.SubElement(item, "userData", code="offset", value=number(controller.program.offset))


def _junction(root: etree._Element, junction: str, identity: int, content: Map) -> None:
    item = etree.SubElement(root, "junction", name=junction, id=str(identity))
    mine = [m for m in content.manoeuvres if m.junction == junction]
    for k, manoeuvre in enumerate(mine):
        connection = etree.SubElement(
            item,
            "connection",
            id=str(k),
            incomingRoad=str(manoeuvre.entry.number),
            connectingRoad=str(manoeuvre.number),
            contactPoint="start",
        )
        link = {"from": str(manoeuvre.start.id), "to": str(manoeuvre.side)}
        etree.SubElement(connection, "laneLink", **link)
    for controller in content.furniture.controllers:
        if junction in controller.junctions:
            etree.SubElement(item, "controller", id=str(controller.number), type="0")
