"""Resolution and checks of the links of roads and lanes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from lxml import etree

from urbantwin.roads.model import LaneSection, ModelJunction, ModelRoad, RoadLink, SectionLane
from urbantwin.roads.opendrive.reading.inferred_links import with_inferred_ends, with_inferred_lanes
from urbantwin.roads.opendrive.reading.junctions import (
    Node,
    Poses,
    end_section,
    middles,
    read_connections,
)
from urbantwin.roads.opendrive.reading.lane_sections import with_lane_links
from urbantwin.roads.opendrive.reading.parsing import Log, Spot, id_number
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["Joined", "Link", "joined", "read_links"]

#: Maximum distance between the ends of a road that is its own predecessor or successor, metres.
RING_M = 1.0
#: Distance between the ends of linked lanes above which they are reported, metres.
APART_M = 0.1
_END = {"predecessor": "start", "successor": "end"}


@dataclass(frozen=True)
class Link:
    """A link of a road as written.

    Attributes:
        element: ``road`` or ``junction``.
        id: its id in the file.
        contact: end of the other road, as written.
        midway: whether it is beside the other road, not at its end.
    """

    element: str
    id: str
    contact: str
    midway: bool


@dataclass(frozen=True)
class Joined:
    """Linked roads and junctions; ``programs`` maps controllers to junctions."""

    roads: tuple[ModelRoad, ...]
    junctions: tuple[ModelJunction, ...]
    programs: Mapping[str, tuple[int, ...]]


def read_links(road: etree._Element, spot: Spot) -> dict[str, Link]:
    """Return ``predecessor`` and ``successor`` of a road as written."""
    links = {}
    for tag in _END:
        item = road.find(f"link/{tag}")
        if item is not None:
            with spot.dropping():
                link = _read_link(item, tag, spot)
                if link is not None:
                    links[tag] = link
    return links


def _read_link(item: etree._Element, tag: str, spot: Spot) -> Link | None:
    element, identity = item.get("elementType", "road"), item.get("elementId")
    if element not in ("road", "junction"):
        raise spot.error(f"has a {tag} of the type {element[:20]!r}", expected="road or junction")
    if not identity:
        raise spot.error(f"has a {tag} without elementId", expected="an id")
    if identity == "-1":
        spot.remark("links to -1, which lead nowhere")
        return None
    midway = item.get("elementS") is not None
    return Link(element, identity, item.get("contactPoint", ""), midway)


def joined(
    roads: Mapping[str, ModelRoad],
    links: Mapping[str, Mapping[str, Link]],
    inside: Mapping[str, str],
    nodes: Mapping[str, Node],
    log: Log,
    *,
    dropped: Collection[str] = (),
) -> Joined:
    """Link roads and junctions; links to missing elements are dropped and reported.

    Args:
        roads: id in the file -> road, with its id in the model and lane links as written.
        links: id in the file -> links as written.
        inside: id in the file -> junction of the road, as written.
        nodes: id in the file -> junction as written.
        log: remarks on the file.
        dropped: ids of dropped roads: links to them are dropped without another remark.
    """
    number = _numbers(nodes)
    poses = Poses()
    for key, node in nodes.items():
        if node.is_midway:
            log.at(f"junction {key}").remark(
                "virtual junctions and crossings: nothing turns off there"
            )
    linked_roads: dict[str, ModelRoad] = {}
    for key, road in roads.items():
        spot = log.at(f"road {key}")
        junction = inside[key]
        if junction != "-1" and junction not in nodes:
            spot.drop(f"leads through junction {junction}, which does not exist")
        ends: dict[str, RoadLink | None] = {}
        for tag, link in links[key].items():
            if link.element == "road" and link.id in dropped:
                continue
            with spot.dropping():
                ends[tag] = (
                    _junction_link(tag, link, nodes, number, spot)
                    if link.element == "junction"
                    else _road_link(tag, link, key, roads, poses, spot)
                )
        in_junction = junction in nodes and not nodes[junction].is_midway
        linked_roads[key] = replace(
            road,
            junction=number[junction] if in_junction else -1,
            predecessor=ends.get("predecessor"),
            successor=ends.get("successor"),
        )
    by_id = {road.id: road for road in linked_roads.values()}
    junctions = []
    programs: dict[str, list[int]] = {}
    for key, node in nodes.items():
        for controller in node.controllers:
            programs.setdefault(controller, []).append(number[key])
        if not node.is_midway:
            connections = read_connections(
                node, number[key], linked_roads, by_id, poses, log, dropped=dropped
            )
            junctions.append(ModelJunction(number[key], node.name, connections))
    spots = {road.id: log.at(f"road {key}") for key, road in linked_roads.items()}
    with_inferred_ends(by_id, junctions, poses, spots)
    junctions = [_without_dropped_roads(junction, by_id) for junction in junctions]
    by_id = {key: _linked_to(road, by_id) for key, road in by_id.items()}
    final = [_linked_lanes(road, by_id, poses, spots[road.id]) for road in by_id.values()]
    switched = {key: tuple(junction_ids) for key, junction_ids in programs.items()}
    return Joined(tuple(final), tuple(junctions), switched)


def _numbers(nodes: Mapping[str, Node]) -> dict[str, int]:
    """Return ids in the model: those of the file if all are whole numbers, else new ones."""
    written_ids = {key: id_number(key) for key in nodes}
    numbers = {key: value for key, value in written_ids.items() if value is not None}
    if len(set(numbers.values())) == len(nodes):
        return numbers
    return {key: k for k, key in enumerate(nodes)}


def _junction_link(
    tag: str, link: Link, nodes: Mapping[str, Node], number: Mapping[str, int], spot: Spot
) -> RoadLink | None:
    if link.id not in nodes:
        raise spot.error(f"has the {tag} junction {link.id}, which does not exist")
    return None if nodes[link.id].is_midway else RoadLink("junction", number[link.id])


def _road_link(
    tag: str,
    link: Link,
    key: str,
    roads: Mapping[str, ModelRoad],
    poses: Poses,
    spot: Spot,
) -> RoadLink | None:
    if link.id not in roads:
        raise spot.error(f"has the {tag} road {link.id}, which does not exist")
    if link.midway:
        spot.remark("roads that begin or end beside another: they are not joined to it")
        return None
    own_road, other = roads[key], roads[link.id]
    contact = link.contact
    if link.id == key:
        contact = "end" if tag == "predecessor" else "start"
        if poses.gap(own_road, _END[tag], own_road, contact) > RING_M:
            raise spot.error(
                f"is its own {tag}", expected="another road, or an end that meets its start"
            )
    if contact not in ("start", "end", ""):
        raise spot.error(
            f"meets its {tag} at {contact[:20]!r}", expected="contactPoint start or end"
        )
    if not contact:
        spot.remark("links without a contact point: the nearer end is taken")
        contact = poses.nearer(own_road, _END[tag], other)
    return RoadLink("road", other.id, contact)


def _linked_lanes(
    road: ModelRoad, by_id: Mapping[int, ModelRoad], poses: Poses, spot: Spot
) -> ModelRoad:
    """Return a road with valid lane links only, and without any at a junction."""
    sections = list(road.sections)
    wrong: set[tuple[int, str, int]] = set()
    for k in range(len(sections)):
        for tag in _END:
            sections[k], invalid = _with_checked_links(road, sections[k], k, tag, by_id, spot)
            wrong |= {(k, tag, lane) for lane in invalid}
    linked = replace(road, sections=tuple(sections))
    linked = with_inferred_lanes(linked, by_id, poses, spot, wrong=wrong)
    for end, link in (("start", road.predecessor), ("end", road.successor)):
        if link is not None and link.element == "road":
            other = by_id[link.id]
            if _largest_gap(linked, end, other, link.contact, poses) > APART_M:
                spot.remark(f"linked lanes that end more than {APART_M:g} m apart")
    return linked


def _largest_gap(road: ModelRoad, end: str, other: ModelRoad, contact: str, poses: Poses) -> float:
    """Return the maximum distance between linked lanes at the end of two roads, metres."""
    pairs = [
        (lane.id, target)
        for lane in end_section(road, end).lanes
        if (target := lane.predecessor if end == "start" else lane.successor) is not None
    ]
    if not pairs:
        return 0.0
    places, places_other = middles(road, end, poses), middles(other, contact, poses)
    return max(math.dist(places[a], places_other[b]) for a, b in pairs)


def _next_section(
    road: ModelRoad, k: int, by_id: Mapping[int, ModelRoad], *, ahead: bool
) -> tuple[LaneSection | None, bool]:
    """Return the adjacent lane section, and whether its stations run in the same direction."""
    inner = k + (1 if ahead else -1)
    if 0 <= inner < len(road.sections):
        return road.sections[inner], True
    link = road.successor if ahead else road.predecessor
    if link is None or link.element != "road":
        return None, True
    return end_section(by_id[link.id], link.contact), (link.contact == "start") == ahead


def _with_checked_links(
    road: ModelRoad,
    section: LaneSection,
    k: int,
    tag: str,
    by_id: Mapping[int, ModelRoad],
    spot: Spot,
) -> tuple[LaneSection, set[int]]:
    """Return the k-th section without invalid links of one kind, and the lanes that had them.

    A link is invalid if its lane does not exist or has traffic in the opposite direction.
    """
    beyond, same_direction = _next_section(road, k, by_id, ahead=tag == "successor")
    invalid: set[int] = set()

    def checked(lane: SectionLane, link: int | None) -> int | None:
        if link is None or beyond is None:
            return None
        target = beyond.by_id.get(link)
        if target is None:
            problem = "which does not exist"
        elif {lane.kind, target.kind} <= set(DRIVEN) and (
            lane.forward == target.forward
        ) != same_direction:
            problem = "on which traffic runs the other way"
        else:
            return link
        lane_spot = spot.within(f"lane section at s = {section.s:g}, lane {lane.id}")
        lane_spot.drop(f"has the {tag} lane {link}, {problem}")
        invalid.add(lane.id)
        return None

    return with_lane_links(section, tag, checked), invalid


def _linked_to(road: ModelRoad, by_id: Mapping[int, ModelRoad]) -> ModelRoad:
    """Return a road without links to dropped roads."""
    before, after = (
        None if link is not None and link.element == "road" and link.id not in by_id else link
        for link in (road.predecessor, road.successor)
    )
    return replace(road, predecessor=before, successor=after)


def _without_dropped_roads(
    junction: ModelJunction, by_id: Mapping[int, ModelRoad]
) -> ModelJunction:
    """Return a junction without connections of dropped roads."""
    links = tuple(e for e in junction.connections if e.incoming in by_id and e.connecting in by_id)
    return replace(junction, connections=links)
