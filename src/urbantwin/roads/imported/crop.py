"""Cropping of a lane model to the region and to its main component."""

from __future__ import annotations

import dataclasses
from collections import defaultdict

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.imported.edges import carries_traffic
from urbantwin.roads.model import (
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    RoadLink,
)
from urbantwin.roads.region_pieces import LeftOut, Part, main_component

__all__ = ["cropped", "main_part", "part_of_road", "with_border"]

#: Spacing of stations tested for being inside, metres; the border is then located to a millimetre.
STEP_M = 0.5
#: Minimum length of a street that remains at a kept junction, metres.
STUB_M = 15.0
#: Shorter pieces without a junction are dropped, metres.
LEAST_M = 5.0
#: Tolerance for assigning objects to a piece of road, metres.
SLACK_M = 2.0
Interval = tuple[float, float]
#: Shorter parts are dropped, metres.
SHORTEST_CUT_M = 1e-3


def cropped(model: LaneModel, region: shapely.Polygon, *, beyond: float = 0.0) -> LaneModel:
    """Return the part of a lane model that lies in a region.

    Streets are cut at the region's border. A junction is kept completely, with a stub of each of
    its streets, if its centre is in the region.

    Args:
        model: the lane model.
        region: the region, site frame.
        beyond: extension of streets beyond the border, metres.
    """
    reach = region.buffer(beyond) if beyond else region
    shapely.prepare([region, reach])
    kept_junctions = {
        junction.id
        for junction in model.junctions
        if region.contains(shapely.Point(middle_of_junction(model, junction)))
    }
    number = model.next_id
    pieces: dict[int, list[tuple[int, Interval]]] = {}
    for road in model.roads:
        if road.junction >= 0:
            continue
        intervals: list[tuple[int, Interval]] = []
        for interval in _intervals(road, reach, kept_junctions):
            intervals.append((number if intervals else road.id, interval))
            number += len(intervals) > 1
        pieces[road.id] = intervals
    return _model_of_pieces(model, pieces, kept_junctions)


def main_part(model: LaneModel) -> tuple[LaneModel, list[LeftOut]]:
    """Return the main component of a lane model, and the parts left out."""
    streets = {road.id: road for road in model.roads if road.junction < 0}
    joints: dict[int, set[tuple[int, int]]] = defaultdict(set)
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if link is None:
                continue
            if road.junction >= 0:
                joints[link.id].add((road.junction, -1))
            elif link.element == "junction":
                joints[road.id].add((link.id, -1))
            else:
                pair = (min(road.id, link.id), max(road.id, link.id))
                joints[road.id].add(pair)
                joints[link.id].add(pair)
    for junction in model.junctions:
        for connection in junction.connections:
            joints[connection.incoming].add((junction.id, -1))
            joints[connection.connecting].add((junction.id, -1))
    parts = {
        road.id: Part(road.name, road.curve.line, _motor_lanes(road), frozenset(joints[road.id]))
        for road in streets.values()
    }
    main_roads, left_out = main_component(parts)
    if not left_out:
        return model, []
    junctions = {number for road in main_roads for number, other in joints[road] if other == -1}
    pieces = {
        identity: [(identity, (0.0, road.length))] if identity in main_roads else []
        for identity, road in streets.items()
    }
    return _model_of_pieces(model, pieces, junctions), left_out


def middle_of_junction(model: LaneModel, junction: ModelJunction) -> NDArray[np.float64]:
    """Return the centre of the connecting roads of a junction (2,); nan without any."""
    places = [
        road.curve.at([road.length / 2])[0, :2]
        if road.junction >= 0
        else road.curve.at([0.0 if connection.contact == "start" else road.length])[0, :2]
        for connection in junction.connections
        if (road := model.road_by_id.get(connection.connecting))
    ]
    if not places:
        return np.full(2, np.nan)
    points = np.array(places)
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def _motor_lanes(road: ModelRoad) -> float:
    return float(
        np.mean(
            [
                sum(lane.kind in ("driving", "bus") for lane in section.lanes)
                for section in road.sections
            ]
        )
    )


def _intervals(road: ModelRoad, region: shapely.Polygon, kept: set[int]) -> list[Interval]:
    """Return the intervals of a street that are kept, from start to end, metres."""
    s = np.linspace(0.0, road.length, max(2, int(road.length / STEP_M) + 2))
    inside = _in_region(road, region, s)
    turns = np.flatnonzero(inside[1:] != inside[:-1])
    borders = [_border(road, region, s[k], s[k + 1]) for k in turns]
    cuts = [*([0.0] if inside[0] else []), *borders, *([road.length] if inside[-1] else [])]
    intervals = list(zip(cuts[::2], cuts[1::2], strict=True))
    ends = []
    for link, stub in (
        (road.predecessor, (0.0, min(STUB_M, road.length))),
        (road.successor, (max(0.0, road.length - STUB_M), road.length)),
    ):
        if link and link.element == "junction" and link.id in kept:
            ends.append(stub)
    merged: list[Interval] = []
    for a, b in sorted([*intervals, *ends]):
        if merged and a <= merged[-1][1] + LEAST_M:
            merged[-1] = (merged[-1][0], max(b, merged[-1][1]))
        else:
            merged.append((a, b))
    return [
        (a, b)
        for a, b in merged
        if b - a >= LEAST_M or a == 0.0 or b == road.length or (a, b) in ends
    ]


