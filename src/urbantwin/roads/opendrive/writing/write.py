"""Writing of a lane model as OpenDRIVE."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import (
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Profile,
    RoadLink,
    RoadSignal,
    SectionLane,
    SignalController,
)
from urbantwin.roads.opendrive.cubics import added
from urbantwin.roads.opendrive.vocabulary import DRIVEN
from urbantwin.roads.opendrive.writing.carla import with_carla_crosswalks, with_carla_signs
from urbantwin.roads.opendrive.writing.document import document
from urbantwin.roads.streets.furniture import WALKER_LIGHTS

__all__ = ["VERSIONS", "write_opendrive"]

#: Supported versions: the newest, and the one that CARLA reads.
VERSIONS = ("1.8", "1.4")
#: ``validity`` of a signal that applies to no lane of its road.
NO_LANE = (0,)
Heads = frozenset[int]
#: New lane ids: (road's old id, section, old lane) -> (road's new id, new lane).
_Renamed = Mapping[tuple[int, int, int], tuple[int, int]]


@dataclass(frozen=True)
class _Part:
    """The lanes of a road that become one road.

    Attributes:
        road: the original road.
        id: id of the new road.
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


def write_opendrive(
    model: LaneModel, frame: SiteFrame, path: Path, *, version: str = "1.8", name: str
) -> None:
    """Write a lane model as an OpenDRIVE file, atomically.

    Ids are those of the model. In 1.4, which is for CARLA, the model is adapted: left-hand traffic
    becomes right-hand traffic (``as_right_hand_traffic``), crosswalks avoid lane offsets
    (``with_carla_crosswalks``), signs get the numbers that CARLA knows (``with_carla_signs``), and
    controllers become stages (``with_carla_stages``).

    Args:
        model: the lane model, with heights.
        frame: the site frame, which becomes the file's ``geoReference``.
        path: the ``.xodr`` to write.
        version: ``1.8``, or ``1.4`` for CARLA.
        name: name of the map.

    Raises:
        InputError: the version is not supported, or the model has no roads.
    """
    if version not in VERSIONS:
        raise InputError(
            f"OpenDRIVE {version!r} is not written", expected=f"one of {', '.join(VERSIONS)}"
        )
    if not model.roads:
        raise InputError("there are no roads to write", file=path)
    if version == "1.4":
        model = with_carla_crosswalks(as_right_hand_traffic(model))
        model = with_carla_signs(with_carla_stages(model))
    content = document(model, frame, version=version, name=name)
    with replaced_file(path, kind="opendrive") as scratch:
        scratch.write_bytes(content)


def with_carla_stages(model: LaneModel) -> LaneModel:
    """Return a lane model with one controller per stage of each program.

    The heads of a stage have green together in some phase of the program. Stages are as few as
    possible, in the order of those phases. A pedestrian head belongs to a vehicle stage with which
    it has green. Without a known program, each incoming road is a stage.

    Every signal gets lanes: for one without, CARLA would assume lanes of the opposite direction
    (``MapBuilder::GenerateDefaultValiditiesForSignalReferences``), and pedestrian heads would stop
    vehicles.
    """
    model = replace(model, signals=tuple(_with_lanes(model, signal) for signal in model.signals))
    heads = {signal.id: signal for signal in model.signals if signal.dynamic}
    number = model.next_id
    controllers: list[SignalController] = []
    for light in model.controllers:
        for k, stage in enumerate(_stages(light, [heads[k] for k in light.signals if k in heads])):
            signals = tuple(k for k in light.signals if k in stage)
            controllers.append(replace(light, id=number if k else light.id, signals=signals))
            number += bool(k)
    return replace(model, controllers=tuple(controllers))


def _with_lanes(model: LaneModel, signal: RoadSignal) -> RoadSignal:
    if signal.lanes:
        return signal
    if signal.type == WALKER_LIGHTS:
        return replace(signal, lanes=NO_LANE)
    section = model.road_by_id[signal.road].section_at(signal.s)
    lanes = (
        lane.id
        for lane in section.lanes
        if lane.kind in DRIVEN and signal.orientation != ("-" if lane.forward else "+")
    )
    return replace(signal, lanes=tuple(sorted(lanes)) or NO_LANE)


def _stages(program: SignalController, heads: Iterable[RoadSignal]) -> list[Heads]:
    """Return the heads of each stage."""
    heads = list(heads)
    walkers = frozenset(head.id for head in heads if head.type == WALKER_LIGHTS)
    vehicles = frozenset(head.id for head in heads) - walkers
    shown = {head.id: _green(program, head) for head in heads}
    green = [
        frozenset(head for head, lit in shown.items() if lit[number])
        for number in range(len(program.phases))
    ]
    covered = _covered(green, vehicles)
    left_over = set(walkers)
    for number, stage in enumerate(covered):
        also = {head for phase in green if stage <= phase for head in left_over & phase}
        covered[number] = stage | also
        left_over -= also
    covered += _covered(green, frozenset(left_over))
    covered.sort(key=lambda stage: next(k for k, phase in enumerate(green) if stage & phase))
    # Never green, or without a known program.
    never_green = [head for head in heads if not any(head.id in stage for stage in covered)]
    roads = sorted({head.road for head in never_green})
    return covered + [
        frozenset(head.id for head in never_green if head.road == road) for road in roads
    ]


def _green(program: SignalController, head: RoadSignal) -> list[bool]:
    """Return in which phases a head is green: by all its links, else by the longest one."""
    links = [
        [state[link : link + 1] in ("G", "g") for _, state in program.phases] for link in head.links
    ]
    every = [bool(links) and all(lit) for lit in zip(*links, strict=True)]
    if any(every):
        return every
    return max(links, key=lambda lit: _seconds(program, lit), default=[False] * len(program.phases))


