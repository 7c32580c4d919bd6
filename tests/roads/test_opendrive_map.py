"""Exported maps, read back by the standard's formulas, against the lanes that they were made of."""

import math

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.opendrive import read_opendrive, write_opendrive
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
            lights = {"highway": "crossing", "crossing": "traffic_signals"}
            nodes |= {7: (-15, -1, lights), 8: (1.2, -18, lights)}
            main = {"highway": "secondary", "lanes": "4", "maxspeed": "50", "sidewalk": "both"}
            side = {"highway": "residential", "lanes": "2", "sidewalk": "both", "cycleway": "lane"}
            BUILT[driving_side] = build_roads(
                read_extract(
                    write_osm(nodes, {10: ([1, 7, 2, 3], main), 11: ([4, 8, 2, 5, 6], side)})
                ),
                HERE,
                shapely.box(-120, -120, 120, 120),
                hill(),
                driving_side=driving_side,
                out=tmp_path / "n.net.xml",
            )
        return BUILT[driving_side]

    return build


@pytest.fixture(params=[("right", "1.8"), ("right", "1.4"), ("left", "1.8"), ("left", "1.4")])
def exported(request, crossing, tmp_path, ruler):
    """Return the roads that were built, root element and roads of an exported map."""
    if request.param not in BUILT:
        side, version = request.param
        built = crossing(side)
        path = tmp_path / "map.xodr"
        write_opendrive(built.model, HERE, path, version=version, name="crossing")
        BUILT[request.param] = (built, *ruler(path))
    return BUILT[request.param]


def stations(road, step=1.0):
    return np.linspace(0, road.length, max(2, int(road.length / step)))


def test_driven_lanes_lie_where_the_network_has_them(exported):
    """Within 2 cm, in space: what SUMO drives on is what the file says."""
    built, _, roads = exported
    network = built.network
    lines = {lane.id: shapely.LineString(lane.centre[:, :2]) for lane in network.lanes}
    driven = [lane.id for road in network.roads for lane in map(network.lane_by_id.get, road.lanes)]
    tree = shapely.STRtree([lines[name] for name in driven])
    checked = 0
    for road in roads.values():
        for k, (start, end) in enumerate(zip(road.starts, road.ends, strict=True)):
            for identity, item in road.lanes_of(k).items():
                if item.get("type") != "driving" or road.junction != "-1":
                    continue
                for s in np.arange(start + 0.5, end - 0.5, 2.0):
                    x, y, z = road.middle(s, identity, k)
                    name = driven[tree.nearest(shapely.Point(x, y))]
                    assert lines[name].distance(shapely.Point(x, y)) < 0.02, (name, s)
                    assert abs(z - network.height(name, [[x, y]])[0]) < 0.02, (name, s)
                    checked += 1
    assert checked > 500


def test_reference_lines_and_profiles_have_no_step_and_no_kink(exported):
    *_, roads = exported
    for road in roads.values():
        if road.element.find("userData") is None and road.length == 1.0:
            continue  # it only carries a crosswalk
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
    built, root, roads = exported
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
    ways = [road for road in built.model.roads if road.junction >= 0]
    assert checked == len(ways) >= 12


def test_crosswalks_lie_where_people_cross(exported):
    built, root, roads = exported
    network = built.network
    found, told = [], []
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
            told.append([data.get("value") for data in item.iterfind("userData[@code='marking']")])
    crossings = [lane for lane in network.lanes if lane.kind == "crossing"]
    assert len(found) == len(crossings) > 0
    for lane in crossings:
        shares = [
            shapely.Polygon(c[:, :2]).intersection(lane.polygon).area / lane.polygon.area
            for c in found
        ]
        corners = found[int(np.argmax(shares))]
        assert max(shares) > 0.999
        assert told[int(np.argmax(shares))] == [lane.marking]
        surface = built.surface.height(corners[:, :2], lane.level)
        assert corners[:, 2] == pytest.approx(surface, abs=1e-4)


def test_controllers_know_their_signals_and_junctions_their_controllers(exported):
    """Whatever is switched is switched once, and is for lanes that are there."""
    built, root, roads = exported
    heads = {}
    for element in root.findall("road"):
        road = roads[element.get("id")]
        for item in element.iterfind("signals/signal"):
            assert 0 <= float(item.get("s")) <= road.length
            if item.get("dynamic") == "yes":
                heads[item.get("id")] = item
        for item in element.iterfind("signals/*/validity"):
            first, last = int(item.get("fromLane")), int(item.get("toLane"))
            assert first <= last
            assert {first, last} <= set(road.lanes_of(len(road.sections) - 1))
    assert len(heads) == sum(signal.dynamic for signal in built.model.signals) >= 4
    controlled = [c.get("signalId") for c in root.iterfind("controller/control")]
    assert sorted(controlled) == sorted(heads)
    numbers = {c.get("id") for c in root.findall("controller")}
    assert {c.get("id") for c in root.iterfind("junction/controller")} == numbers


def test_roads_are_linked_unless_they_end_at_the_border(exported):
    *_, roads = exported
    for road in roads.values():
        if road.junction != "-1" or road.length == 1.0:
            continue
        for tag, s in (("predecessor", 0.0), ("successor", road.length)):
            x, y, _ = road.reference(s)
            at_border = max(abs(x), abs(y)) > 110
            assert road.element.find(f"link/{tag}") is not None or at_border


@pytest.mark.parametrize(("side", "version"), [("right", "1.8"), ("right", "1.4"), ("left", "1.8")])
def test_what_was_built_is_read_again(crossing, tmp_path, side, version):
    """Lane borders within a millimetre, and the same junctions, signals and programs."""
    model = crossing(side).model
    write_opendrive(model, HERE, tmp_path / "m.xodr", version=version, name="x")
    back, projection, notes = read_opendrive(tmp_path / "m.xodr")
    assert (projection, notes["remarks"]) == (HERE.proj, [])
    for road in model.roads:
        other = back.road_by_id[road.id]
        for section, twin, end in zip(
            road.sections, other.sections, road.section_ends, strict=True
        ):
            s = np.linspace(section.s, end - 1e-6, 15)
            for lane in section.lanes:
                copy = twin.by_id[lane.id]
                assert copy.kind == lane.kind
                assert (copy.predecessor, copy.successor) == (lane.predecessor, lane.successor)
                mine = road.place(s, road.border(section, lane, s, outer=True))
                theirs = other.place(s, other.border(twin, copy, s, outer=True))
                assert np.abs(mine - theirs).max() < 1e-3

    def connections(whole):
        return sorted(
            (c.incoming, c.connecting, c.contact, c.links)
            for junction in whole.junctions
            for c in junction.connections
        )

    assert connections(back) == connections(model)
    assert back.controllers == model.controllers
    assert {signal.id for signal in back.signals} >= {signal.id for signal in model.signals}
    assert len(back.areas) == len(model.areas)
