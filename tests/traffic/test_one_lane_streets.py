"""Streets with one lane for both directions: one is built, and vehicles wait for each other."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.site import read_extract
from urbantwin.traffic.assets import asset, asset_names
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo import simulation
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.traffic.sumo.worker_input import one_lane_streets

from .conftest import netconvert

ONE_LANE = Path(simulation.__file__).with_name("one_lane.py")
HERE = SiteFrame(48.7, 9.18)
#: Two lanes at both ends; between them two streets of one lane, and one across where they meet.
NODES = {
    1: (-160, 0, {}),
    2: (-60, 0, {}),
    3: (0, 0, {}),
    4: (60, 0, {}),
    5: (160, 0, {}),
    6: (0, -90, {}),
    7: (0, 90, {}),
}
STREET = {"highway": "residential", "sidewalk": "no", "maxspeed": "30", "lanes": "2"}
NARROW = {**STREET, "lanes": "1"}
WIDTH_M = 3.5


@pytest.fixture(scope="module", params=["right", "left"])
def roads(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("narrow")
    osm = folder / "map.osm"
    lonlat = HERE.lonlat_from_site(np.array([place[:2] for place in NODES.values()], float))
    rows = [
        f'<node id="{n}" version="1" lat="{lat:.9f}" lon="{lon:.9f}"/>'
        for n, (lon, lat) in zip(NODES, lonlat, strict=True)
    ]
    ways = {1: ([1, 2], STREET), 2: ([2, 3], NARROW), 3: ([3, 4], NARROW), 4: ([4, 5], STREET)}
    ways |= {5: ([6, 3], NARROW), 6: ([3, 7], STREET)}
    for number, (nodes, tags) in ways.items():
        inner = "".join(f'<nd ref="{n}"/>' for n in nodes)
        inner += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
        rows.append(f'<way id="{number}" version="1">{inner}</way>')
    osm.write_text(f'<osm version="0.6">{"".join(rows)}</osm>')
    net = folder / "n.net.xml"
    return net, build_roads(
        read_extract(osm),
        HERE,
        shapely.Point(0, 0).buffer(155),
        Elevation.flat(),
        driving_side=request.param,
        out=net,
    )


def test_both_directions_have_one_lane_in_one_place(roads):
    _, built = roads
    network = built.network
    narrow = [road for road in network.roads if {2, 3, 5} & set(road.ways)]
    assert len(narrow) == 6
    for road in narrow:
        (lane,) = (network.lane_by_id[name] for name in road.lanes)
        other = network.lane_by_id[lane.opposite]
        assert other.opposite == lane.id
        assert lane.width == pytest.approx(WIDTH_M)
        assert np.abs(lane.centre - other.centre[::-1]).max() < 1e-6
    for way in (2, 3):
        # Across the middle of the street the carriageway is as wide as that one lane.
        across = shapely.LineString([(30 if way == 3 else -30, y) for y in (-20, 20)])
        driven = shapely.union_all(
            [x.polygon for x in network.lanes if x.kind == "driving"], grid_size=1e-4
        )
        assert driven.intersection(across).length == pytest.approx(WIDTH_M, abs=0.02)
        (road,) = (r for r in built.model.roads if r.junction < 0 and way in r.ways)
        lanes = [x for section in road.sections for x in section.lanes if x.kind == "driving"]
        assert [bool(lane.opposite) for lane in lanes] == [True]
    two = [road for road in network.roads if {1, 4, 6} & set(road.ways)]
    assert not any(network.lane_by_id[name].opposite for road in two for name in road.lanes)


def test_connections_lead_into_and_out_of_both_ends(roads):
    _, built = roads
    model = built.model
    (road,) = (r for r in model.roads if r.junction < 0 and 2 in r.ways)
    ends = {
        (link.contact, which)
        for way in model.roads
        if way.junction >= 0
        for which, link in (("in", way.predecessor), ("out", way.successor))
        if link is not None and link.id == road.id
    }
    assert ends == {(at, which) for at in ("start", "end") for which in ("in", "out")}


def test_vehicles_wait_for_each_other_and_all_arrive(roads):
    """Eight cars each way over both narrow streets, and four out of the one across."""
    net, built = roads
    edge = {}
    for road in built.network.roads:
        line = built.network.lane_by_id[road.lanes[-1]].centre
        edge[road.ways[0], bool(line[-1, 0] + line[-1, 1] > line[0, 0] + line[0, 1])] = road.id
    east = tuple(edge[way, True] for way in (1, 2, 3, 4))
    west = tuple(edge[way, False] for way in (4, 3, 2, 1))
    north = tuple(edge[way, True] for way in (5, 6))
    car = asset_names("car")[0]
    trips = sorted(
        [(4.0 * k, route) for k in range(8) for route in (east, west)]
        + [(7.0 * k, north) for k in range(4)]
    )
    demand = Demand(tuple(Trip("car", car, at, route) for at, route in trips), ())
    seen = simulate(net, demand, asset, warmup_s=3.0, steps=600, step_s=0.5, seed=1)
    assert seen.teleports == 0
    assert seen.departed == frozenset(range(len(trips)))
    street = one_lane_streets(net)["street"]
    assert len(street) == 6
    by_step = {}
    for step, lane in zip(seen.step.tolist(), seen.lane.tolist(), strict=True):
        name = seen.lanes[lane].rpartition("_")[0]
        if name in street:
            by_step.setdefault(step, set()).add(name)
    assert set.union(*by_step.values()) >= {east[1], east[2], west[1], west[2], north[0]}
    for names in by_step.values():
        assert len({street[name] for name in names}) == len(names)
    # Everybody is gone long before the end, and bodies never touched.
    assert seen.step.max() < 560
    length, width = asset(car).length, asset(car).width
    for step in np.unique(seen.step):
        rows = np.flatnonzero(seen.step == step)
        yaw = np.radians(90.0 - seen.angle_deg[rows])
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        back = seen.front[rows] - length * ahead
        bodies = shapely.buffer(
            shapely.linestrings(np.stack([seen.front[rows], back], axis=1)),
            width / 2 - 0.1,
            cap_style="flat",
        )
        tree = shapely.STRtree(bodies)
        first, second = tree.query(bodies, predicate="intersects")
        assert (first == second).all()


#: Runs SUMO: a car stands on the narrow street "ba", and another one wants to enter it at "a".
DRIVE = """
import json, runpy, sys
import libsumo
net, source, known = sys.argv[1:]
streets = runpy.run_path(source)["OneLaneStreets"](json.loads(known))
libsumo.start(["sumo", "-n", net, "--step-length", "0.5", "--no-step-log", "--no-warnings"])
libsumo.route.add("stands", ["yb", "ba", "ax"])
libsumo.route.add("comes", ["xa", "ab", "by"])
libsumo.vehicle.add("1", "stands")
libsumo.vehicle.setStop("1", "ba", 30.0, 0, 300.0)
for _ in range(40):
    streets.heed(0.5)
    libsumo.simulationStep()
