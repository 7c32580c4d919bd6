"""Junctions: connecting roads, and the roads and lanes that they link."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from lxml import etree

from urbantwin.roads.model import Connection, LaneSection, ModelRoad, RoadLink, SectionLane
from urbantwin.roads.opendrive.cubics import value
from urbantwin.roads.opendrive.reading.parsing import Log, Spot

__all__ = ["Node", "Poses", "end_section", "middles", "read_connections", "read_node"]


@dataclass(frozen=True)
class Node:
    """A junction as written, with its connections as XML elements."""

    id: str
    name: str
    kind: str
    connections: tuple[etree._Element, ...]
    controllers: tuple[str, ...]

    @property
    def is_midway(self) -> bool:
        """Return whether it lies along a continuous road: no road ends there."""
        return self.kind in ("virtual", "crossing")


class Poses:
    """Cached poses of the ends of reference lines."""

    def __init__(self) -> None:
        self._known: dict[int, dict[str, tuple[float, float, float]]] = {}

    def at(self, road: ModelRoad, end: str) -> tuple[float, float, float]:
        """Return x, y, heading at the ``start`` or ``end`` of a road."""
        if road.id not in self._known:
            (x0, y0, h0), (x1, y1, h1) = road.curve.at([0.0, road.length]).tolist()
            self._known[road.id] = {"start": (x0, y0, h0), "end": (x1, y1, h1)}
        return self._known[road.id][end]

    def gap(self, road: ModelRoad, end: str, other: ModelRoad, contact: str) -> float:
        """Return the distance between the ends of two reference lines, metres."""
        return math.dist(self.at(road, end)[:2], self.at(other, contact)[:2])

    def nearer(self, road: ModelRoad, end: str, other: ModelRoad) -> str:
        """Return the end of another road that is nearer to an end of a road."""
        return min(("start", "end"), key=lambda contact: self.gap(road, end, other, contact))


def read_node(item: etree._Element) -> Node:
    """Return a junction as written."""
    return Node(
        item.get("id", ""),
        item.get("name") or "",
        item.get("type") or "default",
        tuple(item.findall("connection")),
        tuple(e.get("id", "") for e in item.findall("controller")),
    )


def read_connections(
    node: Node,
    junction: int,
    roads: Mapping[str, ModelRoad],
    by_id: dict[int, ModelRoad],
    poses: Poses,
    log: Log,
    *,
    dropped: Collection[str] = (),
) -> tuple[Connection, ...]:
    """Return the connections of a junction.

    A connecting road without links gets that of its connection, in ``by_id``. In a direct junction
    (1.7 on) the connecting road is the continuation of the other road, without a road between them.

    Args:
        node: the junction as written.
        junction: its id in the model.
        roads: id in the file -> road.
        by_id: id in the model -> road.
        poses: poses of the ends of roads.
        log: remarks on the file.
        dropped: ids of dropped roads, whose connections are dropped too.
    """
    spot = log.at(f"junction {node.id}")
    direct = node.kind == "direct"
    if direct:
        spot.remark("direct junctions: roads are joined there without a road between them")
    connections = []
    for item in node.connections:
        place = spot.within(f"connection {item.get('id', '')}")
        names = _names(item, roads, place, dropped, direct=direct)
        if names is None:
            continue
        incoming, connecting = (by_id[roads[name].id] for name in names)
        contact = item.get("contactPoint", "")
        if contact not in ("start", "end"):
            contact = _contact(incoming, connecting, poses)
        end = (
            _end_at(incoming, junction)
            if direct
            else _incoming_end((incoming, connecting), contact, by_id, poses, place)
        )
        first, second = end_section(incoming, end), end_section(connecting, contact)
        pairs = _lane_links(item, names, (first, second), place)
        if not pairs:
            pairs = _usual_links(first, second, contact)
            place.remark("connections without links of lanes: what lanes say themselves is taken")
        connections.append(Connection(incoming.id, connecting.id, contact, tuple(pairs)))
    if direct:
        return _direct_by_direction(connections, by_id, junction)
    return _by_direction(connections, by_id, spot)


def _by_direction(
    connections: Sequence[Connection], by_id: Mapping[int, ModelRoad], spot: Spot
) -> tuple[Connection, ...]:
    """Return connections with links of incoming lanes only.

    Some tools link both directions of a road through the junction from one side. Outgoing lanes are
    incoming ones at the other end of the road, and are linked there if they are not yet.
    """
    table: dict[tuple[int, int, str], list[tuple[int, int]]] = {}
    for connection in connections:
        road = by_id[connection.connecting]
        section = end_section(road, connection.contact)
        key = (connection.incoming, connection.connecting, connection.contact)
        table.setdefault(key, [])
        for first, second in connection.links:
            if section.by_id[second].forward == (connection.contact == "start"):
                table[key].append((first, second))
                continue
            spot.remark("lanes that are linked where they lead out of the junction")
            other = "end" if connection.contact == "start" else "start"
            link = road.successor if other == "end" else road.predecessor
            lane = _at_other_end(road, second, other)
            if link is None or link.element != "road" or lane is None:
                continue
            before = lane.successor if other == "end" else lane.predecessor
            incoming = end_section(by_id[link.id], link.contact)
            if before is not None and before in incoming.by_id:
                key_there = (link.id, connection.connecting, other)
                table.setdefault(key_there, []).append((before, lane.id))
    return tuple(
        Connection(*key, tuple(dict.fromkeys(links))) for key, links in table.items() if links
    )


def _direct_by_direction(
    connections: Sequence[Connection], by_id: Mapping[int, ModelRoad], junction: int
) -> tuple[Connection, ...]:
    """Return connections of a direct junction, each from the road of its incoming lanes."""
    table: dict[tuple[int, int, str], list[tuple[int, int]]] = {}
    for connection in connections:
        incoming = by_id[connection.incoming]
        end = _end_at(incoming, junction)
        section = end_section(incoming, end)
        for first, second in connection.links:
            if section.by_id[first].forward == (end == "end"):
                key = (connection.incoming, connection.connecting, connection.contact)
                table.setdefault(key, []).append((first, second))
            else:
                key = (connection.connecting, connection.incoming, end)
                table.setdefault(key, []).append((second, first))
    return tuple(Connection(*key, tuple(dict.fromkeys(links))) for key, links in table.items())


def _at_other_end(road: ModelRoad, lane: int, end: str) -> SectionLane | None:
    """Return the continuation of a lane at the other end of its road, through all sections."""
    sections = road.sections if end == "end" else road.sections[::-1]
    for k, section in enumerate(sections):
        section_lane = section.by_id.get(lane)
        if section_lane is None or k == len(sections) - 1:
            return section_lane
        next_lane = section_lane.successor if end == "end" else section_lane.predecessor
        if next_lane is None:
            return None
        lane = next_lane
    return None


def _names(
    item: etree._Element,
    roads: Mapping[str, ModelRoad],
    spot: Spot,
    dropped: Collection[str],
    *,
    direct: bool,
) -> tuple[str, str] | None:
    """Return the ids in the file of the roads of a connection; ``None`` if it is invalid."""
    keys = ("incomingRoad", "linkedRoad" if direct else "connectingRoad")
    first, second = (item.get(key, "") for key in keys)
    if first in dropped or second in dropped:
        return None
    for key, name in zip(keys, (first, second), strict=True):
        if name not in roads:
            spot.drop(f"has the {key} {name}, which does not exist")
            return None
    if first == second:
        spot.drop(f"joins road {first} to itself")
        return None
    return first, second


def _incoming_end(
    roads: tuple[ModelRoad, ModelRoad],
    contact: str,
    by_id: dict[int, ModelRoad],
    poses: Poses,
    spot: Spot,
) -> str:
    """Return the end of the incoming road (the first) at the connecting road."""
    incoming, connecting = roads
    link = connecting.predecessor if contact == "start" else connecting.successor
    if link is not None and link.id == incoming.id and link.element == "road":
        return link.contact
    end = poses.nearer(connecting, contact, incoming)
    if link is None and connecting.junction >= 0:
        spot.remark("roads through junctions without links: they are taken from connections")
        new_link = RoadLink("road", incoming.id, end)
        tag = "predecessor" if contact == "start" else "successor"
        by_id[connecting.id] = with_road_link(connecting, tag, new_link)
    else:
        spot.remark("connections whose road is not linked to the road that comes in")
    return end


def _lane_links(
    item: etree._Element,
    names: tuple[str, str],
    sections: tuple[LaneSection, LaneSection],
    spot: Spot,
) -> list[tuple[int, int]]:
    pairs = []
    for lane_link in item.findall("laneLink"):
        with spot.dropping():
            pair = spot.whole(lane_link, "from"), spot.whole(lane_link, "to")
            if 0 in pair:
                continue  # some tools link the centre lane too
            for lane, section, name in zip(pair, sections, names, strict=True):
                if lane not in section.by_id:
                    raise spot.error(f"links lane {lane} of road {name}, which does not exist")
            pairs.append(pair)
    return pairs


def _usual_links(
    incoming: LaneSection, connecting: LaneSection, contact: str
) -> list[tuple[int, int]]:
    """Return links from the lane links of the connecting road."""
    pairs = []
    for lane in connecting.lanes:
        other = lane.predecessor if contact == "start" else lane.successor
        if other is not None and other in incoming.by_id:
            pairs.append((other, lane.id))
    return pairs


def _contact(incoming: ModelRoad, connecting: ModelRoad, poses: Poses) -> str:
    """Return the end of a connecting road at the incoming one if it is not given."""
    for end, link in (("start", connecting.predecessor), ("end", connecting.successor)):
        if link is not None and link.element == "road" and link.id == incoming.id:
            return end
    return min(
        ("start", "end"),
        key=lambda end: poses.gap(
            connecting, end, incoming, poses.nearer(connecting, end, incoming)
        ),
    )


def _end_at(road: ModelRoad, junction: int) -> str:
    """Return the end of a road that is linked to a junction."""
    for end, link in (("start", road.predecessor), ("end", road.successor)):
        if link is not None and link.element == "junction" and link.id == junction:
            return end
    return "end"


def with_road_link(road: ModelRoad, tag: str, link: RoadLink | None) -> ModelRoad:
    """Return a road with another ``predecessor`` or ``successor``."""
    if tag == "predecessor":
        return replace(road, predecessor=link)
    return replace(road, successor=link)


def end_section(road: ModelRoad, end: str) -> LaneSection:
    """Return the lane section at the start or the end of a road."""
    return road.sections[0 if end == "start" else -1]


def middles(road: ModelRoad, end: str, poses: Poses) -> dict[int, tuple[float, float]]:
    """Return the centres of lanes at one end of a road, by lane id."""
    section = end_section(road, end)
    s = 0.0 if end == "start" else road.length
    x, y, heading = poses.at(road, end)
    level = math.cos(value(road.bank, s))
    left = (-math.sin(heading) * level, math.cos(heading) * level)
    centres = {}
    for sign in (1, -1):
        t = value(road.offset, s)
        for lane in sorted((e for e in section.lanes if e.id * sign > 0), key=lambda e: abs(e.id)):
            width = value(lane.width, s - section.s)
            middle = t + sign * width / 2
            centres[lane.id] = (x + middle * left[0], y + middle * left[1])
            t += sign * width
    return centres
