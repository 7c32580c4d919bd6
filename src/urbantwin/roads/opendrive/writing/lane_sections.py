"""Lane sections: links, widths, marks, speeds, access, raised lanes."""

from __future__ import annotations

from dataclasses import dataclass

from lxml import etree

from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, Profile, SectionLane
from urbantwin.roads.opendrive.vocabulary import (
    ACCESS,
    DRIVEN,
    KIND_OF_TYPE,
    LANE_TYPES,
    usual_users,
)
from urbantwin.roads.opendrive.writing.number_format import abcd, number, numbers, records

__all__ = ["lane_links", "write_lanes"]

#: Width of painted lines, metres (US MUTCD 3A.06: 4 to 6 inches).
LINE_M = 0.12
#: A narrower lane at the end of a section is not linked there, metres (ASAM's rules
#: ``road.lane.link.zero_width_at_start`` and ``new_lane_appear``).
NO_WIDTH_M = 1e-5


@dataclass(frozen=True)
class _SectionPlace:
    """A lane section of a road within the map."""

    model: LaneModel
    road: ModelRoad
    index: int
    version: str

    @property
    def section(self) -> LaneSection:
        return self.road.sections[self.index]

    @property
    def length(self) -> float:
        return self.road.section_ends[self.index] - self.section.s


def write_lanes(road_item: etree._Element, model: LaneModel, road: ModelRoad, version: str) -> None:
    """Write ``<lanes>`` of a road.

    Args:
        road_item: the ``<road>``.
        model: the map, for links between lanes.
        road: the road.
        version: ``1.8`` or ``1.4``.
    """
    lanes = etree.SubElement(road_item, "lanes")
    if not _is_zero(road.offset):
        for start, row in records(road.offset, road.length):
            etree.SubElement(lanes, "laneOffset", s=number(start), **abcd(row))
    for index, section in enumerate(road.sections):
        place = _SectionPlace(model, road, index, version)
        item = etree.SubElement(lanes, "laneSection", s=number(section.s))
        ordered = sorted(section.lanes, key=lambda lane: -lane.id)
        for side, group in (
            ("left", [lane for lane in ordered if lane.id > 0]),
            ("center", None),
            ("right", [lane for lane in ordered if lane.id < 0]),
        ):
            if group is None:
                centre = etree.SubElement(
                    etree.SubElement(item, side), "lane", id="0", type="none", level="false"
                )
                _mark(centre, section.centre_mark, section.centre_change)
            elif group:
                parent = etree.SubElement(item, side)
                for lane in group:
                    _lane(parent, lane, place)


def lane_links(
    incoming: ModelRoad, connecting: ModelRoad, contact: str
) -> dict[tuple[int, int], bool]:
    """Return which pairs of lanes of two roads at a junction have a width there.

    Args:
        incoming: the road that leads to the junction.
        connecting: the road through the junction.
        contact: end of the connecting road at the incoming one.

    Returns:
        (lane of the incoming road, lane of the connecting road) -> whether both are open.
    """
    link = connecting.predecessor if contact == "start" else connecting.successor
    end = link.contact if link is not None and link.id == incoming.id else ""
    widths = _widths(connecting, contact)
    incoming_widths = _widths(incoming, end) if end else {}
    return {
        (a, b): width > NO_WIDTH_M and other > NO_WIDTH_M
        for a, other in incoming_widths.items()
        for b, width in widths.items()
    }


def _is_zero(profile: Profile) -> bool:
    return not profile.abcd.any()


def _lane(parent: etree._Element, lane: SectionLane, place: _SectionPlace) -> None:
    # "A lane on which cars should not drive": lanes closed to all classes.
    is_closed = lane.kind in DRIVEN and not lane.allowed
    kind = "restricted" if is_closed else LANE_TYPES[place.version][lane.kind]
    item = etree.SubElement(parent, "lane", id=str(lane.id), type=kind, level="false")
    along = (lane.id < 0) == (place.model.driving_side == "right")
    reversed_ = lane.kind in DRIVEN and lane.forward != along
    direction = "both" if lane.opposite else "reversed" if reversed_ else ""
    if direction and place.version != "1.4":
        item.set("direction", direction)
    _links(item, lane, place)
    for start, row in records(lane.width, place.length):
        etree.SubElement(item, "width", sOffset=number(start), **abcd(row))
    _mark(item, lane.mark, lane.change)
    if lane.speed_limit > 0 and lane.kind in DRIVEN:
        etree.SubElement(
            item, "speed", sOffset="0", max=number(round(lane.speed_limit, 3)), unit="m/s"
        )
    users = tuple(ACCESS) if is_closed else lane.allowed
    if place.version != "1.4" and users and set(lane.allowed) != set(usual_users(lane.kind)):
        rule = "deny" if is_closed else "allow"
        access = etree.SubElement(item, "access", sOffset="0", rule=rule)
        for name in users:
            etree.SubElement(access, "restriction", type=ACCESS[name])
    if lane.height:
        etree.SubElement(item, "height", **numbers(sOffset=0, inner=lane.height, outer=lane.height))
    if KIND_OF_TYPE[kind] != lane.kind:
        etree.SubElement(item, "userData", code="kind", value=lane.kind)
    if lane.parking:
        etree.SubElement(item, "userData", code="parking", value=lane.parking)
    if direction and place.version == "1.4":
        etree.SubElement(item, "userData", code="direction", value=direction)


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


def _links(item: etree._Element, lane: SectionLane, place: _SectionPlace) -> None:
    linked = {
        tag: lane_id
        for tag, lane_id in (
            ("predecessor", _linked(lane, place, ahead=False)),
            ("successor", _linked(lane, place, ahead=True)),
        )
        if lane_id is not None
    }
    if linked:
        links = etree.SubElement(item, "link")
        for tag, lane_id in linked.items():
            etree.SubElement(links, tag, id=str(lane_id))


def _linked(lane: SectionLane, place: _SectionPlace, *, ahead: bool) -> int | None:
    """Return the id of the continuing lane if both have a width and both links agree."""
    other = lane.successor if ahead else lane.predecessor
    if other is None:
        return None
    road, index = place.road, place.index
    within = float(lane.width.at(place.length if ahead else 0.0)[0])
    inner = index + (1 if ahead else -1)
    mutual = True
    if 0 <= inner < len(road.sections):
        section, end = road.sections[inner], "start" if ahead else "end"
        extent = road.section_ends[inner] - section.s
    else:
        link = road.successor if ahead else road.predecessor
        if link is None or link.element != "road" or link.id not in place.model.road_by_id:
            return None
        other_road = place.model.road_by_id[link.id]
        end = link.contact
        section = other_road.sections[0 if end == "start" else -1]
        extent = other_road.section_ends[0 if end == "start" else -1] - section.s
        # Ends of streets at a junction have no links.
        mutual = road.junction == other_road.junction
    partner = section.by_id.get(other)
    if partner is None:
        return None
    beyond = float(partner.width.at(0.0 if end == "start" else extent)[0])
    back = partner.predecessor if end == "start" else partner.successor
    if min(within, beyond) <= NO_WIDTH_M or (mutual and back != lane.id):
        return None
    return other


def _widths(road: ModelRoad, end: str) -> dict[int, float]:
    """Return the width of each lane at one end of a road, metres."""
    index = 0 if end == "start" else -1
    section = road.sections[index]
    station_m = 0.0 if end == "start" else road.section_ends[index] - section.s
    return {lane.id: float(lane.width.at(station_m)[0]) for lane in section.lanes}