libsumo.vehicle.add("2", "comes")
seen = []
for _ in range(400):
    streets.heed(0.5)
    libsumo.simulationStep()
    if "2" in libsumo.vehicle.getIDList():
        row = libsumo.vehicle.getRoadID("2"), libsumo.simulation.getTime()
        if not seen or seen[-1][0] != row[0]:
            seen.append(row)
print(json.dumps([row for row in seen if not row[0].startswith(":")]))
"""


def test_a_vehicle_that_waits_for_long_takes_another_way(tmp_path):
    places = {"x": (-100, 0), "a": (0, 0), "b": (100, 0), "y": (200, 0), "c": (50, 80)}
    nodes = "".join(f'<node id="{k}" x="{x}" y="{y}"/>' for k, (x, y) in places.items())
    pairs = ["xa", "ax", "ab", "ba", "by", "yb", "ac", "cb"]
    edges = "".join(f'<edge id="{p}" from="{p[0]}" to="{p[1]}" speed="10"/>' for p in pairs)
    net = netconvert(tmp_path, nodes, edges)
    known = {"street": {"ab": "ab", "ba": "ab"}, "mouths": ["xa", "yb"], "short": []}
    done = subprocess.run(
        [sys.executable, "-c", DRIVE, net, ONE_LANE, json.dumps(known)],
        capture_output=True,
        check=True,
        text=True,
    )
    seen = json.loads(done.stdout.splitlines()[-1])
    assert [edge for edge, _ in seen] == ["xa", "ac", "cb", "by"]
    # It came to the street after some ten seconds, and waited three quarters of a minute.
    assert 45 < seen[1][1] - seen[0][1] < 70
