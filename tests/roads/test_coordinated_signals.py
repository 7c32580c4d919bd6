"""Signals with a short road between them, judged by closed-form answers and SUMO's traffic."""

import subprocess
from dataclasses import replace
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, sumo_binary, sumo_environment
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.coordination import (
    Stream,
    best_offset_s,
    passing_shares,
    streams_between,
)
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)
SIGNAL = {"highway": "traffic_signals"}
STREET = {"highway": "primary", "lanes": "4", "maxspeed": "50", "sidewalk": "both"}
SIDE = {"highway": "secondary", "lanes": "2", "maxspeed": "50", "sidewalk": "both"}
HALF = ((30.0, "G"), (30.0, "r"))


def corridor(metres=40.0):
    lanes = f'<lane id="between_0" length="{metres}"/><lane id="out_0" length="500.0"/>'
    return etree.fromstring(f"<net>{lanes}</net>")


def signal(program, road, to, phases, offset=0.0):
    link = Link(0, program, 0, f"{road}_0", f"{to}_0", road, "", "through", 90.0, 24.0, 13.9)
    xy = np.zeros(2)
    return Signalised(
        program, (program,), (), xy, (link,), frozenset(), frozenset(), offset, phases
    )


@pytest.mark.parametrize("seconds", [0.0, 7.0, 31.0, 75.0])
def test_the_best_offset_of_one_stream_is_its_travel_time(seconds):
    streams = [Stream(("a", 0), ("b", 0), 300.0, seconds)]
    assert best_offset_s("b", {"a": HALF, "b": HALF}, {"a": 0}, streams) == seconds % 60
    assert best_offset_s("b", {"a": HALF, "b": HALF}, {"a": 20}, streams) == (20 + seconds) % 60


def test_of_two_directions_the_larger_one_determines_the_offset():
    streams = [Stream(("a", 0), ("b", 0), 300.0, 20.0), Stream(("b", 0), ("a", 0), 100.0, 20.0)]
    assert best_offset_s("b", {"a": HALF, "b": HALF}, {"a": 0}, streams) == 20
    assert best_offset_s("a", {"a": HALF, "b": HALF}, {"b": 0}, streams) == 40


def test_streams_have_the_flow_and_the_time_between_two_stop_lines():
    """24 m on the junction and 40 m of road at 8 m/s; 300 + 100 of the 400 cars go on."""
    signals = [signal("a", "in", "between", HALF), signal("b", "between", "out", HALF)]
    flows = {("in", "between", "x"): 300.0, ("in", "between", "y"): 100.0}
    assert streams_between(corridor(), signals, flows) == [Stream(("a", 0), ("b", 0), 400.0, 8.0)]
    assert streams_between(corridor(90.0), signals, flows) == []


@pytest.mark.parametrize(("offset", "share"), [(8, 1.0), (38, 0.0), (23, 0.5), (68, 1.0)])
def test_vehicles_pass_as_far_as_both_greens_overlap(offset, share):
    signals = [signal("a", "in", "between", HALF), signal("b", "between", "out", HALF, offset)]
    shares = passing_shares(corridor(), signals, {("in", "between", "x"): 400.0})
    assert shares == {("a", 0): pytest.approx(share)}


def test_phases_of_parts_of_seconds_are_sampled_each_second():
    parts = ((14.5, "G"), (15.5, "G"), (2.4, "y"), (27.6, "r"))
    signals = [signal("a", "in", "between", HALF), signal("b", "between", "out", parts, 8)]
    assert passing_shares(corridor(), signals, {}) == {("a", 0): pytest.approx(1.0)}


def test_signals_with_different_cycles_are_not_compared():
    other = ((30.0, "G"), (31.0, "r"))
    signals = [signal("a", "in", "between", HALF), signal("b", "between", "out", other)]
    assert passing_shares(corridor(), signals, {}) == {}


def built(write_osm, tmp_path, nodes, ways):
    out = tmp_path / "roads.net.xml"
    extract = read_extract(write_osm(nodes, ways))
    region = shapely.box(-140, -140, 140, 140)
    build_roads(extract, HERE, region, Elevation.flat(), driving_side="right", out=out)
    return out


def staggered():
    """Two junctions 70 m apart on one street."""
    nodes = {1: (-150, 0, {}), 2: (-35, 0, SIGNAL), 3: (35, 0, SIGNAL), 4: (150, 0, {})}
    nodes |= {5: (-35, 150, {}), 6: (35, -150, {}), 7: (-35, -150, {}), 8: (35, 150, {})}
    return nodes, {10: ([1, 2, 3, 4], STREET), 11: ([5, 2, 7], SIDE), 12: ([6, 3, 8], SIDE)}


