"""What is painted and raised on roads, as lines and areas in plan.

The lane model says it all. Of a twin without one only what the lane network tells is known: lanes
side by side, stop lines where signals stop traffic, zebras.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import Lane, RoadNetwork
from urbantwin.roads.model import LaneModel, ModelRoad, RoadSignal

__all__ = ["Head", "Line", "Sign", "heads", "islands", "lane_marks", "signs", "stop_lines", "turns"]

#: Longest chord of a drawn line where its road bends or its lanes change, metres.
CHORD_M = 1.0
#: A change of heading up to this is no turn, from here to ``U_TURN`` it is one, radians.
STRAIGHT, U_TURN = np.radians(30.0), np.radians(150.0)
#: Kinds of lanes that motor traffic drives on.
MOTOR = ("driving", "bus")


@dataclass(frozen=True)
class Line:
    """A line on the road.

    Attributes:
        kind: ``solid``, ``broken``, ``curb`` or ``stop``.
        points: (N, 2), site frame, metres.
        level: 0 on the ground, 1, 2, ... above other roads.
        lane: id of the strip that it belongs to; empty where it belongs to none.
        signal: id of the signal program that stops traffic there; empty where none does.
    """

    kind: str
    points: NDArray[np.float64]
    level: int = 0
    lane: str = ""
    signal: str = ""


@dataclass(frozen=True)
class Sign:
    """A sign that does not change.

    Attributes:
        name: for people.
        country, type, subtype, value, unit: what it says (``roads.model.RoadSignal``).
        x, y: its place, site frame, metres.
        yaw: heading of the traffic that it is for, radians.
    """

    name: str
    country: str
    type: str
    subtype: str
    value: float
    unit: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Head:
    """A head of a signal.

    Attributes:
        type: OpenDRIVE's number of it; empty where it is not known.
        program: id of its signal program.
        links: what it shows: indices into the program's states.
        lane: id of the strip that it governs; empty where that is not known.
        z: height of its middle above the road, metres; 0 where it is not known.
        x, y: its place, site frame, metres.
        yaw: heading of the traffic that it is for, radians.
    """

    type: str
    program: str
    links: tuple[int, ...]
    lane: str
    z: float
    x: float
    y: float
    yaw: float


def lane_marks(network: RoadNetwork, model: LaneModel | None) -> list[Line]:
    """Return the lines along lanes: painted ones and curbs."""
    if model is None:
        return list(_marks_of_strips(network))
    return [line for road in model.roads if road.junction < 0 for line in _marks_of_road(road)]


def stop_lines(network: RoadNetwork, model: LaneModel | None) -> list[Line]:
    """Return the lines at which traffic stops, from its right to its left or the reverse."""
    found = []
    stopped = {head.lane: head.program for head in network.signals}
    for area in model.areas if model else ():
        if model is None or area.name != "StopLine" or len(area.corners) < 2:
            continue
        corners = shapely.MultiPoint(_placed(model, area.road, area.s, area.corners))
        along = _long_axis(corners)
        if along is not None:
            found.append(
                Line(
                    "stop",
                    along,
                    model.road_by_id[area.road].level,
                    area.strip,
                    stopped.get(area.strip, ""),
                )
            )
    if found:
        return found
    for head in network.signals:
        lane = network.lane_by_id.get(head.lane)
        if lane is not None and lane.kind != "crossing":
            across = np.array([-np.sin(head.yaw), np.cos(head.yaw)]) * lane.width / 2
            middle = np.array([head.x, head.y])
            ends = np.array([middle - across, middle + across])
            found.append(Line("stop", ends, lane.level, lane.id, head.program))
    return found


def islands(network: RoadNetwork, model: LaneModel | None) -> list[tuple[str, shapely.Polygon]]:
    """Return raised areas between lanes: their kind (``median``, ``island``) and outline."""
    found = [
        (lane.kind, lane.polygon) for lane in network.lanes if lane.kind in ("median", "island")
    ]
    for area in model.areas if model else ():
        if model and area.kind == "trafficIsland" and len(area.corners) >= 3:
            outline = shapely.Polygon(_placed(model, area.road, area.s, area.corners))
            found.append(("island", shapely.make_valid(outline)))
    return found


def signs(model: LaneModel | None) -> list[Sign]:
    """Return the signs of a lane model."""
    return [
        Sign(
            one.name, one.country, one.type, one.subtype, one.value, one.unit, *_stands(model, one)
        )
        for one in (model.signals if model else ())
        if model and not one.dynamic
    ]


def heads(network: RoadNetwork, model: LaneModel | None) -> list[Head]:
    """Return the heads of signals where they stand; without a lane model at their stop lines."""
    found = [
        Head(one.type, one.program, one.links, one.strip, one.z, *_stands(model, one))
        for one in (model.signals if model else ())
        if model and one.dynamic
    ]
    if found:
        return found
    return [Head("", h.program, h.links, h.lane, 0.0, h.x, h.y, h.yaw) for h in network.signals]


def _stands(model: LaneModel, signal: RoadSignal) -> tuple[float, float, float]:
    """Return place and heading of the traffic of a signal or sign."""
    x, y, heading = (float(value) for value in model.road_by_id[signal.road].curve.at(signal.s)[0])
    x, y = x - signal.t * np.sin(heading), y + signal.t * np.cos(heading)
    yaw = heading + (np.pi if signal.orientation == "-" else 0.0)
    return float(x), float(y), float((yaw + np.pi) % (2 * np.pi) - np.pi)


def turns(network: RoadNetwork, lane: Lane) -> tuple[str, ...]:
    """Return where traffic of a lane may go at its end: left, through, right, around.

    Nothing for a lane that ends at no junction.
    """
    found = set()
    start = _heading(lane.centre[-2:, :2])
    for name in lane.successors:
        way = network.lane_by_id.get(name)
        if way is None or not way.junction:
            continue
        for last in _ends_of_way(network, way):
            change = _heading(last.centre[-2:, :2]) - start
            change = (change + np.pi) % (2 * np.pi) - np.pi
            if abs(change) <= STRAIGHT:
                found.add("through")
            elif abs(change) >= U_TURN:
                found.add("around")
            else:
                found.add("left" if change > 0 else "right")
    return tuple(name for name in ("left", "through", "right", "around") if name in found)


def _ends_of_way(network: RoadNetwork, way: Lane, depth: int = 6) -> Iterator[Lane]:
    """Yield the last lane within the junction of every way on from one of its lanes."""
    following = [network.lane_by_id.get(name) for name in way.successors]
    inside = [lane for lane in following if lane and lane.junction == way.junction]
    if not inside or depth == 0:
        yield way
    else:
        for lane in inside:
            yield from _ends_of_way(network, lane, depth - 1)


def _heading(ends: NDArray[np.float64]) -> float:
    return float(np.arctan2(*(ends[1] - ends[0])[::-1]))


def _marks_of_road(road: ModelRoad) -> Iterator[Line]:
    for section, end in zip(road.sections, road.section_ends, strict=True):
        count = max(2, int(np.ceil((end - section.s) / CHORD_M)) + 1)
        s = np.linspace(section.s, end, count)
        if section.centre_mark != "none":
            yield Line(
                _kind(section.centre_mark), road.curve.beside(s, road.offset.at(s)), road.level
            )
        for lane in section.lanes:
            if lane.mark != "none":
                t = road.border(section, lane, s, outer=True)
                points = road.place(s, t)[:, :2]
                yield Line(_kind(lane.mark), points, road.level, lane.strip)


def _kind(mark: str) -> str:
    """OpenDRIVE's names of lane marks as what is drawn."""
    if "curb" in mark:
        return "curb"
    return "broken" if mark.startswith("broken") or mark == "botts dots" else "solid"


