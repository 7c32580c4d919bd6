"""Trams in a street that they share with cars, over a crossing with signals."""

import shutil
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from urbantwin.artefact import sha256_of, write_json
from urbantwin.roads import BusStop, Track
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.rails import add_rails
from urbantwin.traffic import run_traffic
from urbantwin.traffic.assets import asset, asset_names
from urbantwin.traffic.demand.demand import plan_demand
from urbantwin.traffic.sumo.route_file import TRAM_DWELL_S
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.twin import load_twin

#: Over the inner lanes of the street from west to east; the stop is before the crossing.
OFFSET_M, STOP_M = 1.6, (60.0, 90.0)
ASKED = {"car": 700.0, "truck": 60.0, "tram": 180.0, "pedestrian": 600.0, "bicycle": 100.0}


def straight(name: str, y: float, sign: int) -> Track:
    line = np.array([[-sign * 149.0, y, 0.0], [sign * 149.0, y, 0.0]])
    return Track(name, line, 13.9, 0, (), False)


@pytest.fixture(scope="module")
def tram_twin(crossing_twin, tmp_path_factory):
    """The crossing with a track in each direction, and a stop on one."""
    folder = tmp_path_factory.mktemp("trams") / "twin"
    shutil.copytree(crossing_twin.folder, folder)
    tracks = (straight("tram-1", -OFFSET_M, 1), straight("tram-2", OFFSET_M, -1))
    stop = BusStop("tram-1_0", "Crossing", *STOP_M)
    add_rails(folder / "network.net.xml", tracks)
    replace(crossing_twin.roads, tracks=tracks, tram_stops=(stop,)).save(folder / "roads.json")
    names = crossing_twin.manifest["files"]
    files = {name: sha256_of(folder / name) for name in names}
    write_json(folder / "twin.json", {**crossing_twin.manifest, "files": files})
    return load_twin(folder)


@pytest.fixture(scope="module")
def motion(tram_twin, tmp_path_factory):
    out = tmp_path_factory.mktemp("motions") / "motion"
    changes = {"per_hour": ASKED, "warmup_s": 30.0}
    return run_traffic(tram_twin, out, seconds=30.0, seed=3, changes=changes)


def outlines(rows) -> np.ndarray:
    c, s = np.cos(rows.yaw), np.sin(rows.yaw)
    ahead, left = rows.length / 2, rows.width / 2
    corners = [
        (rows.x + a * ahead * c - b * left * s, rows.y + a * ahead * s + b * left * c)
        for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    return shapely.polygons(np.stack([np.stack(one, axis=-1) for one in corners], axis=1))


@pytest.mark.thorough
def test_trams_come_as_often_as_asked_and_stay_on_their_rails(motion, records):
    rows = records(motion.actors)
    trams = rows[rows["class"] == "tram"]
    seen = motion.manifest["classes"]["tram"]
    assert seen["seen"] >= 2
    # Of the last one perhaps not all bodies have come.
    bodies = len(np.unique(trams.track)) / len(asset(asset_names("tram")[0]).bodies)
    assert seen["seen"] - 1 < bodies <= seen["seen"]
    np.testing.assert_allclose(np.abs(trams.y), OFFSET_M, atol=0.01)
    assert (np.sign(np.cos(trams.yaw)) == -np.sign(trams.y)).all()
    assert trams.speed.max() > 8.0


def test_nothing_that_drives_or_walks_is_in_a_tram(motion, records):
    rows = records(motion.actors)
    for time_s in np.unique(rows.time_s)[::3]:
        now = rows[rows.time_s == time_s]
        area = outlines(now)
        trams = np.flatnonzero(now["class"] == "tram")
        a, b = shapely.STRtree(area).query(area[trams], predicate="intersects")
        for k, other in zip(trams[a], b, strict=True):
            if k != other:
                assert shapely.intersection(area[k], area[other]).area < 0.01, (
                    time_s, now[k], now[other],
                )  # fmt: skip


def test_bodies_of_a_tram_touch_neither_each_other_nor_fall_apart(motion, records):
    rows = records(motion.actors)
    trams = rows[rows["class"] == "tram"]
    by_time = defaultdict(list)
    for row in trams:
        by_time[row.time_s, row.y > 0].append(row)
    for bodies in by_time.values():
        bodies.sort(key=lambda row: row.x)
        for one, other in pairwise(bodies):
            assert other.x - one.x - (one.length + other.length) / 2 > 0.3


def test_trams_halt_at_stops_and_at_red(tram_twin):
    demand = plan_demand(
        StreetNetwork(tram_twin.net_path, tram_twin.region),
        {"tram": 120.0},
        warmup_s=0.0,
        duration_s=240.0,
        seed=5,
        body=lambda name, number: asset_names(name)[0],
    )
    demand = replace(
        demand,
        stops=tram_twin.roads.tram_stops,
        trips=tuple(
            replace(trip, halts=(0,)) if trip.edges[0] == "tram-1" else trip
            for trip in demand.trips
        ),
    )
    assert {trip.edges for trip in demand.trips} == {("tram-1",), ("tram-2",)}
    seen = simulate(
        tram_twin.net_path, demand, asset,
        warmup_s=0.0, steps=2400, step_s=0.1, seed=5, roads=tram_twin.roads,
    )  # fmt: skip
    # The state of the links that lead straight on from west and from east.
    network = StreetNetwork(tram_twin.net_path, None)
    link = {
        sign: item.getTLLinkIndex()
        for edge in network.streets
        for following, items in edge.getOutgoing().items()
        for item in items
        for sign, start, end in ((1, "wc", "ce"), (-1, "ec", "cw"))
        if (edge.getID(), following.getID()) == (start, end) and item.getFromLane().allows("bus")
    }
    changes = [(step, state) for step, _, state in seen.signals]
    passed = waited = 0
    for number, trip in enumerate(demand.trips):
        sign = 1 if trip.edges[0] == "tram-1" else -1
        rows = np.flatnonzero(seen.trip == number)
        x = sign * seen.front[rows, 0]
        middle = np.flatnonzero((x[:-1] < -8.0) & (x[1:] >= -8.0))
        for k in middle:
            state = [s for step, s in changes if step <= seen.step[rows[k]]][-1]
            assert state[link[sign]] in "Ggy"
            passed += 1
        still = rows[(seen.speed[rows] < 0.01)]
        at_stop = still[np.abs(sign * seen.front[still, 0] + 149.0 - STOP_M[1]) < 1.0]
        if sign == 1 and len(middle):
            assert len(at_stop) * 0.1 == pytest.approx(TRAM_DWELL_S, abs=1.5)
        waited += len(still) > len(at_stop) + 10
    assert passed >= 4
    assert waited >= 1


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_trams(tram_twin, tmp_path):
    changes = {"per_hour": ASKED, "warmup_s": 20.0}
    made = []
    for name in ("one", "again"):
        motion = run_traffic(tram_twin, tmp_path / name, seconds=10.0, seed=3, changes=changes)
        made.append(motion.manifest)
    assert made[0]["classes"]["tram"]["seen"]
    assert made[0]["made"] == made[1]["made"]
