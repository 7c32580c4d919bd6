"""Lanelet2 maps that tests draw: what they hold must be in the lane model, where it was drawn."""

import math
import runpy
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads.lanelet2.read import translate

HERE = Path(__file__).parent
DRAW = SimpleNamespace(**runpy.run_path(str(HERE / "lanelet_town.py")))
RULER = SimpleNamespace(**runpy.run_path(str(HERE / "lanelet_ruler.py")))
LONDON = (51.5, -0.1)
TOWNS = {
    "crossing": DRAW.crossing_town,
    "oblique": lambda: DRAW.crossing_town(skew=0.5, bend=8.0),
    "left-hand": lambda: DRAW.crossing_town(anchor=LONDON, left_hand=True, skew=0.3),
    "motorway": DRAW.motorway,
    "pocket": DRAW.street_with_pocket,
    "roundabout": DRAW.roundabout,
    "ring": DRAW.closed_ring,
    "overpass": DRAW.overpass,
    "parting": DRAW.parting,
}


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    """{name: what was drawn, what we read, the file as the ruler reads it}."""
    folder = tmp_path_factory.mktemp("towns")
    found = {}
    for name, draw in TOWNS.items():
        town = draw()
        path = town.write(folder / f"{name}.osm")
        read = translate(path, SiteFrame(*town.anchor))
        found[name] = SimpleNamespace(
            drawn=town, model=read.model, lanes=read.lanes, notes=read.notes,
            ruler=RULER.Drawn(path, town.anchor), path=path,
        )  # fmt: skip
    return found


@pytest.mark.parametrize("name", TOWNS)
def test_bounds_are_borders_within_a_centimetre(towns, name):
    town = towns[name]
    away = RULER.farthest(town.ruler, town.model, town.lanes)
    lanelets = {i for i, n in town.ruler.lanelets.items() if n[2]["subtype"] != "crosswalk"}
    assert max(away[i] for i in lanelets) < 0.01


@pytest.mark.parametrize("name", TOWNS)
def test_lanes_follow_as_the_shared_points_say(towns, name):
    town = towns[name]
    links = RULER.lanelet_links(town.model, town.lanes, town.ruler)
    wheels = {
        i for i, n in town.ruler.lanelets.items() if n[2]["subtype"] not in ("walkway", "crosswalk")
    }
    assert {pair for pair in links if set(pair) <= wheels} == town.ruler.followers()


@pytest.mark.parametrize("name", TOWNS)
def test_lanes_meet_without_a_gap_or_a_kink(towns, name):
    model = towns[name].model
    for a, b in RULER.lane_links(model):
        for left in (True, False):
            ends = []
            for key, leaving in ((a, True), (b, False)):
                points = RULER.lane_border(model, key, left=left)
                road = model.road_by_id[key[0]]
                forward = road.sections[key[1]].by_id[key[2]].forward
                ends.append(points[-1 if forward == leaving else 0])
            assert np.linalg.norm(ends[0][:2] - ends[1][:2]) < 1e-5
            assert abs(ends[0][2] - ends[1][2]) < 0.02
    for road in model.roads:
        for link, at in ((road.predecessor, 0.0), (road.successor, road.length)):
            if road.junction >= 0:
                other = model.road_by_id[link.id]
                there = other.curve.at(other.length if link.contact == "end" else 0.0)[0, 2]
                turn = road.curve.at(at)[0, 2] - there
                assert abs(math.sin(turn)) < 1e-6


def test_both_directions_lie_on_one_road_about_the_line_between(towns):
    for name in ("crossing", "oblique", "left-hand"):
        model = towns[name].model
        streets = [road for road in model.roads if road.junction < 0]
        assert len(streets) == 4
        for road in streets:
            (section,) = road.sections
            assert [lane.id for lane in section.lanes] == [1, -1]
            ahead = 1 if name == "left-hand" else -1
            assert [lane.forward for lane in section.lanes] == [ahead == 1, ahead == -1]
            assert section.centre_mark == "broken"
        assert model.driving_side == ("left" if name == "left-hand" else "right")
        (junction,) = model.junctions
        assert len(junction.connections) == 12


def test_lights_stop_lines_and_crosswalks_stand_where_they_were_drawn(towns):
    for name in ("crossing", "oblique", "left-hand"):
        town = towns[name]
        model = town.model
        assert Counter(area.name for area in model.areas) == {"StopLine": 4, "crosswalk": 1}
        drawn = [
            town.drawn.line(way)[:, :2]
            for way, (_, tags) in town.drawn.ways.items()
            if tags.get("type") == "stop_line"
        ]
        for area, line in zip([a for a in model.areas if a.name == "StopLine"], drawn, strict=True):
            painted = shapely.Polygon(RULER.placed(model, area)[:, :2])
            assert (
                shapely.LineString(line)
                .buffer(0.2, cap_style="flat")
                .symmetric_difference(painted)
                .area
                < 0.01
            )
        (walk,) = (area for area in model.areas if area.name == "crosswalk")
        (relation,) = (i for i, n in town.ruler.lanelets.items() if n[2]["subtype"] == "crosswalk")
        area = town.ruler.area(relation)
        assert (
            shapely.Polygon(RULER.placed(model, walk)[:, :2]).symmetric_difference(area).area < 0.01
        )
        (controller,) = model.controllers
        assert controller.junctions == (model.junctions[0].id,)
        assert sorted(controller.signals) == sorted(signal.id for signal in model.signals)
        assert len(model.signals) == 4
        for signal in model.signals:
            # They hang on the far side, and belong to the lanes that lead in.
            road = model.road_by_id[signal.road]
            lane = road.sections[0].by_id[signal.lanes[0]]
            end = road.length if lane.forward else 0.0
            assert signal.s == pytest.approx(end)
            assert signal.z == pytest.approx(5.45)
            assert (signal.orientation == "+") == lane.forward


