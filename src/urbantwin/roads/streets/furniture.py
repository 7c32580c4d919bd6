"""What stands on and is painted on roads: crosswalks, stop lines, signals and their controllers."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model.curve import Curve
from urbantwin.roads.model.profile import Profile
from urbantwin.roads.network import Lane, RoadNetwork, SignalHead, SignalProgram
from urbantwin.roads.streets.manoeuvre import Manoeuvre, Topology
from urbantwin.roads.streets.street import Street

__all__ = ["Area", "Controller", "Furniture", "Signal", "furnish"]

#: Types of signals in OpenDRIVE's own catalogue: three lights for vehicles, two for people on foot.
VEHICLE_LIGHTS, WALKER_LIGHTS = "1000001", "1000002"
#: Width of a stop line along the road, metres (US MUTCD 3B.16: 0.3 to 0.6 m).
STOP_LINE_M = 0.4
#: How far before the end of a road a crossing may lie, metres.
_REACH_M = 12.0


@dataclass(frozen=True)
class Area:
    """A painted area.

    Attributes:
        number: id in OpenDRIVE.
        road: the road that it lies on.
        kind, name: type and name in OpenDRIVE.
        s: its origin, on the reference line.
        corners: (N, 3) outline in the road's frame there: ahead, left, up.
    """

    number: int
    road: int
    kind: str
    name: str
    s: float
    corners: NDArray[np.float64]


@dataclass(frozen=True)
class Signal:
    """A signal on a road.

    Attributes:
        number: id in OpenDRIVE.
        road: the road that it stands on.
        type: its type in OpenDRIVE's catalogue.
        s, t: its place.
        orientation: ``+``, ``-`` or ``none``: which traffic it is for.
        lanes: the lanes that it governs, as ids; empty for a crossing.
        links: what it shows: indices into the program's states.
    """

    number: int
    road: int
    type: str
    s: float
    t: float
    orientation: str
    lanes: tuple[int, ...]
    links: tuple[int, ...]


@dataclass(frozen=True)
class Controller:
    """What switches signals together; ``junctions`` are those where they stand."""

    number: int
    program: SignalProgram
    signals: tuple[int, ...]
    junctions: tuple[str, ...]


@dataclass(frozen=True)
class Furniture:
    """Everything on the roads, and the crossings and heads that found no road."""

    areas: tuple[Area, ...]
    signals: tuple[Signal, ...]
    controllers: tuple[Controller, ...]
    unplaced: tuple[str, ...]


@dataclass(frozen=True)
class _Host:
    """A road as something to stand on."""

    number: int
    curve: Curve
    elevation: Profile
    junction: str
    level: int
    line: shapely.LineString  # in plan, drawn out straight where a crossing may lie before its end


def furnish(
    network: RoadNetwork,
    streets: Sequence[Street],
    manoeuvres: Sequence[Manoeuvre],
    topology: Topology,
) -> Furniture:
    """Place crosswalks, stop lines and signals on roads."""
    street_of = {name: street for street in streets for name in street.strip_of}
    through: dict[str, list[Manoeuvre]] = defaultdict(list)
    for manoeuvre in manoeuvres:
        for name in manoeuvre.route.via:
            through[name].append(manoeuvre)
    hosts = _hosts(streets, topology)
    areas: list[Area] = []
    unplaced: list[str] = []
    first = len(streets) + len(manoeuvres) + 1
    for lane in network.lanes:
        if lane.kind != "crossing":
            continue
        host = _crossed(lane, hosts, topology)
        if host is None:
            unplaced.append(lane.id)
            continue
        areas.append(_crosswalk(first + len(areas), network, lane, host))
    signals: list[Signal] = []
    of_program: dict[str, list[Signal]] = defaultdict(list)
    near: dict[str, set[str]] = defaultdict(set)
    first_signal = first + len(areas) + len(network.signals)
    for head in network.signals:
        junction = _junction(network, head, topology)
        within = through[head.lane] or [m for m in manoeuvres if m.junction == junction]
        walkers = network.lane_by_id[head.lane].kind == "crossing"
        place = _place(head, street_of, within, walkers=walkers)
        if place is None:
            unplaced.append(head.lane)
            continue
        signal = Signal(first_signal + len(signals), *place, head.links)
        signals.append(signal)
        of_program[head.program].append(signal)
        near[head.program].add(junction)
        street = street_of.get(head.lane)
        if street is not None:
            areas.append(_stop_line(first + len(areas), street, head, signal))
    number = first_signal + len(signals)
    controllers = tuple(
        Controller(
            number + k,
            program,
            tuple(signal.number for signal in of_program[program.id]),
            tuple(sorted(near[program.id] - {""})),
        )
        for k, program in enumerate(p for p in network.programs if of_program[p.id])
    )
    return Furniture(tuple(areas), tuple(signals), controllers, tuple(unplaced))


def _hosts(streets: Sequence[Street], topology: Topology) -> list[_Host]:
    roads = []
    for street in streets:
        level = street.strips[0].lane.level
        for station, name in ((0.0, street.start), (street.curve.length, street.end)):
            ahead = _REACH_M if station else -_REACH_M
            x, y, heading = street.curve.at(station)[0]
            outer = (x + ahead * math.cos(heading), y + ahead * math.sin(heading))
            inner = street.curve.at(float(np.clip(station - ahead, 0.0, street.curve.length)))[0]
            line = shapely.LineString([inner[:2], (x, y), outer])
            junction = topology.junction.get(name, name)
            roads.append(
                _Host(street.number, street.curve, street.elevation, junction, level, line)
            )
    return roads


def _crossed(lane: Lane, hosts: Sequence[_Host], topology: Topology) -> _Host | None:
    """Return the road whose end a crossing lies across, as squarely as possible.

    Not a connecting road: there CARLA measures from the lane offset, and the standard does not.
    """
    middle = shapely.LineString(lane.centre[:, :2])
    chord = lane.centre[-1, :2] - lane.centre[0, :2]
    junction = topology.junction.get(lane.junction, lane.junction)
    best: tuple[float, int] | None = None
    for k, host in enumerate(hosts):
        if host.level != lane.level or host.junction != junction:
            continue
        leg = np.diff(np.array(host.line.coords)[[0, -1]], axis=0)[0]
        angle = math.atan2(chord[1], chord[0]) - math.atan2(leg[1], leg[0])
        cost = float(host.line.distance(middle)) + 4.0 * (1.0 - abs(math.sin(angle)))
        if best is None or cost < best[0] - 1e-9:
            best = (cost, k)
    return None if best is None else hosts[best[1]]


def _meeting(host: _Host, lane: Lane) -> float:
    """Return the station of a road where a crossing lies, or of the end that it lies before."""
    other = shapely.LineString(lane.centre[:, :2])
    point = shapely.get_coordinates(shapely.shortest_line(host.line, other))[0]
    return float(np.clip(host.curve.locate(point[None])[0][0], 0.0, host.curve.length))


def _corners(lane: Lane) -> NDArray[np.float64]:
    """Return the outline (N, 2) of a crossing, counter-clockwise, not closed."""
    polygon = lane.polygon
    if polygon.geom_type != "Polygon":
        polygon = polygon.convex_hull
    outline = shapely.orient_polygons(polygon.simplify(0.01)).exterior
    return np.asarray(shapely.get_coordinates(outline))[:-1]


def _crosswalk(number: int, network: RoadNetwork, lane: Lane, host: _Host) -> Area:
    xy = _corners(lane)
    at = _meeting(host, lane)
    z = network.height(lane.id, xy)
    corners = _local(host.curve, host.elevation, at, np.column_stack([xy, z]))
    return Area(number, host.number, "crosswalk", "crosswalk", at, corners)


def _local(
    curve: Curve, elevation: Profile, s: float, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    x, y, heading = curve.at(s)[0]
    gap = points - [x, y, float(elevation.at(s)[0])]
    c, sn = math.cos(heading), math.sin(heading)
    return np.column_stack(
        [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, gap[:, 2]]
    )


def _stop_line(number: int, street: Street, head: SignalHead, signal: Signal) -> Area:
    strip = street.strip_of[head.lane]
    back = -STOP_LINE_M if strip.forward else STOP_LINE_M
    half = strip.lane.width / 2
    s = np.clip([signal.s + back, signal.s + back, signal.s, signal.s], 0.0, street.curve.length)
    place = street.place(s, strip.t + np.array([half, -half, -half, half]))
    if not strip.forward:
        place = place[::-1]
    return Area(
        number,
        street.number,
        "roadMark",
        "StopLine",
        signal.s,
        _local(street.curve, street.elevation, signal.s, place),
    )


def _place(
    head: SignalHead,
    street_of: Mapping[str, Street],
    within: Sequence[Manoeuvre],
    *,
    walkers: bool,
) -> tuple[int, str, float, float, str, tuple[int, ...]] | None:
    """Return road, type, s, t, orientation and lanes of a signal."""
    xy = np.array([[head.x, head.y]])
    if head.lane in street_of:
        street = street_of[head.lane]
        strip = street.strip_of[head.lane]
        s = float(np.clip(street.curve.locate(xy)[0][0], 0.0, street.curve.length))
        sign = "+" if strip.forward else "-"
        return street.number, VEHICLE_LIGHTS, s, strip.t, sign, (strip.id,)
    if within:
        # What lies within a junction stands on the manoeuvre over it, else on the nearest.
        point = shapely.Point(head.x, head.y)
        manoeuvre = min(within, key=lambda m: (round(m.curve.line.distance(point), 3), m.number))
        s, t = (float(v[0]) for v in manoeuvre.curve.locate(xy))
        s = float(np.clip(s, 0.0, manoeuvre.curve.length))
        if walkers:
            return manoeuvre.number, WALKER_LIGHTS, s, t, "none", ()
        return manoeuvre.number, VEHICLE_LIGHTS, s, 0.0, "+", (manoeuvre.side,)
    return None


def _junction(network: RoadNetwork, head: SignalHead, topology: Topology) -> str:
    lane = network.lane_by_id[head.lane]
    name = lane.junction
    if lane.road:
        name = next(road.to_junction for road in network.roads if road.id == lane.road)
    return topology.junction.get(name, name)
