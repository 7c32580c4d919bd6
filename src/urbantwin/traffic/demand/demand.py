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

#: No party is larger.
LARGEST = 4
_STREAM = 7_100_000  # apart from those of actors and classes


def party_places(count: int, in_groups: float, seed: int) -> list[int]:
    """Return for each of ``count`` people which of its party it is: 0 leads, 1, 2, 3 follow it.

    Sizes of parties are those of a Poisson distribution without zero, as Moussaid et al. (PLOS ONE
    5, 2010, e10047, figure 1) found them; larger ones than `LARGEST` are cut. Who is in which party
    depends on nobody who comes later.

    Args:
        count: of people.
        in_groups: share of people who are not alone, 0..1; of that distribution 1 - exp(-rate).
        seed: of the random choice.
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
_WORTHWHILE_M = 60.0  # a route shorter than this is no way through, where there are longer ones


@dataclass(frozen=True)
class Trip:
    """One actor's journey.

    Attributes:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        asset: the actor's mesh.
        depart_s: when it sets out, seconds from the start of the warm-up.
        edges: the streets that it passes, in order.
        depart_m: on foot: where on the first edge it begins, metres from the edge's start.
        arrive_m: on foot: where on the last edge it ends.
        anywhere: whether it sets out somewhere on the first street, where there is room.
        then: on foot: further walks, each from where the one before ends: streets and where on the
            last one it ends.
        halts: of a bus: numbers of the demand's stops in the order in which it halts at them.
        waits: on foot: after which of its walks (0 is the first) it waits for a bus or a tram.
        beside: on foot: it walks with whom the trip so many before this one is; 0 for nobody.
        in_reserve: whether it sets out only if a gate needs another vehicle during the warm-up.
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
    """A class that was asked for and cannot come: its name, how many were asked for, and why."""

    actor_class: str
    count: int
    why: str


@dataclass(frozen=True)
class Population:
    """The actors of one class.

    Attributes:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        per_hour: passages through the region per hour that were asked for.
        count: how many actors there are.
        seconds: free travel time of the usual way round, from one entry to the next.
        metres: its length.
        without_room: how many more the flow asks for than there is room for.
    """

    actor_class: str
    per_hour: float
    count: int
    seconds: float
    metres: float
    without_room: int = 0


@dataclass(frozen=True)
class CountedRow:
    """Who was planned for a row of counts.

    Attributes:
        approach: the edge by which they come; where it is a crossing, that.
        leaving: the edge that they have passed when they are counted.
        trips: numbers of the trips that may pass.
    """

    approach: str
    leaving: str
    trips: tuple[int, ...]


