"""Controlled links of signal programs: their approaches and conflicts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points, wrapped
from urbantwin.roads.curve_speed import lane_speeds
from urbantwin.roads.junctions.plain import CYCLE_TRACK_TYPE
from urbantwin.roads.model.furniture import Phase

__all__ = [
    "COMPASS",
    "FACING_DEG",
    "Link",
    "Signalised",
    "admits_cars",
    "outgoing_of_lanes",
    "rows_of_junction",
    "signalised_junctions",
]

#: Compass directions and their bearings, degrees clockwise from north.
COMPASS = {
    name: 45.0 * k
    for k, name in enumerate(
        "north northeast east southeast south southwest west northwest".split()
    )
}
#: Movements by SUMO's letters for the direction of a connection.
MOVEMENTS = {
    "s": "through",
    "l": "left",
    "L": "left",
    "r": "right",
    "R": "right",
    "t": "u-turn",
}
#: Approaches whose bearings differ by less are on one arm; by more than the second, they are
#: opposite, degrees.
SAME_ARM_DEG, FACING_DEG = 30.0, 120.0
#: A shorter road between two stop lines of one program is part of the junction, metres.
INNER_M = 40.0
#: Length at the end of an approach over which its bearing is measured, metres.
APPROACH_M = 25.0
#: On shorter roads vehicles do not change lanes if they can do so before, metres.
CHANGING_M = 60.0


@dataclass(frozen=True)
class Link:
    """A connection controlled by a signal program.

    Attributes:
        index: its index in the program's states.
        junction: id of its junction.
        row: its row in the junction's conflict table.
        lane: the lane that waits; of a crossing, the crossing.
        to: the lane that it leads to.
        road: SUMO edge of the lane that waits.
        street: name of the street.
        movement: left, through, right, u-turn; ``walk`` for a crossing.
        bearing: direction from the junction to its arm (for a crossing, the crossed arm), degrees
            clockwise from north.
        length: length through the junction, or across the road, metres.
        speed: speed limit, m/s.
        bend_speed: speed in its sharpest bend, m/s, at most the limit.
        crosses: edges that a crossing leads over.
        cycle_track: whether it continues along a cycle track.
        for_cars: whether cars may use the lane that waits.
    """

    index: int
    junction: str
    row: int
    lane: str
    to: str
    road: str
    street: str
    movement: str
    bearing: float
    length: float
    speed: float
    bend_speed: float = math.inf
    crosses: tuple[str, ...] = ()
    cycle_track: bool = False
    for_cars: bool = True

    def __hash__(self) -> int:
        """Return the hash of junction and row, which identify a link: lookups are frequent."""
        return hash((self.junction, self.row))

    @property
    def arm(self) -> str:
        """Compass direction of its arm: one of ``COMPASS``."""
        return min(COMPASS, key=lambda name: turn_between(COMPASS[name], self.bearing))

    @property
    def is_turn(self) -> bool:
        """Whether it is a turn or U-turn."""
        return self.movement in ("left", "right", "u-turn")


@dataclass(frozen=True)
class Feeder:
    """A link that leads to another stop line: its index, and that distance, metres."""

    index: int
    length: float


@dataclass(frozen=True)
class Signalised:
    """The links controlled by one signal program.

    Attributes:
        program: id of the program.
        junctions: ids of the junctions.
        streets: names of the streets that meet there, in compass order.
        xy: (2,) its centre, site frame, metres.
        links: all links, sorted by index; links may share an index.
        foes: pairs of rows of one junction whose paths cross or merge: (junction, row, row).
        yields: (junction, row, row): the former yields to the latter.
        offset: delay of the program's start, seconds.
        phases: its phases with their usual durations.
        longest: the same with maximum durations if traffic extends them.
        onward: lane of a short road behind the junction -> the edges that it leads to.
        inner_m: edge between two of the junctions, with a further stop line -> its length, metres.
    """

    program: str
    junctions: tuple[str, ...]
    streets: tuple[str, ...]
    xy: NDArray[np.float64]
    links: tuple[Link, ...]
    foes: frozenset[tuple[str, int, int]]
    yields: frozenset[tuple[str, int, int]]
    offset: float
    phases: tuple[Phase, ...]
    onward: Mapping[str, frozenset[str]] = field(default_factory=dict)
    inner_m: Mapping[str, float] = field(default_factory=dict)
    longest: tuple[Phase, ...] = ()

    @property
    def size(self) -> int:
        """Number of letters of a state."""
        return 1 + max((link.index for link in self.links), default=-1)

    @property
    def cycle(self) -> float:
        """Cycle length, seconds."""
        return sum(seconds for seconds, _ in self.phases)

    @cached_property
    def of_index(self) -> Mapping[int, tuple[Link, ...]]:
        """Links by index."""
        by_index: dict[int, list[Link]] = defaultdict(list)
        for link in self.links:
            by_index[link.index].append(link)
        return {index: tuple(links) for index, links in by_index.items()}

    @cached_property
    def yields_to(self) -> Mapping[Link, tuple[Link, ...]]:
        """Links that each link yields to, in the order of ``links``."""
        return {
            link: tuple(other for other in self.links if self.gives_way(link, other))
            for link in self.links
        }

    def are_foes(self, a: Link, b: Link) -> bool:
        """Return whether the paths of two links cross or merge."""
        return a.junction == b.junction and (a.junction, a.row, b.row) in self.foes

    def is_walk(self, index: int) -> bool:
        """Return whether an index belongs to a crossing."""
        return self.of_index[index][0].movement == "walk"

    @cached_property
    def feeders(self) -> Mapping[int, Sequence[Feeder]]:
        """Index -> links that lead to its stop line from another stop line of the program."""
        feeders_of: dict[int, list[Feeder]] = {index: [] for index in self.of_index}
        for link in self.links:
            if link.movement == "walk" or link.road not in self.inner_m:
                continue
            for before in self.links:
                if before.movement != "walk" and before.to.rpartition("_")[0] == link.road:
                    length = before.length + self.inner_m[link.road]
                    feeders_of[link.index].append(Feeder(before.index, length))
        return feeders_of

    def together(self, i: int, j: int) -> bool:
        """Return whether the links of two indices may have green at the same time."""
        if (i, j) not in self._together:
            pairs = product(self.of_index[i], self.of_index[j])
            self._together[i, j] = i == j or not any(self._conflict(a, b) for a, b in pairs)
        return self._together[i, j]

    def fits(self, index: int, green: Iterable[int]) -> bool:
        """Return whether an index may have green together with all others given."""
        return all(self.together(index, other) for other in green)

    @cached_property
    def _together(self) -> dict[tuple[int, int], bool]:
        return {}

    def _conflict(self, a: Link, b: Link) -> bool:
        if not self.are_foes(a, b) or a.road == b.road:
            return False
        if "walk" in (a.movement, b.movement):
            vehicle, walk = (b, a) if a.movement == "walk" else (a, b)
            hidden = self.meets_walkers(vehicle, walk) or self._beside_a_turn(vehicle)
            return hidden or not self.gives_way(vehicle, walk)
        if SAME_ARM_DEG <= turn_between(a.bearing, b.bearing) <= FACING_DEG:
            return True
        if a.cycle_track or b.cycle_track:
            # A turn beside a cycle track conflicts with its cyclists as with pedestrians.
            turning = b if a.cycle_track else a
            return not turning.is_turn or not (self.gives_way(a, b) or self.gives_way(b, a))
        return not (self._waits_for(a, b) or self._waits_for(b, a))

    def _beside_a_turn(self, link: Link) -> bool:
        """Return whether the link turns beside another lane of cars.

        One of the vehicles hides pedestrians and opposing traffic from the other.
        """
        return (
            link.is_turn
            and link.for_cars
            and any(
                other.road == link.road
                and other.lane != link.lane
                and other.for_cars
                and other.movement == link.movement
                and other.to.rpartition("_")[0] == link.to.rpartition("_")[0]
                for other in self.links
            )
        )

    def _waits_for(self, a: Link, b: Link) -> bool:
        yields = self.gives_way(a, b) and not self.gives_way(b, a)
        return a.is_turn and yields and not self._beside_a_turn(a)

    def meets_walkers(self, vehicle: Link, walk: Link) -> bool:
        """Return whether a link conflicts with a crossing in any way other than as a turn.

        Turning vehicles yield to pedestrians at their exit, but not to those before their own stop
        line.
        """
        before = vehicle.road in walk.crosses
        return self.are_foes(vehicle, walk) and (before or not vehicle.is_turn)

    def gives_way(self, a: Link, b: Link) -> bool:
        """Return whether the former yields to the latter."""
        return a.junction == b.junction and (a.junction, a.row, b.row) in self.yields


def turn_between(a: float, b: float) -> float:
    """Return the angle between two bearings, degrees, 0 to 180."""
    return abs(wrapped(a - b, 360.0))


def signalised_junctions(root: etree._Element) -> list[Signalised]:
    """Return the controlled links of all programs of a ``.net.xml``, sorted by program.

    Args:
        root: the network.
    """
    edges = {edge.get("id"): edge for edge in root.iter("edge")}
    lanes = {lane.get("id"): lane for lane in root.iter("lane")}
    outgoing = outgoing_of_lanes(root)
    bend_speeds = _bend_speeds(root)
    links: dict[str, list[Link]] = defaultdict(list)
    foes: dict[str, set[tuple[str, int, int]]] = defaultdict(set)
    yields: dict[str, set[tuple[str, int, int]]] = defaultdict(set)
    junctions_of: dict[str, list[etree._Element]] = defaultdict(list)
    streets_at = _streets(edges.values())
    for junction in root.iter("junction"):
        if junction.get("type") == "internal":
            continue
        name = junction.get("id")
        rows = rows_of_junction(junction, outgoing, edges)
        programs = {item.get("tl") for item in rows} - {None}
        for program in programs:
            junctions_of[program].append(junction)
        for row, item in enumerate(rows):
            if item.get("tl"):
                links[item.get("tl")].append(_link(item, name, row, edges, lanes, bend_speeds))
        for request in junction.iter("request"):
            row = int(request.get("index"))
            for key, table in (("foes", foes), ("response", yields)):
                bits = request.get(key)[::-1]
                for program in programs:
                    table[program] |= {
                        (name, row, other) for other, bit in enumerate(bits) if bit == "1"
                    }
    junctions = []
    for logic in sorted(root.iter("tlLogic"), key=lambda item: str(item.get("id"))):
        program = logic.get("id")
        if not links[program]:
            continue
        middles = [[float(j.get("x")), float(j.get("y"))] for j in junctions_of[program]]
        names = [pair for j in junctions_of[program] for pair in streets_at[j.get("id")]]
        junctions.append(
            Signalised(
                program,
                tuple(sorted(j.get("id") for j in junctions_of[program])),
                tuple(dict.fromkeys(name for _, name in sorted(names))),
                np.mean(middles, axis=0),
                tuple(sorted(links[program], key=lambda link: (link.index, link.lane))),
                frozenset(foes[program]),
                frozenset(yields[program]),
                float(logic.get("offset", 0)),
                tuple((float(p.get("duration")), p.get("state")) for p in logic.iter("phase")),
                {
                    link.to: frozenset(str(item.get("to")) for item in outgoing.get(link.to, ()))
                    for link in links[program]
                    if float(lanes[link.to].get("length")) < CHANGING_M
                },
                _inner_edges(links[program], lanes),
                tuple(
                    (float(p.get("maxDur", p.get("duration"))), p.get("state"))
                    for p in logic.iter("phase")
                ),
            )
        )
    return junctions


def _inner_edges(links: Sequence[Link], lanes: Mapping[str, etree._Element]) -> dict[str, float]:
    let_in = {link.to.rpartition("_")[0] for link in links if link.movement != "walk"}
    inner = {link.road: link.lane for link in links if link.road in let_in}
    lengths = {road: float(lanes[lane].get("length")) for road, lane in inner.items()}
    return {road: length for road, length in lengths.items() if length < INNER_M}


def outgoing_of_lanes(root: etree._Element) -> Mapping[str, list[etree._Element]]:
    """Return lane -> the connections that begin on it."""
    outgoing: dict[str, list[etree._Element]] = defaultdict(list)
    for item in root.iter("connection"):
        outgoing[f"{item.get('from')}_{item.get('fromLane')}"].append(item)
    return outgoing


def rows_of_junction(
    junction: etree._Element,
    outgoing: Mapping[str, list[etree._Element]],
    edges: Mapping[str, etree._Element],
) -> list[etree._Element]:
    """Return the connections in the order of the junction's conflict table.

    It omits connections between sidewalks and walking areas.
    """
    return [
        item
        for lane in junction.get("incLanes", "").split()
        for item in outgoing.get(lane, ())
        if edges[item.get("to")].get("function") in (None, "crossing")
        and edges[item.get("from")].get("function") in (None, "walkingarea")
        and (":" in item.get("to") or ":" not in item.get("from"))
    ]


def _shape(lane: etree._Element) -> NDArray[np.float64]:
    return np.array([[float(v) for v in p.split(",")[:2]] for p in lane.get("shape").split()])


def _streets(edges: Iterable[etree._Element]) -> dict[str, list[tuple[float, str]]]:
    """Return junction -> (bearing, name) of its streets."""
    streets: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for edge in edges:
        if edge.get("function") or not edge.get("name"):
            continue
        shape = _shape(edge.find("lane"))
        streets[edge.get("to")].append((round(_bearing(shape[::-1])), edge.get("name")))
        streets[edge.get("from")].append((round(_bearing(shape)), edge.get("name")))
    return streets


def _bearing(shape: NDArray[np.float64]) -> float:
    """Return the bearing of a line at its first point, degrees clockwise from north."""
    along = stations_of_points(shape)
    reach = min(APPROACH_M, float(along[-1]))
    dx, dy = (np.interp(reach, along, shape[:, k]) - shape[0, k] for k in (0, 1))
    return math.degrees(math.atan2(dx, dy)) % 360.0


def _link(
    item: etree._Element,
    junction: str,
    row: int,
    edges: Mapping[str, etree._Element],
    lanes: Mapping[str, etree._Element],
    bends: Mapping[str, float],
) -> Link:
    start, end = (f"{item.get(k)}_{item.get(k + 'Lane')}" for k in ("from", "to"))
    if item.get("from").startswith(":"):
        # Pedestrians: from a walking area over a crossing.
        crossing = edges[item.get("to")]
        crossed = [edges[name] for name in crossing.get("crossingEdges", "").split()]
        bearing = _mean([_arm(edge, junction) for edge in crossed])
        names = [edge.get("name", "") for edge in crossed]
        length = float(lanes[end].get("length"))
        return Link(
            int(item.get("linkIndex")),
            junction,
            row,
            end,
            end,
            item.get("to"),
            next((name for name in names if name), ""),
            "walk",
            bearing,
            length,
            float(lanes[end].get("speed")),
            crosses=tuple(crossing.get("crossingEdges", "").split()),
        )
    edge = edges[item.get("from")]
    # A cycle track continues straight on, however it bends.
    track = {edge.get("type"), edges[item.get("to")].get("type")} == {CYCLE_TRACK_TYPE}
    movement = "through" if track else MOVEMENTS.get(item.get("dir"), "through")
    via = lanes.get(item.get("via", ""))
    # A path with a waiting position has a second part; the straight distance accounts for its
    # length.
    gap = _shape(lanes[end])[0] - _shape(lanes[start])[-1]
    length = max(float(np.hypot(*gap)), float(via.get("length")) if via is not None else 0.0)
    return Link(
        int(item.get("linkIndex")),
        junction,
        row,
        start,
        end,
        item.get("from"),
        edge.get("name", ""),
        movement,
        _arm(edge, junction),
        length,
        float(lanes[start].get("speed")),
        min(bends.get(item.get("via", ""), math.inf), float(lanes[start].get("speed"))),
        cycle_track=track,
        for_cars=admits_cars(lanes[start]),
    )


def admits_cars(lane: etree._Element) -> bool:
    """Return whether cars may use a lane of a ``.net.xml``."""
    allow, disallow = (lane.get(key, "").split() for key in ("allow", "disallow"))
    return "passenger" in allow if allow else not {"passenger", "all"} & set(disallow)


def _bend_speeds(root: etree._Element) -> dict[str, float]:
    """Return first lane of a signalised path -> its lowest speed in bends, m/s."""
    onward = {
        f"{item.get('from')}_{item.get('fromLane')}": item.get("via")
        for item in root.iter("connection")
        if item.get("from").startswith(":")
    }
    parts: dict[str, list[str]] = {}
    for item in root.iter("connection"):
        if item.get("tl") and item.get("via") and not item.get("from").startswith(":"):
            first = item.get("via")
            # A path with a waiting position has a second part.
            parts[first] = [first, *filter(None, [onward.get(first)])]
    speeds = lane_speeds(root, {name for names in parts.values() for name in names})
    return {
        first: min((float(speeds[x].min()) for x in names if x in speeds), default=math.inf)
        for first, names in parts.items()
    }


def _arm(edge: etree._Element, junction: str) -> float:
    """Return the bearing from a junction along one of its roads, degrees clockwise from north."""
    shape = _shape(edge.find("lane"))
    return _bearing(shape[::-1] if edge.get("to") == junction else shape)


def _mean(bearings: list[float]) -> float:
    if not bearings:
        return 0.0
    angles = np.radians(bearings)
    return math.degrees(math.atan2(np.sin(angles).sum(), np.cos(angles).sum())) % 360.0
