"""Streets between junctions whose connecting roads lead directly from one into the other.

SUMO and the rest of the build know ways through a junction from street to street only. Where a map
joins a connecting road of one junction to that of another (OpenDRIVE allows such links), the last
metres of the road become a street.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.imported.road_cut import part_of_road
from urbantwin.roads.model import (
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    RoadLink,
    RoadSignal,
)

__all__ = ["with_streets_between"]

#: Length of such a street, metres, and the largest share of a connecting road that it takes.
STREET_M, SHARE = 2.0, 0.25
#: Ends of connecting roads this close are one place, metres.
MEET_M = 1.0

#: A road and one of its ends (``start`` or ``end``).
_End = tuple[int, str]


@dataclass(frozen=True)
class _Place:
    """Where connecting roads of two junctions meet.

    Attributes:
        ends: junction -> ends of its roads there.
        host: the end whose road gives its last metres to the street.
    """

    ends: Mapping[int, tuple[_End, ...]]
    host: _End


def with_streets_between(model: LaneModel) -> tuple[LaneModel, list[str], list[str]]:
    """Return a model with a street between every two junctions that are joined directly.

    Args:
        model: the lane model of a map.

    Returns:
        The model, one line for each street that was made, and one for each link of a road through
        a junction that is not followed.
    """
    notes, unfollowed = [], []
    for place in _places(model):
        model, street = _with_street(model, place)
        first, second = sorted(place.ends)
        notes.append(
            f"road {place.host[0]}: leads from junction {first} directly into junction {second}: "
            f"its last {street.length:.1f} m are street {street.id}"
        )
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if road.junction < 0 or link is None:
                continue
            there = link.id
            if link.element == "road":
                there = model.road_by_id[link.id].junction
                if there in (-1, road.junction):
                    continue
            unfollowed.append(
                f"road {road.id}: leads through junction {road.junction} into junction {there} "
                "where others join them: its link is not followed"
            )
    return model, notes, unfollowed


def _places(model: LaneModel) -> list[_Place]:
    """Return where connecting roads of exactly two junctions meet."""
    roads = model.road_by_id
    ends: dict[_End, RoadLink] = {}
    for road in model.roads:
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if road.junction < 0 or link is None:
                continue
            other = link.id if link.element == "junction" else roads[link.id].junction
            if other not in (-1, road.junction):
                ends[road.id, end] = link
    points = {end: _point(roads[end[0]], end[1]) for end in ends}
    clusters: list[list[_End]] = []
    for each in sorted(ends):
        near = [c for c in clusters if np.linalg.norm(points[c[0]] - points[each]) < MEET_M]
        if near:
            near[0].append(each)
        else:
            clusters.append([each])
    found = []
    for cluster in clusters:
        of: dict[int, list[_End]] = defaultdict(list)
        for identity, end in cluster:
            of[roads[identity].junction].append((identity, end))
        if len(of) != 2:
            continue
        host = max(cluster, key=lambda one: (_driven(roads[one[0]], one[1]), -one[0]))
        found.append(_Place({key: tuple(value) for key, value in of.items()}, host))
    return found


def _with_street(model: LaneModel, place: _Place) -> tuple[LaneModel, ModelRoad]:
    roads = dict(model.road_by_id)
    number, end = place.host
    host = roads[number]
    (other,) = set(place.ends) - {host.junction}
    length = min(STREET_M, SHARE * min(roads[e].length for e, _ in place.ends[host.junction]))
    at_start = end == "start"
    first, last = (0.0, length) if at_start else (host.length - length, host.length)
    street = part_of_road(host, first, last, model.next_id)
    links = (RoadLink("junction", host.junction), RoadLink("junction", other))
    street = replace(
        street,
        junction=-1,
        predecessor=links[at_start],
        successor=links[not at_start],
        sections=tuple(_unlinked(section, street) for section in street.sections),
    )
    roads[street.id] = street
    moved: dict[int, float] = {}
    connections: dict[int, list[Connection]] = {key: [] for key in place.ends}
    for junction, ends in place.ends.items():
        # The street's end that lies at this junction.
        near = ("end" if at_start else "start") if junction == host.junction else end
        for identity, contact in ends:
            road = roads[identity]
            if junction == host.junction:
                cut = (length, road.length) if contact == "start" else (0.0, road.length - length)
                moved[identity] = -length if contact == "start" else 0.0
                road = part_of_road(road, *cut, identity)
            pairs = _pairs(road, contact, street, near)
            road = _linked(road, contact, RoadLink("road", street.id, near), pairs)
            roads[identity] = road
            inwards = [
                (pairs[lane.id], lane.id)
                for lane in _section(road, contact).lanes
                if lane.id in pairs and lane.forward == (contact == "start")
            ]
            if inwards:
                connections[junction].append(
                    Connection(street.id, identity, contact, tuple(inwards))
                )
    there = {identity for ends in place.ends.values() for identity, _ in ends}
    junctions = tuple(
        _with_connections(junction, connections.get(junction.id, []), there)
        for junction in model.junctions
    )
    order = [road.id for road in model.roads]
    return (
        replace(
            model,
            roads=tuple(roads[identity] for identity in (*order, street.id)),
            junctions=junctions,
            signals=tuple(_moved(e, moved, roads) for e in model.signals),
            areas=tuple(
                replace(e, s=float(np.clip(e.s + moved[e.road], 0.0, roads[e.road].length)))
                if e.road in moved
                else e
                for e in model.areas
            ),
        ),
        street,
    )


def _with_connections(
    junction: ModelJunction, made: Iterable[Connection], there: set[int]
) -> ModelJunction:
    """Return a junction with new connections in place of those from other connecting roads."""
    kept = [e for e in junction.connections if e.incoming not in there]
    return replace(junction, connections=(*kept, *made))


def _moved(
    signal: RoadSignal, moved: Mapping[int, float], roads: Mapping[int, ModelRoad]
) -> RoadSignal:
    if signal.road not in moved:
        return signal
    s = float(np.clip(signal.s + moved[signal.road], 0.0, roads[signal.road].length))
    return replace(signal, s=s)


def _unlinked(section: LaneSection, street: ModelRoad) -> LaneSection:
    """Return a section of a street whose lanes lead on within the street only."""
    first, last = section is street.sections[0], section is street.sections[-1]
    lanes = tuple(
        replace(
            lane,
            predecessor=None if first else lane.predecessor,
            successor=None if last else lane.successor,
        )
        for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _linked(road: ModelRoad, contact: str, link: RoadLink, pairs: Mapping[int, int]) -> ModelRoad:
    """Return a road whose end, and the lanes there, lead to a street."""
    sections = list(road.sections)
    k = 0 if contact == "start" else -1
    lanes = tuple(
        replace(lane, predecessor=pairs.get(lane.id))
        if contact == "start"
        else replace(lane, successor=pairs.get(lane.id))
        for lane in sections[k].lanes
    )
    sections[k] = replace(sections[k], lanes=lanes)
    if contact == "start":
        return replace(road, predecessor=link, sections=tuple(sections))
    return replace(road, successor=link, sections=tuple(sections))


def _pairs(road: ModelRoad, contact: str, street: ModelRoad, near: str) -> dict[int, int]:
    """Return lane of a road -> lane of a street that it meets: the nearest of its direction."""
    theirs = _middles(street, near)
    found = {}
    for lane, place in _middles(road, contact).items():
        mine = _section(road, contact).by_id[lane]
        outwards = mine.forward == (contact == "end")
        gaps = [
            (float(np.linalg.norm(place - there)), other)
            for other, there in theirs.items()
            if (kind := _section(street, near).by_id[other]).forward
            == (outwards == (near == "start"))
            and kind.kind == mine.kind
        ]
        if gaps and min(gaps)[0] < MEET_M:
            found[lane] = min(gaps)[1]
    return found


def _middles(road: ModelRoad, end: str) -> dict[int, NDArray[np.float64]]:
    section = _section(road, end)
    s = 0.0 if end == "start" else road.length
    return {lane.id: road.place(s, road.middle(section, lane, s))[0, :2] for lane in section.lanes}


def _section(road: ModelRoad, end: str) -> LaneSection:
    return road.sections[0 if end == "start" else -1]


def _point(road: ModelRoad, end: str) -> NDArray[np.float64]:
    """Return the middle of the lanes at an end of a road in plan (2,)."""
    x, y, _ = road.curve.at([0.0 if end == "start" else road.length])[0]
    return np.array([x, y])


def _driven(road: ModelRoad, end: str) -> int:
    return sum(lane.kind in ("driving", "bus", "bicycle") for lane in _section(road, end).lanes)
