"""Resolving and checking the links of roads and lanes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from lxml import etree

from urbantwin.roads.model import LaneSection, ModelJunction, ModelRoad, RoadLink
from urbantwin.roads.opendrive.reading.inferred_links import with_inferred_ends, with_inferred_lanes
from urbantwin.roads.opendrive.reading.junctions import Node, read_connections
from urbantwin.roads.opendrive.reading.parsing import Log, Spot, id_number
from urbantwin.roads.opendrive.reading.road_ends import Poses, end_section, middles

__all__ = ["Joined", "Link", "joined", "read_links"]

#: A road that goes on as itself must come back to within this distance, metres.
RING_M = 1.0
#: Linked lanes whose ends lie further apart are remarked, metres.
APART_M = 0.1
_END = {"predecessor": "start", "successor": "end"}


@dataclass(frozen=True)
class Link:
    """A link of a road as written.

    Attributes:
        element: ``road`` or ``junction``.
        id: its id in the file.
        contact: which end of the other road, as written.
        midway: whether it is beside the other road, not at an end of it.
    """

    element: str
    id: str
    contact: str
    midway: bool


@dataclass(frozen=True)
class Joined:
    """Roads and junctions that are joined; ``programs`` are controllers -> junctions."""

    roads: tuple[ModelRoad, ...]
    junctions: tuple[ModelJunction, ...]
    programs: Mapping[str, tuple[int, ...]]


def read_links(road: etree._Element, spot: Spot) -> dict[str, Link]:
    """Return ``predecessor`` and ``successor`` of a road as written.

    Raises:
        InputError: a link leads to nothing that roads are linked to.
    """
    found = {}
    for tag in _END:
        item = road.find(f"link/{tag}")
        if item is None:
            continue
        element, identity = item.get("elementType", "road"), item.get("elementId")
        if element not in ("road", "junction"):
            raise spot.error(
                f"has a {tag} of the type {element[:20]!r}", expected="road or junction"
            )
        if not identity:
            raise spot.error(f"has a {tag} without elementId", expected="an id")
        if identity == "-1":
            spot.remark("links to -1, which lead nowhere")
            continue
        midway = item.get("elementS") is not None
        found[tag] = Link(element, identity, item.get("contactPoint", ""), midway)
    return found


def joined(
    roads: Mapping[str, ModelRoad],
    links: Mapping[str, Mapping[str, Link]],
    inside: Mapping[str, str],
    nodes: Mapping[str, Node],
    log: Log,
) -> Joined:
    """Join roads and junctions.

    Args:
        roads: id in the file -> road, with its id in the model, links of lanes as written.
        links: id in the file -> links as written.
        inside: id in the file -> the junction that the road leads through, as written.
        nodes: id in the file -> junction as written.
        log: the file.

    Raises:
        InputError: something that is linked does not exist, or a road is linked to itself.
    """
    number = _numbers(nodes)
    poses = Poses()
    for key, node in nodes.items():
        if node.is_midway:
            log.at(f"junction {key}").remark(
                "virtual junctions and crossings: nothing turns off there"
            )
    found: dict[str, ModelRoad] = {}
    for key, road in roads.items():
        spot = log.at(f"road {key}")
        junction = inside[key]
        if junction != "-1" and junction not in nodes:
            raise spot.error(f"leads through junction {junction}, which does not exist")
        ends = {
            tag: (
                _junction_link(tag, link, nodes, number, spot)
                if link.element == "junction"
                else _road_link(tag, link, key, roads, poses, spot)
            )
            for tag, link in links[key].items()
        }
        through = junction in nodes and not nodes[junction].is_midway
        found[key] = replace(
            road,
            junction=number[junction] if through else -1,
            predecessor=ends.get("predecessor"),
            successor=ends.get("successor"),
        )
    by_id = {road.id: road for road in found.values()}
    junctions = []
    programs: dict[str, list[int]] = {}
    for key, node in nodes.items():
        for controller in node.controllers:
            programs.setdefault(controller, []).append(number[key])
        if not node.is_midway:
            connections = read_connections(node, number[key], found, by_id, poses, log)
            junctions.append(ModelJunction(number[key], node.name, connections))
    spots = {road.id: log.at(f"road {key}") for key, road in found.items()}
    with_inferred_ends(by_id, junctions, poses, spots)
    final = [_linked_lanes(road, by_id, poses, spots[road.id]) for road in by_id.values()]
    switched = {key: tuple(where) for key, where in programs.items()}
    return Joined(tuple(final), tuple(junctions), switched)


def _numbers(nodes: Mapping[str, Node]) -> dict[str, int]:
    """Return ids in the model: the file's if all are whole numbers."""
    whole = {key: id_number(key) for key in nodes}
    known = {key: value for key, value in whole.items() if value is not None}
    if len(set(known.values())) == len(nodes):
        return known
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
    mine, other = roads[key], roads[link.id]
    contact = link.contact
    if link.id == key:
        contact = "end" if tag == "predecessor" else "start"
        if poses.gap(mine, _END[tag], mine, contact) > RING_M:
            raise spot.error(
                f"is its own {tag}", expected="another road, or an end that meets its start"
            )
    if contact not in ("start", "end", ""):
        raise spot.error(
            f"meets its {tag} at {contact[:20]!r}", expected="contactPoint start or end"
        )
    if not contact:
        spot.remark("links without a contact point: the nearer end is taken")
        contact = poses.nearer(mine, _END[tag], other)
    return RoadLink("road", other.id, contact)