def test_speed_limits_are_as_tagged_else_as_usual(towns):
    model = towns["crossing"].model
    said = Counter(round(n.speed_limit * 3.6) for r in model.roads[:4] for n in r.sections[0].lanes)
    assert said == {30: 2, 50: 6}
    limits = {
        lane.speed_limit
        for road in towns["motorway"].model.roads
        for lane in road.sections[0].lanes
    }
    assert max(limits) == pytest.approx(130 / 3.6)


def test_a_pocket_begins_with_no_width_in_a_section_of_its_own(towns):
    town = towns["pocket"]
    (road,) = town.model.roads
    first, second = road.sections
    kinds = [[(lane.id, lane.kind) for lane in section.lanes] for section in road.sections]
    assert kinds[0] == [(1, "driving"), (-1, "driving"), (-2, "bicycle"), (-3, "sidewalk")]
    assert kinds[1] == [
        (1, "driving"), (-1, "driving"), (-2, "driving"), (-3, "bicycle"), (-4, "sidewalk"),
    ]  # fmt: skip
    pocket = second.by_id[-2]
    assert pocket.predecessor is None
    assert pocket.width.at(0.0)[0] < 0.05
    assert pocket.width.at(road.length - second.s)[0] == pytest.approx(3.0, abs=0.01)
    assert first.by_id[-2].successor == -3
    # From the right one may cross a line that is solid on the left.
    assert (first.centre_mark, first.centre_change) == ("solid broken", "increase")
    assert first.by_id[-2].mark == "curb"
    assert first.by_id[-2].allowed == ("bicycle",)
    assert first.by_id[-3].allowed == ("pedestrian",)


def test_an_exit_and_a_slip_road_are_junctions_of_their_own(towns):
    town = towns["motorway"]
    assert sorted(len(j.connections) for j in town.model.junctions) == [3, 3]
    # What is left of the main road between them stays a street of two lanes.
    streets = [r for r in town.model.roads if r.junction < 0 and len(r.sections[0].lanes) == 2]
    assert len(streets) == 3


def test_a_street_that_parts_has_a_way_for_each_direction(towns):
    (junction,) = towns["parting"].model.junctions
    assert len(junction.connections) == 2


def test_heights_and_tilt_are_the_maps(towns):
    town = towns["overpass"]
    assert not town.model.junctions  # seven metres above each other
    datum = town.notes["heights_count_from_metres"]
    for identity, (left, right, _) in town.ruler.lanelets.items():
        for bound, on_left in ((left, True), (right, False)):
            points = town.ruler.line(bound)
            rows = [RULER.lane_border(town.model, k, left=on_left) for k in town.lanes[identity]]
            border = np.vstack(rows)
            gap = np.linalg.norm(border[None, :, :2] - points[:, None, :2], axis=2)
            nearest = border[np.argmin(gap, axis=1)]
            # Between the map's points the ground is as the road's profile runs.
            assert np.abs(nearest[:, 2] + datum - points[:, 2]).max() < 0.03


def test_local_coordinates_place_a_map_without_degrees(towns, tmp_path):
    town = towns["crossing"]
    path = town.drawn.write(tmp_path / "local.osm", local=True)
    read = translate(path, SiteFrame(*town.drawn.anchor))
    assert read.notes["map_without_a_place_on_earth"] == "its origin lies at the anchor"
    for a, b in zip(read.model.roads, town.model.roads, strict=True):
        assert np.abs(a.curve.at([0.0, a.length]) - b.curve.at([0.0, b.length])).max() < 1e-3


def test_lanelets_within_a_junction_may_carry_the_light(tmp_path):
    """As in Autoware's maps: ``turn_direction``, and the light on the lanelets that turn."""
    town = DRAW.crossing_town()
    for i, arm in enumerate(town.arms):
        members, tags = town.relations[arm["in"]]
        light = next(ref for _, ref, role in members if role == "regulatory_element")
        town.relations[arm["in"]] = ([m for m in members if m[1] != light], tags)
        for (first, _), turn in town.turns.items():
            if first == i:
                members, tags = town.relations[turn]
                tags = {**tags, "turn_direction": "straight"}
                town.relations[turn] = ([*members, ("relation", light, "regulatory_element")], tags)
    model = translate(town.write(tmp_path / "a.osm"), SiteFrame(*town.anchor)).model
    assert len(model.signals) == 4
    assert {s.road for s in model.signals} == {r.id for r in model.roads if r.junction < 0}
    assert all(len(s.lanes) == 1 for s in model.signals)
