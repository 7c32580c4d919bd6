"""Short streets: signals near each other, lanes that begin shortly before them, wrong lanes."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from urbantwin.roads import sumo_binary, sumo_environment
from urbantwin.roads.signals.capacity import saturation_flow
from urbantwin.roads.signals.controlled_links import signalised_junctions
from urbantwin.roads.signals.coordination import COORDINATED_M, least_waiting
from urbantwin.roads.signals.inner_links import feeds
from urbantwin.roads.signals.queue_model import QueueModel
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.simulation import observe, sumo_options, write_routes

from ..thorough import further

pytestmark = pytest.mark.thorough

GREEN_S, CYCLE_S, COMES = 27, 60, 600.0
WAY = ("wa", "ab", "be")


@pytest.fixture(scope="module")
def two_signals(make_net, tmp_path_factory):
    """A lane with two signals 35 m apart, each green for nearly half of the time."""
    places = {"w": -300, "a": 0, "b": 35, "e": 300}
    kinds = {"a": "traffic_light", "b": "traffic_light"}
    nodes = "".join(
        f'<node id="{k}" x="{x}" y="0" type="{kinds.get(k, "priority")}"/>'
        for k, x in places.items()
    )
    edges = "".join(f'<edge id="{k}" from="{k[0]}" to="{k[1]}" speed="13.9"/>' for k in WAY)
    net = make_net(tmp_path_factory.mktemp("two"), nodes, edges)
    tree = etree.parse(net)
    for logic in tree.getroot().iter("tlLogic"):
        for phase in list(logic):
            logic.remove(phase)
        for seconds, state in ((GREEN_S, "G"), (3, "y"), (CYCLE_S - GREEN_S - 3, "r")):
            etree.SubElement(logic, "phase", duration=str(seconds), state=state)
    tree.write(str(net))
    return net


@pytest.fixture(scope="module")
def model(two_signals):
    root = etree.parse(two_signals).getroot()
    there = signalised_junctions(root)
    flows = {("wa", "ab", "be"): COMES, ("ab", "be", ""): COMES}
    ways = feeds(root, there, COORDINATED_M)
    return QueueModel(there, {item.program: item.phases for item in there}, ways, flows)


def carried(model, offset):
    """Return how many an hour get through, found by trying."""
    scale = np.arange(0.05, 2.0, 0.025)
    late = np.tile([0, offset], (len(scale), 1))
    return COMES * scale[np.flatnonzero(model.run(late, scale).worst > 0.02)[0]]


def simulated(net, offset, folder):
    """Return how many an hour SUMO lets through of more than can."""
    tree = etree.parse(net)
    tree.getroot().xpath("//tlLogic[@id='b']")[0].set("offset", str(offset))
    tree.write(str(folder / "late.net.xml"))
    body = Fleet().body
    trips = tuple(Trip("car", body("car", k), 2.5 * k, WAY) for k in range(400))
    write_routes(folder / "r.rou.xml", Demand(trips, ()), asset)
    how = [x for key, value in sumo_options(500, 1).items() for x in (f"--{key}", str(value))]
    (folder / "e.add.xml").write_text(
        f'<additional><inductionLoop id="e" lane="be_0" pos="200" period="840" '
        f'file="{folder / "e.xml"}"/></additional>'
    )
    subprocess.run(
        [sumo_binary("sumo"), "-n", folder / "late.net.xml", "-r", folder / "r.rou.xml",
         "-a", folder / "e.add.xml", *how, "--begin", "0", "--end", "840", "--no-step-log", "true",
         "--no-warnings", "true", "--xml-validation", "never"],
        check=True, capture_output=True, env=sumo_environment(),
    )  # fmt: skip
    (row,) = etree.parse(folder / "e.xml").getroot().iter("interval")
    # The first come to the detector after some 40 s.
    return float(row.get("nVehContrib")) * 3600 / 800


@pytest.mark.parametrize("offset", [30, *further(3)])
def test_as_many_find_room_between_two_signals_as_sumo_lets_through(
    offset, model, two_signals, tmp_path
):
    assert carried(model, offset) == pytest.approx(
        simulated(two_signals, offset, tmp_path), rel=0.2
    )


def test_out_of_step_a_cycle_lets_through_what_has_room(model):
    room = model.room_m[np.isfinite(model.room_m)][0] / 6.6
    per_cycle = carried(model, 30) * CYCLE_S / 3600
    assert room - 1 <= per_cycle <= room + 3
    assert carried(model, 3) > 1.8 * carried(model, 30)


def test_signals_are_brought_into_step(model):
    late, cost = least_waiting(model, {"a": 0.0, "b": 30.0}, CYCLE_S, "a")
    assert late["a"] == 0.0
    # 35 m take 2.5 s at the limit.
    assert late["b"] in [*range(-6, 0), *range(13), *range(CYCLE_S - 8, CYCLE_S)]
    assert carried(model, int(late["b"])) > 1.8 * carried(model, 30)
    assert cost >= 0


def test_who_turns_slowly_leaves_slowly(two_signals):
    (link, *_) = signalised_junctions(etree.parse(two_signals).getroot())[0].links
    assert saturation_flow(link) == 1800.0
    # A radius of 10 m at 2.2 m/s2 sideways: 4.7 m/s; cars 6.6 m from front to front, 1.35 s apart.
    bend = replace(link, movement="left", bend_speed=4.7)
    assert saturation_flow(bend) == pytest.approx(3600 / (1.35 + 6.6 / 4.7))


def test_who_stands_in_a_wrong_lane_goes_on_along_it(make_net, tmp_path):
    """All want to turn left, where it is red for ever; one lane leads right only."""
    nodes = (
        '<node id="a" x="-200" y="30"/><node id="b" x="-200" y="-30"/><node id="m" x="0" y="0"/>'
        '<node id="d" x="20" y="0" type="traffic_light"/><node id="l" x="200" y="60"/>'
        '<node id="r" x="200" y="-60"/><node id="o" x="400" y="0"/><node id="z" x="600" y="0"/>'
    )
    edges = (
        '<edge id="am" from="a" to="m"/><edge id="bm" from="b" to="m"/>'
        '<edge id="md" from="m" to="d" numLanes="2"/><edge id="dl" from="d" to="l"/>'
        '<edge id="dr" from="d" to="r"/><edge id="lo" from="l" to="o"/>'
        '<edge id="ro" from="r" to="o"/><edge id="oz" from="o" to="z"/>'
    )
    ways = {"am": 1, "bm": 0}
    rows = (f'<connection from="{k}" to="md" fromLane="0" toLane="{n}"/>' for k, n in ways.items())
    (tmp_path / "x.con.xml").write_text(f"<connections>{''.join(rows)}</connections>")
    net = make_net(tmp_path, nodes, edges, "-x", tmp_path / "x.con.xml")
    tree = etree.parse(net)
    (left,) = tree.getroot().xpath("//connection[@from='md'][@to='dl']")
    (right,) = tree.getroot().xpath("//connection[@from='md'][@to='dr']")
    assert (left.get("fromLane"), right.get("fromLane")) == ("1", "0")
    (logic,) = tree.getroot().iter("tlLogic")
    for phase in list(logic):
        logic.remove(phase)
    state = ["r", "r"]
    state[int(right.get("linkIndex"))] = "G"
    etree.SubElement(logic, "phase", duration="60", state="".join(state))
    tree.write(str(net))
    onward = ("md", "dl", "lo", "oz")
    body = Fleet().body
    trips = tuple(
        Trip("car", body("car", k), 2.0 * (k // 2), (("am", "bm")[k % 2], *onward))
        for k in range(12)
    )
    seen = observe(net, Demand(trips, ()), asset, seconds=420, step_ms=500, seed=1).observed
    # Those before the red light stay; those beside them do not wait for them.
    assert seen.most[0].sum() == 12
    assert 6 <= seen.least[5].sum() <= 9
