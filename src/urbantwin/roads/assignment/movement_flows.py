"""Flows of circulating traffic on each movement from street to street."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Set
from pathlib import Path

from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.routing_graph import driven_graph
from urbantwin.roads.assignment.street_network import StreetNetwork

__all__ = ["IN_CARS", "ON_LANES_IN_CARS", "flows_of_circuits", "movement_flows"]

#: Passenger car equivalents by class (HCM 2016, 19: 2 for heavy vehicles; Indian Roads Congress
#: 106, 1990, has 0.4 to 0.5 for motorcycles, but simulated ones queue behind each other more than
#: those of Chennai do).
IN_CARS = {"car": 1.0, "van": 1.0, "truck": 2.0, "bus": 2.0, "motorcycle": 0.7}
#: The same with bicycles in mixed lanes. HBS 2001 has 0.5 for them (table 7-2); simulated cars stay
#: behind a bicycle, and a queue leaves a green of 10 s at its speed.
ON_LANES_IN_CARS = {**IN_CARS, "bicycle": 1.0}


def movement_flows(
    net: Path,
    outer: Set[str],
    per_hour: Mapping[str, float],
    *,
    bus_roads: Set[str] = frozenset(),
) -> dict[tuple[str, str, str], float]:
    """Return (edge, next edge, the one after that) -> cars per hour.

    Empty without circulating traffic; the third edge is empty where a passage ends. Bicycles count
    where they share lanes with cars.

    Args:
        net: the SUMO network.
        outer: ids of the edges of outer roads.
        per_hour: actors that enter the region per hour, by class.
        bus_roads: ids of the edges of bus lines.
    """
    if not outer:
        return {}
    network = StreetNetwork(net, None)
    circuits = []
    for vclass, names, preferred in (
        ("passenger", IN_CARS.keys() - {"bus"}, frozenset[str]()),
        ("bus", {"bus"}, bus_roads),
        ("bicycle", {"bicycle"}, frozenset()),
    ):
        graph = driven_graph(network, vclass, outer, preferred)
        circuit = None if graph is None else Circuit.of(graph)
        if circuit is not None:
            cars = sum(per_hour.get(name, 0.0) * ON_LANES_IN_CARS[name] for name in sorted(names))
            circuits.append((circuit, cars))
    return flows_of_circuits(circuits)


def flows_of_circuits(
    circuits: Iterable[tuple[Circuit, float]],
) -> dict[tuple[str, str, str], float]:
    """Return the result of ``movement_flows`` for circuits and their entering cars per hour."""
    flows: dict[tuple[str, str, str], float] = defaultdict(float)
    for circuit, cars in circuits:
        edges, apart = (*circuit.graph.edges, ""), circuit.graph.apart
        for (a, b, c), share in circuit.flows(3).items():
            if not apart[a]:
                flows[edges[a], edges[b], edges[c]] += cars * share
    return dict(flows)
