"""Who sets out: how many, how evenly, from where to where."""

import itertools
import subprocess
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.errors import StageError
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.netconvert import sumo_binary, sumo_environment
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Routes, Trip, plan_demand
from urbantwin.traffic.sumo.simulation import write_routes

REGION = shapely.box(-150, -150, 150, 150)


def plan(
    net: Path, per_hour: dict[str, float], *, seed: int = 1, duration_s: float = 540
) -> Demand:
    network = StreetNetwork(net, REGION)
    times = {"warmup_s": 60.0, "duration_s": duration_s}
    return plan_demand(network, per_hour, seed=seed, body=Fleet().body, **times)


def test_counts_are_the_rates_times_the_period(crossing_net: Path) -> None:
    asked = {"car": 1000.0, "truck": 33.0, "bus": 2.0, "bicycle": 6.0, "pedestrian": 500.0}
    counts = Counter(trip.actor_class for trip in plan(crossing_net, asked).trips)
    for name, per_hour in asked.items():
        assert abs(counts[name] - per_hour / 6) <= 0.5
    assert counts["motorcycle"] == 0


def test_setting_out_is_even(crossing_net: Path) -> None:
    trips = plan(crossing_net, {"car": 600.0}).trips
    times = np.array([trip.depart_s for trip in trips])
    assert (np.diff(times) >= 0).all()
    # 100 trips in 600 s: one in each 6 s, at random within them.
    np.testing.assert_array_equal(np.floor(times / 6), np.arange(100))
    assert np.std(times % 6) > 1


def test_trips_depend_on_the_seed_alone(crossing_net: Path) -> None:
    asked = {"car": 600.0, "pedestrian": 300.0}
    assert plan(crossing_net, asked) == plan(crossing_net, asked)
    assert plan(crossing_net, asked) != plan(crossing_net, asked, seed=2)


def test_more_of_one_class_leaves_the_others_alone(crossing_net: Path) -> None:
    def cars(demand: Demand) -> list[object]:
        return [trip for trip in demand.trips if trip.actor_class == "car"]

    few, many = {"car": 300.0, "bus": 10.0}, {"car": 300.0, "bus": 200.0}
    assert cars(plan(crossing_net, few)) == cars(plan(crossing_net, many))


def test_routes_follow_the_networks_connections_from_border_to_border(crossing_net: Path) -> None:
    root = ElementTree.parse(crossing_net).getroot()
    joined = {(item.get("from"), item.get("to")) for item in root.iter("connection")}
    trips = plan(crossing_net, {"car": 900.0, "bus": 120.0, "bicycle": 240.0}).trips
    routes = Counter(trip.edges for trip in trips)
    for edges in routes:
        assert all(pair in joined for pair in itertools.pairwise(edges))
        assert edges[0] in {"ec", "nc", "wc", "sc"}
        assert edges[-1] in {"ce", "cn", "cw", "cs"}
        assert edges[0][0] != edges[-1][1], "nobody leaves where they came in"
    assert len(routes) == 12, "every turn is made"


def test_people_walk_from_border_to_border_over_every_crossing(crossing_net: Path) -> None:
    trips = plan(crossing_net, {"pedestrian": 3000.0}).trips
    late = [trip for trip in trips if trip.depart_s > 60]
    for trip in late:
        for edge, place in ((trip.edges[0], trip.depart_m), (trip.edges[-1], trip.arrive_m)):
            # Sidewalks belong to streets towards (?c) and from (c?) the crossing.
            assert place == 0 if edge.endswith("c") else place > 100
    arms = Counter(frozenset("".join(trip.edges)) - {"c"} for trip in late)
    assert len(arms) >= 6, "between any two arms"


def test_walkers_of_the_warm_up_begin_along_their_way(crossing_net: Path) -> None:
    trips = plan(crossing_net, {"pedestrian": 3000.0}).trips
    early = [trip for trip in trips if trip.depart_s < 30]
    begun = [trip for trip in early if 1 < trip.depart_m < 135]
    assert len(begun) > len(early) / 2


def test_a_single_street_works(make_net: Callable[..., Path], tmp_path: Path) -> None:
    nodes = '<node id="a" x="-140" y="0"/><node id="b" x="140" y="0"/>'
    edges = (
        '<edge id="ab" from="a" to="b" numLanes="1" speed="13.9"/>'
        '<edge id="ba" from="b" to="a" numLanes="1" speed="13.9"/>'
    )
    demand = plan(make_net(tmp_path, nodes, edges), {"car": 600.0, "pedestrian": 60.0})
    assert Counter(trip.edges for trip in demand.trips) == {("ab",): 50, ("ba",): 50}
    assert [(item.actor_class, item.count) for item in demand.left_out] == [("pedestrian", 10)]
    assert "sidewalk" in demand.left_out[0].why