def _in_region(
    road: ModelRoad, region: shapely.Polygon, s: NDArray[np.float64]
) -> NDArray[np.bool_]:
    xy = road.curve.at(s)[:, :2]
    return np.asarray(shapely.intersects_xy(region, xy[:, 0], xy[:, 1]))


def _border(road: ModelRoad, region: shapely.Polygon, low: float, high: float) -> float:
    """Return the station between two at which a road crosses the region's border, metres."""
    begins_inside = bool(_in_region(road, region, np.array([low]))[0])
    for _ in range(10):
        middle = (low + high) / 2
        if bool(_in_region(road, region, np.array([middle]))[0]) == begins_inside:
            low = middle
        else:
            high = middle
    return low if begins_inside else high


def _model_of_pieces(
    model: LaneModel, pieces: dict[int, list[tuple[int, Interval]]], kept: set[int]
) -> LaneModel:
    """Return the model with the given pieces of its streets and the kept junctions."""
    streets: dict[int, ModelRoad] = {}
    at_end: dict[tuple[int, str], int] = {}
    for identity, parts in pieces.items():
        road = model.road_by_id[identity]
        for new, (a, b) in parts:
            piece = part_of_road(road, a, b, new)
            streets[new] = piece
            if piece.length >= road.length - 1e-9 or a <= 1e-3:
                at_end[identity, "start"] = new
            if b >= road.length - 1e-3:
                at_end[identity, "end"] = new
    ways = {
        road.id: road
        for road in model.roads
        if road.junction in kept
        and all(
            link is None
            or link.element != "road"
            or (link.id, link.contact) in at_end
            or link.id not in pieces
            for link in (road.predecessor, road.successor)
        )
    }
    # A connecting road may continue in another one.
    roads = {
        road.id: _relinked(road, at_end, kept, ways) for road in (*streets.values(), *ways.values())
    }
    order = {road.id: k for k, road in enumerate(model.roads)}
    junctions = tuple(
        _junction_of_pieces(model, junction, roads, at_end)
        for junction in model.junctions
        if junction.id in kept
    )
    junctions = tuple(junction for junction in junctions if junction.connections)
    junction_ids = {junction.id for junction in junctions}
    ordered = sorted(roads.values(), key=lambda road: (order.get(road.id, len(order)), road.id))
    result = dataclasses.replace(
        model,
        roads=tuple(_unjoined(road, junction_ids) for road in ordered),
        junctions=junctions,
    )
    return _furnished(model, result, pieces)


def _relinked(
    road: ModelRoad,
    at_end: dict[tuple[int, str], int],
    kept: set[int],
    ways: dict[int, ModelRoad],
) -> ModelRoad:
    """Return a road linked to its remaining neighbours."""

    def link(old: RoadLink | None) -> RoadLink | None:
        if old is None or old.element == "junction":
            return old if old and old.id in kept else None
        if old.id in ways:
            return old
        new_id = at_end.get((old.id, old.contact))
        return None if new_id is None else dataclasses.replace(old, id=new_id)

    before, after = link(road.predecessor), link(road.successor)
    sections = list(road.sections)
    if before is None and road.predecessor:
        sections[0] = without_links(sections[0], "predecessor")
    if after is None and road.successor:
        sections[-1] = without_links(sections[-1], "successor")
    return dataclasses.replace(road, predecessor=before, successor=after, sections=tuple(sections))


def _unjoined(road: ModelRoad, junctions: set[int]) -> ModelRoad:
    """Return a road without links to dropped junctions."""
    before, after = (
        None if link and link.element == "junction" and link.id not in junctions else link
        for link in (road.predecessor, road.successor)
    )
    return dataclasses.replace(road, predecessor=before, successor=after)


def _junction_of_pieces(
    model: LaneModel,
    junction: ModelJunction,
    roads: dict[int, ModelRoad],
    at_end: dict[tuple[int, str], int],
) -> ModelJunction:
    connections: list[Connection] = []
    for connection in junction.connections:
        road = roads.get(connection.connecting)
        incoming = model.road_by_id.get(connection.incoming)
        if incoming is None:
            continue
        if model.road_by_id[connection.connecting].junction < 0:  # a direct junction
            new_id = at_end.get((connection.connecting, connection.contact))
            road = roads.get(new_id) if new_id is not None else None
        if road is None:
            continue
        old_road = model.road_by_id[connection.connecting]
        link = old_road.predecessor if connection.contact == "start" else old_road.successor
        end = link.contact if link and link.id == incoming.id and link.element == "road" else ""
        if not end:
            after = incoming.successor
            end = "end" if after == RoadLink("junction", junction.id) else "start"
        if (incoming.id, end) in at_end:
            connections.append(
                dataclasses.replace(
                    connection, incoming=at_end[incoming.id, end], connecting=road.id
                )
            )
    return dataclasses.replace(junction, connections=tuple(connections))


