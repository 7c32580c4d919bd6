"""Objects on roads: crosswalks, stop lines, signals and their controllers."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.lane_polylines import SurfaceHeight
from urbantwin.roads.model import (
    LaneModel,
    LaneSection,
    ModelRoad,
    RoadArea,
    RoadSignal,
    SectionLane,
    SignalController,
)
from urbantwin.roads.network import Lane, RoadNetwork, SignalHead

__all__ = ["with_furniture"]

#: Signal types of OpenDRIVE's own catalogue: three lights for vehicles, two for pedestrians.
VEHICLE_LIGHTS, WALKER_LIGHTS = "1000001", "1000002"
#: Height of signal heads above the road, metres (clearance of US MUTCD 4D.15: at least 4.6 m).
LIGHTS_M = {VEHICLE_LIGHTS: 5.0, WALKER_LIGHTS: 2.2}
#: Width of a stop line along the road, metres (US MUTCD 3B.16: 0.3 to 0.6 m).
STOP_LINE_M = 0.4
#: Reach of an end of a road, before and beyond it, within which crossings belong to it, metres.
REACH_M = 12.0


@dataclass(frozen=True)
class _Host:
    """An end of a street, as a candidate for a crossing."""

    road: ModelRoad
    junction: int
    line: shapely.LineString  # In plan, extended straight ahead: a crossing may lie beyond the end.


@dataclass(frozen=True)
class _LaneEnd:
    """A lane of the model, with the station where traffic leaves it."""

    road: ModelRoad
    section: LaneSection
    lane: SectionLane

    @property
    def end(self) -> float:
        return self.road.length if self.lane.forward else 0.0


def with_furniture(model: LaneModel, raw: RoadNetwork, height: SurfaceHeight) -> LaneModel:
    """Return the lane model with crosswalks, stop lines and signals.

    Args:
        model: the lane model, with heights.
        raw: the network that it was made from: crossings, signal heads, programs.
        height: heights of the surface.
    """
    junction_of = {name: j.id for j in model.junctions for name in j.members}
    places = _places(model)
    hosts = _hosts(model)
    crossed = [
        (lane, host)
        for lane in raw.lanes
        if lane.kind == "crossing" and (host := _crossed(lane, hosts, junction_of))
    ]
    first = model.next_id
    outlines = _outlines([lane for lane, _ in crossed], height)
    areas = [
        _crosswalk(number, lane, host, outline)
        for number, ((lane, host), outline) in enumerate(zip(crossed, outlines, strict=True), first)
    ]
    first_signal = first + len(areas) + len(raw.signals)
    signals: list[RoadSignal] = []
    of_program: dict[str, list[RoadSignal]] = defaultdict(list)
    junctions_of: dict[str, set[int]] = defaultdict(set)
    to_junction = {road.id: road.to_junction for road in raw.roads}
    for head in raw.signals:
        lane = raw.lane_by_id[head.lane]
        junction = junction_of.get(to_junction.get(lane.road, lane.junction), -1)
        place = places.get(head.lane)
        number = first_signal + len(signals)
        if place is not None and place.road.junction < 0:
            signal = _at_stop_line(number, place, head)
            areas.append(_stop_line(first + len(areas), place))
        elif lane.kind != "crossing" and not lane.allowed:
            # Closed lanes between two parts of a junction have no signals.
            continue
        else:
            inner = _inner_signal(number, model, junction, head, walkers=lane.kind == "crossing")
            if inner is None:
                continue
            signal = inner
        signals.append(signal)
        of_program[head.program].append(signal)
        junctions_of[head.program].add(junction)
    first_controller = first_signal + len(signals)
    programs = [program for program in raw.programs if of_program[program.id]]
    controllers = tuple(
        SignalController(
            first_controller + k,
            program.id,
            tuple(signal.id for signal in of_program[program.id]),
            tuple(sorted(junctions_of[program.id] - {-1})),
            program.offset,
            program.phases,
        )
        for k, program in enumerate(programs)
    )
    return replace(model, areas=tuple(areas), signals=tuple(signals), controllers=controllers)


def _places(model: LaneModel) -> dict[str, _LaneEnd]:
    """Return a map from each strip to the lane where its traffic leaves the road."""
    ends: dict[str, _LaneEnd] = {}
    for road in model.roads:
        for section in road.sections:
            for lane in section.directed:
                for name in lane.strip.split():
                    if name not in ends or lane.forward:
                        ends[name] = _LaneEnd(road, section, lane)
    return ends


def _hosts(model: LaneModel) -> list[_Host]:
    hosts = []
    for road in model.roads:
        if road.junction >= 0:
            continue
        for station, link in ((0.0, road.predecessor), (road.length, road.successor)):
            ahead = REACH_M if station else -REACH_M
            x, y, heading = road.curve.pose(station)
            outer = (x + ahead * math.cos(heading), y + ahead * math.sin(heading))
            inner = road.curve.pose(station - ahead)
            line = shapely.LineString([inner[:2], (x, y), outer])
            at_junction = link is not None and link.element == "junction"
            hosts.append(_Host(road, link.id if link and at_junction else -1, line))
    return hosts


def _crossed(lane: Lane, hosts: Sequence[_Host], junction_of: Mapping[str, int]) -> _Host | None:
    """Return the end of a street that a crossing lies across, at the largest angle.

    Connecting roads are excluded: on them, CARLA measures from the lane offset, contrary to the
    standard.
    """
    middle = shapely.LineString(lane.centre[:, :2])
    chord = lane.centre[-1, :2] - lane.centre[0, :2]
    junction = junction_of.get(lane.junction)
    best: tuple[float, int] | None = None
    for k, host in enumerate(hosts):
        if host.road.level != lane.level or host.junction != junction:
            continue
        leg = np.diff(np.array(host.line.coords)[[0, -1]], axis=0)[0]
        angle = math.atan2(chord[1], chord[0]) - math.atan2(leg[1], leg[0])
        cost = float(host.line.distance(middle)) + 4.0 * (1.0 - abs(math.sin(angle)))
        if best is None or cost < best[0] - 1e-9:
            best = (cost, k)
    return None if best is None else hosts[best[1]]


def _outlines(lanes: Sequence[Lane], height: SurfaceHeight) -> list[NDArray[np.float64]]:
    """Return the outlines (N, 3) of crossings on the surface, site frame."""
    outlines = [_corners(lane) for lane in lanes]
    for level in sorted({lane.level for lane in lanes}):
        on_level = [k for k, lane in enumerate(lanes) if lane.level == level]
        z = height(np.concatenate([outlines[k] for k in on_level]), level)
        ends = np.cumsum([len(outlines[k]) for k in on_level])
        for k, part in zip(on_level, np.split(z, ends[:-1]), strict=True):
            outlines[k] = np.column_stack([outlines[k], part])
    return outlines


def _crosswalk(number: int, lane: Lane, host: _Host, outline: NDArray[np.float64]) -> RoadArea:
    road = host.road
    other = shapely.LineString(lane.centre[:, :2])
    point = shapely.get_coordinates(shapely.shortest_line(host.line, other))[0]
    s = float(np.clip(road.curve.locate(point[None])[0][0], 0.0, road.length))
    corners = _local(road, s, outline)
    return RoadArea(
        number,
        road.id,
        "crosswalk",
        "crosswalk",
        s,
        corners,
        strip=lane.id,
        marking=lane.marking,
    )


def _corners(lane: Lane) -> NDArray[np.float64]:
    """Return the outline (N, 2) of a crossing, counter-clockwise, not closed."""
    polygon = lane.polygon
    if polygon.geom_type != "Polygon":
        polygon = polygon.convex_hull
    outline = shapely.orient_polygons(polygon.simplify(0.01)).exterior
    return np.asarray(shapely.get_coordinates(outline))[:-1]


def _local(road: ModelRoad, s: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, heading = road.curve.pose(s)
    gap = points - [x, y, float(road.elevation.at(s)[0])]
    c, sn = math.cos(heading), math.sin(heading)
    return np.column_stack(
        [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, gap[:, 2]]
    )


def _stop_line(number: int, place: _LaneEnd) -> RoadArea:
    road, lane, end = place.road, place.lane, place.end
    back = -STOP_LINE_M if lane.forward else STOP_LINE_M
    s = np.clip([end + back, end + back, end, end], 0.0, road.length)
    inner = road.border(place.section, lane, s, outer=False)
    outer = road.border(place.section, lane, s, outer=True)
    left, right = np.maximum(inner, outer), np.minimum(inner, outer)
    t = np.array([left[0], right[1], right[2], left[3]])
    corners = road.place(s, t)
    if not lane.forward:
        corners = corners[::-1]
    return RoadArea(
        number,
        road.id,
        "roadMark",
        "StopLine",
        end,
        _local(road, end, corners),
        strip=lane.strip,
    )


def _at_stop_line(number: int, place: _LaneEnd, head: SignalHead) -> RoadSignal:
    t = float(place.road.middle(place.section, place.lane, place.end)[0])
    sign = "+" if place.lane.forward else "-"
    return _signal(number, place.road, VEHICLE_LIGHTS, place.end, t, sign, (place.lane.id,), head)


def _inner_signal(
    number: int, model: LaneModel, junction: int, head: SignalHead, *, walkers: bool
) -> RoadSignal | None:
    """Return a signal on its lane's connecting road, else on the nearest of the junction."""
    roads = [road for road in model.roads if road.junction >= 0 and road.junction == junction]
    if not roads:
        return None
    through = [r for r in roads if head.lane in r.sections[0].lanes[0].strip.split()]
    point = shapely.Point(head.x, head.y)
    road = min(
        through or roads, key=lambda r: (round(float(r.curve.line.distance(point)), 3), r.id)
    )
    s, t = (float(v[0]) for v in road.curve.locate([[head.x, head.y]]))
    s = float(np.clip(s, 0.0, road.length))
    if walkers:
        return _signal(number, road, WALKER_LIGHTS, s, t, "none", (), head)
    lane = road.sections[0].lanes[0].id
    return _signal(number, road, VEHICLE_LIGHTS, s, 0.0, "+", (lane,), head)


def _signal(
    number: int,
    road: ModelRoad,
    kind: str,
    s: float,
    t: float,
    orientation: str,
    lanes: tuple[int, ...],
    head: SignalHead,
) -> RoadSignal:
    return RoadSignal(
        id=number,
        road=road.id,
        name="links " + " ".join(map(str, head.links)),
        dynamic=True,
        country="OpenDRIVE",
        type=kind,
        subtype="-1",
        value=-1.0,
        unit="",
        s=s,
        t=t,
        z=LIGHTS_M[kind],
        orientation=orientation,
        lanes=lanes,
        program=head.program,
        links=head.links,
        strip=head.lane,
    )
