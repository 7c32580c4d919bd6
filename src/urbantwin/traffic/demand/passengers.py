"""Passengers: people that walk to stops, wait there, board, and come back some time later.

Each belongs to one stop. It walks in from a gate of the region, waits, boards the next vehicle, and
is away until it alights there again and walks to a gate and back. So no passenger appears from
nowhere or is lost.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.traffic.demand.demand import Demand, Passengers, Trip
from urbantwin.traffic.demand.stop_places import StopPlace, stop_place

__all__ = ["boarding_job", "with_passengers"]

#: Boarding passengers per halt of a tram relative to a bus. Assumed.
_TRAM_FACTOR = 2.0
#: Number of passengers that are away at first, in multiples of the mean number alighting at a halt.
_AWAY_FACTOR = 4.0
_ON_FOOT, _STREAM, _NUMBERS_PER_STOP = "pedestrian", 7_200_000, 10_000


def with_passengers(
    demand: Demand,
    roads: RoadNetwork,
    walks: Circuit,
    *,
    per_halt: float,
    seconds: float,
    come_in_s: float,
    seed: int,
    body: Callable[[str, int], str],
) -> Demand:
    """Return a demand with passengers appended to its trips.

    Args:
        demand: a circulating demand.
        roads: the lanes.
        walks: the circuit of pedestrians.
        per_halt: mean number of boarding, and of alighting, passengers per halt of a bus.
        seconds: duration of the whole simulation.
        come_in_s: period within which passengers that walk in depart.
        seed: random seed; each stop has its own stream.
        body: returns the asset of the n-th actor of a class.
    """
    halts = np.zeros(len(demand.stops))
    for trip in demand.trips:
        if not trip.in_reserve:
            np.add.at(halts, list(trip.halts), 1.0)
    edges = frozenset(walks.graph.edges)
    places, trips = [], list(demand.trips)
    begins: dict[int, str] = {}
    stop_of: dict[int, int] = {}
    alight: dict[int, tuple[int, ...]] = {}
    for number in np.flatnonzero(halts).tolist():
        place = stop_place(roads, demand.stops[number], number, edges, seed)
        street_routes = None if place is None else _Ways.of(walks, place.edge)
        if place is None or street_routes is None:
            continue
        random = np.random.Generator(np.random.Philox(key=[seed, _STREAM + number]))
        mean = per_halt * (_TRAM_FACTOR if place.kind == "tram" else 1.0)
        # Trips are planned for somewhat longer than they last.
        rate = mean * halts[number] / (1.25 * seconds + 120.0)
        expected = int(halts[number]) + 20
        alight[number] = tuple(random.poisson(mean, expected).tolist())
        groups = {
            # Mean number of arrivals since the last halt, at a random time.
            "waits": int(random.poisson(mean / 2)),
            "walks": int(rate * street_routes.mean_s + random.random()),
            "rides": int(np.ceil(_AWAY_FACTOR * mean)),
        }
        places.append(place)
        kinds = [kind for kind, count in groups.items() for _ in range(count)]
        for k, kind in enumerate(kinds):
            own_seed = _STREAM * 2 + number * _NUMBERS_PER_STOP + k
            own = np.random.Generator(np.random.Philox(key=[seed, own_seed]))
            asset = body(_ON_FOOT, own_seed)
            begins[len(trips)], stop_of[len(trips)] = kind, number
            trips.append(_trip(place, street_routes, kind, asset, seconds, come_in_s, own))
    if not begins:
        return demand
    passengers = Passengers(tuple(places), begins, stop_of, alight)
    return replace(demand, trips=tuple(trips), passengers=passengers)


def _trip(
    place: StopPlace,
    ways: _Ways,
    kind: str,
    asset: str,
    seconds: float,
    come_in_s: float,
    random: np.random.Generator,
) -> Trip:
    """Return the trip of a passenger."""
    depart_s = round(float(random.random()) * come_in_s, 2)
    walks: list[tuple[tuple[str, ...], float]] = []
    waits = [0]
    if kind == "walks":
        gate = ways.gate(random)
        edges, begin_m = ways.part(ways.inward(gate), float(random.random()))
        if len(edges) == 1:
            begin_m = min(begin_m, place.along_m)
        walks.append((edges, place.along_m))
    else:
        begin_m = max(place.along_m - 0.5, 0.0)
        walks.append(((place.edge,), place.along_m))
        depart_s = round(0.01 * float(random.random()), 2)
    left_s = seconds
    while left_s > 0:
        gate = ways.gate(random)
        out, back = ways.outward(gate), ways.inward(gate)
        walks.append((ways.names(out), ways.middle_m(out[-1])))
        walks.append((ways.names(back), place.along_m))
        waits.append(len(walks) - 1)
        left_s -= ways.seconds(out) + ways.seconds(back)
    return Trip(
        _ON_FOOT, asset, depart_s, walks[0][0], begin_m, walks[0][1],
        then=tuple(walks[1:]), waits=tuple(waits),
    )  # fmt: skip


class _Ways:
    """The paths between a street and the gates.

    Args:
        walks: the circuit of pedestrians.
        states: states of the street, in both directions.
        out: cost and predecessors of the paths from each state.
        back: the same of the paths to each state.
    """

    def __init__(
        self,
        walks: Circuit,
        states: list[int],
        out: tuple[NDArray[np.float64], NDArray[np.int32]],
        back: tuple[NDArray[np.float64], NDArray[np.int32]],
    ) -> None:
        self._walks, self._states, self._out, self._back = walks, states, out, back
        graph = walks.graph
        own = {graph.edges[state] for state in states}
        gate_states = [s for s in walks.starts.tolist() if graph.edges[s] not in own]
        both = np.array([out[0][:, s].min() + back[0][:, s].min() for s in gate_states])
        self._gates = [
            s for s, cost in zip(gate_states, both.tolist(), strict=True) if np.isfinite(cost)
        ]
        gate = graph.gate[self._gates]
        times = np.bincount(gate, minlength=len(graph.weight)) if len(gate) else np.ones(1)
        load = graph.weight[gate] / times[gate] if len(gate) else np.zeros(0)
        self._load = np.cumsum(load)
        inward = [self.seconds(self.inward(state)) for state in self._gates]
        self.mean_s = float(np.average(inward, weights=load)) if len(gate) else 0.0

    @classmethod
    def of(cls, walks: Circuit, edge: str) -> _Ways | None:
        """Return the paths of a street; ``None`` if no gate can be reached from it."""
        graph = walks.graph
        states = [k for k, name in enumerate(graph.edges) if name == edge]
        cost = graph.seconds.copy()
        cost.data[np.asarray(graph.shunned[graph.seconds.nonzero()]).ravel() > 0] = np.inf
        out, back = (
            scipy.sparse.csgraph.dijkstra(costs, indices=states, return_predecessors=True)
            for costs in (cost, cost.T.tocsr())
        )
        paths = cls(walks, states, out, back)
        return paths if paths._gates else None

    def gate(self, random: np.random.Generator) -> int:
        """Draw a gate in proportion to its traffic."""
        load_index = np.searchsorted(self._load, random.random() * self._load[-1], side="right")
        return int(self._gates[min(int(load_index), len(self._gates) - 1)])

    def outward(self, gate: int) -> list[int]:
        """Return the states of the path from the stop to a gate."""
        return self._way(self._out, gate)[::-1]

    def inward(self, gate: int) -> list[int]:
        """Return the states of the path from a gate to the stop, turning at the gate."""
        ends = [k for k, name in enumerate(self._walks.graph.edges)
                if name == self._walks.graph.edges[gate]]  # fmt: skip
        return self._way(self._back, min(ends, key=lambda k: float(self._back[0][:, k].min())))

    def _way(self, found: tuple[NDArray[np.float64], NDArray[np.int32]], last: int) -> list[int]:
        cost, before = found
        row = int(cost[:, last].argmin())
        states = [last]
        while states[-1] != self._states[row]:
            states.append(int(before[row, states[-1]]))
        return states

    def seconds(self, states: list[int]) -> float:
        """Return the duration of a path."""
        pairs = itertools.pairwise(states)
        return float(sum(self._walks.graph.seconds[pair] for pair in pairs))

    def names(self, states: list[int]) -> tuple[str, ...]:
        """Return the edges of a path."""
        names = [self._walks.graph.edges[state] for state in states]
        return tuple(n for k, n in enumerate(names) if k == 0 or n != names[k - 1])

    def middle_m(self, state: int) -> float:
        """Return the middle of a state's edge, metres."""
        return float(np.floor(self._walks.graph.length_m[state] * 50) / 100)

    def part(self, states: list[int], share: float) -> tuple[tuple[str, ...], float]:
        """Return the edges of a path beyond a share of its length, and the start on the first."""
        length = np.array([self._walks.graph.length_m[state] for state in states])
        total = np.cumsum(length)
        start_m = share * total[-1]
        first = min(int(np.searchsorted(total, start_m, side="right")), len(states) - 1)
        within = (start_m - (total[first] - length[first])) / length[first]
        # Odd states run against the direction of their edge.
        within = 1.0 - within if states[first] % 2 else within
        return self.names(states[first:]), float(np.floor(within * length[first] * 100) / 100)


def boarding_job(passengers: Passengers) -> dict[str, Any]:
    """Return the passengers in the form that ``boarding.Boarding`` takes."""
    return {
        "stops": {str(place.stop): [place.end_m, place.leaves_s] for place in passengers.places},
        "alight": {str(stop): many for stop, many in passengers.alight.items()},
        "people": {
            str(trip): [str(stop), passengers.begins[trip]]
            for trip, stop in passengers.stop_of.items()
        },
    }
