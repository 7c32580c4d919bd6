"""Left-hand traffic as right-hand traffic, which is all that OpenDRIVE 1.4 has.

In 1.4, and in CARLA, lanes of negative ids run along the reference line and lanes of positive ids
against it. On the left side of the road it is the other way about. Each direction of a street then
becomes a road of its own over the same reference line, so that stations, offsets, heights and all
that stands on the road stay as they are: its lanes are counted from the border that lies on the
right side of none of them (traffic along the line) or on the left of none (against it), and the
lane offset leads there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from urbantwin.roads.model import (
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Profile,
    RoadLink,
    SectionLane,
)
from urbantwin.roads.opendrive.cubics import added
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["as_right_hand_traffic"]

#: New ids of lanes: (road's old id, section, old lane) -> (road's new id, new lane).
_Renamed = Mapping[tuple[int, int, int], tuple[int, int]]


@dataclass(frozen=True)
class _Part:
    """The lanes of a road that become one road.

    Attributes:
        id: the id of that road.
        along: whether its traffic runs along the reference line.
        sides: 1 for the lanes to the left of the reference line, -1 for those to the right.
    """

    road: ModelRoad
    id: int
    along: bool
    sides: tuple[int, ...]

    def has(self, lane: SectionLane) -> bool:
        return (1 if lane.id > 0 else -1) in self.sides

    def lanes(self, section: LaneSection) -> list[SectionLane]:
        """Return its lanes of a section from left to right."""
        return sorted((lane for lane in section.lanes if self.has(lane)), key=lambda e: -e.id)

    def number(self, section: LaneSection) -> dict[int, int]:
        """Return old id -> new id."""
        lanes = self.lanes(section)
        first = -1 if self.along else len(lanes)
        return {lane.id: first - k for k, lane in enumerate(lanes)}


def as_right_hand_traffic(model: LaneModel) -> LaneModel:
    """Return a lane model of left-hand traffic in the form of right-hand traffic.

    A road keeps its id; where it is parted, that goes to the lanes along the reference line, and
    the others get a new one. A model of right-hand traffic is returned as it is.
    """
    if model.driving_side == "right":
        return model
    parts: list[_Part] = []
    free = model.next_id
    for road in model.roads:
        for along, sides in _sides(road):
            fresh = any(part.id == road.id for part in parts[-1:])
            parts.append(_Part(road, free if fresh else road.id, along, sides))
            free += fresh
    renamed = {
        (part.road.id, k, old): (part.id, new)
        for part in parts
        for k, section in enumerate(part.road.sections)
        for old, new in part.number(section).items()
    }
    roads = tuple(_road(part, model, renamed) for part in parts)
    junctions = tuple(_junction(junction, model, renamed) for junction in model.junctions)
    signals = []
    for signal in model.signals:
        road = model.road_by_id[signal.road]
        k = road.sections.index(road.section_at(signal.s))
        named = [
            renamed[road.id, k, lane] for lane in signal.lanes if (road.id, k, lane) in renamed
        ]
        along = signal.orientation != "-"
        choice = [part for part in parts if part.road is road]
        there = named[0][0] if named else next((p.id for p in choice if p.along == along), road.id)
        lanes = tuple(lane for number, lane in named if number == there)
        signals.append(replace(signal, road=there, lanes=lanes))
    return replace(
        model, driving_side="right", roads=roads, junctions=junctions, signals=tuple(signals)
    )


def _sides(road: ModelRoad) -> list[tuple[bool, tuple[int, ...]]]:
    """Return what a road is parted into: whether traffic runs along the line, and the sides."""
    driven = {
        1 if lane.id > 0 else -1
        for section in road.sections
        for lane in section.lanes
        if lane.kind in DRIVEN
    }
    if len(driven) == 2:
        return [(True, (1,)), (False, (-1,))]
    # One direction only, or none: lanes beside it stay with it.
    return [(driven != {-1}, (1, -1))]


def _road(part: _Part, model: LaneModel, renamed: _Renamed) -> ModelRoad:
    road = part.road
    sections = tuple(_section(part, k, model, renamed) for k in range(len(road.sections)))
    return replace(
        road,
        id=part.id,
        offset=_offset(part),
        sections=sections,
        predecessor=_link(part, road.predecessor, model, renamed, ahead=False),
        successor=_link(part, road.successor, model, renamed, ahead=True),
    )


def _section(part: _Part, k: int, model: LaneModel, renamed: _Renamed) -> LaneSection:
    section = part.road.sections[k]
    number = part.number(section)
    ordered = sorted(section.lanes, key=lambda lane: -lane.id)
    lanes = []
    for lane in part.lanes(section):
        # The line on the new outer border, the right one along the reference line, else the left.
        mark = _line(section, ordered, lane, left=not part.along)
        before = _renumbered(part.road, k, lane.predecessor, model, renamed, ahead=False)
        after = _renumbered(part.road, k, lane.successor, model, renamed, ahead=True)
        lanes.append(
            replace(
                lane,
                id=number[lane.id],
                mark=mark[0],
                change=mark[1],
                predecessor=before,
                successor=after,
            )
        )
    mine = part.lanes(section)
    inner = mine[0 if part.along else -1] if mine else None
    centre = ("none", "none")
    if inner is not None:
        centre = _line(section, ordered, inner, left=part.along)
    return LaneSection(section.s, tuple(lanes), *centre)


def _line(
    section: LaneSection, ordered: list[SectionLane], lane: SectionLane, *, left: bool
) -> tuple[str, str]:
    """Return the mark on one border of a lane and who may change lanes over it."""
    if (lane.id > 0) == left:
        return lane.mark, lane.change
    inner = section.by_id.get(lane.id + (-1 if lane.id > 0 else 1))
    if inner is None:
        return section.centre_mark, section.centre_change
    return inner.mark, inner.change


def _offset(part: _Part) -> Profile:
    """Return the lane offset to the border that the lanes of a part are counted from."""
    road = part.road
    starts, rows = [], []
    for section, end in zip(road.sections, road.section_ends, strict=True):
        # Along the reference line that is the left border, against it the right one.
        sign = 1.0 if part.along else -1.0
        beside = [lane for lane in section.lanes if part.has(lane)]
        widths = [(sign, lane.width) for lane in beside if (lane.id > 0) == part.along]
        offset = Profile(road.offset.start - section.s, road.offset.abcd)
        profile = added([(1.0, offset), *widths], end - section.s)
        starts.append(profile.start + section.s)
        rows.append(profile.abcd)
    return Profile(np.concatenate(starts), np.concatenate(rows))


def _met(road: ModelRoad, k: int, model: LaneModel, *, ahead: bool) -> tuple[ModelRoad, int] | None:
    """Return road and section that a section's lanes are linked to at one end."""
    inner = k + (1 if ahead else -1)
    if 0 <= inner < len(road.sections):
        return road, inner
    link = road.successor if ahead else road.predecessor
    if link is None or link.element != "road" or link.id not in model.road_by_id:
        return None
    there = model.road_by_id[link.id]
    return there, 0 if link.contact == "start" else len(there.sections) - 1


