"""SUMO's network of a lane model: the same lanes, the same ways, drivable; SUMO is the judge."""

import dataclasses
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported import ImportedMap, build_imported_roads, prepared_map
from urbantwin.roads.imported.read import read_map
from urbantwin.roads.imported.sumo import sumo_network_of_model
from urbantwin.roads.model import RoadLink
from urbantwin.roads.netconvert import sumo_binary, sumo_environment

from ..thorough import further
from . import lane_town
from .tee import EAST, FAR, JUNCTION, LANE, MOUTH, POCKET, SOUTH, WALK, WEST, tee

FRAME = SiteFrame(50.0, 8.0)
EVERYTHING = shapely.Point(0.0, 0.0).buffer(500.0)


def built(model, out, region=EVERYTHING):
    prepared = prepared_map(ImportedMap(Path("map.xodr"), model), region, None)
    return build_imported_roads(prepared, FRAME, out=out)


@pytest.fixture(scope="module", params=["right", "left"])
def crossing(request, tmp_path_factory):
    """A T-junction with signals, as it is in the twin: (model, network, SUMO's own reader)."""
    out = tmp_path_factory.mktemp("tee") / "network.net.xml"
    roads = built(tee(request.param, signals=True), out)
    net = sumolib.net.readNet(
        str(out), withInternal=True, withPrograms=True, withPedestrianConnections=True
    )
    return roads, net, out


def driven(edge):
    return [lane for lane in edge.getLanes() if lane.allows("passenger")]


def test_every_lane_is_there_with_its_width_and_its_users(crossing):
    _, net, _ = crossing
    lanes = {edge.getID(): len(driven(edge)) for edge in net.getEdges(withInternal=False)}
    pocket = {f"{WEST}#0": 1, f"{WEST}#1": 2, f"-{WEST}#0": 1, f"-{WEST}#1": 1}
    assert lanes == {**pocket, f"{EAST}": 1, f"-{EAST}": 1, f"{SOUTH}": 1, f"-{SOUTH}": 1}
    for edge in net.getEdges(withInternal=False):
        walk, *others = edge.getLanes()  # from the kerb inwards
        assert walk.allows("pedestrian")
        assert not walk.allows("passenger")
        assert walk.getWidth() == pytest.approx(WALK)
        for lane in others:
            assert all(lane.allows(c) for c in ("passenger", "truck", "bus", "bicycle"))
            assert not lane.allows("pedestrian")
            assert lane.getSpeed() == pytest.approx(50 / 3.6, abs=0.01)
    for name in (f"{WEST}#0", f"{EAST}", f"{SOUTH}"):
        assert net.getEdge(name).getLanes()[-1].getWidth() == pytest.approx(LANE)


def test_lanes_lie_where_they_were_drawn(crossing):
    """The streets are straight: their lanes are lines that one can write down."""
    roads, net, _ = crossing
    side = 1.0 if roads.network.driving_side == "right" else -1.0
    kerb = LANE + WALK / 2
    expected = {
        f"{EAST}_1": [(MOUTH, -side * LANE / 2), (FAR, -side * LANE / 2)],
        f"-{EAST}_0": [(FAR, side * kerb), (MOUTH, side * kerb)],
        f"{SOUTH}_1": [(side * LANE / 2, -FAR), (side * LANE / 2, -MOUTH)],
        f"{WEST}#0_1": [(-FAR, -side * LANE / 2), (-POCKET, -side * LANE / 2)],
        f"{WEST}#1_2": [(-POCKET, -side * LANE / 2), (-MOUTH, -side * LANE / 2)],
    }
    for name, line in expected.items():
        shape = shapely.LineString(net.getLane(name).getShape())
        if name.endswith("_0"):  # sidewalks go on round the corner
            assert shape.buffer(0.01).covers(shapely.LineString(line)), name
        else:
            assert shapely.hausdorff_distance(shape, shapely.LineString(line)) < 0.01, name
            # All lanes of an edge have one length in SUMO: the mean.
            assert net.getLane(name).getLength() == pytest.approx(shape.length, abs=0.2)