def time_loss_s(net_file, folder):
    """Mean loss of time of vehicles that drive through both junctions, by SUMO, seconds."""
    net = sumolib.net.readNet(str(net_file))
    ends = {
        edge: next(lane.getShape() for lane in edge.getLanes())
        for edge in net.getEdges()
        if edge.allows("passenger")
    }
    starts = [edge for edge, shape in ends.items() if abs(shape[0][0]) > 130]
    goals = [edge for edge, shape in ends.items() if abs(shape[-1][0]) > 130]
    flows = ElementTree.Element("routes")
    for k, (start, goal) in enumerate(product(starts, goals)):
        if start.getFromNode().getCoord()[0] * goal.getToNode().getCoord()[0] > 0:
            continue
        way, _ = net.getShortestPath(start, goal, vClass="passenger")
        flow = ElementTree.SubElement(
            flows, "flow", id=str(k), begin="0", end="1200", vehsPerHour="500", departLane="best"
        )
        ElementTree.SubElement(flow, "route", edges=" ".join(edge.getID() for edge in way))
    assert len(flows) == 2
    ElementTree.ElementTree(flows).write(folder / "r.rou.xml")
    command = [
        sumo_binary("sumo"), "-n", net_file, "-r", folder / "r.rou.xml", "--end", "1500",
        "--statistic-output", folder / "s.xml", "--duration-log.statistics", "true",
        "--no-step-log", "true", "--xml-validation", "never", "--no-warnings", "true",
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, env=sumo_environment())
    trips = ElementTree.parse(folder / "s.xml").getroot().find("vehicleTripStatistics")
    assert int(trips.get("count")) > 300
    return float(trips.get("timeLoss"))


def test_coordinated_signals_have_one_cycle_and_an_offset_that_saves_time(write_osm, tmp_path):
    path = built(write_osm, tmp_path, *staggered())
    root = ElementTree.parse(path)
    logics = list(root.iter("tlLogic"))
    assert len(logics) == 2
    assert {logic.get("type") for logic in logics} == {"static"}
    cycles = {sum(float(phase.get("duration")) for phase in logic) for logic in logics}
    assert len(cycles) == 1
    (cycle,) = cycles
    losses = {}
    for late in (0.0, 0.25, 0.5, 0.75):
        logics[1].set("offset", str(float(logics[1].get("offset")) + (late and 0.25) * cycle))
        (tmp_path / str(late)).mkdir()
        root.write(tmp_path / str(late) / "roads.net.xml")
        losses[late] = time_loss_s(tmp_path / str(late) / "roads.net.xml", tmp_path / str(late))
    assert losses[0.0] <= min(losses.values()) + 2.0, losses
    assert losses[0.0] < 0.8 * max(losses.values()), losses


def greens(path):
    """Yield each phase's state with sumolib's links by their index."""
    net = sumolib.net.readNet(str(path), withPrograms=True, withPedestrianConnections=True)
    (light,) = net.getTrafficLights()
    links = {}
    for edge in net.getEdges(withInternal=True):
        for lane in edge.getLanes():
            for item in lane.getOutgoing():
                if item.getTLSID():
                    links.setdefault(item.getTLLinkIndex(), []).append(item)
    (program,) = light.getPrograms().values()
    return [phase.state for phase in program.getPhases()], links


@pytest.mark.parametrize("cars_beside", [False, True])
def test_cars_turn_while_pedestrians_walk_unless_beside_other_cars(cars_beside):
    """Cyclists beside a turning car do not hide pedestrians from its driver."""
    turn = Link(0, "a", 0, "in_1", "out_1", "in", "", "right", 90.0, 12.0, 8.0)
    beside = replace(turn, index=1, row=1, lane="in_0", to="out_0", for_cars=cars_beside)
    walk = Link(2, "a", 2, ":a_c0", ":a_w0", ":a_c0", "", "walk", 0.0, 8.0, 1.4, crosses=("out",))
    rows = [("a", 0, 2), ("a", 1, 2)]
    foes = frozenset(rows) | {(name, b, a) for name, a, b in rows}
    links = (turn, beside, walk)
    junction = Signalised("a", ("a",), (), np.zeros(2), links, foes, frozenset(rows), 0.0, HALF)
    assert junction.together(0, 2) is not cars_beside


def test_turns_from_two_lanes_never_yield_to_opposing_traffic(write_osm, tmp_path):
    """One of two vehicles side by side hides the opposing traffic from the other."""
    nodes = {1: (-150, 0, {}), 2: (0, 0, SIGNAL), 3: (150, 0, {}), 4: (0, -150, {})}
    nodes |= {5: (0, 150, {}), 6: (-60, 0, {}), 7: (60, 0, {})}
    to = {**STREET, "lanes": "6", "lanes:forward": "4", "lanes:backward": "2"}
    lefts = {"turn:lanes:forward": "left|left|through|through;right"}
    ways = {10: ([6, 2], to | lefts), 11: ([4, 2, 5], STREET), 12: ([1, 6], STREET)}
    ways |= {13: ([7, 2], to | lefts), 14: ([3, 7], STREET)}
    states, links = greens(built(write_osm, tmp_path, nodes, ways))
    turns = {}
    for k, found in links.items():
        if found[0].getDirection() == "l":
            turns.setdefault(found[0].getFrom().getID(), []).append(k)
    pairs = {road: ks for road, ks in turns.items() if len(ks) == 2}
    assert pairs
    for road, ks in pairs.items():
        opposing = [
            k
            for k, found in links.items()
            if found[0].getDirection() == "s"
            and found[0].getFrom().getID() != road
            and found[0].getFrom().getID() in pairs
        ]
        assert opposing
        assert any(state[ks[0]] in "gG" for state in states)
        for state in states:
            if any(state[k] in "gG" for k in ks):
                assert all(state[k] not in "gG" for k in opposing)