def _renumbered(
    road: ModelRoad,
    k: int,
    lane: int | None,
    model: LaneModel,
    renamed: _Renamed,
    *,
    ahead: bool,
) -> int | None:
    met = _met(road, k, model, ahead=ahead)
    if lane is None or met is None:
        return None
    return renamed.get((met[0].id, met[1], lane), (0, None))[1]


def _link(
    part: _Part, link: RoadLink | None, model: LaneModel, renamed: _Renamed, *, ahead: bool
) -> RoadLink | None:
    """Return what a part is joined to: of a parted road, the part that its lanes lead to."""
    if link is None or link.element != "road":
        return link
    road = part.road
    k = len(road.sections) - 1 if ahead else 0
    met = _met(road, k, model, ahead=ahead)
    if met is None:
        return link
    for lane in sorted(part.lanes(road.sections[k]), key=lambda e: e.kind not in DRIVEN):
        other = lane.successor if ahead else lane.predecessor
        if other is not None and (met[0].id, met[1], other) in renamed:
            return replace(link, id=renamed[met[0].id, met[1], other][0])
    return link


def _junction(junction: ModelJunction, model: LaneModel, renamed: _Renamed) -> ModelJunction:
    connections = [
        parted
        for connection in junction.connections
        for parted in _connections(connection, model, renamed)
    ]
    return replace(junction, connections=tuple(connections))


def _connections(
    connection: Connection, model: LaneModel, renamed: _Renamed
) -> Iterable[Connection]:
    """Return a connection for every pair of parts that its lanes join."""
    connecting = model.road_by_id[connection.connecting]
    k = 0 if connection.contact == "start" else len(connecting.sections) - 1
    met = _met(connecting, k, model, ahead=connection.contact == "end")
    if met is None or met[0].id != connection.incoming:
        incoming = model.road_by_id[connection.incoming]
        met = incoming, len(incoming.sections) - 1
    links: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, second in connection.links:
        one = renamed.get((met[0].id, met[1], first))
        two = renamed.get((connecting.id, k, second))
        if one is not None and two is not None:
            links.setdefault((one[0], two[0]), []).append((one[1], two[1]))
    for (incoming_id, connecting_id), pairs in links.items():
        yield Connection(incoming_id, connecting_id, connection.contact, tuple(pairs))
