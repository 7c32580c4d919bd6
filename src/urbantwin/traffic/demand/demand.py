"""Demand: trips with departure times and routes that yield the site's flows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.roads import BusStop
from urbantwin.roads.assignment.street_network import StreetNetwork, Streets
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.stop_places import StopPlace
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS

__all__ = [
    "LARGEST",
    "WALKING_MS",
    "Bound",
    "CountedRow",
    "Demand",
    "Gate",
    "GatePlan",
    "LeftOut",
    "NetworkPart",
    "Passengers",
    "Population",
    "Routes",
    "Trip",
    "departure_count",
    "party_places",
    "plan_demand",
    "systematic",
    "together",
]

#: Maximum size of a group of pedestrians.
LARGEST = 4
_STREAM = 7_100_000  # differs from the random streams of actors and classes


def party_places(count: int, in_groups: float, seed: int) -> list[int]:
    """Return, for each of ``count`` pedestrians, its place in its group: 0 leads, 1, 2, 3 follow.

    Group sizes follow a Poisson distribution without zero, as Moussaid et al. (PLOS ONE 5, 2010,
    e10047, figure 1) found, cut at `LARGEST`. Groups do not depend on pedestrians that come later.

    Args:
        count: number of pedestrians.
        in_groups: share of pedestrians that are not alone, 0..1; 1 - exp(-rate) of the
            distribution.
        seed: random seed.
    """
    if in_groups <= 0:
        return [0] * count
    random = np.random.Generator(np.random.Philox(key=[seed, _STREAM]))
    rate = -np.log1p(-min(in_groups, 0.95))
    places: list[int] = []
    while len(places) < count:
        size = 0
        while size == 0:
            size = min(int(random.poisson(rate)), LARGEST)
        places += range(size)
    return places[:count]


WALKING_MS = 1.34  # mean free walking speed (Weidmann, ETH IVT 90, 1993)
_MIN_THROUGH_ROUTE_M = 60.0  # shorter routes are no through routes, if there are longer ones


@dataclass(frozen=True)
class Trip:
    """The journey of one actor.

    Attributes:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        asset: the actor's mesh.
        depart_s: time of departure, seconds from the start of the warm-up.
        edges: the edges of the route, in order.
        depart_m: pedestrians: start on the first edge, metres from the edge's start.
        arrive_m: pedestrians: end on the last edge, metres from the edge's start.
        anywhere: depart anywhere on the first edge where there is room.
        then: pedestrians: further walks, each from the end of the previous one: edges, and end on
            the last edge, metres.
        halts: buses and trams: numbers of the demand's stops, in order.
        waits: pedestrians: walks (0 is the first) after which it waits for a bus or a tram.
        beside: pedestrians: offset back to the trip of the group's leader; 0 if it walks alone.
        in_reserve: depart only if a gate needs another vehicle during the warm-up.
    """

    actor_class: str
    asset: str
    depart_s: float
    edges: tuple[str, ...]
    depart_m: float = 0.0
    arrive_m: float = 0.0
    anywhere: bool = False
    then: tuple[tuple[tuple[str, ...], float], ...] = ()
    halts: tuple[int, ...] = ()
    waits: tuple[int, ...] = ()
    beside: int = 0
    in_reserve: bool = False


@dataclass(frozen=True)
class LeftOut:
    """A class with requested actors that cannot enter: class, number of actors, and reason."""

    actor_class: str
    count: int
    why: str


@dataclass(frozen=True)
class Population:
    """The circulating actors of one class.

    Attributes:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        per_hour: requested passages through the region per hour.
        count: number of actors.
        seconds: free travel time of the usual circuit, from one entry to the next.
        metres: its length.
        without_room: number of further actors that the flow needs but for which there is no room.
    """

    actor_class: str
    per_hour: float
    count: int
    seconds: float
    metres: float
    without_room: int = 0


@dataclass(frozen=True)
class CountedRow:
    """The trips of a row of counts.

    Attributes:
        approach: edge of the approach; for a crossing, the crossing itself.
        leaving: edge on which the trips are counted.
        trips: numbers of the trips that may be counted there.
    """

    approach: str
    leaving: str
    trips: tuple[int, ...]


@dataclass(frozen=True)
class Passengers:
    """The passengers of buses and trams.

    Attributes:
        places: the stops with waiting people.
        begins: by trip: its first activity, ``waits``, ``rides`` or ``walks``.
        stop_of: by trip: its stop.
        alight: by stop: number of alighting passengers at the first halt, the second, ...
    """

    places: tuple[StopPlace, ...] = ()
    begins: Mapping[int, str] = field(default_factory=dict)
    stop_of: Mapping[int, int] = field(default_factory=dict)
    alight: Mapping[int, tuple[int, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Bound:
    """The part of a guessed volume that is used.

    Attributes:
        share: share of the guessed motor traffic, 1 for all; ``None`` if nothing was guessed.
        because: location and capacity of the bottleneck; empty if all is used.
    """

    share: float | None = None
    because: str = ""


@dataclass(frozen=True)
class Gate:
    """The end of one outer road, which meters the vehicles that enter the region.

    Attributes:
        edge: id of the outer road.
        per_hour: requested vehicles per hour.
        holds: whether vehicles wait there if more come; else vehicles are only added.
        reserve: numbers of the trips that may be added during the warm-up, in order.
        part: number of the part of the network that it leads into, of those of its kind.
    """

    edge: str
    per_hour: float
    holds: bool
    reserve: tuple[int, ...]
    part: int = 0


@dataclass(frozen=True)
class NetworkPart:
    """A part of the network that no vehicle leaves for another; gates meter each part separately.

    Attributes:
        edges: ids of its edges.
        room: motor vehicles that fit onto its lanes in the region bumper to bumper.
        passage_m: mean distance of motor vehicles from one entry into the region to the next.
    """

    edges: tuple[str, ...]
    room: float
    passage_m: float


@dataclass(frozen=True)
class GatePlan:
    """The gates of a closed loop.

    Attributes:
        gates: one per outer road that leads into the region, for motor vehicles and for bicycles.
        parts: parts of the network of motor vehicles.
    """

    gates: tuple[Gate, ...] = ()
    parts: tuple[NetworkPart, ...] = ()


@dataclass(frozen=True)
class Demand:
    """All trips.

    Attributes:
        trips: the trips, by departure; gates' reserves and passengers follow.
        left_out: requested actors that cannot enter.
        populations: populations that stay for the whole motion; empty for through traffic.
        outer: ids of the edges of outer roads, by which circulating actors return.
        stops: stops of buses and trams.
        manners: by class, attributes of SUMO's vehicle type that differ from the usual ones.
        counted: the trips of each row of counts.
        bound: part of the guessed volumes that is used.
        passengers: passengers of buses and trams among the trips.
        approaches: use of single approaches (`approaches.approaches_of`).
        gates: gates that meter the inflow from outer roads.
        planned: circulating motor vehicles per hour by (edge, next edge).
    """

    trips: tuple[Trip, ...]
    left_out: tuple[LeftOut, ...]
    populations: tuple[Population, ...] = ()
    outer: frozenset[str] = frozenset()
    stops: tuple[BusStop, ...] = ()
    manners: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    counted: tuple[CountedRow, ...] = ()
    bound: Bound = field(default_factory=Bound)
    passengers: Passengers = field(default_factory=Passengers)
    approaches: Mapping[str, Any] = field(default_factory=dict)
    gates: GatePlan = field(default_factory=GatePlan)
    planned: Mapping[tuple[str, str], float] = field(default_factory=dict)

    @property
    def circulates(self) -> bool:
        """Whether all actors stay for the whole motion."""
        return bool(self.populations)


def plan_demand(
    network: StreetNetwork,
    per_hour: Mapping[str, float],
    *,
    warmup_s: float,
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
    in_groups: float = 0.0,
) -> Demand:
    """Plan the trips of every class.

    Departure times are stratified: the period is split into as many equal parts as there are trips,
    and each trip departs at a random time of its own part. Routes are drawn in the same way from
    their weights (systematic sampling; Cochran, Sampling Techniques, 1977, ch. 8).

    Args:
        network: the streets.
        per_hour: actors per hour and class; classes without an entry get no trips.
        warmup_s: duration of traffic before the motion starts.
        duration_s: duration of the motion.
        seed: random seed.
        body: returns the asset of the n-th actor of a class.
        in_groups: share of pedestrians that walk in groups.
    """
    trips: list[Trip] = []
    left_out: list[LeftOut] = []
    period_s = warmup_s + duration_s
    for number, actor_class in enumerate(ACTOR_CLASSES):
        count = departure_count(per_hour.get(actor_class, 0.0), period_s)
        if count == 0:
            continue
        random = np.random.Generator(np.random.Philox(key=[seed, number]))
        walks = actor_class == "pedestrian"
        vclass = ACTOR_KINDS[actor_class].vclass
        streets = network.walked() if walks else network.driven_by(vclass)
        routes = None if streets is None else Routes.between_gates(streets)
        if routes is None:
            why = (
                "no sidewalk, footway or crossing to walk on"
                if walks
                else f"no street that allows SUMO's class {vclass!r}"
            )
            left_out.append(LeftOut(actor_class, count, why))
            continue
        depart_s = (np.arange(count) + random.random(count)) * (period_s / count)
        pairs = systematic(routes.weight, count, random)
        place, lead_m = random.random(count), WALKING_MS * (warmup_s - depart_s)
        company = party_places(count, in_groups if walks else 0.0, seed)
        for k in range(count):
            asset, departs_s = body(actor_class, k), round(float(depart_s[k]), 2)
            if company[k]:
                trips.append(replace(trips[-company[k]], asset=asset, beside=company[k]))
            elif walks:
                # Walkers need minutes to reach the middle. Those of the warm-up start so that they
                # are spread over their whole route when the motion starts.
                spread = float(place[k]) if lead_m[k] > 0 else 0.0
                lead = max(float(lead_m[k]), 0.0)
                edges, begin, end = routes.walk(int(pairs[k]), spread, lead)
                trips.append(Trip(actor_class, asset, departs_s, edges, begin, end))
            else:
                trips.append(Trip(actor_class, asset, departs_s, routes.drive(int(pairs[k]))))
    trips.sort(key=lambda trip: (trip.depart_s, ACTOR_CLASSES.index(trip.actor_class)))
    return Demand(tuple(trips), tuple(left_out))


def together(first: Demand, second: Demand) -> Demand:
    """Return two demands as one without circulation; counted rows are the first's."""
    both = [(trip.depart_s, 0, k) for k, trip in enumerate(first.trips)]
    both += [(trip.depart_s, 1, k) for k, trip in enumerate(second.trips)]
    both.sort()
    place = {(which, k): number for number, (_, which, k) in enumerate(both)}
    return Demand(
        tuple((first, second)[which].trips[k] for _, which, k in both),
        first.left_out + second.left_out,
        counted=tuple(
            replace(row, trips=tuple(sorted(place[0, trip] for trip in row.trips)))
            for row in first.counted
        ),
    )