@dataclass(frozen=True)
class Passengers:
    """Who takes buses and trams.

    Attributes:
        places: the stops at which people wait.
        begins: by the number of a trip: how it begins, ``waits``, ``rides`` or ``walks``.
        stop_of: by the number of a trip: its stop.
        alight: by stop: how many get off at the first halt, at the second, ...
    """

    places: tuple[StopPlace, ...] = ()
    begins: Mapping[int, str] = field(default_factory=dict)
    stop_of: Mapping[int, int] = field(default_factory=dict)
    alight: Mapping[int, tuple[int, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Bound:
    """How much of a guess comes.

    Attributes:
        share: of the motor traffic guessed, 1 where it is all; ``None`` where nothing was guessed.
        because: where it would queue, and what passes there; empty where all comes.
    """

    share: float | None = None
    because: str = ""


@dataclass(frozen=True)
class Gate:
    """How the end of one outer road meters the vehicles that come into the region.

    Attributes:
        edge: id of the outer road.
        per_hour: requested vehicles per hour.
        holds: whether vehicles wait there when more come; else vehicles are only added.
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
    """A part of the network that no vehicle leaves for another part: gates meter each by itself.

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
    """Every trip, in the order of setting out.

    Attributes:
        trips: who sets out.
        left_out: who was asked for and cannot come.
        populations: who circulates: stays for the whole motion; empty where traffic passes through.
        outer: ids of the edges of outer roads, by which those who circulate come back.
        stops: where buses halt.
        manners: by class, attributes of SUMO's vehicle type that are not as usual.
        counted: of each row that was counted, who was planned for it.
        bound: how much of guessed volumes comes.
        passengers: who of them takes buses and trams.
        approaches: how single approaches are used (`approaches.approaches_of`).
        gates: how outer roads meter the inflow of those who circulate.
        planned: of those who circulate: (edge, next edge) -> motor vehicles per hour.
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
        """Whether everybody stays for the whole motion."""
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

    Setting-out times are stratified: the period is cut into as many equal parts as there are
    trips and each trip sets out at a random instant of its own part, so a class comes as often
    as it was asked for, and evenly. Routes are drawn in the same way from their weights
    (systematic sampling; Cochran, Sampling Techniques, 1977, ch. 8).

    Args:
        network: the streets.
        per_hour: actors per hour and class; a class that is not named does not come.
        warmup_s: how long traffic runs before the motion starts.
        duration_s: how long the motion is.
        seed: the same seed gives the same trips.
        body: the asset of the n-th actor of a class.
        in_groups: share of people on foot who walk in company.
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
            asset, at = body(actor_class, k), round(float(depart_s[k]), 2)
            if company[k]:
                trips.append(replace(trips[-company[k]], asset=asset, beside=company[k]))
            elif walks:
                # Walkers need minutes to reach the middle. Those of the warm-up begin where they
                # will have spread over their whole way by the time the motion starts.
                spread = float(place[k]) if lead_m[k] > 0 else 0.0
                lead = max(float(lead_m[k]), 0.0)
                edges, begin, end = routes.walk(int(pairs[k]), spread, lead)
                trips.append(Trip(actor_class, asset, at, edges, begin, end))
            else:
                trips.append(Trip(actor_class, asset, at, routes.drive(int(pairs[k]))))
    trips.sort(key=lambda trip: (trip.depart_s, ACTOR_CLASSES.index(trip.actor_class)))
    return Demand(tuple(trips), tuple(left_out))


def together(first: Demand, second: Demand) -> Demand:
    """Return two demands as one in which nobody circulates; counted rows are the first's."""
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
    """Return how many actors set out in a period, rounded half up."""
    return int(np.floor(per_hour * period_s / 3600.0 + 0.5))


@dataclass(frozen=True, eq=False)
class Routes:
    """The ways between gates: pairs of gates with their relative traffic."""

    streets: Streets
    pairs: NDArray[np.int64]
    weight: NDArray[np.float64]
    previous: NDArray[np.int32]
    row: dict[int, int]

    @classmethod
    def between_gates(cls, streets: Streets) -> Routes | None:
        """Find the fastest way between each two gates; ``None`` where there is none at all.

        A pair's traffic is the product of its gates' traffic, less where the way is a detour
        (share of the straight line in the way's length, squared). Nobody leaves where they came
        in while there is another way out.
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
        # Of streets alone: ways over wide junctions may be longer than that.
        for unwanted in (returns, np.maximum(length, straight) < _WORTHWHILE_M):
            if np.any(weight[~unwanted] > 0):
                weight = np.where(unwanted, 0.0, weight)
        return cls(streets, routes.pairs, weight, previous, row)

    def drive(self, number: int) -> tuple[str, ...]:
        """Return the streets of a way; on foot its corners and crossings too."""
        return tuple(self.streets.edges[edge] for edge in self._path(number))

    def walk(
        self, number: int, spread: float, lead_m: float
    ) -> tuple[tuple[str, ...], float, float]:
        """Return the streets of a walk, and where on the first and last it begins and ends (m).

        Behind the first street stands the corner at its end. Where a street's two sides meet at
        both ends, SUMO would choose the end from which it is nearest by all sidewalks, and refuse
        the walk if the way from there leads over streets that the walk does not name.

        Args:
            number: which pair of gates.
            spread: share of the way that shall be behind the pedestrian ...
            lead_m: ... after walking this far.
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
        return names, _inside(begin, length[first]), _inside(end, length[-1])

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
    """Draw ``count`` indices in proportion to their weights, evenly, in a random order."""
    total = np.cumsum(weight)
    at = (np.arange(count) + random.random(count)) / count * total[-1]
    drawn = np.searchsorted(total, at, side="right").clip(0, len(weight) - 1)
    return np.asarray(random.permutation(drawn), np.int64)


def _inside(share: float, length_m: float) -> float:
    """Return a place on an edge, in centimetres and not beyond its end: SUMO is strict there."""
    return float(np.floor(share * length_m * 100) / 100)