def test_a_way_over_a_wide_junction_is_no_short_one(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    # The streets end 40 m before the middle: 20 m and 20 m of streets, 80 m between them.
    nodes = '<node id="a" x="-60" y="0"/><node id="b" x="-40" y="0"/>'
    nodes += '<node id="m" x="0" y="0" radius="38"/><node id="c" x="60" y="0"/>'
    nodes += '<node id="d" x="0" y="160"/>'
    edges = '<edge id="in" from="a" to="m"/><edge id="on" from="m" to="c"/>'
    edges += '<edge id="up" from="m" to="d"/>'
    streets = StreetNetwork(make_net(tmp_path, nodes, edges), None).driven_by("passenger")
    assert streets is not None
    routes = Routes.between_gates(streets)
    assert routes is not None
    ways = {routes.drive(k): routes.weight[k] for k in range(len(routes.pairs))}
    assert streets.length_m[[streets.edges.index(x) for x in ("in", "on")]].sum() < 60
    assert ways["in", "on"] > 0
    assert ways["in", "up"] > 0


def test_who_goes_back_on_the_other_side_turns_where_the_way_was_planned(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    # One crosses at b, and at a, which is beyond a road that nobody is to use, but much nearer.
    nodes = '<node id="a" x="-112" y="0"/><node id="o" x="-100" y="0"/>'
    nodes += '<node id="b" x="0" y="0"/><node id="c" x="100" y="0"/>'
    ends = "ao", "oa", "ob", "bo", "bc", "cb"
    like = 'numLanes="1" sidewalkWidth="2"'
    edges = "".join(f'<edge id="{x}{y}" from="{x}" to="{y}" {like}/>' for x, y in ends)
    own = tmp_path / "own.con.xml"
    own.write_text(
        '<connections><crossing node="a" edges="ao oa" priority="1"/>'
        '<crossing node="b" edges="ob bo" priority="1"/></connections>'
    )
    net = make_net(tmp_path, nodes, edges, "--walkingareas", "true", "-x", str(own))
    streets = StreetNetwork(net, None, without={"ao", "oa"}).walked()
    assert streets is not None
    routes = Routes.between_gates(streets)
    assert routes is not None
    ways = [routes.walk(number, 0.1, 0.0) for number in range(len(routes.pairs))]
    (way,) = (way for way in ways if [x for x in way[0] if x[0] != ":"] == ["bo", "ob"])
    trip = Trip("pedestrian", "pedestrian-man", 0.0, *way)
    write_routes(tmp_path / "walk.rou.xml", Demand((trip,), ()), asset)
    files = "-n", str(net), "-r", str(tmp_path / "walk.rou.xml")
    told = tmp_path / "trips.xml"
    command = [sumo_binary("sumo"), *files, "--tripinfo-output", str(told), "--no-step-log"]
    env = sumo_environment()
    run = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
    assert run.returncode == 0, run.stderr
    (walk,) = ElementTree.parse(told).getroot().iter("walk")
    assert float(walk.get("routeLength", "nan")) > 150.0


def test_a_ring_without_ends_works(make_net: Callable[..., Path], tmp_path: Path) -> None:
    places = {"a": (0, 0), "b": (100, 0), "c": (100, 100), "d": (0, 100)}
    nodes = "".join(f'<node id="{k}" x="{x}" y="{y}"/>' for k, (x, y) in places.items())
    edges = "".join(f'<edge id="{s}{e}" from="{s}" to="{e}"/>' for s, e in ("ab", "bc", "cd", "da"))
    demand = plan(make_net(tmp_path, nodes, edges), {"car": 120.0})
    assert len(demand.trips) == 20
    assert not demand.left_out


def test_a_dead_end_within_the_site_has_little_traffic(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    places = {"w": (-150, 0), "m": (0, 0), "e": (150, 0), "n": (0, 80)}
    nodes = "".join(f'<node id="{k}" x="{x}" y="{y}"/>' for k, (x, y) in places.items())
    edges = "".join(
        f'<edge id="{s}{e}" from="{s}" to="{e}"/>' for s, e in ("wm", "mw", "me", "em", "mn", "nm")
    )
    trips = plan(make_net(tmp_path, nodes, edges), {"car": 1200.0}).trips
    starts = Counter(trip.edges[0] for trip in trips)
    assert 0 < starts["nm"] < starts["wm"] / 4


def test_a_class_without_streets_is_left_out_and_said_so(
    make_net: Callable[..., Path], tmp_path: Path
) -> None:
    nodes = '<node id="a" x="-140" y="0"/><node id="b" x="140" y="0"/>'
    edges = '<edge id="ab" from="a" to="b" allow="passenger truck"/>'
    asked = {"car": 60.0, "truck": 6.0, "bicycle": 60.0, "bus": 12.0}
    demand = plan(make_net(tmp_path, nodes, edges), asked)
    counts = Counter(trip.actor_class for trip in demand.trips)
    assert counts == {"car": 10, "truck": 1}
    left = {item.actor_class: (item.count, item.why) for item in demand.left_out}
    assert left["bicycle"][0] == 10
    assert left["bus"][0] == 2
    assert "bicycle" in left["bicycle"][1]


def test_what_is_not_a_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.net.xml").write_text("<net><edge id=")
    with pytest.raises(StageError, match=r"x\.net\.xml"):
        StreetNetwork(tmp_path / "x.net.xml", None)
