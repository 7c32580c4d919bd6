"""Short streets before signals: slow bends, and vehicles in wrong lanes."""

from dataclasses import replace

import pytest
from lxml import etree

from urbantwin.roads.signals.capacity import saturation_flow
from urbantwin.roads.signals.controlled_links import signalised_junctions
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.simulation import observe

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def two_signals(make_net, tmp_path_factory):
    """A lane with two signals 35 m apart."""
    nodes = "".join(
        f'<node id="{k}" x="{x}" y="0" type="{kind}"/>'
        for k, x, kind in (
            ("w", -300, "priority"),
            ("a", 0, "traffic_light"),
            ("b", 35, "traffic_light"),
            ("e", 300, "priority"),
        )
    )
    edges = "".join(
        f'<edge id="{k}" from="{k[0]}" to="{k[1]}" speed="13.9"/>' for k in ("wa", "ab", "be")
    )
    return make_net(tmp_path_factory.mktemp("two"), nodes, edges)


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