def test_ways_through_the_junction_are_the_models(crossing):
    roads, net, _ = crossing
    model = roads.model
    wanted = set()
    for connection in model.junctions[0].connections:
        way = model.road_by_id[connection.connecting]
        start = model.road_by_id[connection.incoming]
        start = start.sections[-1 if way.predecessor.contact == "end" else 0]
        end = model.road_by_id[way.successor.id]
        end = end.sections[-1 if way.successor.contact == "end" else 0]
        lane = way.sections[0].lanes[0]
        wanted.add((start.by_id[lane.predecessor].strip, end.by_id[lane.successor].strip))
        # The way itself: its lanes in SUMO, end to end, are its middle.
        line = np.vstack([net.getLane(name).getShape() for name in lane.strip.split()])
        s = np.linspace(0.0, way.length, 40)
        middle = way.place(s, way.middle(way.sections[0], lane, s))[:, :2]
        gap = shapely.distance(shapely.points(middle), shapely.LineString(line))
        assert gap.max() < 0.02, way.id
    found = {
        (c.getFromLane().getID(), c.getToLane().getID())
        for edge in net.getEdges(withInternal=False)
        for others in edge.getOutgoing().values()
        for c in others
        if c.getFromLane().allows("passenger") and edge.getToNode().getID() == f"J{JUNCTION}"
    }
    assert found == wanted


def test_a_turn_lane_opens_beside_the_lane_that_goes_on(crossing):
    _, net, _ = crossing
    before, after = net.getEdge(f"{WEST}#0"), net.getEdge(f"{WEST}#1")
    (links,) = [c for to, c in before.getOutgoing().items() if to is after]
    assert [(c.getFromLane().getIndex(), c.getToLane().getIndex())
            for c in links if c.getFromLane().allows("passenger")] == [(1, 2)]  # fmt: skip


def test_nobody_is_led_back_where_they_came_from(crossing):
    _, net, _ = crossing
    for edge in net.getEdges(withInternal=False):
        for other in edge.getOutgoing():
            turns_back = {edge.getFromNode(), edge.getToNode()} == {
                other.getFromNode(),
                other.getToNode(),
            }
            assert not turns_back or other is edge or not driven(edge)


def test_the_mapped_crosswalk_is_a_crossing_and_the_only_one(crossing):
    roads, net, _ = crossing
    crossings = [e for e in net.getEdges(withInternal=True) if e.getFunction() == "crossing"]
    assert len(crossings) == 1
    shape = np.array(crossings[0].getLanes()[0].getShape())
    # It was drawn 2 m before the end of the southern street, over its two lanes.
    assert np.abs(shape[:, 1] + MOUTH + 2.0).max() < 0.1
    assert np.abs(shape[:, 0]).max() == pytest.approx(LANE, abs=0.6)
    (area,) = [a for a in roads.model.areas if a.kind == "crosswalk"]
    assert area.strip == crossings[0].getLanes()[0].getID()
    assert roads.network.lane_by_id[area.strip].marking == "dashes"


def test_the_maps_program_is_kept(crossing):
    """West and east first, then south, as the controller says; the crossing while south waits."""
    roads, net, _ = crossing
    (light,) = net.getTrafficLights()
    (program,) = light.getPrograms().values()
    phases = program.getPhases()
    assert [phase.duration for phase in phases] == [30.0, 4.0, 20.0, 4.0]
    assert roads.network.programs[0].offset == 7.0
    links = {link: start.getEdge().getID() for start, _, link in light.getConnections()}
    for phase, green in ((phases[0], (WEST, EAST)), (phases[2], (SOUTH,))):
        for link, edge in links.items():
            if edge.startswith(":"):
                assert (phase.state[link] == "G") == (SOUTH not in green)
            else:
                street = int(edge.lstrip("-").split("#")[0])
                assert (phase.state[link] in "Gg") == (street in green), (edge, phase.state)
    assert set(phases[1].state) == {"y", "r"}


def test_signals_name_what_they_show(crossing):
    roads, net, _ = crossing
    (light,) = net.getTrafficLights()
    links = {}
    for start, _, link in light.getConnections():
        links.setdefault(start.getID(), set()).add(link)
    for signal in roads.model.signals:
        assert signal.program == light.getID()
        assert set(signal.links) == set().union(*(links[name] for name in signal.strip.split()))
    (controller,) = roads.model.controllers
    assert controller.phases == roads.network.programs[0].phases
    assert controller.junctions == (JUNCTION,)


