"""Insertion of lanes into a road: new lane sections, renumbered ids, links kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from urbantwin.roads.model import (
    RAISED_KINDS,
    LaneModel,
    LaneSection,
    ModelRoad,
    Profile,
    RoadLink,
    SectionLane,
)
from urbantwin.roads.model.road import with_lane_marks

__all__ = ["Insertion", "Renumbering", "relinked", "with_curbs", "with_lanes"]

#: Minimum distance between section boundaries, metres.
SLIVER_M = 0.05
#: Key of a lane: ("old", section, id) in the original road, or ("new", number, 0).
Key = tuple[str, int, int]
#: Width of a curb stone, metres (EN 1340: usually 0.12 to 0.15 m; AASHTO Green Book: 0.15 m).
CURB_WIDTH_M = 0.15
#: Minimum width of a sidewalk from which a curb's width is taken, metres.
NARROWEST_M = 0.6


@dataclass(frozen=True, eq=False)
class Insertion:
    """A lane to insert into a road.

    Attributes:
        side: 1 to the left of the reference line, -1 to its right.
        place: ``reference``: next to the reference line; ``outer``: beyond the outermost lane of
            the carriageway; ``before_track``: the same, but inside a cycle track there;
            ``before_raised``: before the first raised lane.
        kind: kind of the lane.
        first: start station, metres.
        last: end station, metres.
        width: metres over the distance from ``first``.
        height: height above the carriageway, metres.
        parking: orientation of parked vehicles, as in ``SectionLane``.
    """

    side: int
    place: str
    kind: str
    first: float
    last: float
    width: Profile
    height: float = 0.0
    parking: str = ""


@dataclass(frozen=True)
class Renumbering:
    """Old id -> new id of the lanes at a road's start and at its end."""

    start: Mapping[int, int]
    end: Mapping[int, int]

    def at(self, contact: str) -> Mapping[int, int]:
        """Return the ids at one end, ``start`` or ``end``."""
        return self.start if contact == "start" else self.end


def with_lanes(road: ModelRoad, insertions: Sequence[Insertion]) -> tuple[ModelRoad, Renumbering]:
    """Return a road with additional lanes.

    Outer lanes move outwards and get new ids; they keep their strips. Each new lane has its own
    strip, ``"<road>:<section>:<lane>"``, named after the section where it begins.

    Args:
        road: the road.
        insertions: the lanes to insert; of two at one place, the first is the inner one.
    """
    borders = [section.s for section in road.sections]
    for item in insertions:
        borders += [item.first, item.last]
    cuts = _distinct(borders, road.length)
    starts = [section.s for section in road.sections]
    parts: list[dict[Key, SectionLane]] = []
    bases: list[int] = []
    strips: dict[int, str] = {}
    for number, (a, b) in enumerate(zip(cuts, [*cuts[1:], road.length], strict=True)):
        base = max(k for k, start in enumerate(starts) if start < a + SLIVER_M)
        lanes: dict[Key, SectionLane] = {}
        for side in (1, -1):
            active = [
                (k, item)
                for k, item in enumerate(insertions)
                if item.side == side and item.first < (a + b) / 2 < item.last
            ]
            row = _row(road, base, side, active)
            for place, (key, lane, start) in enumerate(row, start=1):
                strip = lane.strip
                if key[0] == "new":
                    strip = strips.setdefault(key[1], f"{road.id}:{number}:{side * place}")
                width = lane.width.between(max(a - start, 0.0), b - start)
                lanes[key] = replace(lane, id=side * place, width=width, strip=strip)
        parts.append(lanes)
        bases.append(base)
    linked = [_linked(road, parts, bases, k) for k in range(len(parts))]
    sections = tuple(
        with_lane_marks(LaneSection(a, tuple(sorted(lanes, key=lambda lane: -lane.id))))
        for a, lanes in zip(cuts, linked, strict=True)
    )
    ends = [{key[2]: lane.id for key, lane in parts[k].items() if key[0] == "old"} for k in (0, -1)]
    return replace(road, sections=sections), Renumbering(*ends)


def relinked(model: LaneModel, changed: Mapping[int, Renumbering]) -> LaneModel:
    """Return the model with links of lanes updated to their neighbours' new ids."""
    roads = []
    for road in model.roads:
        before, after = (_ids(link, changed) for link in (road.predecessor, road.successor))
        sections = list(road.sections)
        sections[0] = _linked_to(sections[0], "predecessor", before)
        sections[-1] = _linked_to(sections[-1], "successor", after)
        same = sections[0] is road.sections[0] and sections[-1] is road.sections[-1]
        roads.append(road if same else replace(road, sections=tuple(sections)))
    by_id = model.road_by_id
    junctions = []
    for junction in model.junctions:
        connections = []
        for item in junction.connections:
            connecting = by_id[item.connecting]
            link = connecting.predecessor if item.contact == "start" else connecting.successor
            ids = _ids(link, changed)
            links = tuple((ids.get(a, a), b) for a, b in item.links)
            connections.append(replace(item, links=links) if ids else item)
        junctions.append(replace(junction, connections=tuple(connections)))
    return replace(model, roads=tuple(roads), junctions=tuple(junctions))


def _ids(link: RoadLink | None, changed: Mapping[int, Renumbering]) -> Mapping[int, int]:
    if link is None or link.element != "road" or link.id not in changed:
        return {}
    return changed[link.id].at(link.contact)


