"""How many take each way from street to street, of those who circulate."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Set
from pathlib import Path

from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.routing_graph import driven_graph
from urbantwin.roads.assignment.street_network import StreetNetwork

__all__ = ["IN_CARS", "ON_LANES_IN_CARS", "flows_of_circuits", "movement_flows"]

#: How many cars take as much of a green as one of a class (HCM 2016, 19: 2 for heavy vehicles;
#: Indian Roads Congress 106, 1990, has 0.4 to 0.5 for motorcycles, but simulated ones queue behind
#: each other more than those of Chennai do).
IN_CARS = {"car": 1.0, "van": 1.0, "truck": 2.0, "bus": 2.0, "motorcycle": 0.7}
#: The same with bicycles, which ride among cars where they have no lane of their own. HBS 2001 has
#: 0.5 for them (table 7-2); simulated cars stay behind one, and a queue leaves a green of 10 s at
#: its pace.
ON_LANES_IN_CARS = {**IN_CARS, "bicycle": 1.0}


def movement_flows(
    net: Path,
    outer: Set[str],
    per_hour: Mapping[str, float],
    *,
    bus_roads: Set[str] = frozenset(),
) -> dict[tuple[str, str, str], float]:
    """Return (edge, next edge, the one after that) -> cars an hour.

    Empty where nobody circulates by car; the third is empty where a passage ends. Cyclists count
    where they ride among cars.

    Args:
        net: the SUMO network.
        outer: ids of the edges of outer roads.
        per_hour: who comes into the region, by class of actors.
        bus_roads: ids of the edges that bus lines run on.
    """
    if not outer:
        return {}
    network = StreetNetwork(net, None)
    found = []
    for vclass, names, preferred in (
        ("passenger", IN_CARS.keys() - {"bus"}, frozenset[str]()),
        ("bus", {"bus"}, bus_roads),
        ("bicycle", {"bicycle"}, frozenset()),
    ):
        graph = driven_graph(network, vclass, outer, preferred)
        circuit = None if graph is None else Circuit.of(graph)
        if circuit is not None:
            cars = sum(per_hour.get(name, 0.0) * ON_LANES_IN_CARS[name] for name in sorted(names))
            found.append((circuit, cars))
    return flows_of_circuits(found)


def flows_of_circuits(
    circuits: Iterable[tuple[Circuit, float]],
) -> dict[tuple[str, str, str], float]:
    """Return what ``movement_flows`` does, of circuits and the cars that come in by each."""
    found: dict[tuple[str, str, str], float] = defaultdict(float)
    for circuit, cars in circuits:
        edges, apart = (*circuit.graph.edges, ""), circuit.graph.apart
        for (a, b, c), share in circuit.flows(3).items():
            if not apart[a]:
                found[edges[a], edges[b], edges[c]] += cars * share
    return dict(found)
