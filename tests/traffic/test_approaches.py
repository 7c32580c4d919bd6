"""How approaches are used, against SUMO's own detectors, closed forms and tables of bad input."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.roads.netconvert import sumo_environment
from urbantwin.traffic.calibration.arrivals import come_evenly
from urbantwin.traffic.calibration.lane_use import LaneUse, approach_rows
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import JunctionLinks
from urbantwin.traffic.demand.approaches import approaches_of
from urbantwin.traffic.demand.count_rates import departures_of
from urbantwin.twin import Twin

#: A short approach of two lanes behind a road of two lanes; a signal in the middle of a street that
#: the map cuts in two 30 m before it.
NODES = """<node id="a" x="-400" y="0"/><node id="b" x="-25" y="0"/>
<node id="c" x="0" y="0"/><node id="d" x="200" y="0"/>
<node id="e" x="0" y="-300"/><node id="x" x="370" y="-300"/>
<node id="f" x="400" y="-300" type="traffic_light"/>
<node id="g" x="600" y="-300"/><node id="h" x="400" y="-400"/><node id="i" x="400" y="-200"/>"""
EDGES = """<edge id="ab" from="a" to="b" numLanes="2"/><edge id="bc" from="b" to="c" numLanes="2"/>
<edge id="cd" from="c" to="d" numLanes="2"/><edge id="ex" from="e" to="x" numLanes="1"/>
<edge id="xf" from="x" to="f" numLanes="1"/>
<edge id="fg" from="f" to="g" numLanes="1"/><edge id="hf" from="h" to="f" numLanes="1"/>
<edge id="fi" from="f" to="i" numLanes="1"/>"""
#: SUMO alone with one of the worker's parts, and detectors of SUMO's.
DRIVES = """
import importlib.util, json, sys
import libsumo
options, part, name, told, seconds = json.loads(sys.argv[1])
spec = importlib.util.spec_from_file_location("part", part)
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
libsumo.start(["sumo", *options])
looks = getattr(module, name)(told)
for step in range(seconds * 10):
    libsumo.simulationStep()
    if step % 10 == 0:
        looks.look()