def _linked_to(section: LaneSection, end: str, ids: Mapping[int, int]) -> LaneSection:
    """Return a section whose links at one end use the neighbours' new ids."""
    old = [getattr(lane, end) for lane in section.lanes]
    if all(ids.get(link, link) == link for link in old):
        return section
    lanes = (
        replace(lane, **{end: ids.get(link, link)})
        for lane, link in zip(section.lanes, old, strict=True)
    )
    return replace(section, lanes=tuple(lanes))


def _distinct(borders: Sequence[float], length: float) -> list[float]:
    stations = [0.0]
    for s in sorted(borders):
        if s > stations[-1] + SLIVER_M and s < length - SLIVER_M:
            stations.append(float(s))
    return stations


def _row(
    road: ModelRoad, base: int, side: int, active: Sequence[tuple[int, Insertion]]
) -> list[tuple[Key, SectionLane, float]]:
    """Return the lanes of one side from the reference line outwards, with their start stations."""
    section = road.sections[base]
    old = sorted(
        (lane for lane in section.lanes if lane.id * side > 0), key=lambda lane: abs(lane.id)
    )
    row: list[tuple[Key, SectionLane, float]] = [
        (("old", base, lane.id), lane, section.s) for lane in old
    ]
    flat = next((k for k, x in enumerate(old) if x.kind in RAISED_KINDS), len(old))
    inside = flat - 1 if flat and old[flat - 1].kind == "bicycle" else flat
    index_of = {"reference": 0, "outer": flat, "before_track": inside, "before_raised": flat}
    forward = old[0].forward if old else any(lane.forward for lane in section.lanes)
    # From the outermost place inwards, so that positions stay valid.
    for k, item in sorted(active, key=lambda pair: (-index_of[pair[1].place], -pair[0])):
        lane = SectionLane(
            side, item.kind, item.width, forward, height=item.height, parking=item.parking
        )
        row.insert(index_of[item.place], (("new", k, 0), lane, item.first))
    return row


def _linked(
    road: ModelRoad, parts: Sequence[Mapping[Key, SectionLane]], bases: Sequence[int], k: int
) -> list[SectionLane]:
    linked = []
    for key, lane in parts[k].items():
        before, after = lane.predecessor, lane.successor
        if k > 0:
            before = _neighbour(key, lane.predecessor, bases[k - 1] - bases[k], parts[k - 1])
        elif key[0] == "new":
            before = None
        if k < len(parts) - 1:
            after = _neighbour(key, lane.successor, bases[k + 1] - bases[k], parts[k + 1])
        elif key[0] == "new":
            after = None
        same = (before, after) == (lane.predecessor, lane.successor)
        linked.append(lane if same else replace(lane, predecessor=before, successor=after))
    return linked


def _neighbour(
    key: Key, link: int | None, step: int, other: Mapping[Key, SectionLane]
) -> int | None:
    if key[0] == "old" and step:
        if link is None:
            return None
        key = ("old", key[1] + step, link)
    lane = other.get(key)
    return None if lane is None else lane.id


def with_curbs(model: LaneModel) -> LaneModel:
    """Return the model with a curb along each sidewalk of a street, taken from its width.

    Args:
        model: roads in plan, with their side lanes.
    """
    changed: dict[int, Renumbering] = {}
    roads = []
    for road in model.roads:
        items = [_curb(road, side) for side in (1, -1) if _has_sidewalk(road, side)]
        if road.junction >= 0 or not items:
            roads.append(road)
            continue
        curbed, changed[road.id] = with_lanes(road, items)
        roads.append(
            replace(curbed, sections=tuple(_narrowed(section) for section in curbed.sections))
        )
    return relinked(replace(model, roads=tuple(roads)), changed)


def _has_sidewalk(road: ModelRoad, side: int) -> bool:
    """Return whether the innermost raised lane of a side is a wide enough sidewalk all along."""
    shared = any(lane.opposite for section in road.sections for lane in section.lanes)
    for section in road.sections:
        lanes = sorted(
            (lane for lane in section.lanes if lane.id * side > 0), key=lambda lane: abs(lane.id)
        )
        raised = next((lane for lane in lanes if lane.kind in RAISED_KINDS), None)
        # Connecting roads start at a sidewalk that is the only lane of a side, unless both
        # directions share the lane on the other side: it stays in place.
        if raised is None or raised.kind != "sidewalk" or (abs(raised.id) == 1 and not shared):
            return False
        ends = [0.0, *raised.width.start]
        if np.min(raised.width.at(ends)) < NARROWEST_M:
            return False
    return True


def _curb(road: ModelRoad, side: int) -> Insertion:
    section = road.sections[0]
    height = next(
        lane.height for lane in section.lanes if lane.id * side > 0 and lane.kind == "sidewalk"
    )
    width = Profile.constant(CURB_WIDTH_M)
    return Insertion(side, "before_raised", "curb", 0.0, road.length, width, height)


def _narrowed(section: LaneSection) -> LaneSection:
    lanes = {lane.id: lane for lane in section.lanes}
    for number, lane in section.by_id.items():
        inner = section.by_id.get(number - (1 if number > 0 else -1))
        if lane.kind == "sidewalk" and inner is not None and inner.kind == "curb":
            abcd = lane.width.abcd - [CURB_WIDTH_M, 0.0, 0.0, 0.0]
            lanes[number] = replace(lane, width=Profile(lane.width.start, abcd))
    return replace(section, lanes=tuple(lanes.values()))
