"""Lanes that become one, driven by SUMO itself."""

import subprocess
from xml.etree import ElementTree

import pytest

from urbantwin.roads import sumo_binary, sumo_environment
from urbantwin.roads.merging_lanes import zip_merging_lanes
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS

NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="250" y="0"/>
<node id="c" x="{c}" y="0" type="priority"/><node id="d" x="700" y="0"/>
<node id="s" x="{c}" y="-200"/></nodes>"""
EDGES = """<edges><edge id="ab" from="a" to="b" numLanes="1" speed="10"/>
<edge id="bc" from="b" to="c" numLanes="2" speed="10"/>
<edge id="cd" from="c" to="d" numLanes="1" speed="10"/>{side}</edges>"""
JOINED = """<connections><connection from="bc" to="cd" fromLane="0" toLane="0"/>
<connection from="bc" to="cd" fromLane="1" toLane="0"/></connections>"""


@pytest.fixture
def merge(tmp_path):
    """A lane that becomes two and then one again, with a side street there or not."""

    def made(side=""):
        (tmp_path / "n.nod.xml").write_text(NODES.format(c=300))
        (tmp_path / "e.edg.xml").write_text(EDGES.format(side=side))
        (tmp_path / "c.con.xml").write_text(JOINED)
        net = tmp_path / "m.net.xml"
        kinds = {"node": "n.nod.xml", "edge": "e.edg.xml", "connection": "c.con.xml"}
        files = [f"--{kind}-files={tmp_path / name}" for kind, name in kinds.items()]
        subprocess.run(
            [sumo_binary("netconvert"), *files, "-o", str(net), "--no-turnarounds", "true"],
            check=True, capture_output=True, env=sumo_environment(),
        )  # fmt: skip
        return net

    return made


def driven(net, tmp_path):
    """Vehicles that entered each lane before the merge, and all who came through."""
    how = " ".join(f'{key}="{value}"' for key, value in ACTOR_KINDS["car"].parameters.items())
    (tmp_path / "r.rou.xml").write_text(
        f'<routes><vType id="car" {how}/>'
        '<flow id="f" type="car" begin="0" end="600" vehsPerHour="900" departSpeed="max">'
        '<route edges="ab bc cd"/></flow></routes>'
    )
    (tmp_path / "a.add.xml").write_text(
        f'<additional><laneData id="l" file="{tmp_path / "l.xml"}"/></additional>'
    )
    subprocess.run(
        [sumo_binary("sumo"), "-n", net, "-r", tmp_path / "r.rou.xml", "-a", tmp_path / "a.add.xml",
         "--end", "700", "--no-step-log", "true", "--seed", "1", "--xml-validation", "never"],
        check=True, capture_output=True, env=sumo_environment(),
    )  # fmt: skip
    lanes = ElementTree.parse(tmp_path / "l.xml").iter("lane")
    return {lane.get("id"): int(lane.get("entered")) + int(lane.get("departed")) for lane in lanes}


def test_both_lanes_are_used_where_they_take_turns(merge, tmp_path):
    net = merge()
    before = driven(net, tmp_path)
    assert min(before["bc_0"], before["bc_1"]) < 0.1 * before["cd_0"]
    assert zip_merging_lanes(net) == 1
    after = driven(net, tmp_path)
    assert after["cd_0"] >= 0.98 * before["cd_0"] > 100
    assert min(after["bc_0"], after["bc_1"]) > 0.3 * after["cd_0"]


def test_who_gives_way_to_others_does_so_still(merge):
    net = merge(side='<edge id="sc" from="s" to="c" priority="9" numLanes="1"/>')
    text = net.read_bytes()
    assert zip_merging_lanes(net) == 0
    assert net.read_bytes() == text
