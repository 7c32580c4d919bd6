"""Roads that begin shortly before a stop line, made longer for who comes in."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.sumo.run_ups import net_with_run_ups, without_run_ups
from urbantwin.traffic.sumo.simulation import Simulated
from urbantwin.twin import Twin

LANE = '<lane id="{0}_0" index="0" speed="13.9" length="{1}" shape="{2}"/>'


@pytest.fixture
def net(tmp_path: Path) -> Path:
    edges = {
        "short": (5.0, "10.0,0.0 13.0,4.0"),
        "long": (80.0, "0.0,0.0 80.0,0.0"),
        "walked": (20.0, "0.0,50.0 20.0,50.0"),
        "out": (20.0, "50.0,50.0 70.0,50.0"),
    }
    rows = "".join(f'<edge id="{x}">{LANE.format(x, *y)}</edge>' for x, y in edges.items())
    (tmp_path / "a.net.xml").write_text(f"<net>{rows}</net>")
    return tmp_path / "a.net.xml"


def demand_of(*trips: tuple[str, tuple[str, ...]]) -> Demand:
    return Demand(tuple(Trip(name, name, 0.0, edges) for name, edges in trips), ())


def test_a_short_first_road_goes_on_straight_behind_its_beginning(
    net: Path, tmp_path: Path
) -> None:
    demand = demand_of(
        ("car", ("short", "out")),
        ("car", ("long", "out")),
        ("car", ("walked", "out")),
        ("pedestrian", ("walked",)),
    )
    made = net_with_run_ups(net, demand, tmp_path / "b.net.xml")
    lanes = {x.get("id"): x for x in etree.parse(made).iter("lane")}
    before = {x.get("id"): x for x in etree.parse(net).iter("lane")}
    for name in ("long_0", "walked_0", "out_0"):
        assert dict(lanes[name].attrib) == dict(before[name].attrib)
    line = np.array([x.split(",") for x in lanes["short_0"].get("shape", "").split()], float)
    assert line[-2:].tolist() == [[10.0, 0.0], [13.0, 4.0]]
    steps = np.diff(line, axis=0)
    assert float(lanes["short_0"].get("length")) == pytest.approx(np.hypot(*steps.T).sum())
    assert np.hypot(*steps.T).sum() > 100
    (a, b), (c, d) = steps
    assert a * d - b * c == pytest.approx(0, abs=0.1)


def test_nothing_is_written_where_no_road_is_short(net: Path, tmp_path: Path) -> None:
    demand = demand_of(("car", ("long", "out")), ("pedestrian", ("short",)))
    assert net_with_run_ups(net, demand, tmp_path / "b.net.xml") == net
    assert not (tmp_path / "b.net.xml").exists()


def test_nobody_is_there_before_the_map_begins(
    crossing_twin: Twin, net: Path, tmp_path: Path
) -> None:
    long = crossing_twin.roads.lane_by_id["wc_1"]
    line = np.array([[10.0, 0.0, 0.0], [13.0, 4.0, 0.0]])
    short = replace(long, id="short_0", centre=line, widths=np.zeros(0))
    roads = replace(crossing_twin.roads, lanes=(*crossing_twin.roads.lanes, short))
    made = net_with_run_ups(net, demand_of(("car", ("short", "out"))), tmp_path / "b.net.xml")
    away = np.array([-100.0, -1.0, 2.0, 4.5, 5.0])  # metres from where the map begins
    rows = {
        "step": np.arange(5),
        "trip": np.zeros(5, int),
        "front": line[0, :2] + away[:, None] * [0.6, 0.8],
        "angle_deg": np.zeros(5),
        "speed": np.arange(5.0),
        "lane": np.zeros(5, int),
    }
    rest = {one.name: () for one in fields(Simulated) if one.name not in rows}
    simulated = Simulated(**{**rest, **rows, "lanes": ("short_0",)})  # type: ignore[arg-type]
    assert without_run_ups(simulated, made, roads).step.tolist() == [3, 4]
    assert without_run_ups(simulated, net, roads).step.tolist() == [0, 1, 2, 3, 4]
