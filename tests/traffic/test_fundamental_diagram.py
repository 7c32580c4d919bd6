"""Flow and density of our drivers, by SUMO's own detectors, against what is known of real ones."""

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from urbantwin.roads import sumo_binary, sumo_environment
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.simulation import sumo_options, write_routes

pytestmark = pytest.mark.thorough

#: Speeds at which three streets go on behind the detectors, m/s: the slower, the denser before.
NARROW = (6.0, 3.5, 2.0)
LIMIT, SECONDS, AREA_M = 13.9, 600, 200.0


@pytest.fixture(scope="module")
def diagram(make_net, tmp_path_factory) -> np.ndarray:
    """Half minutes of three streets that fill up: density (1/km), flow (1/h), mean speed (m/s)."""
    folder: Path = tmp_path_factory.mktemp("diagram")
    nodes, edges, detectors = "", "", ""
    body, trips = Fleet().body, []
    # Ever more come, until the streets are full.
    times = np.cumsum(np.concatenate([np.linspace(9.0, 1.9, 60), np.full(150, 1.9)]))
    for n, speed in enumerate(NARROW):
        for name, x in (("w", -900), ("c", 0), ("e", 300)):
            nodes += f'<node id="{name}{n}" x="{x}" y="{200 * n}"/>'
        edges += f'<edge id="in{n}" from="w{n}" to="c{n}" speed="{LIMIT}"/>'
        edges += f'<edge id="out{n}" from="c{n}" to="e{n}" speed="{speed}"/>'
        detectors += (
            f'<laneAreaDetector id="{n}" lane="in{n}_0" pos="650" length="{AREA_M:g}" '
            f'period="30" file="{folder / "e2.xml"}"/>'
        )
        trips += [
            Trip("car", body("car", k), float(at), (f"in{n}", f"out{n}"))
            for k, at in enumerate(times)
        ]
    net = make_net(folder, nodes, edges)
    write_routes(
        folder / "r.rou.xml", Demand(tuple(sorted(trips, key=lambda x: x.depart_s)), ()), asset
    )
    (folder / "d.add.xml").write_text(f"<additional>{detectors}</additional>")
    how = [x for key, value in sumo_options(500, 1).items() for x in (f"--{key}", str(value))]
    subprocess.run(
        [sumo_binary("sumo"), "-n", net, "-r", folder / "r.rou.xml", "-a", folder / "d.add.xml",
         *how, "--end", str(SECONDS), "--no-step-log", "true", "--xml-validation", "never"],
        check=True, capture_output=True, env=sumo_environment(),
    )  # fmt: skip
    rows = [
        [float(row.get(name)) for name in ("sampledSeconds", "meanSpeed")]
        for row in ElementTree.parse(folder / "e2.xml").iter("interval")
    ]
    seconds, speed = np.array([row for row in rows if row[0] > 0]).T
    # Edie's definitions: time spent and distance gone, by length and duration of what is observed.
    density = seconds / (30 * AREA_M / 1000)
    return np.column_stack([density, density * speed * 3.6, speed])


def test_cars_are_free_where_there_are_few(diagram) -> None:
    few = diagram[diagram[:, 0] < 12]
    assert len(few) > 8
    assert np.median(few[:, 2]) == pytest.approx(LIMIT, rel=0.1)


def test_a_lane_carries_at_most_what_lanes_carry(diagram) -> None:
    """Of uninterrupted streets of 50 km/h: 1,900 to 2,100 veh/h (HCM 2016, 12; Treiber 2013, 4)."""
    assert 1300 < diagram[:, 1].max() < 2200


def test_the_denser_a_jam_the_less_it_carries(diagram) -> None:
    """Jams dissolve against the traffic at 12 to 22 km/h (Treiber and Kesting 2013, 18)."""
    jam = diagram[diagram[:, 2] < 0.5 * LIMIT]
    assert len(jam) > 8
    slope, flow = np.polyfit(jam[:, 0], jam[:, 1], 1)
    assert 12 < -slope < 25
    assert 100 < flow / -slope < 180  # standing bumper to bumper: 5.5 to 10 m for each car
