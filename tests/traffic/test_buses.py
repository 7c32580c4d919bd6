"""Buses halt where stops are, for as long as people take to get on, and keep to their lines."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from urbantwin.roads import BusStop
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.sumo_network import read_sumo_network
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.sumo.route_file import DWELL_S
from urbantwin.traffic.sumo.simulation import simulate

#: A ring of four streets with two short cuts across its middle; buses run on the ring.
NODES = """<node id="a" x="0" y="0"/><node id="b" x="150" y="0"/><node id="c" x="150" y="150"/>
<node id="d" x="0" y="150"/>"""
EDGES = "".join(
    f'<edge id="{start}{end}" from="{start}" to="{end}" numLanes="1" speed="13.9"/>'
    for start, end in ("ab", "bc", "cd", "da", "ac", "ca")
)


@pytest.fixture(scope="module")
def ring(make_net: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_net(tmp_path_factory.mktemp("ring"), NODES, EDGES)


def test_every_bus_halts_at_every_stop_on_its_way(ring: Path) -> None:
    lanes = read_sumo_network(ring, driving_side="right", level_of_way={}, origin={}).lane_by_id
    stop = BusStop("bc_0", "Corner", 60.0, 78.0)
    circulation = Circulation(
        StreetNetwork(ring, None),
        {"ab", "da"},
        {"bus": 200.0, "car": 100.0},
        3,
        stops=[stop],
        bus_roads={"ab", "bc", "cd", "da"},
    )
    demand = circulation.demand(
        circulation.populations(), warmup_s=60.0, duration_s=240.0, body=Fleet().body
    )
    kinds = [trip.actor_class for trip in demand.trips]
    buses = [number for number, kind in enumerate(kinds) if kind == "bus"]
    assert len(buses) >= 2
    assert all(not trip.halts for trip in demand.trips if trip.actor_class != "bus")
    assert {edge for k in buses for edge in demand.trips[k].edges} == {"ab", "bc", "cd", "da"}
    seen = simulate(ring, demand, asset, warmup_s=60.0, steps=2400, step_s=0.1, seed=3)
    begin = lanes["bc_0"].centre[0, :2]
    halts = 0
    for bus in buses:
        last = -1000
        rows = np.flatnonzero((seen.trip == bus) & (seen.speed < 0.01))
        for still in np.split(rows, np.flatnonzero(np.diff(seen.step[rows]) > 1) + 1):
            along = np.linalg.norm(seen.front[still] - begin, axis=1)
            if len(still) < 50:
                continue  # behind another bus
            if stop.start_m < along.mean() < stop.end_m + 0.5:
                halts += 1
                # Once each time that it comes round: the ring is about 300 m long.
                assert seen.step[still[0]] - last > 200
                last = seen.step[still[-1]]
                whole = seen.step[still[0]] > 0 and seen.step[still[-1]] < 2390
                assert not whole or abs(len(still) * 0.1 - DWELL_S) < 1.0
    assert halts >= 2 * len(buses)