def departure_count(per_hour: float, period_s: float) -> int:
    """Return the number of departures in a period, rounded half up."""
    return int(np.floor(per_hour * period_s / 3600.0 + 0.5))


@dataclass(frozen=True, eq=False)
class Routes:
    """The routes between gates: pairs of gates with their relative traffic."""

    streets: Streets
    pairs: NDArray[np.int64]
    weight: NDArray[np.float64]
    previous: NDArray[np.int32]
    row: dict[int, int]

    @classmethod
    def between_gates(cls, streets: Streets) -> Routes | None:
        """Return the fastest route between each two gates; ``None`` if there is none at all.

        The traffic of a pair is the product of its gates' traffic, times the squared ratio of
        straight-line to route length, so that detours are rare. No route leaves where it entered if
        there is another exit.
        """
        entries, exits = streets.entries, streets.exits
        starts = np.unique(entries.edge)
        seconds, previous = scipy.sparse.csgraph.dijkstra(
            streets.seconds, indices=starts, return_predecessors=True
        )
        row = {int(edge): number for number, edge in enumerate(starts)}
        rows = np.array([row[int(edge)] for edge in entries.edge])
        reach = np.isfinite(seconds[rows][:, exits.edge])
        same_gate = (entries.edge[:, None] == exits.edge) & (
            entries.at_start[:, None] == exits.at_start
        )
        source, sink = np.nonzero(reach & ~same_gate)
        if not len(source):
            return None
        begin = streets.ends[entries.edge[source], np.where(entries.at_start[source], 0, 1)]
        end = streets.ends[exits.edge[sink], np.where(exits.at_start[sink], 0, 1)]
        straight = np.linalg.norm(end - begin, axis=1)
        routes = cls(streets, np.column_stack([source, sink]), straight, previous, row)
        length = np.array([routes._length_m(number) for number in range(len(source))])
        returns = np.array(
            [
                (int(a), int(b)) in streets.turn_back
                for a, b in zip(entries.edge[source], exits.edge[sink], strict=True)
            ]
        )
        weight = entries.weight[source] * exits.weight[sink]
        weight = weight * (np.clip(straight / length, 0.1, 1.0) ** 2)
        # Of edges outside junctions alone; the straight line counts where wide junctions make it
        # longer.
        for unwanted in (returns, np.maximum(length, straight) < _MIN_THROUGH_ROUTE_M):
            if np.any(weight[~unwanted] > 0):
                weight = np.where(unwanted, 0.0, weight)
        return cls(streets, routes.pairs, weight, previous, row)

    def drive(self, number: int) -> tuple[str, ...]:
        """Return the edges of a route; for pedestrians including corners and crossings."""
        return tuple(self.streets.edges[edge] for edge in self._path(number))

    def walk(
        self, number: int, spread: float, lead_m: float
    ) -> tuple[tuple[str, ...], float, float]:
        """Return the edges of a walk, and its start and end on the first and last edge (m).

        The corner at the end of the first edge is named explicitly. Where the two sidewalks of a
        street meet at both ends, SUMO would choose the end that is nearest by all sidewalks. It
        would then reject the walk if the path from there uses streets that the walk does not name.

        Args:
            number: number of the pair of gates.
            spread: share of the route that shall be behind the pedestrian ...
            lead_m: ... after walking this distance.
        """
        source, sink = self.pairs[number]
        whole = self._path(number)
        path = [edge for edge in whole if edge < self.streets.street_count]
        length = self.streets.length_m[path]
        begin = 0.0 if self.streets.entries.at_start[source] else 1.0
        end = 0.0 if self.streets.exits.at_start[sink] else 1.0
        done = max(spread * float(length.sum()) - lead_m, 0.0)
        first = int(np.searchsorted(np.cumsum(length), done, side="right").clip(0, len(path) - 1))
        if first > 0:
            begin = self._near_end(path[first], path[first - 1])
        last = first == len(path) - 1
        far = end if last else self._near_end(path[first], path[first + 1])
        share = min((done - float(length[:first].sum())) / float(length[first]), 0.9)
        begin += (far - begin) * share
        corner = [] if last else [whole[whole.index(path[first]) + 1]]
        named = (path[first], *corner, *path[first + 1 :])
        names = tuple(self.streets.edges[edge] for edge in named)
        return names, _rounded_down(begin, length[first]), _rounded_down(end, length[-1])

    def _near_end(self, edge: int, other: int) -> float:
        """Return the end of an edge (0 start, 1 end) that is nearer to another edge."""
        ends = self.streets.ends
        gaps = np.linalg.norm(ends[edge][:, None] - ends[other][None], axis=2)
        return float(np.argmin(gaps.min(axis=1)))

    def _path(self, number: int) -> list[int]:
        """Return the edges from gate to gate."""
        source, sink = self.pairs[number]
        start = int(self.streets.entries.edge[source])
        edge = int(self.streets.exits.edge[sink])
        path = [edge]
        while edge != start:
            edge = int(self.previous[self.row[start], edge])
            path.append(edge)
        return path[::-1]

    def _length_m(self, number: int) -> float:
        return float(self.streets.length_m[self._path(number)].sum())


def systematic(
    weight: NDArray[np.float64], count: int, random: np.random.Generator
) -> NDArray[np.int64]:
    """Draw ``count`` indices in proportion to their weights, stratified, in random order."""
    total = np.cumsum(weight)
    draws = (np.arange(count) + random.random(count)) / count * total[-1]
    drawn = np.searchsorted(total, draws, side="right").clip(0, len(weight) - 1)
    return np.asarray(random.permutation(drawn), np.int64)


def _rounded_down(share: float, length_m: float) -> float:
    """Return a position on an edge rounded down to centimetres: SUMO rejects any beyond its end."""
    return float(np.floor(share * length_m * 100) / 100)
