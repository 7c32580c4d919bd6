"""Where heads stand, at a crossing of which every measure is known."""

import math

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.signals import heads_of
from urbantwin.roads.signals.pole_sites import FreeGround
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
CROSSED = {"highway": "crossing", "crossing": "traffic_signals"}
MAIN = {"highway": "primary", "name": "Long Avenue", "lanes": "4", "maxspeed": "50",
        "sidewalk": "both"}  # fmt: skip
SIDE = {"highway": "secondary", "name": "Cross Street", "lanes": "2", "maxspeed": "50",
        "sidewalk": "both"}  # fmt: skip


@pytest.fixture
def crossing(write_osm, tmp_path, monkeypatch):
    """Return a function: country, side of driving -> roads and the heads of their signals.

    A street of two lanes each way runs east, one of one lane each way north. What is told of the
    country is all that changes.
    """
    nodes = {1: (-150, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (150, 0, {})}
    nodes |= {4: (0, -150, {}), 5: (0, 150, {})}
    nodes |= {6: (-13, 0, CROSSED), 7: (13, 0, CROSSED), 8: (0, -14, CROSSED), 9: (0, 14, CROSSED)}

    def build(country, side, ways=None):
        monkeypatch.setattr("urbantwin.roads.build.country_of", lambda *_: country)
        path = write_osm(nodes, ways or {10: ([1, 6, 2, 7, 3], MAIN), 11: ([4, 8, 2, 9, 5], SIDE)})
        built = build_roads(
            read_extract(path),
            HERE,
            shapely.box(-140, -140, 140, 140),
            Elevation.flat(),
            driving_side=side,
            out=tmp_path / "n.net.xml",
        )
        return built, [head for head in heads_of(built.model) if head.signal.dynamic]

    return build


def towards(heads, heading):
    """Heads for vehicles that are seen by traffic of a heading."""
    return [h for h in heads if h.signal.lanes and math.cos(h.heading - heading) < -0.99]


def stop_line(built, heads):
    """x of the stop line, for traffic that comes from the west."""
    signal = towards(heads, 0.0)[0].signal
    return float(built.model.road_by_id[signal.road].place(signal.s, 0.0)[0, 0])


def test_german_heads_stand_at_the_stop_line_and_hang_over_two_lanes(crossing):
    built, heads = crossing("DE", "right")
    line = stop_line(built, heads)
    east = towards(heads, 0.0)
    beside = [h for h in east if h.z < 4]
    over = [h for h in east if h.z > 4]
    assert beside
    assert len(over) == 2
    for head in east:
        assert line - 8.0 < head.x < line + 0.5
    kerb = min(h.y for h in over)
    for head in beside:
        assert kerb - 9.0 < head.y < kerb - 1.5 - 0.6 + 0.3
    lanes = {built.network.lane_by_id[h.signal.strip].centre[-1, 1] for h in over}
    assert sorted(h.y for h in over) == pytest.approx(sorted(lanes), abs=0.05)
    # One lane from the south: a pole, no arm.
    assert all(h.z < 4 for h in towards(heads, math.pi / 2))


def test_american_heads_stand_beyond_the_junction(crossing):
    built, heads = crossing("US", "right")
    line = stop_line(built, heads)
    east = towards(heads, 0.0)
    assert east
    for head in east:
        assert line + 12.0 <= head.x <= line + 55.0
        assert head.x > 5.0
    assert sum(h.z - h.signal.height / 2 >= 4.6 for h in east) == 2
    # Over the lanes drawn on across the junction.
    over = sorted(h.y for h in east if h.z > 4)
    lanes = sorted(built.network.lane_by_id[h.signal.strip].centre[-1, 1] for h in east if h.z > 4)
    assert over == pytest.approx(lanes, abs=0.1)


def test_british_heads_stand_on_the_left_before_and_beyond(crossing):
    built, heads = crossing("GB", "left")
    line = stop_line(built, heads)
    east = towards(heads, 0.0)
    assert all(head.y > 3.0 and head.z < 4 for head in east)
    assert any(head.x < line + 0.5 for head in east)
    assert any(head.x > line + 12.0 for head in east)


@pytest.mark.parametrize(
    ("country", "side"),
    [("DE", "right"), ("AU", "left"), *further(("US", "right"), ("TW", "right"))],
)
def test_every_lane_has_a_head_and_no_pole_stands_where_somebody_drives(country, side, crossing):
    built, heads = crossing(country, side)
    network = built.network
    carriageway = network.carriageway(0)
    for head in heads:
        spot = shapely.Point(head.x, head.y)
        away = float(carriageway.distance(spot))
        if head.z < 4:
            assert away > 0.5, head
        else:
            assert head.z - head.signal.height / 2 > 4.6
        assert head.z - 0.15 - head.signal.height / 2 > 2.1
    seen = {name for head in heads for name in head.signal.strip.split()}
    assert seen == {signal.lane for signal in network.signals}
    shown = {(h.signal.program, link) for h in heads for link in h.signal.links}
    assert shown == {(s.program, link) for s in network.signals for link in s.links}
    for head in heads:
        if not head.signal.lanes:
            continue
        road = built.model.road_by_id[head.signal.road]
        end = road.length if head.signal.orientation == "+" else 0.0
        assert abs(head.signal.s - end) < 8.0
        section = road.section_at(head.signal.s)
        assert {section.by_id[k].strip for k in head.signal.lanes} == set(head.signal.strip.split())
    (controller,) = built.model.controllers
    assert set(controller.signals) == {h.signal.id for h in heads}


def test_walkers_see_their_lights_at_the_other_end(crossing):
    built, heads = crossing("DE", "right")
    crossings = [lane for lane in built.network.lanes if lane.kind == "crossing"]
    assert len(crossings) == 4
    for lane in crossings:
        mine = [h for h in heads if h.signal.strip == lane.id]
        assert len(mine) == 2
        a, b = lane.centre[0, :2], lane.centre[-1, :2]
        for head in mine:
            at = np.array([head.x, head.y])
            here, there = (a, b) if np.linalg.norm(at - a) < np.linalg.norm(at - b) else (b, a)
            assert np.linalg.norm(at - here) < lane.width / 2 + 3.0
            looks = np.array([math.cos(head.heading), math.sin(head.heading)])
            assert looks @ (there - here) > 0.99 * np.linalg.norm(there - here)


def test_where_a_street_ends_heads_stand_opposite(crossing):
    ways = {10: ([1, 6, 2, 7, 3], MAIN), 11: ([4, 8, 2], SIDE)}
    built, heads = crossing("US", "right", ways)
    north = towards(heads, math.pi / 2)
    assert north
    lane = built.network.lane_by_id[north[0].signal.strip.split()[0]]
    for head in north:
        assert head.y > 6.0
        assert abs(head.x - lane.centre[-1, 0]) < 1.0


def test_where_no_kerb_is_near_heads_hang_over_their_lanes_from_an_island(crossing, monkeypatch):
    """No ground is free to the right of the eastbound lanes or beyond: only the other side is."""
    monkeypatch.setattr("urbantwin.roads.signals.heads.SEARCH_M", 0.7)
    free = FreeGround.free

    def left_of_the_street(self, xy, level):
        return free(self, xy, level) & (xy[:, 1] > 6.0) & (xy[:, 0] < -6.0)

    monkeypatch.setattr(FreeGround, "free", left_of_the_street)
    built, heads = crossing("DE", "right")
    east = towards(heads, 0.0)
    lanes = {s.lane for s in built.network.signals if built.network.lane_by_id[s.lane].kind
             == "driving" and math.cos(s.yaw) > 0.99}  # fmt: skip
    assert {name for h in east for name in h.signal.strip.split()} == lanes
    line = stop_line(built, heads)
    assert all(h.z > 5 and line - 10.0 <= h.x <= line + 30.0 for h in east)
