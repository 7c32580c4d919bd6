"""Queues at signals, judged by SUMO's own detectors and by what is known of saturation flow."""

import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
from lxml import etree

from urbantwin.roads import sumo_binary, sumo_environment
from urbantwin.roads.signals.capacity import gap_flow, lane_loads
from urbantwin.roads.signals.controlled_links import signalised_junctions
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.simulation import simulate, sumo_options, write_routes

pytestmark = pytest.mark.thorough

GREEN_S, CYCLE_S = 40, 80
SECONDS = 600


@pytest.fixture(scope="module")
def street(make_net, tmp_path_factory):
    """A lane of 50 km/h with a signal in its middle."""
    nodes = '<node id="w" x="-400" y="0"/><node id="e" x="300" y="0"/>'
    nodes += '<node id="c" x="0" y="0" type="traffic_light"/>'
    edges = (
        '<edge id="wc" from="w" to="c" speed="13.9"/><edge id="ce" from="c" to="e" speed="13.9"/>'
    )
    net = make_net(tmp_path_factory.mktemp("street"), nodes, edges)
    tree = etree.parse(net)
    (logic,) = tree.getroot().iter("tlLogic")
    for phase in list(logic):
        logic.remove(phase)
    for seconds, state in ((GREEN_S, "G"), (3, "y"), (CYCLE_S - GREEN_S - 3, "r")):
        etree.SubElement(logic, "phase", duration=str(seconds), state=state)
    tree.write(str(net))
    return net


@pytest.fixture(scope="module")
def queue():
    """Cars as they drive here, more of them than the signal lets through."""
    body = Fleet().body
    return Demand(tuple(Trip("car", body("car", k), 3.0 * k, ("wc", "ce")) for k in range(150)), ())


@pytest.fixture(scope="module")
def detected(street, queue, tmp_path_factory):
    """Times at which SUMO's own detector sees fronts pass the stop line."""
    folder = tmp_path_factory.mktemp("detector")
    write_routes(folder / "r.rou.xml", queue, asset)
    (lane,) = etree.parse(street).getroot().xpath("//edge[@id='wc']/lane")
    end = float(lane.get("length")) - 0.1
    (folder / "e1.add.xml").write_text(
        f'<additional><instantInductionLoop id="e1" lane="wc_0" pos="{end:.2f}" '
        f'file="{folder / "e1.xml"}"/></additional>'
    )
    how = [x for key, value in sumo_options(100, 1).items() for x in (f"--{key}", str(value))]
    subprocess.run(
        [sumo_binary("sumo"), "-n", street, "-r", folder / "r.rou.xml", "-a", folder / "e1.add.xml",
         *how, "--end", str(SECONDS), "--no-step-log", "true", "--xml-validation", "never"],
        check=True, capture_output=True, env=sumo_environment(),
    )  # fmt: skip
    rows = ElementTree.parse(folder / "e1.xml").iter("instantOut")
    return np.array([float(row.get("time")) for row in rows if row.get("state") == "enter"])


def test_a_lane_discharges_1700_to_2000_cars_an_hour_of_green(detected):
    """HCM 2016, 19: from the fifth vehicle of a queue on; base 1900."""
    rates = []
    for start in np.arange(3 * CYCLE_S, SECONDS - CYCLE_S, CYCLE_S):
        passed = detected[(detected > start) & (detected < start + GREEN_S)]
        rates.append((len(passed) - 4) / (passed[-1] - passed[3]) * 3600)
    assert 1700 <= np.mean(rates) <= 2000


def test_our_counts_are_those_of_sumos_detector_and_nobody_runs_red(street, queue, detected):
    seen = simulate(
        street, queue, asset, warmup_s=1.0, steps=10 * (SECONDS - 10), step_s=0.1, seed=1
    )
    (lane,) = etree.parse(street).getroot().xpath("//edge[@id='wc']/lane")
    x_stop = float(lane.get("shape").split()[-1].split(",")[0])
    passed = []
    for trip in np.unique(seen.trip):
        own = np.flatnonzero(seen.trip == trip)
        beyond = own[seen.front[own, 0] > x_stop - 0.1]
        if len(beyond) and beyond[0] != own[0]:
            passed.append(seen.step[beyond[0]] * 0.1 + 1.0)
    passed = np.sort(passed)
    same = detected[detected < SECONDS - 20]
    assert len(same) > 100
    np.testing.assert_allclose(passed[: len(same)], same, atol=0.3)
    phase = passed % CYCLE_S
    assert phase.max() < GREEN_S + 3 + 0.3


def test_the_capacity_of_a_lane_is_saturation_flow_times_its_share_of_green(street):
    (junction,) = signalised_junctions(etree.parse(street).getroot())
    (lane,) = lane_loads(junction, junction.phases, {("wc", "ce", ""): 500.0})
    assert lane.capacity == pytest.approx(1800 * (GREEN_S - 1) / CYCLE_S)
    assert lane.load == pytest.approx(500 / lane.capacity)


def test_a_simulated_lane_of_cars_carries_what_is_computed_and_little_more(detected):
    carried = np.sum((detected > 3 * CYCLE_S) & (detected < 7 * CYCLE_S)) / (4 * CYCLE_S) * 3600
    computed = 1800 * (GREEN_S - 1) / CYCLE_S
    assert computed <= carried <= 1.2 * computed


@pytest.mark.parametrize("opposing", [200.0, 600.0, 1200.0])
def test_turns_find_as_many_gaps_as_random_traffic_has(opposing):
    gaps = np.random.default_rng(1).exponential(3600 / opposing, 200_000)
    turning = np.floor((gaps - 4.5) / 2.5 + 1.0).clip(0.0).sum()
    assert gap_flow(opposing) == pytest.approx(turning / gaps.sum() * 3600, rel=0.02)
