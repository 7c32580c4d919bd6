"""Approaches of signalised junctions, in the frame of their traffic."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.model import (
    LaneModel,
    ModelRoad,
    RoadArea,
    RoadSignal,
    SectionLane,
    SignalController,
)

__all__ = ["Approach", "Exit", "Frame", "WaitingLane", "approaches_of", "stop_lines_within"]

#: Movements with a smaller turn lead straight on, radians.
STRAIGHT = math.radians(50.0)
#: Width of a stop line along the road, metres (US MUTCD 3B.16: 0.3 to 0.6 m).
STOP_LINE_M = 0.4


@dataclass(frozen=True)
class Frame:
    """A frame at a point: u ahead, v to the left, metres; ``heading`` in radians."""

    x: float
    y: float
    heading: float

    def place(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.float64]:
        """Return points (N, 2) in the site frame."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        u, v = np.broadcast_arrays(np.asarray(u, np.float64), np.asarray(v, np.float64))
        return np.column_stack(
            [self.x + np.ravel(u) * c - np.ravel(v) * s, self.y + np.ravel(u) * s + np.ravel(v) * c]
        )

    def locate(self, xy: ArrayLike) -> tuple[float, float]:
        """Return u, v of a point in the site frame."""
        dx, dy = np.asarray(xy, np.float64) - [self.x, self.y]
        c, s = math.cos(self.heading), math.sin(self.heading)
        return float(dx * c + dy * s), float(dy * c - dx * s)


@dataclass(frozen=True)
class WaitingLane:
    """A lane that waits at a signal.

    Attributes:
        signal: the lane's signal at the stop line.
        v: offset of the lane's centre to the left in the approach's frame, metres.
        half: half its width, metres.
        shown: states that it sees over the program: equal for lanes that go together.
    """

    signal: RoadSignal
    v: float
    half: float
    shown: tuple[str, ...]


@dataclass(frozen=True)
class Exit:
    """The exit for straight-on traffic: a frame, and the outer border of its outermost lane."""

    frame: Frame
    outer: float


@dataclass(frozen=True)
class Approach:
    """One direction of a street before a signalised junction.

    Attributes:
        program: id of its signal program.
        road: the street.
        forward: whether its traffic runs along the street's reference line.
        frame: at the street's end on its reference line, in the direction of travel.
        line: distance of the stop line beyond that end, metres: 0 except in combined junctions.
        lanes: the waiting lanes, from the kerb inwards.
        outward: 1 where the kerb is on the left of traffic, else -1.
        exit: the exit straight on beyond the junction, if any.
    """

    program: str
    road: ModelRoad
    forward: bool
    frame: Frame
    line: float
    lanes: tuple[WaitingLane, ...]
    outward: int
    exit: Exit | None

    @cached_property
    def kerb(self) -> float:
        """Offset of the outermost lane's outer border to the left in the frame, metres."""
        outer = self.lanes[0]
        return outer.v + self.outward * outer.half

    @property
    def s(self) -> float:
        """Station of the street's end, metres."""
        return self.road.length if self.forward else 0.0

    @cached_property
    def groups(self) -> list[list[WaitingLane]]:
        """Groups of lanes with the same states, from the kerb inwards."""
        groups: dict[tuple[str, ...], list[WaitingLane]] = defaultdict(list)
        for lane in self.lanes:
            groups[lane.shown].append(lane)
        return list(groups.values())


def approaches_of(model: LaneModel) -> list[Approach]:
    """Return all approaches whose lanes have signals at their stop lines.

    A stop line may lie within a junction that combines several of SUMO's. Its lanes are then those
    of the street that leads there.
    """
    outward = -1 if model.driving_side == "right" else 1
    shows = {controller.name: controller for controller in model.controllers}
    signals_of: dict[tuple[str, int, bool], list[RoadSignal]] = defaultdict(list)
    entries = _entries(model)
    for signal in model.signals:
        road = model.road_by_id[signal.road]
        if not signal.dynamic or not signal.lanes or signal.orientation not in "+-":
            continue
        if road.junction < 0:
            signals_of[signal.program, road.id, signal.orientation == "+"].append(signal)
            continue
        for name in signal.strip.split():
            for number, forward, lane in sorted(entries.get(name, ())):
                signals_of[signal.program, number, forward].append(replace(signal, lanes=(lane,)))
    result = []
    for (program, number, forward), signals in sorted(signals_of.items()):
        road = model.road_by_id[number]
        s = road.length if forward else 0.0
        x, y, heading = road.curve.pose(s)
        frame = Frame(x, y, heading + (0.0 if forward else math.pi))
        lanes = [_waiting(model, frame, signal, shows.get(program)) for signal in signals]
        lanes.sort(key=lambda lane: -outward * lane.v)
        within = [signal for signal in signals if signal.road != number]
        ahead = [frame.locate(_position(model, signal))[0] for signal in within]
        exit_ = _exit(model, road, frame, forward, outward)
        result.append(
            Approach(
                program,
                road,
                forward,
                frame,
                max(0.0, *ahead) if ahead else 0.0,
                tuple(lanes),
                outward,
                exit_,
            )
        )
    return result