def _linked_lanes(
    road: ModelRoad, by_id: Mapping[int, ModelRoad], poses: Poses, spot: Spot
) -> ModelRoad:
    """Return a road whose links of lanes lead to lanes that exist, or nowhere at a junction."""
    sections = []
    for k, section in enumerate(road.sections):
        before = _beyond(road, k, by_id, ahead=False)
        after = _beyond(road, k, by_id, ahead=True)
        lanes = tuple(
            replace(
                lane,
                predecessor=_checked(lane.id, "predecessor", lane.predecessor, before, spot),
                successor=_checked(lane.id, "successor", lane.successor, after, spot),
            )
            for lane in section.lanes
        )
        sections.append(replace(section, lanes=lanes))
    linked = with_inferred_lanes(replace(road, sections=tuple(sections)), by_id, poses, spot)
    for end, link in (("start", road.predecessor), ("end", road.successor)):
        if link is not None and link.element == "road":
            there = by_id[link.id]
            if _apart(linked, end, there, link.contact, poses) > APART_M:
                spot.remark(f"linked lanes that end more than {APART_M:g} m apart")
    return linked


def _apart(road: ModelRoad, end: str, other: ModelRoad, contact: str, poses: Poses) -> float:
    """Return how far linked lanes of two roads lie apart where the roads meet, metres."""
    pairs = [
        (lane.id, there)
        for lane in end_section(road, end).lanes
        if (there := lane.predecessor if end == "start" else lane.successor) is not None
    ]
    if not pairs:
        return 0.0
    mine, theirs = middles(road, end, poses), middles(other, contact, poses)
    return max(math.dist(mine[a], theirs[b]) for a, b in pairs)


def _beyond(
    road: ModelRoad, k: int, by_id: Mapping[int, ModelRoad], *, ahead: bool
) -> LaneSection | None:
    inner = k + (1 if ahead else -1)
    if 0 <= inner < len(road.sections):
        return road.sections[inner]
    link = road.successor if ahead else road.predecessor
    if link is None or link.element != "road":
        return None
    return end_section(by_id[link.id], link.contact)


def _checked(
    lane: int, tag: str, other: int | None, beyond: LaneSection | None, spot: Spot
) -> int | None:
    if other is None or beyond is None:
        return None
    if other not in beyond.by_id:
        raise spot.within(f"lane {lane}").error(f"has the {tag} lane {other}, which does not exist")
    return other
