"""A closed loop: everybody stays, moves and comes back, as SUMO's own output and our tables say."""

import itertools
import re
import subprocess
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.sparse
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, sumo_binary
from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.movement_flows import IN_CARS, flows_of_circuits
from urbantwin.roads.assignment.routing_graph import WayGraph, driven_graph, walked_graph
from urbantwin.roads.assignment.street_network import StreetNetwork, has_walkway
from urbantwin.site import read_extract
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.guessed_volumes import bounded_by_signals
from urbantwin.traffic.sumo.simulation import observe, sumo_options, write_routes

SECONDS, WARMUP = 900, 120
PER_HOUR = {"car": 500.0, "truck": 40.0, "bus": 30.0, "motorcycle": 40.0, "bicycle": 80.0}
PER_HOUR["pedestrian"] = 120.0
REGION = shapely.box(-120, -120, 120, 120)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, frozenset[str]]:
    """A signalised crossing whose four arms the region's border cuts: net and outer edges."""
    folder = tmp_path_factory.mktemp("town")
    places = {1: (-200, 0), 2: (0, 0), 3: (200, 0), 4: (0, -200), 5: (0, 200)}
    nodes = ""
    for node, (x, y) in places.items():
        lat, lon = 48.7 + y / 111_194.9, 9.18 + x / 73_391.0
        tag = '<tag k="highway" v="traffic_signals"/>' if node == 2 else ""
        nodes += f'<node id="{node}" lat="{lat:.9f}" lon="{lon:.9f}" version="1">{tag}</node>'
    tags = {"highway": "secondary", "lanes": "4", "sidewalk": "both", "maxspeed": "50"}
    tagged = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
    ways = "".join(
        f'<way id="{way}" version="1">{"".join(f"<nd ref={chr(34)}{n}{chr(34)}/>" for n in refs)}'
        f"{tagged}</way>"
        for way, refs in ((10, (1, 2, 3)), (11, (4, 2, 5)))
    )
    osm = folder / "town.osm"
    osm.write_text(f'<osm version="0.6">{nodes}{ways}</osm>')
    net = folder / "town.net.xml"
    built = build_roads(
        read_extract(osm),
        SiteFrame(48.7, 9.18),
        REGION,
        Elevation.flat(),
        driving_side="right",
        out=net,
        closed_loop=True,
    )
    return net, frozenset(road.id for road in built.network.roads if not road.ways)


@pytest.fixture(scope="module")
def circulation(town: tuple[Path, frozenset[str]]) -> Circulation:
    return Circulation(StreetNetwork(town[0], REGION), town[1], PER_HOUR, 7)


@pytest.fixture(scope="module")
def demand(town: tuple[Path, frozenset[str]], circulation: Circulation):
    inside = [x.getID() for x in StreetNetwork(town[0], REGION).streets if x.getID() not in town[1]]
    return circulation.demand(
        circulation.populations(),
        warmup_s=WARMUP,
        duration_s=SECONDS - WARMUP,
        body=Fleet().body,
        room=dict.fromkeys(inside, 500.0 / len(inside)),
    )


@pytest.fixture(scope="module")
def seen(town: tuple[Path, frozenset[str]], demand):
    return observe(town[0], demand, asset, seconds=SECONDS, step_ms=500, seed=7, warmup_s=WARMUP)


def test_nobody_leaves_nobody_is_lifted_and_nobody_is_stuck(demand, seen) -> None:
    planned = Counter(demand.trips[number].actor_class for number in seen.departed)
    for name in PER_HOUR:
        column = ACTOR_CLASSES.index(name)
        assert planned[name] > 0
        assert (seen.observed.least[2:, column] == planned[name]).all()
        assert (seen.observed.most[2:, column] == planned[name]).all()
    assert seen.teleports == 0
    assert seen.observed.stuck == ()
    assert seen.observed.longest_halt_s < 180


def test_speed_does_not_fall_with_time(seen) -> None:
    speed = seen.observed.metres[:, :5].sum(axis=1) / seen.observed.samples[:, :5].sum(axis=1)
    first, last = speed[3:8].mean(), speed[-6:-1].mean()
    assert last == pytest.approx(first, rel=0.15)
    assert first > 2.0


def test_as_many_pass_as_were_asked_for(seen) -> None:
    """Within 15 % and the chance of counting (three standard deviations of a Poisson count)."""
    hours = (len(seen.observed.entries) - 3) / 60
    for name, per_hour in PER_HOUR.items():
        column = ACTOR_CLASSES.index(name)
        counted = seen.observed.entries[3:, column].sum()
        asked = per_hour * hours
        # One vehicle more or less is the finest that there is.
        one = asked / max(seen.observed.most[-1, column], 1)
        assert abs(counted - asked) < 0.15 * asked + 0.5 * one + 3 * np.sqrt(asked), name