def _marks_of_strips(network: RoadNetwork) -> Iterator[Line]:
    """Lines between lanes side by side that run in one direction."""
    side = 1.0 if network.driving_side == "right" else -1.0
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes if name in network.lane_by_id]
        for lane, inner in pairwise(lanes):
            if "sidewalk" in (lane.kind, inner.kind):
                continue
            both = lane.kind in MOTOR and inner.kind in MOTOR
            line = shapely.LineString(lane.centre[:, :2]).offset_curve(
                side * lane.width / 2, join_style="mitre"
            )
            for part in shapely.get_parts(line):
                points = shapely.get_coordinates(part)
                if len(points) >= 2:
                    yield Line("broken" if both else "solid", points, lane.level, lane.id)


def _placed(
    model: LaneModel, road: int, s: float, corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return corners (N, 2) in the site frame of corners ahead and to the left of a station."""
    x, y, heading = model.road_by_id[road].curve.at(s)[0]
    c, sn = np.cos(heading), np.sin(heading)
    return np.asarray(np.array([x, y]) + corners[:, :2] @ np.array([[c, sn], [-sn, c]]))


def _long_axis(corners: shapely.MultiPoint) -> NDArray[np.float64] | None:
    """Return the ends (2, 2) of the line along the middle of a narrow area."""
    frame = shapely.oriented_envelope(corners)
    if frame.geom_type == "LineString":
        return np.asarray(shapely.get_coordinates(frame)[:2])
    if frame.geom_type != "Polygon":
        return None
    ring = shapely.get_coordinates(frame)[:4]
    if np.linalg.norm(ring[1] - ring[0]) < np.linalg.norm(ring[2] - ring[1]):
        ring = np.roll(ring, -1, axis=0)
    return np.array([(ring[0] + ring[3]) / 2, (ring[1] + ring[2]) / 2])
