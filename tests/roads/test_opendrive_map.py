"""Exported maps, read back by the standard's formulas, against the lanes that they were made of."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.opendrive import opendrive_map, write_opendrive
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)


def hill():
    """Ground that climbs both along and across, with a crest."""
    y, x = np.mgrid[-200:201, -200:201].astype(float)
    return Elevation(-200.0, -200.0, 1.0, 0.03 * x + 0.02 * y + 2.0 * np.sin(y / 40.0))


BUILT: dict = {}  # networks and maps are made once: tests only read them


@pytest.fixture
def crossing(write_osm, tmp_path):
    """Return a function: driving side -> two streets that cross at signals on a hill."""

    def build(driving_side):
        if driving_side not in BUILT:
            nodes = {1: (-150, -10, {}), 2: (0, 0, {"highway": "traffic_signals"})}
            nodes |= {3: (150, 20, {}), 4: (10, -150, {}), 5: (-8, 70, {}), 6: (-5, 150, {})}
            main = {"highway": "secondary", "lanes": "4", "maxspeed": "50", "sidewalk": "both"}
            side = {"highway": "residential", "lanes": "2", "sidewalk": "both", "cycleway": "lane"}
            BUILT[driving_side] = build_roads(
                read_extract(write_osm(nodes, {10: ([1, 2, 3], main), 11: ([4, 2, 5, 6], side)})),
                HERE,
                shapely.box(-120, -120, 120, 120),
                hill(),
                driving_side=driving_side,
                out=tmp_path / "n.net.xml",
            ).network
        return BUILT[driving_side]

    return build


@pytest.fixture(params=[("right", "1.8"), ("right", "1.4"), ("left", "1.8"), ("left", "1.4")])
def exported(request, crossing, tmp_path, read_opendrive):
    """Return network, content, root element and roads of an exported map."""
    if request.param not in BUILT:
        side, version = request.param
        network = crossing(side)
        path = tmp_path / "map.xodr"
        write_opendrive(network, HERE, path, version=version, name="crossing")
        BUILT[request.param] = (network, opendrive_map(network, version), *read_opendrive(path))
    return BUILT[request.param]


def stations(road, step=1.0):
    return np.linspace(0, road.length, max(2, int(road.length / step)))


def test_lanes_lie_where_the_lane_model_has_them(exported):
    network, content, _, roads = exported
    for street in content.streets:
        road = roads[str(street.number)]
        assert set(road.lanes) - {0} == {strip.id for strip in street.strips}
        for strip in street.strips:
            line = shapely.LineString(strip.lane.centre[:, :2])
            for s in stations(road):
                x, y, z = road.middle(s, strip.id)
                if strip.lane.kind != "sidewalk":
                    assert line.distance(shapely.Point(x, y)) < 0.05, (strip.lane.id, s)
                if line.distance(shapely.Point(x, y)) < 0.05:
                    assert abs(z - network.height(strip.lane.id, [[x, y]])[0]) < 0.02, strip
                inner, outer = road.borders(s, strip.id)
                assert np.linalg.norm(outer - inner) == pytest.approx(strip.lane.width, abs=1e-6)


def test_reference_lines_and_profiles_have_no_step_and_no_kink(exported):
    *_, roads = exported
    for road in roads.values():
        knots = [float(item.get("s")) for item in road.geometry]
        knots += [float(e.get("s")) for e in road.element.iter("elevation")]
        for s in knots:
            if not 0 < s < road.length:
                continue
            before, after = road.reference(s - 1e-5), road.reference(s + 1e-5)
            assert np.hypot(before[0] - after[0], before[1] - after[1]) < 1e-4
            turn = (before[2] - after[2] + math.pi) % (2 * math.pi) - math.pi
            assert abs(turn) < 1e-4
            z = [road.place(s + d, 0)[2] for d in (-2e-3, -1e-3, 1e-3, 2e-3)]
            assert abs(z[2] - z[1]) < 1e-3
            assert abs((z[3] - z[2]) - (z[1] - z[0])) / 1e-3 < 1e-2


def test_every_manoeuvre_joins_two_lanes_without_a_step_or_a_bend(exported):
    """Both borders of the connecting lane meet the borders of the lanes that it joins, in 3D."""
    _, content, root, roads = exported
    checked = 0
    for junction in root.findall("junction"):
        for connection in junction.findall("connection"):
            way = roads[connection.get("connectingRoad")]
            assert way.junction == junction.get("id")
            link = connection.find("laneLink")
            lane = int(link.get("to"))
            for tag, at in (("predecessor", 0.0), ("successor", way.length)):
                joined = way.element.find(f"link/{tag}")
                road = roads[joined.get("elementId")]
                there = int(way.lanes[lane].find(f"link/{tag}").get("id"))
                end = road.length if joined.get("contactPoint") == "end" else 0.0
                ends = road.borders(end, there)
                if tag == "predecessor":
                    assert connection.get("incomingRoad") == road.id
                    assert link.get("from") == str(there)
                    assert end == (road.length if road.forward[there] else 0.0)
                for mine, other in zip(way.borders(at, lane), ends, strict=True):
                    assert np.linalg.norm(mine - other) < 0.01, (way.id, tag)
                turn = way.reference(at)[2] - road.reference(end)[2]
                turn += 0.0 if road.forward[there] else math.pi
                assert abs((turn + math.pi) % (2 * math.pi) - math.pi) < 1e-4
            checked += 1
    assert checked == len(content.manoeuvres) >= 12


def test_manoeuvres_follow_the_turns_of_the_lane_model(exported):
    """Away from their ends, where the lane model may step sideways to another kind of lane."""
    network, content, _, roads = exported
    passed = 0
    for manoeuvre in content.manoeuvres:
        road = roads[str(manoeuvre.number)]
        at = np.array([road.middle(s, manoeuvre.side) for s in stations(road, 0.1)])
        for name in manoeuvre.route.via:
            for point in network.lane_by_id[name].centre:
                if min(np.hypot(*(at[end] - point)[:2]) for end in (0, -1)) > 2.0:
                    gap = np.hypot(*(at - point)[:, :2].T)
                    assert gap.min() < 0.30, manoeuvre.route
                    assert abs(at[gap.argmin(), 2] - point[2]) < 0.02, manoeuvre.route
                    passed += 1
    assert passed > 50


def test_an_undivided_street_is_one_road(crossing):
    for side, version, shared in (
        ("right", "1.8", True),
        ("left", "1.8", True),
        ("left", "1.4", 0),
    ):
        content = opendrive_map(crossing(side), version)
        assert len(content.streets) == (4 if shared else 8)
        for street in content.streets:
            assert street.is_two_way == shared
            if version == "1.8":
                keep = 1 if side == "left" else -1
                assert all((strip.id * keep > 0) == strip.forward for strip in street.strips)
            else:
                assert all(strip.id < 0 and strip.forward for strip in street.strips)


def test_rules_types_speeds_and_curbs_are_written(crossing, tmp_path, read_opendrive):
    write_opendrive(crossing("left"), HERE, tmp_path / "m.xodr", version="1.8", name="x")
    root, roads = read_opendrive(tmp_path / "m.xodr")
    assert {road.element.get("rule") for road in roads.values()} == {"LHT"}
    lanes = [lane for road in roads.values() for lane in road.lanes.values()]
    assert {lane.get("type") for lane in lanes} == {"none", "driving", "biking", "sidewalk"}
    speeds = {
        float(lane.find("speed").get("max")) for lane in lanes if lane.find("speed") is not None
    }
    assert any(speed == pytest.approx(50 / 3.6, abs=0.01) for speed in speeds)
    for lane in lanes:
        if lane.get("type") == "sidewalk":
            height = lane.find("height")
            assert (height.get("inner"), height.get("outer")) == ("0.15", "0.15")
    assert root.find("header/geoReference").text == HERE.proj


def test_crosswalks_lie_where_people_cross(exported):
    network, _, root, roads = exported
    found = []
    for element in root.findall("road"):
        road = roads[element.get("id")]
        for item in element.iterfind("objects/object[@type='crosswalk']"):
            s = float(item.get("s"))
            assert 0 <= s <= road.length
            heading = road.reference(s)[2] + float(item.get("hdg"))
            x, y = road.place(s, float(item.get("t")))[:2]
            z = road.place(s, 0)[2]
            corners = []
            for corner in item.iter("cornerLocal"):
                u, v, up = (float(corner.get(k)) for k in "uvz")
                c, sn = math.cos(heading), math.sin(heading)
                corners.append((x + u * c - v * sn, y + u * sn + v * c, z + up))
            found.append(np.array(corners))
    crossings = [lane for lane in network.lanes if lane.kind == "crossing"]
    assert len(found) == len(crossings) > 0
    for lane in crossings:
        shares = [
            shapely.Polygon(c[:, :2]).intersection(lane.polygon).area / lane.polygon.area
            for c in found
        ]
        corners = found[int(np.argmax(shares))]
        assert max(shares) > 0.999
        assert corners[:, 2] == pytest.approx(network.height(lane.id, corners[:, :2]), abs=1e-4)


def test_signals_stand_at_stop_lines_and_their_controllers_know_them(exported):
    network, _, root, roads = exported
    heads = {}
    for element in root.findall("road"):
        road = roads[element.get("id")]
        for item in element.iterfind("signals/signal"):
            s, t = float(item.get("s")), float(item.get("t"))
            assert 0 <= s <= road.length
            heads[item.get("id")] = (road.place(s, t)[:2], item)
    assert len(heads) == len(network.signals)
    places = np.array([place for place, _ in heads.values()])
    for head in network.signals:
        assert np.hypot(*(places - [head.x, head.y]).T).min() < 0.75, head.lane
    controlled = [c.get("signalId") for c in root.iterfind("controller/control")]
    assert sorted(controlled) == sorted(heads)
    numbers = {c.get("id") for c in root.findall("controller")}
    assert {c.get("id") for c in root.iterfind("junction/controller")} == numbers
    for _, item in heads.values():
        assert item.get("dynamic") == "yes"
        lanes = item.findall("validity")
        assert bool(lanes) == (item.get("type") == "1000001")


def test_roads_end_at_the_border_without_a_link(exported):
    *_, roads = exported
    open_ends = 0
    for road in roads.values():
        if road.junction != "-1":
            continue
        for tag, s in (("predecessor", 0.0), ("successor", road.length)):
            x, y, _ = road.reference(s)
            at_border = max(abs(x), abs(y)) > 110
            linked = road.element.find(f"link/{tag}") is not None
            assert linked != at_border
            open_ends += not linked
    assert open_ends >= 4


def test_the_same_lanes_give_the_same_bytes(crossing, tmp_path):
    network = crossing("right")
    for name in ("a.xodr", "b.xodr"):
        write_opendrive(network, HERE, tmp_path / name, version="1.8", name="x")
    assert (tmp_path / "a.xodr").read_bytes() == (tmp_path / "b.xodr").read_bytes()
    ids = [
        element.get("id")
        for element in ElementTree.parse(tmp_path / "a.xodr").getroot()
        if element.tag in ("road", "junction", "controller")
    ]
    assert len(ids) == len(set(ids))


def test_an_unknown_version_is_refused(crossing, tmp_path):
    with pytest.raises(InputError, match=r"one of 1\.8, 1\.4"):
        write_opendrive(crossing("right"), HERE, tmp_path / "a.xodr", version="1.6", name="x")
    assert not list(tmp_path.glob("*a.xodr*"))