def stop_lines_within(model: LaneModel, approaches: Sequence[Approach]) -> list[RoadArea]:
    """Return the stop lines of lanes that end within a junction, with new ids."""
    signals = {
        lane.signal.strip: lane.signal
        for approach in approaches
        for lane in approach.lanes
        if lane.signal.road != approach.road.id
    }
    areas: list[RoadArea] = []
    for strip, signal in sorted(signals.items()):
        road = model.road_by_id[signal.road]
        lane = _lane_of(road, signal)
        section = road.section_at(min(signal.s, road.length - 1e-6))
        sides = [float(road.border(section, lane, signal.s, outer=o)[0]) for o in (False, True)]
        s = np.maximum(signal.s - np.array([STOP_LINE_M, STOP_LINE_M, 0.0, 0.0]), 0.0)
        t = np.array([max(sides), min(sides), min(sides), max(sides)])
        x, y, heading = road.curve.pose(signal.s)
        points = road.place(s, t)
        local = [Frame(x, y, heading).locate(point[:2]) for point in points]
        up = points[:, 2] - float(road.elevation.at(signal.s)[0])
        corners = np.column_stack([local, up])
        number = model.next_id + len(areas)
        areas.append(
            RoadArea(number, road.id, "roadMark", "StopLine", signal.s, corners, strip=strip)
        )
    return areas


def _entries(model: LaneModel) -> dict[str, set[tuple[int, bool, int]]]:
    """Return strip within a junction -> the streets that lead there, with direction and lane."""
    entries: dict[str, set[tuple[int, bool, int]]] = defaultdict(set)
    for junction in model.junctions:
        for connection in junction.connections:
            road = model.road_by_id.get(connection.connecting)
            street = model.road_by_id.get(connection.incoming)
            if road is None or street is None:
                continue
            link = road.predecessor if connection.contact == "start" else road.successor
            forward = link is not None and link.contact == "end"
            for section in road.sections:
                for start, lane in connection.links:
                    strip = section.by_id[lane].strip if lane in section.by_id else ""
                    for name in strip.split():
                        entries[name].add((street.id, forward, start))
    return entries


def _position(model: LaneModel, signal: RoadSignal) -> NDArray[np.float64]:
    road = model.road_by_id[signal.road]
    return np.asarray(road.place(signal.s, signal.t)[0, :2])


def _lane_of(road: ModelRoad, signal: RoadSignal) -> SectionLane:
    """Return the lane that a signal at its stop line applies to."""
    section = road.section_at(min(signal.s, road.length - 1e-6))
    names = set(signal.strip.split())
    return next(
        (lane for lane in section.directed if names & set(lane.strip.split())), section.lanes[0]
    )


def _waiting(
    model: LaneModel, frame: Frame, signal: RoadSignal, shows: SignalController | None
) -> WaitingLane:
    road = model.road_by_id[signal.road]
    section = road.section_at(min(signal.s, road.length - 1e-6))
    lane = _lane_of(road, signal)
    inner, outer = (float(road.border(section, lane, signal.s, outer=o)[0]) for o in (False, True))
    middle = road.place(signal.s, (inner + outer) / 2)[0, :2]
    return WaitingLane(
        signal, frame.locate(middle)[1], abs(outer - inner) / 2, _shown(signal, shows)
    )


def _shown(signal: RoadSignal, shows: SignalController | None) -> tuple[str, ...]:
    """Return the states over time of a lane's main link, the one with the longest green."""
    if shows is None or not shows.phases or not signal.links:
        return ()

    def green(link: int) -> float:
        return sum(
            seconds for seconds, state in shows.phases if state[link : link + 1] in ("G", "g")
        )

    main = max(signal.links, key=lambda link: (green(link), -link))
    return tuple(state[main : main + 1].lower() for _, state in shows.phases)


def _exit(
    model: LaneModel, road: ModelRoad, frame: Frame, forward: bool, outward: int
) -> Exit | None:
    link = road.successor if forward else road.predecessor
    junction = model.junction_by_id.get(link.id) if link and link.element == "junction" else None
    if junction is None:
        return None
    best: tuple[float, Frame, ModelRoad] | None = None
    for connection in junction.connections:
        via = model.road_by_id.get(connection.connecting)
        if connection.incoming != road.id or via is None:
            continue
        end_m = via.length if connection.contact == "start" else 0.0
        x, y, heading = via.curve.pose(end_m)
        end = Frame(x, y, heading + (0.0 if end_m else math.pi))
        turn = abs(wrapped(end.heading - frame.heading))
        u, _ = frame.locate((x, y))
        if turn < STRAIGHT and u > 3.0 and (best is None or turn < best[0] - 1e-6):
            best = (turn, end, via)
    if best is None:
        return None
    _, end, via = best
    other = via.successor if via.predecessor and via.predecessor.id == road.id else via.predecessor
    street = model.road_by_id.get(other.id) if other and other.element == "road" else None
    if street is None:
        return Exit(end, outward * 2.0)
    at_start = other is not None and other.contact == "start"
    section = street.sections[0 if at_start else -1]
    s = 0.0 if at_start else street.length
    borders = [
        float(street.border(section, lane, s, outer=o)[0]) * (1 if at_start else -1)
        for lane in section.directed
        if lane.kind in ("driving", "bus", "bicycle") and lane.forward == at_start
        for o in (False, True)
    ]
    x, y, heading = street.curve.pose(s)
    base = Frame(x, y, heading + (0.0 if at_start else math.pi))
    return Exit(base, max((outward * b for b in borders), default=2.0) * outward)
