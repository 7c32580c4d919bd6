"""A large junction whose outer sidewalks are all connected: walkers come in all the same."""

from collections.abc import Callable

import numpy as np
import pytest

from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.routing_graph import walked_graph
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.traffic import Motion
from urbantwin.traffic.demand.site_demand import outer_roads
from urbantwin.twin import Twin


@pytest.mark.thorough
def test_walkers_come_inside_and_are_as_many_as_have_room(
    real_drive: Callable[[str], tuple[Twin, Motion]],
) -> None:
    twin, motion = real_drive("manchester-kingsway")
    graph = walked_graph(StreetNetwork(twin.net_path, twin.region), outer_roads(twin))
    assert graph is not None
    circuit = Circuit.of(graph)
    assert circuit is not None
    assert len(circuit.gates) > 2
    random = np.random.Generator(np.random.Philox(key=3))
    state, inside = circuit.begin(0.5), 0
    for _ in range(50):
        passage = [state, *circuit.passage(state, random)]
        inside += not graph.outer[passage].all()
        state = passage[-1]
    assert inside == 50

    walkers = motion.manifest["classes"]["pedestrian"]
    assert walkers["asked"] == walkers["driven"]
    # Little's law: a way round over its signals takes two minutes to a quarter of an hour.
    hour = walkers["per_hour"]
    population = motion.manifest["circulation"]["population"]["pedestrian"]
    assert hour / 30 <= population["planned"] <= hour / 4
    # Beyond those there are passengers: the map has no sidewalk at either of its stops.
    assert motion.manifest["passengers"]
    assert walkers["asked"] > population["planned"]
    assert motion.manifest["left_out"] == []
