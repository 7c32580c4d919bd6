"""Lane links: between sections, between roads, and through junctions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from urbantwin.roads.imported.edges import Edge, linked
from urbantwin.roads.model import LaneModel, ModelJunction, ModelRoad, RoadLink, SectionLane

__all__ = ["VEHICLE_CLASSES", "LaneLink", "Lanes", "allowed", "lane_links", "speed"]

#: Maximum distance between the ends of lanes that are linked without a link in the map, metres.
MEET_M = 1.0
#: Road id, index of the section, lane id.
Place = tuple[int, int, int]
#: Vehicle classes of SUMO per class of actors, including similar ones.
VEHICLE_CLASSES = {
    "car": "passenger private emergency authority army vip hov taxi custom1 custom2 evehicle",
    "truck": "truck trailer delivery",
    "bus": "bus coach",
    "motorcycle": "motorcycle moped",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
#: Default users of a lane, by its kind.
USUAL = {
    "driving": ("car", "truck", "bus", "motorcycle", "bicycle"),
    "bus": ("bus", "bicycle"),
    "bicycle": ("bicycle",),
    "sidewalk": ("pedestrian",),
}
#: Default speed limits in towns, of bicycles and of pedestrians, m/s.
TOWN_MS, BICYCLE_MS, WALKING_MS = 50 / 3.6, 25 / 3.6, 1.39
#: Maximum speed limit of streets with bicycles on the carriageway, m/s.
FAST_MS = 75 / 3.6


@dataclass(frozen=True)
class LaneLink:
    """A link from the end of one lane to the start of another.

    Attributes:
        start: edge and index of the lane that it leaves.
        end: edge and index of the lane that it leads to.
        path: the lanes in between, inside a junction, in the order of travel; empty if the two
            lanes are adjacent.
    """

    start: tuple[Edge, int]
    end: tuple[Edge, int]
    path: tuple[Place, ...] = ()


class Lanes:
    """The lanes of all edges, by their place in the model."""

    def __init__(self, model: LaneModel, edges: tuple[Edge, ...]) -> None:
        self.model, self.edges = model, edges
        self.at: dict[Place, tuple[Edge, int]] = {
            (edge.road.id, number, lane[k]): (edge, index)
            for edge in edges
            for index, lane in enumerate(edge.lanes)
            for k, number in enumerate(edge.sections)
        }

    def at_end(self, road: int, end: str, lane: int) -> tuple[Edge, int] | None:
        """Return the edge and lane index of a road's lane at its start or end; ``None`` if none."""
        model_road = self.model.road_by_id.get(road)
        number = 0 if end == "start" or model_road is None else len(model_road.sections) - 1
        return self.at.get((road, number, lane))


def lane_links(lanes: Lanes) -> list[LaneLink]:
    """Return all links between edge lanes, one per pair, except those of pedestrians.

    Pedestrians use walking areas and crossings, which netconvert makes.
    """
    by_strips: dict[tuple[str, str], LaneLink] = {}
    model = lanes.model
    every = [_links_within(lanes, road) for road in model.roads if road.junction < 0]
    every += [_links_between(lanes, road) for road in model.roads if road.junction < 0]
    every += [_links_through(lanes, junction) for junction in model.junctions]
    for links in every:
        for link in links:
            (start, i), (end, j) = link.start, link.end
            if "sidewalk" not in (start.lane(i).kind, end.lane(j).kind):
                by_strips.setdefault((start.strip(i), end.strip(j)), link)
    for further_links in (_from_bicycle_lanes, _to_bicycles):
        for link in list(further_links(lanes.edges, list(by_strips.values()))):
            (start, i), (end, j) = link.start, link.end
            by_strips.setdefault((start.strip(i), end.strip(j)), link)
    return list(by_strips.values())


def _from_bicycle_lanes(edges: tuple[Edge, ...], links: list[LaneLink]) -> Iterator[LaneLink]:
    """Yield links for bicycle lanes without any: maps draw them up to a junction, not through it.

    Bicycles follow the adjacent traffic, onto a bicycle lane if there is one.
    """
    onward: dict[str, list[LaneLink]] = defaultdict(list)
    for link in links:
        onward[link.start[0].strip(link.start[1])].append(link)
    for edge in edges:
        going = [index for index in range(len(edge.lanes)) if onward[edge.strip(index)]]
        for index in range(len(edge.lanes)):
            if not going or index in going or edge.lane(index, -1).kind != "bicycle":
                continue
            beside = min(going, key=lambda other: (abs(other - index), other))
            for link in onward[edge.strip(beside)]:
                end, lane = link.end
                cycle_lanes = [k for k in range(len(end.lanes)) if end.lane(k).kind == "bicycle"]
                yield LaneLink((edge, index), (end, cycle_lanes[0] if cycle_lanes else lane))


