"""Circulation: a constant population of actors that pass through the region again and again.

The population of a class follows from its passages per hour by Little's law: actors on the way =
rate times the time of a full circuit.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from copy import copy
from dataclasses import replace

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from urbantwin.roads import BusStop
from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.movement_flows import (
    IN_CARS,
    ON_LANES_IN_CARS,
    flows_of_circuits,
)
from urbantwin.roads.assignment.routing_graph import driven_graph, walked_graph
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.demand import (
    Demand,
    Gate,
    GatePlan,
    LeftOut,
    NetworkPart,
    Population,
    Trip,
    party_places,
)
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS

__all__ = ["COMING_IN_S", "Circulation"]

#: Time after which all actors have entered, seconds; half of the warm-up if that is shorter.
COMING_IN_S = 60.0
#: Mean speed as a share of the free speed when populations are planned, for delays at junctions and
#: by other traffic. Gates correct the difference to the real speed for the classes that they meter.
PACE = {
    "pedestrian": 0.85, "bicycle": 0.55, "tram": 0.5,
    **dict.fromkeys(IN_CARS, 0.5),
}  # fmt: skip
#: Share of the planned motor vehicles and bicycles that depart at once; gates add the others.
AT_ONCE = 0.7
#: Duration for which a gate has vehicles in reserve, s.
RESERVE_S = 240.0
_ON_FOOT, _BUS, _TRAM = "pedestrian", "bus", "tram"
#: Vehicles do not depart on streets shorter than this, where a queue leaves no room, metres.
_MIN_DEPARTURE_STREET_M = 25.0
#: Least length of footway per pedestrian, metres: 5.6 m2 (60 square feet) at the 2 m width of
#: SUMO's sidewalks, the limit of level of service A of a walkway (Highway Capacity Manual 2010,
#: chapter 23).
_FOOTWAY_PER_PERSON_M = 2.8
#: Factor by which the fastest actors exceed the usual speed.
_FASTEST_FACTOR = 1.25


class Circulation:
    """The closed network as each class may use it.

    Args:
        network: the streets.
        outer: ids of the edges of outer roads.
        per_hour: passages through the region per hour and class.
        seed: random seed.
        stops: stops of buses and trams.
        bus_roads: ids of the edges that mapped bus lines use.
        in_groups: share of pedestrians that walk in groups.
    """

    def __init__(
        self,
        network: StreetNetwork,
        outer: Set[str],
        per_hour: Mapping[str, float],
        seed: int,
        *,
        stops: Sequence[BusStop] = (),
        bus_roads: Set[str] = frozenset(),
        in_groups: float = 0.0,
    ) -> None:
        self.outer, self.seed, self.stops = frozenset(outer), seed, tuple(stops)
        self.in_groups = in_groups
        self._stops_of: dict[str, list[int]] = {}
        for number, stop in enumerate(self.stops):
            self._stops_of.setdefault(stop.lane.rpartition("_")[0], []).append(number)
        self.per_hour = {name: float(per_hour.get(name, 0.0)) for name in ACTOR_CLASSES}
        self._circuits: dict[str, Circuit] = {}
        self._missing: dict[str, str] = {}
        self._usual: dict[str, tuple[float, float]] = {}
        made: dict[str, Circuit | None] = {}
        for name, rate in self.per_hour.items():
            if rate <= 0:
                continue
            vclass = ACTOR_KINDS[name].vclass
            if vclass not in made:
                walks = name == _ON_FOOT
                graph = (
                    walked_graph(network, self.outer)
                    if walks
                    else driven_graph(
                        network, vclass, self.outer, bus_roads if name == _BUS else frozenset()
                    )
                )
                made[vclass] = None if graph is None else Circuit.of(graph)
            circuit = made[vclass]
            if circuit is None:
                self._missing[name] = f"no way round that allows SUMO's class {vclass!r}"
                continue
            self._circuits[name] = circuit
            self._usual[name] = circuit.usual()

    @property
    def walks(self) -> Circuit | None:
        """The circuit of pedestrians; ``None`` without pedestrians."""
        return self._circuits.get(_ON_FOOT)

    @property
    def drives(self) -> bool:
        """Whether any class other than pedestrians has a circuit."""
        driving = [name for name, rate in self.per_hour.items() if rate > 0 and name != _ON_FOOT]
        return any(name in self._circuits for name in driving)

    def lowered(self, share: Mapping[tuple[str, str], float], classes: Set[str]) -> Circulation:
        """Return a copy with fewer passages of some classes over movements (``Circuit.lowered``).

        Args:
            share: (edge, next edge) -> share of the passages that remains, above 0.
            classes: the classes.
        """
        made = copy(self)
        made.per_hour, made._circuits = dict(self.per_hour), dict(self._circuits)
        made._usual = dict(self._usual)
        for name in sorted(classes & self._circuits.keys()):
            circuit, left = self._circuits[name].lowered(share)
            made._circuits[name], made._usual[name] = circuit, circuit.usual()
            made.per_hour[name] *= left
        return made

    def flows(self) -> dict[tuple[str, str, str], float]:
        """Return cars per hour, equivalents of bicycles included, by three consecutive edges."""
        return flows_of_circuits(
            (circuit, self.per_hour[name] * ON_LANES_IN_CARS[name])
            for name, circuit in self._circuits.items()
            if name in ON_LANES_IN_CARS
        )

    def populations(self, *, at_once: float = AT_ONCE) -> list[Population]:
        """Return the number of actors of each class that depart at once.

        Args:
            at_once: share of the vehicles of metered classes; gates add the others.
        """
        counts = []
        for name in self._circuits:
            seconds, metres = self._usual[name]
            rate = self.per_hour[name]
            share = 1.0 if name in (_ON_FOOT, _TRAM) else at_once
            wanted = max(1, int(np.floor(rate * share * seconds / PACE[name] / 3600.0 + 0.5)))
            count = wanted
            if name == _ON_FOOT:
                count = max(
                    1, min(wanted, int(self._circuits[name].room_m / _FOOTWAY_PER_PERSON_M))
                )
            counts.append(Population(name, rate, count, seconds, metres, wanted - count))
        return counts

    def demand(
        self,
        populations: list[Population],
        *,
        warmup_s: float,
        duration_s: float,
        body: Callable[[str, int], str],
        room: Mapping[str, float] | None = None,
    ) -> Demand:
        """Plan the passages of all actors, from their entry to beyond the end of the motion.

        Each actor departs somewhere on its first passage. Its passages depend only on the seed, its
        class and its number in the class.

        Args:
            populations: number of actors of each class.
            warmup_s: duration of traffic before the motion starts.
            duration_s: duration of the motion.
            body: returns the asset of the n-th actor of a class.
            room: motor vehicles that fit onto each edge of the region bumper to bumper; ``None``:
                no gates.
        """
        trips: list[Trip] = []
        left_out = [
            LeftOut(name, max(1, round(self.per_hour[name] / 60)), why)
            for name, why in self._missing.items()
        ]
        left_out += [
            LeftOut(group.actor_class, group.without_room, "no room on the footways")
            for group in populations
            if group.without_room
        ]
        come_in_s = min(COMING_IN_S, warmup_s / 2)
        needed_s = (warmup_s + duration_s) * _FASTEST_FACTOR + 120.0
        for group in populations:
            number = ACTOR_CLASSES.index(group.actor_class)
            random = np.random.Generator(np.random.Philox(key=[self.seed, number]))
            places = (random.permutation(group.count) + random.random(group.count)) / group.count
            on_foot = group.actor_class == _ON_FOOT
            company = party_places(group.count, self.in_groups if on_foot else 0.0, self.seed)
            for k in range(group.count):
                if company[k]:
                    asset = body(group.actor_class, k)
                    trips.append(replace(trips[-company[k]], asset=asset, beside=company[k]))
                    continue
                name = group.actor_class
                begin = self._circuits[name].begin(float(places[k]))
                depart_s = round(come_in_s * (k + 0.5) / group.count, 2)
                own = self._random(name, k)
                trips.append(
                    self._trip(name, body(name, k), depart_s, needed_s, own, begin, anywhere=True)
                )
        trips.sort(key=lambda trip: (trip.depart_s, ACTOR_CLASSES.index(trip.actor_class)))
        gates, more = GatePlan(), list[Trip]()
        if room is not None:
            gates, more = self._gate_plan(populations, needed_s, body, len(trips), room)
        return Demand(
            (*trips, *more),
            tuple(left_out),
            tuple(populations),
            self.outer,
            stops=self.stops,
            gates=gates,
            planned=self._planned(),
        )

    def _planned(self) -> dict[tuple[str, str], float]:
        """Return the planned motor vehicles per hour by (edge, next edge)."""
        flows: dict[tuple[str, str], float] = defaultdict(float)
        for name in sorted(IN_CARS.keys() & self._circuits.keys()):
            edges = self._circuits[name].graph.edges
            for (a, b), share in self._circuits[name].flows().items():
                flows[edges[a], edges[b]] += share * self.per_hour[name]
        return dict(flows)

    def _gate_plan(
        self,
        populations: list[Population],
        needed_s: float,
        body: Callable[[str, int], str],
        first: int,
        room: Mapping[str, float],
    ) -> tuple[GatePlan, list[Trip]]:
        """Return the gates, and the trips that they keep in reserve.

        Args:
            populations: number of actors of each class that depart at once.
            needed_s: least duration of a trip.
            body: returns the asset of the n-th actor of a class.
            first: number of the first trip in reserve.
            room: motor vehicles that fit onto each edge of the region bumper to bumper.
        """
        per_hour: dict[tuple[str, bool], float] = {}
        arcs: dict[bool, dict[tuple[str, str], float]] = {True: {}, False: {}}
        reserve: dict[tuple[str, bool], list[tuple[float, str, int]]] = {}
        for group in populations:
            if group.actor_class in (_ON_FOOT, _TRAM):
                continue
            circuit = self._circuits[group.actor_class]
            rates: dict[int, float] = {}
            edges, holds = circuit.graph.edges, group.actor_class in IN_CARS
            for (a, b), flow in circuit.flows().items():
                arc = edges[a], edges[b]
                metres = flow * group.per_hour * float(circuit.graph.metres[a, b])
                arcs[holds][arc] = arcs[holds].get(arc, 0.0) + metres
                if circuit.graph.outer[a] and not circuit.graph.outer[b]:
                    rates[a] = rates.get(a, 0.0) + flow * group.per_hour
            for state, rate in rates.items():
                gate = edges[state], holds
                per_hour[gate] = per_hour.get(gate, 0.0) + rate
                if state in circuit.starts:
                    reserve.setdefault(gate, []).extend(
                        ((k + 0.5) * 3600.0 / rate, group.actor_class, state)
                        for k in range(int(np.ceil(RESERVE_S * rate / 3600.0)) + 1)
                        if rate > 0
                    )
        made = {group.actor_class: group.count for group in populations}
        part_of = {holds: _parts(arcs[holds]) for holds in (True, False)}
        trips: list[Trip] = []
        gates = []
        for edge, holds in sorted(per_hour):
            numbers = []
            for _, name, state in sorted(reserve.get((edge, holds), ())):
                k, made[name] = made[name], made[name] + 1
                trip = self._trip(name, body(name, k), 0.0, needed_s, self._random(name, k), state)
                numbers.append(first + len(trips))
                trips.append(replace(trip, in_reserve=True))
            part = part_of[holds][edge]
            gates.append(Gate(edge, per_hour[edge, holds], holds, tuple(numbers), part))
        parts = []
        for number in range(max(part_of[True].values(), default=-1) + 1):
            own = sorted(edge for edge, part in part_of[True].items() if part == number)
            rate = sum(gate.per_hour for gate in gates if gate.holds and gate.part == number)
            metres = sum(
                length for (edge, _), length in arcs[True].items() if part_of[True][edge] == number
            )
            room_m = sum(room.get(edge, 0.0) for edge in own)
            parts.append(NetworkPart(tuple(own), room_m, metres / rate if rate else 1.0))
        return GatePlan(tuple(gates), tuple(parts)), trips

    def _random(self, actor_class: str, number: int) -> np.random.Generator:
        """Return the random stream of an actor, which depends only on its class and number."""
        stream = (ACTOR_CLASSES.index(actor_class) + 1) * 1_000_000 + number
        return np.random.Generator(np.random.Philox(key=[self.seed, stream]))

    def _trip(
        self,
        actor_class: str,
        asset: str,
        depart_s: float,
        needed_s: float,
        random: np.random.Generator,
        begin: int,
        *,
        anywhere: bool = False,
    ) -> Trip:
        """Return a trip of consecutive passages.

        Args:
            actor_class: its class.
            asset: its mesh.
            depart_s: time of departure.
            needed_s: least duration of the trip.
            random: its random stream.
            begin: the state from which the first passage starts.
            anywhere: depart anywhere on the first passage, in proportion to the time spent there,
                instead of at its start.
        """
        circuit = self._circuits[actor_class]
        graph = circuit.graph
        first = [begin, *circuit.passage(begin, random)]
        total = np.cumsum([float(graph.seconds[pair]) for pair in itertools.pairwise(first)])
        skipped = int(np.searchsorted(total, random.random() * total[-1], side="right"))
        skipped = min(skipped, len(first) - 2) if anywhere else 0
        while (
            anywhere
            and skipped < len(first) - 2
            and graph.length_m[first[skipped]] < _MIN_DEPARTURE_STREET_M
        ):
            skipped += 1
        share = float(random.random())
        passages, left_s = [first[skipped:]], needed_s - float(total[-1] - total[skipped])
        while left_s > 0:
            state = passages[-1][-1]
            passage = [state, *circuit.passage(state, random)]
            left_s -= sum(float(graph.seconds[pair]) for pair in itertools.pairwise(passage))
            passages.append(passage)
        if actor_class != _ON_FOOT:
            states = passages[0] + [state for passage in passages[1:] for state in passage[1:]]
            edges = tuple(graph.edges[state] for state in states)
            halts: tuple[int, ...] = ()
            if actor_class in (_BUS, _TRAM):
                # A departure on the first street may lie beyond a stop there.
                halts = tuple(k for edge in edges[1:] for k in self._stops_of.get(edge, ()))
            return Trip(actor_class, asset, depart_s, edges, anywhere=anywhere, halts=halts)
        # Walks end in the middle of a gate's sidewalk, where the next begins. A walk that turns
        # back on a sidewalk goes to its end first, since the planned way would otherwise take no
        # time.
        walks = []
        for passage in passages:
            parts = _split_at_reversals(passage, graph.edges)
            for number, (part, state) in enumerate(parts):
                along = 0.5 if number == len(parts) - 1 else float(state % 2 == 0)
                walks.append((part, _rounded_position(graph.length_m[state] * along)))
        begin_m = _rounded_position(graph.length_m[passages[0][0]] * share)
        return Trip(
            actor_class, asset, depart_s, walks[0][0], begin_m, walks[0][1], then=tuple(walks[1:])
        )


def _parts(arcs: Iterable[tuple[str, str]]) -> dict[str, int]:
    """Return the number of the connected part of the network that each edge belongs to.

    Args:
        arcs: (edge, next edge) that vehicles take.
    """
    pairs = sorted(arcs)
    index = {edge: k for k, edge in enumerate(dict.fromkeys(itertools.chain(*pairs)))}
    ends = np.array([[index[a], index[b]] for a, b in pairs], np.int64).reshape(-1, 2).T
    graph = scipy.sparse.coo_array((np.ones(ends.shape[1]), ends), shape=(len(index),) * 2)
    _, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return {edge: int(part[k]) for edge, k in index.items()}


def _split_at_reversals(
    states: list[int], edges: tuple[str, ...]
) -> list[tuple[tuple[str, ...], int]]:
    """Return the edges and last state of a walk, split where it turns back on an edge.

    Even states are edges in their own direction, odd ones in the opposite direction
    (``walked_graph``).
    """
    parts: list[list[int]] = [[states[0]]]
    for a, b in itertools.pairwise(states):
        if edges[a] == edges[b]:
            parts.append([b])
        else:
            parts[-1].append(b)
    return [(tuple(edges[state] for state in part), part[-1]) for part in parts]


def _rounded_position(metres: float) -> float:
    """Round a position on an edge down to centimetres, since SUMO rejects any beyond its end."""
    return float(np.floor(metres * 100) / 100)