def _seconds(program: SignalController, lit: list[bool]) -> float:
    return sum(
        seconds for (seconds, _), is_green in zip(program.phases, lit, strict=True) if is_green
    )


def _covered(green: list[Heads], wanted: Heads) -> list[Heads]:
    """Return sets of heads that are green at once, largest first, until all are included."""
    uncovered, groups = wanted, []
    while largest := max((phase & uncovered for phase in green), key=len, default=frozenset()):
        groups.append(largest)
        uncovered -= largest
    return groups


def as_right_hand_traffic(model: LaneModel) -> LaneModel:
    """Return a lane model of left-hand traffic in the form of right-hand traffic.

    A road keeps its id. If it is split, the lanes along the reference line keep it, and the others
    get a new id. A model of right-hand traffic is returned unchanged.
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
        renamed_lanes = [
            renamed[road.id, k, lane] for lane in signal.lanes if (road.id, k, lane) in renamed
        ]
        along = signal.orientation != "-"
        choice = [part for part in parts if part.road is road]
        target = (
            renamed_lanes[0][0]
            if renamed_lanes
            else next((p.id for p in choice if p.along == along), road.id)
        )
        lanes = tuple(lane for number, lane in renamed_lanes if number == target)
        signals.append(replace(signal, road=target, lanes=lanes))
    return replace(
        model, driving_side="right", roads=roads, junctions=junctions, signals=tuple(signals)
    )


def _sides(road: ModelRoad) -> list[tuple[bool, tuple[int, ...]]]:
    """Return the parts of a road: whether traffic runs along the line, and the sides."""
    driven = {
        1 if lane.id > 0 else -1
        for section in road.sections
        for lane in section.lanes
        if lane.kind in DRIVEN
    }
    if len(driven) == 2:
        return [(True, (1,)), (False, (-1,))]
    # One direction only, or none: the lanes beside it stay with it.
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
        # The line on the new outer border: the right one along the reference line, else the left
        # one.
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
    part_lanes = part.lanes(section)
    inner = part_lanes[0 if part.along else -1] if part_lanes else None
    centre = ("none", "none")
    if inner is not None:
        centre = _line(section, ordered, inner, left=part.along)
    return LaneSection(section.s, tuple(lanes), *centre)


def _line(
    section: LaneSection, ordered: list[SectionLane], lane: SectionLane, *, left: bool
) -> tuple[str, str]:
    """Return the mark on one border of a lane and the lane changes permitted over it."""
    if (lane.id > 0) == left:
        return lane.mark, lane.change
    inner = section.by_id.get(lane.id + (-1 if lane.id > 0 else 1))
    if inner is None:
        return section.centre_mark, section.centre_change
    return inner.mark, inner.change


def _offset(part: _Part) -> Profile:
    """Return the lane offset to the border from which the lanes of a part are counted."""
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


def _linked_section(
    road: ModelRoad, k: int, model: LaneModel, *, ahead: bool
) -> tuple[ModelRoad, int] | None:
    """Return road and section that a section's lanes are linked to at one end."""
    inner = k + (1 if ahead else -1)
    if 0 <= inner < len(road.sections):
        return road, inner
    link = road.successor if ahead else road.predecessor
    if link is None or link.element != "road" or link.id not in model.road_by_id:
        return None
    other = model.road_by_id[link.id]
    return other, 0 if link.contact == "start" else len(other.sections) - 1


def _renumbered(
    road: ModelRoad,
    k: int,
    lane: int | None,
    model: LaneModel,
    renamed: _Renamed,
    *,
    ahead: bool,
) -> int | None:
    linked = _linked_section(road, k, model, ahead=ahead)
    if lane is None or linked is None:
        return None
    return renamed.get((linked[0].id, linked[1], lane), (0, None))[1]


def _link(
    part: _Part, link: RoadLink | None, model: LaneModel, renamed: _Renamed, *, ahead: bool
) -> RoadLink | None:
    """Return the link of a part; to a split road, it is to the part that its lanes lead to."""
    if link is None or link.element != "road":
        return link
    road = part.road
    k = len(road.sections) - 1 if ahead else 0
    linked = _linked_section(road, k, model, ahead=ahead)
    if linked is None:
        return link
    for lane in sorted(part.lanes(road.sections[k]), key=lambda e: e.kind not in DRIVEN):
        other = lane.successor if ahead else lane.predecessor
        if other is not None and (linked[0].id, linked[1], other) in renamed:
            return replace(link, id=renamed[linked[0].id, linked[1], other][0])
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
    """Yield a connection for each pair of parts that its lanes link."""
    connecting = model.road_by_id[connection.connecting]
    k = 0 if connection.contact == "start" else len(connecting.sections) - 1
    linked = _linked_section(connecting, k, model, ahead=connection.contact == "end")
    if linked is None or linked[0].id != connection.incoming:
        incoming = model.road_by_id[connection.incoming]
        linked = incoming, len(incoming.sections) - 1
    links: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, second in connection.links:
        start = renamed.get((linked[0].id, linked[1], first))
        end = renamed.get((connecting.id, k, second))
        if start is not None and end is not None:
            links.setdefault((start[0], end[0]), []).append((start[1], end[1]))
    for (incoming_id, connecting_id), pairs in links.items():
        yield Connection(incoming_id, connecting_id, connection.contact, tuple(pairs))