def _to_bicycles(edges: tuple[Edge, ...], links: list[LaneLink]) -> Iterator[LaneLink]:
    """Yield links to bicycle lanes that begin after a junction, from lanes open to bicycles."""
    reached = {link.end[0].strip(link.end[1]) for link in links}
    into: dict[str, list[LaneLink]] = defaultdict(list)
    for link in links:
        into[link.end[0].id].append(link)
    for edge in edges:
        for index in range(len(edge.lanes)):
            if edge.lane(index).kind != "bicycle" or edge.strip(index) in reached:
                continue
            come: dict[str, tuple[Edge, int]] = {}
            for link in into[edge.id]:
                start, i = link.start
                ridden = "bicycle" in allowed(start.lane(i, -1))
                if ridden and i <= come.get(start.id, (start, i))[1]:
                    come[start.id] = (start, i)
            yield from (LaneLink(lane, (edge, index)) for lane in come.values())


def _links_within(lanes: Lanes, road: ModelRoad) -> Iterator[LaneLink]:
    """Yield links between the edges of one road."""
    for number in range(1, len(road.sections)):
        for before in road.sections[number - 1].lanes:
            for after in road.sections[number].lanes:
                a = lanes.at.get((road.id, number - 1, before.id))
                b = lanes.at.get((road.id, number, after.id))
                if a and b and a[0] is not b[0] and linked(before, after):
                    if before.forward and after.forward:
                        yield LaneLink(a, b)
                    elif not before.forward and not after.forward:
                        yield LaneLink(b, a)


def _links_between(lanes: Lanes, road: ModelRoad) -> Iterator[LaneLink]:
    """Yield links from a road to the roads linked to it without a junction."""
    for end, link in (("start", road.predecessor), ("end", road.successor)):
        if link is None or link.element != "road":
            continue
        other = lanes.model.road_by_id.get(link.id)
        if other is None or other.junction >= 0:
            continue
        section = road.sections[-1 if end == "end" else 0]
        for lane in section.lanes:
            a = lanes.at_end(road.id, end, lane.id)
            if a is None or lane.forward != (end == "end"):
                continue
            for following in other.sections[-1 if link.contact == "end" else 0].lanes:
                b = lanes.at_end(other.id, link.contact, following.id)
                leaves = following.forward == (link.contact == "start")
                if b and leaves and _joined(lane, end, following, link.contact):
                    yield LaneLink(a, b)


def _joined(lane: SectionLane, end: str, following: SectionLane, contact: str) -> bool:
    onward = lane.successor if end == "end" else lane.predecessor
    back = following.successor if contact == "end" else following.predecessor
    return onward == following.id or back == lane.id


def _links_through(lanes: Lanes, junction: ModelJunction) -> Iterator[LaneLink]:
    """Yield links through a junction."""
    roads = lanes.model.road_by_id
    for connection in junction.connections:
        incoming, road = roads.get(connection.incoming), roads.get(connection.connecting)
        if incoming is None or road is None:
            continue
        incoming_end = _end_at(incoming, road, connection.contact, junction.id)
        for first, second in connection.links:
            start = lanes.at_end(incoming.id, incoming_end, first)
            if start is None or start[0].lane(start[1]).forward != (incoming_end == "end"):
                continue
            if road.junction < 0:  # a direct junction: no road in between
                end = lanes.at_end(road.id, connection.contact, second)
                if end and end[0].lane(end[1]).forward == (connection.contact == "start"):
                    yield LaneLink(start, end)
                continue
            path, last = _path(road, connection.contact, second)
            contact, seen = connection.contact, {road.id}
            while path and (onward := _next_connecting_road(lanes.model, road, contact)):
                road, contact = onward
                further, last = _path(road, contact, last) if last is not None else ([], None)
                path = path + further if further and road.id not in seen else []
                seen.add(road.id)
            for end in _ends(lanes, road, contact, path, last):
                yield LaneLink(start, end, tuple(path))


