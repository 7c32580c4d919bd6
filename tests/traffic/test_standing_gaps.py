"""How far drivers stand behind each other, by what SUMO says of a queue at a red signal."""

import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from urbantwin.roads import sumo_binary, sumo_environment
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.demand.vehicle_types import manners_of
from urbantwin.traffic.sumo.simulation import sumo_options, write_routes

CARS, SECONDS = 60, 310
NODES = """<node id="a" x="-800" y="0"/><node id="b" x="0" y="0" type="traffic_light"/>
<node id="c" x="100" y="0"/><node id="s" x="0" y="-100"/>"""
EDGES = """<edge id="ab" from="a" to="b" numLanes="1" speed="13.9"/>
<edge id="bc" from="b" to="c" numLanes="1"/><edge id="sb" from="s" to="b" numLanes="1"/>"""


@pytest.fixture(scope="module")
def queue(make_net, tmp_path_factory):
    """Return a function: the gap ahead of each trip in the queue of some trips, metres."""
    folder: Path = tmp_path_factory.mktemp("queue")
    net = make_net(folder, NODES, EDGES)
    links = len(ElementTree.parse(net).findall("./tlLogic/phase")[0].get("state"))
    red = f'<phase duration="1000" state="{"r" * links}"/>'
    program = f'<tlLogic id="b" type="static" programID="red" offset="0">{red}</tlLogic>'
    (folder / "red.add.xml").write_text(f"<additional>{program}</additional>")

    def gaps(trips: list[Trip], drivers: dict) -> dict[Trip, float]:
        write_routes(
            folder / "r.rou.xml", Demand(tuple(trips), (), manners=manners_of(drivers)), asset
        )
        options = {**sumo_options(500, 1), "time-to-teleport": -1}
        how = [x for key, value in options.items() for x in (f"--{key}", str(value))]
        subprocess.run(
            [sumo_binary("sumo"), "-n", net, "-r", folder / "r.rou.xml",
             "-a", folder / "red.add.xml", *how, "--fcd-output", folder / "fcd.xml",
             "--fcd-output.attributes", "id,pos", "--begin", "0", "--end", str(SECONDS),
             "--no-step-log", "true", "--xml-validation", "never"],
            check=True, capture_output=True, env=sumo_environment(),
        )  # fmt: skip
        last = ElementTree.parse(folder / "fcd.xml").findall("timestep")[-1]
        stand = sorted(((float(x.get("pos")), int(x.get("id"))) for x in last), reverse=True)
        assert len(stand) == len(trips)
        return {
            trips[behind]: front - asset(trips[ahead].asset).length - at
            for (front, ahead), (at, behind) in pairwise(stand)
        }

    return gaps


@pytest.fixture(scope="module")
def trips() -> list[Trip]:
    body = Fleet().body
    return [Trip("car", body("car", k), 3.5 * k, ("ab", "bc")) for k in range(CARS)]


def test_drivers_stand_in_a_queue_as_far_apart_as_they_like(queue, trips):
    found = np.array(list(queue(trips, {}).values()))
    assert found.mean() == pytest.approx(2.0, abs=3 * 0.6 / CARS**0.5)
    assert found.std() == pytest.approx(0.6, abs=0.2)
    assert found.min() > 0.45


def test_what_a_site_says_of_gaps_holds(queue, trips):
    alike = queue(trips, {"car": {"standing_gap_m": 3.0, "standing_gap_spread_m": 0.0}})
    np.testing.assert_allclose(list(alike.values()), 3.0, atol=0.05)
    wide = queue(trips, {"car": {"standing_gap_m": 3.0, "standing_gap_spread_m": 1.0}})
    assert np.mean(list(wide.values())) == pytest.approx(3.0, abs=0.4)
    assert np.std(list(wide.values())) == pytest.approx(1.0, abs=0.3)


@pytest.mark.thorough
def test_nobody_elses_gap_changes_when_one_stays_away(queue, trips):
    every = queue(trips, {})
    fewer = queue([*trips[:10], *trips[11:]], {})
    for trip, gap in fewer.items():
        assert gap == pytest.approx(every[trip], abs=0.05)
    later = replace(trips[5], depart_s=trips[5].depart_s + 0.5)
    moved = queue([*trips[:5], later, *trips[6:]], {})
    assert moved[trips[20]] == pytest.approx(every[trips[20]], abs=0.05)
