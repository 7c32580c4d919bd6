"""The measures of benchmarks/places.py, on streets and motions made for them."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import places_map
import places_motion
from urbantwin.traffic import Motion
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA

Write = Callable[..., Path]
ROAD = {"highway": "primary", "lanes": "2"}
STEP_S = 0.1


def test_a_crossing_that_is_mapped_twice_is_one(write_osm: Write) -> None:
    footway = {"highway": "footway", "footway": "crossing"}
    nodes = {
        1: (-50, 0, {}), 2: (-20, 0, {"highway": "crossing"}), 3: (50, 0, {}),
        4: (-20, -8, {}), 5: (-20, 8, {}),  # over node 2
        6: (20, -8, {}), 7: (20, 8, {}),  # shares no node with the street
        8: (40, -8, {}), 9: (40, 8, {}),  # on a bridge
        10: (30, 0, {"highway": "crossing", "crossing": "no"}),
    }  # fmt: skip
    ways = {
        1: ([1, 2, 10, 3], ROAD), 2: ([4, 2, 5], footway), 3: ([6, 7], footway),
        4: ([8, 9], {**footway, "layer": "1"}),
    }  # fmt: skip
    found = places_map.MappedStreets(write_osm(nodes, ways), 48.7, 9.18).crossings()
    assert sorted(round(one.x) for one in found) == [-20, 20]


def test_signals_are_for_the_traffic_that_reaches_them(write_osm: Write) -> None:
    forward = {"highway": "traffic_signals", "traffic_signals:direction": "forward"}
    nodes = {
        1: (-50, 0, {}), 2: (-10, 0, forward), 3: (0, 0, {"highway": "traffic_signals"}),
        4: (50, 0, {}), 5: (0, 50, {}),
    }  # fmt: skip
    ways = {1: ([1, 2, 3, 4], ROAD), 2: ([5, 3], {**ROAD, "oneway": "yes"})}
    before, junction = places_map.MappedStreets(write_osm(nodes, ways), 48.7, 9.18).signals()
    assert np.allclose(before.headings, [0.0], atol=1e-3)
    assert not before.is_junction
    assert junction.is_junction
    headings = np.sort(np.round(np.degrees(junction.headings)) % 360)
    assert headings.tolist() == [0, 180, 270]


def test_arrows_are_those_of_the_last_way_and_know_what_leads_there(write_osm: Write) -> None:
    one_way = {**ROAD, "oneway": "yes"}
    turns = {**one_way, "turn:lanes": "left|through;right"}
    nodes = {k: (x, y, {}) for k, x, y in [(1, -90, 0), (2, -60, 1), (3, -30, 0), (4, 0, 0),
                                           (5, 40, 0), (6, 0, 40)]}  # fmt: skip
    ways = {1: ([1, 2], one_way), 2: ([2, 3], turns), 3: ([3, 4], turns), 4: ([4, 5], ROAD),
            5: ([4, 6], ROAD)}  # fmt: skip
    (found,) = places_map.MappedStreets(write_osm(nodes, ways), 48.7, 9.18).arrows()
    assert found.lanes == ({"left"}, {"through", "right"})
    assert np.allclose(found.line[-1], [0, 0], atol=0.5)
    assert found.tagged_before
    assert np.allclose(found.before[0], [-90, 0], atol=0.5)


def driven(rows: list[dict[str, Any]]) -> Motion:
    """A motion of cars, 4 x 2 m."""
    still = {"class": "car", "asset": "car", "phase": 0, "z": 0.0, "pitch": 0.0, "roll": 0.0,
             "length": 4.0, "width": 2.0, "height": 1.5, "lane": "a_0"}  # fmt: skip
    steps = 1 + max(round(row["time_s"] / STEP_S) for row in rows)
    manifest = {"step_s": STEP_S, "steps": steps, "classes": {}, "teleports": 0, "collisions": 0}
    table = pa.Table.from_pylist(
        sorted(({**still, **row} for row in rows), key=lambda x: (x["time_s"], x["track"])),
        ACTOR_SCHEMA,
    )
    return Motion(manifest, table, SIGNAL_SCHEMA.empty_table())


def on_a_circle(track: int, radius: float, speed: float) -> list[dict[str, Any]]:
    rate = speed / radius
    return [
        {"time_s": round(k * STEP_S, 9), "track": track, "x": radius * np.sin(rate * k * STEP_S),
         "y": -radius * np.cos(rate * k * STEP_S),
         "yaw": float((rate * k * STEP_S + np.pi) % (2 * np.pi) - np.pi), "speed": speed}
        for k in range(60)
    ]  # fmt: skip


def test_lateral_acceleration_of_a_circle_and_braking_of_a_stop() -> None:
    twin = SimpleNamespace(roads=SimpleNamespace(signals=(), lane_by_id={}))
    stop = [
        {"time_s": round(k * STEP_S, 9), "track": 3, "x": 900.0, "y": 0.0, "yaw": 0.0,
         "speed": max(12.0 - 3.0 * k * STEP_S, 0.0)}
        for k in range(60)
    ]  # fmt: skip
    motion = driven([*on_a_circle(1, 50.0, 10.0), *on_a_circle(2, 20.0, 10.0), *stop])
    found = places_motion.driving(twin, motion)
    over, vehicles, most = found["lateral"]  # v^2 / r: 2 and 5 m/s2
    assert (over, vehicles) == (1, 3)
    assert most == pytest.approx(10.0**2 / 20.0, abs=0.05)
    assert found["braking"] == pytest.approx(3.0, abs=0.05)
    assert found["moved"] == [2, 3]


def test_overlaps_count_pairs_once_and_by_their_boxes() -> None:
    def parked(track: int, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> list[dict]:
        return [
            {"time_s": round(k * STEP_S, 9), "track": track, "x": x, "y": y, "z": z, "yaw": yaw,
             "speed": 0.0}
            for k in range(12)
        ]  # fmt: skip

    apart = [*parked(1, 0, 0), *parked(2, 0, 2.01), *parked(3, 0, 0, z=6.0)]  # one on a bridge
    assert places_motion.overlaps(driven(apart)) == {}
    across = [*apart, *parked(4, 2.5, -1.5, np.pi / 2)]  # its side is in the bonnet of the first
    assert places_motion.overlaps(driven(across)) == {(1, 4): ("car", "car")}