def _next_connecting_road(
    model: LaneModel, road: ModelRoad, contact: str
) -> tuple[ModelRoad, str] | None:
    """Return the next connecting road in the same junction with its end; ``None`` if none."""
    link = road.successor if contact == "start" else road.predecessor
    if link is None or link.element != "road":
        return None
    other = model.road_by_id.get(link.id)
    return (other, link.contact) if other and other.junction == road.junction else None


def _end_at(incoming: ModelRoad, road: ModelRoad, contact: str, junction: int) -> str:
    """Return the end of the incoming road at which a connecting road begins."""
    link = road.predecessor if contact == "start" else road.successor
    if link and link.element == "road" and link.id == incoming.id and link.contact:
        return link.contact
    after = incoming.successor
    return "end" if after and after.element == "junction" and after.id == junction else "start"


def _path(road: ModelRoad, contact: str, lane: int) -> tuple[list[Place], int | None]:
    """Follow a lane along a connecting road; return its lanes and the last one's link."""
    numbers = range(len(road.sections))
    onward = contact == "start"
    path: list[Place] = []
    current_id: int | None = lane
    for number in numbers if onward else reversed(numbers):
        current = road.sections[number].by_id.get(current_id) if current_id is not None else None
        if current is None or current.forward != onward:
            return [], None
        path.append((road.id, number, current.id))
        current_id = current.successor if onward else current.predecessor
        last = number == (len(road.sections) - 1 if onward else 0)
        if current_id is None and not last:
            following = road.sections[number + (1 if onward else -1)]
            back = [
                lane.id for lane in following.lanes
                if (lane.predecessor if onward else lane.successor) == current.id
            ]  # fmt: skip
            current_id = back[0] if back else None
    return path, current_id


def _ends(
    lanes: Lanes, road: ModelRoad, contact: str, path: list[Place], last: int | None
) -> Iterator[tuple[Edge, int]]:
    """Yield the lane that a connecting road leads to, if there is one."""
    link: RoadLink | None = road.successor if contact == "start" else road.predecessor
    if not path or link is None or link.element != "road":
        return
    leaves = link.contact == "start"
    end = lanes.at_end(link.id, link.contact, last) if last is not None else None
    if end is None:
        end = _nearest(lanes, road, path[-1], link, at_end=contact == "start")
    if end and end[0].lane(end[1]).forward == leaves:
        yield end


def _nearest(
    lanes: Lanes, road: ModelRoad, place: Place, link: RoadLink, *, at_end: bool
) -> tuple[Edge, int] | None:
    """Return the lane of a linked road that begins where a connecting lane ends."""
    other = lanes.model.road_by_id.get(link.id)
    if other is None:
        return None
    section = road.sections[place[1]]
    s = road.length if at_end else 0.0
    end_xy = road.place(s, road.middle(section, section.by_id[place[2]], s))[0, :2]
    candidates: list[tuple[float, tuple[Edge, int]]] = []
    section = other.sections[0 if link.contact == "start" else -1]
    s = 0.0 if link.contact == "start" else other.length
    for lane in section.lanes:
        edge = lanes.at_end(other.id, link.contact, lane.id)
        if edge and lane.forward == (link.contact == "start") and lane.kind != "sidewalk":
            start_xy = other.place(s, other.middle(section, lane, s))[0, :2]
            candidates.append((float(np.linalg.norm(start_xy - end_xy)), edge))
    best = min(candidates, key=lambda item: item[0], default=(np.inf, None))
    return best[1] if best[0] <= MEET_M else None


def allowed(lane: SectionLane) -> tuple[str, ...]:
    """Return the classes of actors that may use a lane, by default those usual for its kind."""
    if lane.allowed:
        return lane.allowed
    default_actors = USUAL.get(lane.kind, ())
    return tuple(
        actor for actor in default_actors if actor != "bicycle" or lane.speed_limit <= FAST_MS
    )


def speed(lane: SectionLane) -> float:
    """Return a lane's speed limit, by default the usual one for its kind, m/s."""
    default_speed = {"sidewalk": WALKING_MS, "bicycle": BICYCLE_MS}.get(lane.kind, TOWN_MS)
    return lane.speed_limit or default_speed
