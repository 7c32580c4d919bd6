"""Lanes of a road as OpenDRIVE writes them: widths, marks, speed limits, access, raised curbs."""

from __future__ import annotations

from collections.abc import Iterable

from lxml import etree

from urbantwin.roads.opendrive.digits import abcd, number, numbers
from urbantwin.roads.streets.manoeuvre import Manoeuvre
from urbantwin.roads.streets.street import Street, Strip

__all__ = ["CURB_M", "connecting_lane", "street_lanes"]

#: Height of a raised sidewalk over the carriageway, metres.
CURB_M = 0.15
#: Width of painted lines, metres (US MUTCD 3A.06: 4 to 6 inches).
LINE_M = 0.12
LANE_TYPES = {
    "1.8": {"driving": "driving", "bus": "bus", "bicycle": "biking", "sidewalk": "sidewalk"},
    # 1.4 has no lanes for buses only.
    "1.4": {"driving": "driving", "bus": "driving", "bicycle": "biking", "sidewalk": "sidewalk"},
}


def street_lanes(lanes: etree._Element, street: Street, version: str) -> None:
    """Write the lanes of a road outside junctions, from left to right."""
    section = etree.SubElement(lanes, "laneSection", s="0")
    left = [strip for strip in street.strips if strip.id > 0]
    right = [strip for strip in street.strips if strip.id < 0]
    if left:
        _side(etree.SubElement(section, "left"), left, street, version)
    _centre(section, *_middle_mark(street))
    if right:
        _side(etree.SubElement(section, "right"), right, street, version)


def connecting_lane(lanes: etree._Element, manoeuvre: Manoeuvre, version: str) -> None:
    """Write the one lane of a connecting road; the reference line runs in its middle."""
    side, length = manoeuvre.side, manoeuvre.curve.length
    first, last = manoeuvre.start.lane.width, manoeuvre.end.lane.width
    grow = last - first
    width = (first, 0.0, 3 * grow / length**2, -2 * grow / length**3)
    offset = [-side * value / 2 for value in width]
    etree.SubElement(lanes, "laneOffset", s="0", **abcd(offset))
    section = etree.SubElement(lanes, "laneSection", s="0")
    if side < 0:
        _centre(section, "none", "none")
    parent = etree.SubElement(section, "left" if side > 0 else "right")
    lane = _lane(parent, side, manoeuvre.kind, version)
    link = etree.SubElement(lane, "link")
    etree.SubElement(link, "predecessor", id=str(manoeuvre.start.id))
    etree.SubElement(link, "successor", id=str(manoeuvre.end.id))
    etree.SubElement(lane, "width", sOffset="0", **abcd(width))
    _mark(lane, "none", "none")
    _rules(lane, manoeuvre.kind, manoeuvre.speed_limit, version)
    if side > 0:
        _centre(section, "none", "none")


def _side(parent: etree._Element, strips: Iterable[Strip], street: Street, version: str) -> None:
    for strip in strips:
        lane = _lane(parent, strip.id, strip.lane.kind, version)
        etree.SubElement(lane, "width", sOffset="0", **abcd((strip.lane.width, 0, 0, 0)))
        _mark(lane, *_outer_mark(street, strip))
        _rules(lane, strip.lane.kind, strip.lane.speed_limit, version)


def _lane(parent: etree._Element, identity: int, kind: str, version: str) -> etree._Element:
    return etree.SubElement(
        parent, "lane", id=str(identity), type=LANE_TYPES[version][kind], level="false"
    )


def _centre(section: etree._Element, mark: str, change: str) -> None:
    lane = etree.SubElement(
        etree.SubElement(section, "center"), "lane", id="0", type="none", level="false"
    )
    _mark(lane, mark, change)


def _mark(lane: etree._Element, kind: str, change: str) -> None:
    etree.SubElement(
        lane,
        "roadMark",
        sOffset="0",
        type=kind,
        weight="standard",
        color="standard",
        width=number(0 if kind in ("none", "curb") else LINE_M),
        laneChange=change,
    )


def _middle_mark(street: Street) -> tuple[str, str]:
    """Two ways: broken where there is one lane each way, else solid. One way: the edge's."""
    if not street.is_two_way:
        first = min(street.strips, key=lambda strip: abs(strip.id))
        return ("none" if first.lane.kind == "sidewalk" else "solid"), "none"
    driven = [strip for strip in street.strips if strip.lane.kind in ("driving", "bus")]
    return ("solid" if len(driven) > 2 else "broken"), "none"


def _outer_mark(street: Street, strip: Strip) -> tuple[str, str]:
    """Return the mark on the border away from the reference line, and who may change lanes."""
    outer = next((s for s in street.strips if s.id == strip.id + (1 if strip.id > 0 else -1)), None)
    kinds = {strip.lane.kind, outer.lane.kind if outer else "none"}
    if "sidewalk" in kinds:
        return ("none" if "none" in kinds else "curb"), "none"
    if kinds == {"driving"}:
        return "broken", "both"
    return "solid", "none"


def _rules(lane: etree._Element, kind: str, speed: float, version: str) -> None:
    if kind != "sidewalk":
        etree.SubElement(lane, "speed", sOffset="0", max=number(round(speed, 3)), unit="m/s")
    if kind == "bus" and version != "1.4":
        access = etree.SubElement(lane, "access", sOffset="0", rule="allow")
        etree.SubElement(access, "restriction", type="bus")
    if kind == "sidewalk":
        etree.SubElement(lane, "height", **numbers(sOffset=0, inner=CURB_M, outer=CURB_M))