libsumo.close()
"""
#: Where the parts of SUMO's worker lie.
WORKER = Path(sys.modules["urbantwin.traffic.demand"].__file__ or "").parents[1] / "sumo"


def driven(folder: Path, net: Path, routes: str, detectors: str, part: Any) -> ElementTree.Element:
    """Return what detectors told of a simulation with a part of the worker: (file, class, told)."""
    (folder / "routes.xml").write_text(f"<routes>{routes}</routes>")
    (folder / "detectors.xml").write_text(f"<additional>{detectors}</additional>")
    options = ["-n", str(net), "-r", str(folder / "routes.xml"), "--step-length", "0.1"]
    options += ["-a", str(folder / "detectors.xml"), "--no-step-log", "true", "--seed", "3"]
    options += ["--lateral-resolution", "0.8"]
    file, name, told, seconds = part
    job = json.dumps([options, str(WORKER / file), name, told, seconds])
    subprocess.run([sys.executable, "-c", DRIVES, job], env=sumo_environment(), check=True)
    return ElementTree.parse(folder / "out.xml").getroot()


@pytest.fixture(scope="module")
def net(make_net: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_net(tmp_path_factory.mktemp("approach"), NODES, EDGES)


@pytest.mark.thorough
def test_detectors_of_sumo_count_the_shares_that_are_told(net: Path, tmp_path: Path) -> None:
    """Eight in ten by the left lane, which nobody needs, of an approach of 25 m."""
    flow = '<vType id="car" sigma="0.3"/><route id="r" edges="ab bc cd"/>'
    flow += '<flow id="f" type="car" route="r" begin="0" end="480" vehsPerHour="900" '
    flow += 'departLane="random" departSpeed="max"/>'
    loops = "".join(
        f'<e1Detector id="{lane}" lane="{lane}" pos="-2" period="1000" file="out.xml"/>'
        for lane in ("bc_0", "bc_1")
    )
    told = {"bc": {"queue_headway_s": None, "lanes": {"cd": {"0": 0.2, "1": 0.8}}}}
    found = driven(tmp_path, net, flow, loops, ("lane_use.py", "LaneUse", told, 560))
    count = {row.get("id"): float(row.get("nVehContrib", 0)) for row in found}
    assert sum(count.values()) == pytest.approx(120, abs=2)
    assert count["bc_1"] / sum(count.values()) == pytest.approx(0.8, abs=0.03)
    again = driven(tmp_path, net, flow, loops, ("lane_use.py", "LaneUse", told, 560))
    assert ElementTree.tostring(again) == ElementTree.tostring(found)


@pytest.mark.thorough
def test_queues_leave_as_greenshields_saw_and_close_up_again(net: Path, tmp_path: Path) -> None:
    """Past SUMO's loop at the stop line, and behind it as close as who never kept more.

    Most of a queue stands on the road before the approach. Drivers who keep one headway everywhere
    leave a queue too fast, or do not close up.
    """

    def headways(tau_s: float, queue_s: float | None) -> tuple[list[float], float]:
        """Return the medians of the third of a queue to the seventh, and at 180 m a fifth below."""
        flow = f'<vType id="car" accel="2.0" tau="{tau_s}"/>'
        flow += (
            '<route id="r" edges="ex xf fg"/><flow id="f" type="car" route="r" begin="0" end="450"'
        )
        flow += ' vehsPerHour="1600" departSpeed="max"/>'
        loops = "".join(
            f'<instantInductionLoop id="{name}" lane="{lane}" pos="{at}" file="out.xml"/>'
            for name, lane, at in (("line", "xf_0", -0.1), ("later", "fg_0", 180))
        )
        told = {"xf": {"queue_headway_s": queue_s, "lanes": {}}}
        part = ("queue_headway.py", "QueueHeadways", told, 480)
        found: dict[str, list[float]] = {"line": [], "later": []}
        for row in driven(tmp_path, net, flow, loops, part):
            if row.get("state") == "enter":
                found[row.get("id", "")].append(float(row.get("time", 0)))
        first, later = (np.diff(times) for times in found.values())
        # More come than pass: behind each red a queue begins.
        queues = [one[2:7] for one in np.split(first, np.flatnonzero(first > 15.0))[1:]]
        whole = [one for one in queues if len(one) == 5]
        assert len(whole) >= 4
        return np.median(whole, axis=0).tolist(), float(np.quantile(later, 0.2))

    close, told, far = headways(1.2, None), headways(1.2, 2.5), headways(2.0, None)
    # Greenshields, Schapiro and Ericksen, 1947; of the first two it matters where they stood.
    assert told[0] == pytest.approx([2.7, 2.4, 2.2, 2.1, 2.1], abs=0.2)
    assert close[0][0] < 2.5
    assert far[0][-1] > 2.4
    assert told[1] == pytest.approx(close[1], abs=0.15)
    assert far[1] > told[1] + 0.4


def test_who_sets_out_at_random_comes_as_a_poisson_process_does() -> None:
    def came(seed: int, *, evenly: bool) -> np.ndarray[Any, Any]:
        random = np.random.Generator(np.random.Philox(key=[seed, 1]))
        return departures_of(
            [(0.0, 900.0, 80.0), (900.0, 1800.0, 40.0)], 0.5, random, evenly=evenly
        )

    for evenly in (True, False):
        times = came(1, evenly=evenly)
        assert [(times < 900).sum(), (times >= 900).sum()] == [80, 40]
        assert (np.diff(times) >= 0).all()
    gaps = np.concatenate([np.diff(came(seed, evenly=False)[:80]) for seed in range(50)])
    # Exponential: of a mean of 11.25 s, 16 % are shorter than 2 s; a triangle has 1.6 %.
    assert (gaps < 2.0).mean() == pytest.approx(1 - np.exp(-2 / 11.25), abs=0.02)
    even = np.concatenate([np.diff(came(seed, evenly=True)[:80]) for seed in range(50)])
    assert (even < 2.0).mean() == pytest.approx(0.5 * (2 / 11.25) ** 2, abs=0.01)


def test_chance_is_told_from_evenness() -> None:
    """Draws from a Poisson process are called even in one case of a hundred, slots always."""
    random = np.random.default_rng(3)
    poisson = [
        come_evenly({"a": np.sort(random.uniform(0, 2000, random.poisson(200)))}, 2000.0, 75.0)
        for _ in range(300)
    ]
    assert np.mean(poisson) == pytest.approx(0.01, abs=0.015)
    slots = [10.0 * (np.arange(200) + random.random(200)) for _ in range(20)]
    assert all(come_evenly({"a": times}, 2000.0, 75.0) for times in slots)
    assert come_evenly({"a": np.sort(random.uniform(0, 90, 40))}, 90.0, 0.0)  # too short to tell


def test_shares_of_lanes_are_those_recorded_drawn_towards_the_usual() -> None:
    """Closed form: n / (n + 20) of the way; then what was asked is corrected by what came of it."""
    ways = {":c_0": ("w_1", "e"), ":c_1": ("w_2", "e"), ":c_2": ("w_1", "s")}
    links = JunctionLinks("c", ways, {}, None, np.zeros((0, 0), np.bool_))
    nothing = Measured(600.0, {}, {}, {})
    way = ("w", "e")
    recorded = replace(
        nothing, lane_use={way: {"w_1": 20, "w_2": 60, "w_0": 1}, ("w", "s"): {"w_1": 50}}
    )
    lanes = LaneUse(recorded, links)
    assert approach_rows(lanes, {}) == []
    lanes.learn(replace(nothing, lane_use={way: {"w_1": 30, "w_2": 10}}))
    first = 0.75 + 80 / 100 * (0.25 - 0.75)
    told = [{"turn": "e", "shares": {"w_1": round(first, 3), "w_2": round(1 - first, 3)}}]
    assert approach_rows(lanes, {"n": 1.5}) == [
        {"approach": "n", "queue_headway_s": 1.5},
        {"approach": "w", "lanes": told},
    ]
    lanes.learn(replace(nothing, lane_use={way: {"w_1": 50, "w_2": 50}}))
    (row,) = approach_rows(lanes, {})
    assert row["lanes"][0]["shares"]["w_1"] < first  # too many came by it
    assert sum(row["lanes"][0]["shares"].values()) == pytest.approx(1.0, abs=0.002)
    few = LaneUse(replace(nothing, lane_use={way: {"w_1": 5, "w_2": 14}}), links)
    few.learn(recorded)
    assert approach_rows(few, {}) == []


@pytest.mark.parametrize(
    ("rows", "place", "says"),
    [
        ([{"approach": "wx"}], r"approaches\[0\]\.approach", "no road 'wx'.*wc"),
        ([{"approach": "wc"}, {"approach": "wc"}], r"approaches\[1\]\.approach", "twice"),
        (
            [{"approach": "wc", "lanes": [{"turn": "nc", "shares": {"wc_1": 1.0}}]}],
            r"approaches\[0\]\.lanes\[0\]\.turn",
            "no lane of the approach leads to road 'nc'",
        ),
        (
            [{"approach": "wc", "lanes": [{"turn": "ce", "shares": {"wc_7": 1.0}}]}],
            r"approaches\[0\]\.lanes\[0\]\.shares",
            "'wc_7' is no lane",
        ),
    ],
)
def test_what_is_not_there_is_named(
    crossing_twin: Twin, rows: list[dict[str, Any]], place: str, says: str
) -> None:
    with pytest.raises(InputError, match=f"{place}: .*{says}"):
        approaches_of(rows, crossing_twin.roads)