def test_sumo_itself_counts_everybody_all_the_time(town, circulation, tmp_path: Path) -> None:
    """Traffic without gates in the program ``sumo``: its summary says how many there are."""
    demand = circulation.demand(
        circulation.populations(at_once=1.0), warmup_s=120, duration_s=700, body=Fleet().body
    )
    write_routes(tmp_path / "r.rou.xml", demand, asset)
    summary, people = tmp_path / "s.xml", tmp_path / "p.xml"
    options = [f"--{k}={v}" for k, v in sumo_options(1000, 7, circulates=True).items()]
    command = [sumo_binary("sumo"), "-n", town[0], "-r", tmp_path / "r.rou.xml", *options]
    command += ["--summary-output", summary, "--person-summary-output", people, "--end", "600"]
    done = subprocess.run(
        [*map(str, command), "--no-step-log", "true"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    vehicles = sum(trip.actor_class != "pedestrian" for trip in demand.trips)
    for path, tag, count in ((summary, "running", vehicles), (people, "loaded", None)):
        steps = ElementTree.parse(path).getroot().findall("step")
        assert len(steps) > 500
        late = steps[120:]
        if count is not None:
            assert {int(step.get(tag)) for step in late} == {count}
            assert {int(step.get("arrived", step.get("ended"))) for step in late} == {0}
            assert {int(step.get("teleports")) for step in late} == {0}
    assert not re.search(r"(?m)^Error", done.stderr)


def test_passages_follow_the_networks_connections(town, demand) -> None:
    root = ElementTree.parse(town[0]).getroot()
    joined = {(item.get("from"), item.get("to")) for item in root.iter("connection")}
    for trip in demand.trips:
        if trip.actor_class != "pedestrian":
            assert all(pair in joined for pair in itertools.pairwise(trip.edges))
            assert len(set(trip.edges) & demand.outer) >= 2, "more than one way out and in"


def test_walks_go_on_where_the_one_before_ended(demand) -> None:
    for trip in demand.trips:
        if trip.actor_class == "pedestrian":
            walks = [(trip.edges, trip.arrive_m), *trip.then]
            assert len(walks) > 3
            for (before, _), (after, _) in itertools.pairwise(walks):
                assert after[0] == before[-1]
            for edges, _ in walks:
                assert all(a != b for a, b in itertools.pairwise(edges))


def test_trips_depend_on_the_seed_and_on_nothing_else(town, circulation: Circulation) -> None:
    def planned(seed: int, **more: float):
        made = Circulation(StreetNetwork(town[0], REGION), town[1], {**PER_HOUR, **more}, seed)
        return made.demand(made.populations(), warmup_s=60, duration_s=60, body=Fleet().body).trips

    assert planned(7) == planned(7)
    assert planned(7) != planned(8)

    def cars(trips) -> list:
        return [trip for trip in trips if trip.actor_class == "car"]

    assert cars(planned(7)) == cars(planned(7, bus=300.0))


def test_who_walks_in_company_has_the_way_of_whom_it_walks_with(town) -> None:
    def planned(in_groups: float):
        network = StreetNetwork(town[0], REGION)
        made = Circulation(network, town[1], {"pedestrian": 400.0}, 7, in_groups=in_groups)
        return made.demand(made.populations(), warmup_s=60, duration_s=60, body=Fleet().body).trips

    alone, parties = planned(0.0), planned(0.56)
    assert len(alone) == len(parties)
    company = 0
    for number, trip in enumerate(parties):
        if trip.beside:
            first = parties[number - trip.beside]
            assert (trip.depart_s, trip.edges, trip.then) == (
                first.depart_s,
                first.edges,
                first.then,
            )
            company += 1
        else:  # who leads walks as it would alone
            assert trip == alone[number]
    assert company > 5


@pytest.mark.parametrize("vclass", ["passenger", "bicycle", None])
def test_gates_are_passed_in_proportion_to_their_traffic(town, vclass: str | None) -> None:
    """The four arms are alike: over many passages each is passed equally often."""
    network = StreetNetwork(town[0], REGION)
    graph = walked_graph(network, town[1]) if vclass is None else driven_graph(
        network, vclass, town[1]
    )  # fmt: skip
    circuit = Circuit.of(graph)
    random = np.random.default_rng(1)
    state, passed = circuit.begin(0.5), Counter()
    for _ in range(2000):
        before = state
        state = circuit.passage(state, random)[-1]
        passed[int(graph.gate[state])] += 1
        assert graph.gate[state] != graph.gate[before], "nobody returns where there is another way"
    assert len(passed) == 4
    assert min(passed.values()) > 0.8 * 500


def test_a_network_without_a_way_round_has_no_circuit(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    nodes = '<node id="a" x="-140" y="0"/><node id="b" x="140" y="0"/>'
    net = make_net(tmp_path, nodes, '<edge id="ab" from="a" to="b"/>')
    circulation = Circulation(StreetNetwork(net, REGION), frozenset(), {"car": 100.0}, 1)
    assert not circulation.drives
    assert circulation.populations() == []


def test_who_walks_to_and_fro_walks_as_far_as_was_planned(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    """On a street of its own one turns back at its ends: 15 minutes are 1.2 km and more."""
    nodes = '<node id="a" x="-140" y="0"/><node id="b" x="140" y="0"/>'
    net = make_net(tmp_path, nodes, '<edge id="ab" from="a" to="b" sidewalkWidth="2"/>')
    made = Circulation(StreetNetwork(net, None), frozenset(), {"pedestrian": 60.0}, 1)
    demand = made.demand(made.populations(), warmup_s=0.0, duration_s=900.0, body=Fleet().body)
    assert demand.trips
    for trip in demand.trips:
        assert {trip.edges, *(edges for edges, _ in trip.then)} == {("ab",)}
        places = np.array([trip.depart_m, trip.arrive_m, *(place for _, place in trip.then)])
        assert np.abs(np.diff(places)).sum() > 900.0 * 1.34


def square_of_footways(outside: int) -> WayGraph:
    """Four footways of 50 m in a ring, two of them gates, and outer roads that nothing leads to."""
    count = 4 + outside
    step = scipy.sparse.csr_array(
        (np.full(4, 40.0), (np.arange(4), (np.arange(4) + 1) % 4)), shape=(count, count)
    )
    gate = np.full(count, -1)
    gate[[0, 2]] = 0, 1
    return WayGraph(
        tuple(f"e{n}" for n in range(count)),
        np.full(count, 50.0),
        step * 1.25,
        np.array([[n % 2 * 50.0, n // 2 * 50.0] for n in range(count)]),
        step,
        scipy.sparse.csr_array((count, count)),
        np.arange(count) >= 4,
        gate,
        np.ones(2),
        np.zeros(count, bool),
        np.zeros(count, bool),
    )


def test_nobody_goes_round_outside_alone_however_much_traffic_there_is() -> None:
    """Outer roads that lead to one another and never into the region, ten times as busy."""
    count = 6
    before, after = [0, 1, 2, 3, 4, 5], [1, 2, 3, 0, 5, 4]
    step = scipy.sparse.csr_array((np.full(6, 40.0), (before, after)), shape=(count, count))
    ring = replace(
        square_of_footways(2),
        seconds=step,
        metres=step * 1.25,
        gate=np.array([0, -1, 1, -1, 2, 3]),
        weight=np.array([1.0, 1.0, 10.0, 10.0]),
    )
    circuit = Circuit.of(ring)
    assert circuit is not None
    assert circuit.room_m == 200
    assert circuit.usual() == pytest.approx((80, 100))
    assert Circuit.of(replace(ring, gate=np.array([-1, -1, -1, -1, 2, 3]))) is None


@pytest.mark.parametrize("outside", [0, 2])
def test_who_never_meets_an_outer_road_goes_round_from_gate_to_gate(outside: int) -> None:
    """Half the ring is 80 s and 100 m, whether or not there are outer roads elsewhere."""
    circuit = Circuit.of(square_of_footways(outside))
    assert circuit is not None
    assert circuit.usual() == (pytest.approx(80.0), pytest.approx(100.0))
    assert circuit.room_m == 200.0


def test_no_more_walk_than_there_is_room(town: tuple[Path, frozenset[str]]) -> None:
    net, outer = town
    network = StreetNetwork(net, REGION)
    few = Circulation(network, outer, {"pedestrian": 100.0}, seed=1).populations()[0]
    many = Circulation(network, outer, {"pedestrian": 1e6}, seed=1)
    (crowd,) = many.populations()
    length = sum(edge.getLength() for edge in network.streets if has_walkway(edge))
    assert few.without_room == 0
    assert few.count < crowd.count <= length / 2.8
    demand = many.demand([crowd], warmup_s=0.0, duration_s=1.0, body=Fleet().body)
    assert len(demand.trips) == crowd.count
    (left,) = demand.left_out
    assert (left.count, left.why) == (crowd.without_room, "no room on the footways")


def test_flows_are_those_of_everybody_who_comes_in(town, circulation: Circulation) -> None:
    """In cars: trucks and buses count twice, motorcycles 0.7, bicycles among cars once."""
    flows = circulation.flows()
    entries = sum(n for (a, b, _), n in flows.items() if a in town[1] and b not in town[1])
    assert entries == pytest.approx(500 + 2 * 40 + 2 * 30 + 0.7 * 40 + 80)
    # As many come to a street as go on from it.
    for edge in {b for _, b, _ in flows}:
        comes = sum(n for (_, b, _), n in flows.items() if b == edge)
        goes = sum(n for (a, _, _), n in flows.items() if a == edge)
        assert comes == pytest.approx(goes, rel=1e-6)


def test_cyclists_with_a_lane_of_their_own_take_no_green_of_cars(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    """Round a triangle, one side of it with a cycle lane, and round four sides."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/><node id="c" x="50" y="80"/>'
    own = '<lane index="0" allow="bicycle"/><lane index="1" disallow="bicycle"/>'
    edges = f'<edge id="ab" from="a" to="b" numLanes="2">{own}</edge>'
    edges += '<edge id="bc" from="b" to="c"/><edge id="ca" from="c" to="a"/>'
    network = StreetNetwork(make_net(tmp_path, nodes, edges), None)
    for vclass, apart in (("bicycle", {"ab"}), ("passenger", set())):
        graph = driven_graph(network, vclass, {"ca"})
        assert graph is not None
        assert {edge for edge, own in zip(graph.edges, graph.apart, strict=True) if own} == apart
    ring = replace(square_of_footways(0), apart=np.array([True, False, False, False]))
    circuit = Circuit.of(ring)
    assert circuit is not None
    assert {a for a, _, _ in flows_of_circuits([(circuit, 60.0)])} == {"e1", "e2", "e3"}


def test_guesses_are_lowered_to_what_signals_can_let_through(town) -> None:
    net, outer = town
    network = StreetNetwork(net, REGION)
    few = Circulation(network, outer, PER_HOUR, 7)
    same, light = bounded_by_signals(net, few)
    assert (light.share, light.because) == (1.0, "")
    assert same.flows() == few.flows()
    crowd = Circulation(network, outer, {name: 10 * n for name, n in PER_HOUR.items()}, 7)
    less, bound = bounded_by_signals(net, crowd)
    # Four lanes each way: no more than 1,800 cars an hour on each of eight lanes, half of the time.
    come = sum(less.per_hour[name] * cars for name, cars in IN_CARS.items())
    assert 1000 < come < 8 * 1800 / 2
    assert "its signal lets" in bound.because
    assert less.per_hour["pedestrian"] == crowd.per_hour["pedestrian"]
    motor = [sum(one.per_hour[name] for name in IN_CARS) for one in (less, crowd)]
    assert bound.share == pytest.approx(motor[0] / motor[1])


def test_only_those_stay_away_who_would_pass_where_it_is_full(town) -> None:
    """Of four arms that are alike what comes from one is halved.

    Each of the others misses what it exchanges with that arm, a third, by sqrt(0.5): a tenth.
    """
    net, outer = town
    made = Circulation(StreetNetwork(net, REGION), outer, {"car": 600.0}, 7)
    comes_in = {
        way: n for way, n in made.flows().items() if way[0] in outer and way[1] not in outer
    }
    weak = sorted(comes_in)[0][:2]
    less = made.lowered({weak: 0.5}, {"car"})
    flows = less.flows()
    arms = {way[:2] for way in comes_in}
    entries = {arm: sum(n for way, n in flows.items() if way[:2] == arm) for arm in arms}
    assert sum(entries.values()) == pytest.approx(less.per_hour["car"])
    # Nobody is taken off the road, so fewer come to that arm, too.
    assert 150 * 0.5 < entries[weak] < 150 * 0.75
    others = [count for arm, count in entries.items() if arm != weak]
    assert min(others) > 150 * 0.85
    assert max(others) < 150 * 1.02
    for edge in {b for _, b, _ in flows}:
        comes = sum(n for (_, b, _), n in flows.items() if b == edge)
        goes = sum(n for (a, _, _), n in flows.items() if a == edge)
        assert comes == pytest.approx(goes, rel=1e-4)