def test_traffic_runs_without_a_collision(crossing, tmp_path):
    """SUMO itself, 120 s, a vehicle every 3 s on every route."""
    _, _, path = crossing
    ways = [(WEST, EAST), (WEST, SOUTH), (EAST, WEST), (EAST, SOUTH), (SOUTH, WEST), (SOUTH, EAST)]
    into = {WEST: f"{WEST}#0 {WEST}#1", EAST: f"-{EAST}", SOUTH: f"{SOUTH}"}
    out_of = {WEST: f"-{WEST}#1 -{WEST}#0", EAST: f"{EAST}", SOUTH: f"-{SOUTH}"}
    rows = "".join(
        f'<flow id="{a}-{b}" begin="0" end="120" period="12"><route edges="{into[a]} {out_of[b]}"/>'
        "</flow>"
        for a, b in ways
    )
    walks = (f"{SOUTH} -{SOUTH}", f"-{EAST} -{WEST}#1")  # over the crosswalk and back
    rows += "".join(
        f'<personFlow id="p{k}" begin="0" end="60" period="15"><walk edges="{walk}"/></personFlow>'
        for k, walk in enumerate(walks)
    )
    (tmp_path / "r.rou.xml").write_text(f"<routes>{rows}</routes>")
    report = tmp_path / "statistics.xml"
    done = subprocess.run(
        [str(sumo_binary("sumo")), "-n", str(path), "-r", str(tmp_path / "r.rou.xml"), "-e", "300",
         "--collision.check-junctions", "--intermodal-collision.action", "warn",
         "--collision.action", "warn", "--statistic-output", str(report),
         "--time-to-teleport", "120", "--no-step-log"],
        capture_output=True, text=True, check=False, env=sumo_environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    root = ElementTree.parse(report).getroot()
    assert root.find("teleports").get("total") == "0"
    assert root.find("safety").get("collisions") == "0", done.stderr
    assert int(root.find("vehicles").get("inserted")) == 60
    assert int(root.find("vehicles").get("running")) == 0
    assert int(root.find("persons").get("loaded")) == 8
    assert int(root.find("persons").get("running")) == 0


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_every_lane_of_the_town_is_somewhere_in_the_network(side, tmp_path):
    """Lanes that SUMO has no use for (parking, islands, curbs) are strips of the twin."""
    model = lane_town.town(side)
    roads = built(model, tmp_path / "n.net.xml")
    strips = {
        lane.strip for road in roads.model.roads for part in road.sections for lane in part.lanes
    }
    lanes = roads.network.lane_by_id
    assert {name for strip in strips for name in strip.split()} <= set(lanes)
    kinds = {lane.kind for lane in lanes.values()}
    assert {"driving", "bus", "bicycle", "parking", "shoulder", "sidewalk", "median"} <= kinds
    for road in roads.model.roads:
        for part in road.sections:
            for lane in part.lanes:
                if lane.kind in ("driving", "bus", "bicycle", "sidewalk"):
                    assert lane.strip, (road.id, lane.id)


def test_a_street_that_leads_back_to_its_junction_is_cut_in_two(tmp_path):
    """SUMO knows no edge from a node to itself."""
    model = tee(crosswalk=False)
    ring = dataclasses.replace(
        model.road_by_id[EAST],
        id=50,
        predecessor=RoadLink("junction", JUNCTION),
        successor=RoadLink("junction", JUNCTION),
    )
    model = model.with_roads((*model.roads, ring))
    found = sumo_network_of_model(model, tmp_path / "n.net.xml")
    net = sumolib.net.readNet(str(tmp_path / "n.net.xml"))
    assert {e.getID() for e in net.getEdges() if "50" in e.getID()} == {
        "50#0", "50#1", "-50#0", "-50#1"
    }  # fmt: skip
    road = found.model.road_by_id[50]
    assert [section.s for section in road.sections] == [0.0, road.length / 2]
    assert all(lane.strip for section in road.sections for lane in section.lanes)


def test_the_same_map_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        built(tee(signals=True), tmp_path / f"{name}.net.xml")
    assert (tmp_path / "a.net.xml").read_bytes() == (tmp_path / "b.net.xml").read_bytes()


def crossings_by_node(out):
    edges = ElementTree.parse(out).getroot().iter("edge")
    names = [e.get("id") for e in edges if e.get("function") == "crossing"]
    return {name[1:].rsplit("_", 1)[0] for name in names}


@pytest.mark.parametrize("side", ["right", "left"])
def test_without_mapped_crosswalks_they_lie_at_junctions_alone(side, tmp_path):
    """Where a turn lane opens, or a street follows another, nobody crosses."""
    model = tee(side)
    model = dataclasses.replace(model, areas=())
    built(model, tmp_path / "network.net.xml")
    assert crossings_by_node(tmp_path / "network.net.xml") == {f"J{JUNCTION}"}


@pytest.mark.parametrize("name", ["map.xodr", "map_with_pockets.xodr"])
def test_a_ring_of_roads_without_a_junction_has_no_crossings(shared_data, tmp_path, name):
    path = shared_data / "faults" / "05-ring-road-crossings-at-joints" / name
    prepared = prepared_map(read_map(path, FRAME, (0.0, 0.0)), EVERYTHING, None)
    build_imported_roads(prepared, FRAME, out=tmp_path / "network.net.xml")
    assert crossings_by_node(tmp_path / "network.net.xml") == set()
    areas = ElementTree.parse(tmp_path / "network.net.xml").getroot().iter("edge")
    assert any(e.get("function") == "walkingarea" for e in areas), "people walk on over joints"