def _furnished(
    old: LaneModel, new: LaneModel, pieces: dict[int, list[tuple[int, Interval]]]
) -> LaneModel:
    """Return the new model with the old one's objects and signals on its remaining roads."""

    def place(road: int, s: float) -> tuple[int, float] | None:
        if road not in pieces:
            return (road, s) if road in new.road_by_id else None
        for identity, (a, b) in pieces[road]:
            if a - SLACK_M <= s <= b + SLACK_M and identity in new.road_by_id:
                return identity, float(np.clip(s - a, 0.0, b - a))
        return None

    areas = tuple(
        dataclasses.replace(item, road=located[0], s=located[1])
        for item in old.areas
        if (located := place(item.road, item.s))
    )
    signals = tuple(
        dataclasses.replace(item, road=located[0], s=located[1])
        for item in old.signals
        if (located := place(item.road, item.s))
    )
    standing = {signal.id for signal in signals}
    valid = {junction.id for junction in new.junctions}
    controllers = tuple(
        dataclasses.replace(
            item,
            signals=tuple(signal for signal in item.signals if signal in standing),
            junctions=tuple(junction for junction in item.junctions if junction in valid),
        )
        for item in old.controllers
        if standing & set(item.signals)
    )
    return dataclasses.replace(new, areas=areas, signals=signals, controllers=controllers)


def has_traffic(model: LaneModel) -> bool:
    """Return whether a lane model has a lane with motor traffic."""
    return any(
        lane.kind in ("driving", "bus") and carries_traffic(road, number, lane)
        for road in model.roads
        if road.junction < 0
        for number, section in enumerate(road.sections)
        for lane in section.lanes
    )


def part_of_road(road: ModelRoad, first: float, last: float, identity: int) -> ModelRoad:
    """Return the part of a road between two stations as a separate road.

    A cut end has no link; other ends keep theirs.

    Args:
        road: the road.
        first: station of the new start, metres.
        last: station of the new end, metres.
        identity: id of the new road.
    """
    uncut = (first <= SHORTEST_CUT_M, last >= road.length - SHORTEST_CUT_M)
    first, last = (0.0 if uncut[0] else first), (road.length if uncut[1] else last)
    if all(uncut):
        return road if road.id == identity else dataclasses.replace(road, id=identity)
    sections = [
        _part(section, max(first, section.s), first)
        for section, end in zip(road.sections, road.section_ends, strict=True)
        if min(last, end) - max(first, section.s) > SHORTEST_CUT_M
    ]
    if not uncut[0]:
        sections[0] = without_links(sections[0], "predecessor")
    if not uncut[1]:
        sections[-1] = without_links(sections[-1], "successor")
    profiles = {
        name: getattr(road, name).between(first, last)
        for name in ("offset", "elevation", "bank", "crown")
    }
    return dataclasses.replace(
        road,
        id=identity,
        curve=road.curve.between(first, last),
        sections=tuple(sections),
        predecessor=road.predecessor if uncut[0] else None,
        successor=road.successor if uncut[1] else None,
        **profiles,
    )


def with_border(road: ModelRoad, s: float) -> tuple[ModelRoad, int]:
    """Return a road with a section boundary at a station, and the index of the section after it."""
    number = max(k for k, section in enumerate(road.sections) if section.s < s)
    before = road.sections[number]
    after = _part(before, s, 0.0)
    joined = (
        dataclasses.replace(
            before,
            lanes=tuple(dataclasses.replace(lane, successor=lane.id) for lane in before.lanes),
        ),
        dataclasses.replace(
            after,
            lanes=tuple(dataclasses.replace(lane, predecessor=lane.id) for lane in after.lanes),
        ),
    )
    sections = (*road.sections[:number], *joined, *road.sections[number + 1 :])
    return dataclasses.replace(road, sections=sections), number + 1


def _part(section: LaneSection, start: float, origin: float) -> LaneSection:
    """Return the rest of a section from a station on; its station counts from ``origin``."""
    gone = start - section.s
    lanes = section.lanes
    if gone > SHORTEST_CUT_M:
        lanes = tuple(
            dataclasses.replace(lane, width=lane.width.between(gone, float("inf")))
            for lane in lanes
        )
    return dataclasses.replace(section, s=start - origin, lanes=lanes)


def without_links(section: LaneSection, side: str) -> LaneSection:
    """Return a section whose lanes have no links at ``predecessor`` or ``successor``."""
    lanes = tuple(
        dataclasses.replace(lane, predecessor=None)
        if side == "predecessor"
        else dataclasses.replace(lane, successor=None)
        for lane in section.lanes
    )
    return dataclasses.replace(section, lanes=lanes)
