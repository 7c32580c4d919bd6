"""Exported maps before two independent judges: ASAM's official checker, and CARLA's own map.

`make judges` installs them beside the development environment; without them these tests skip.
"""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.site import read_extract

from ..thorough import further

ROOT = Path(__file__).parents[2]
PLACES = ("two-avenues", "perth_stretched_lights")
MORE_PLACES = ("quad_intersection", "taipei", "neukolln", "munich", "West-Oakland")
#: ASAM's checker takes some seconds a file: a right-hand map and an old-style one are below.
CHECKED = ("perth_stretched_lights=1.8",)
#: The towns that it checks: side and version.
TOWNS = (("right", "1.8"), ("left", "1.4"))


def slope():
    """Ground that climbs 4 % to the north-east."""
    y, x = np.mgrid[-250:251, -250:251].astype(float)
    return Elevation(-250.0, -250.0, 1.0, 0.04 * (x + y) / math.sqrt(2.0))


@pytest.fixture(scope="session")
def judged(real_roads, tmp_path_factory, judge):
    """Return ``judged(map=version)``: roads that were built, frame, {judge: answer}."""
    folder = tmp_path_factory.mktemp("judged")

    def two_avenues():
        frame = SiteFrame(48.7, 9.18)
        built = build_roads(
            read_extract(ROOT / "examples/two-avenues/two-avenues.osm"),
            frame,
            shapely.Point(0, 0).buffer(80),
            slope(),
            driving_side="right",
            out=folder / "two-avenues.net.xml",
        )
        return built, frame

    def place_of(name):
        place = real_roads(name)
        return place.built, place.frame

    @cache
    def answers_of(names):
        places = {
            name: two_avenues() if name == "two-avenues" else place_of(name) for name in names
        }
        return _answers(places, folder, judge)

    return lambda key: answers_of(PLACES if key.split("=")[0] in PLACES else MORE_PLACES)[key]


def _answers(places, folder, judge):
    maps, tasks = {}, {}
    for name, (built, frame) in places.items():
        for version in ("1.8", "1.4"):
            key, file = f"{name}={version}", folder / f"{name}-{version}.xodr"
            write_opendrive(built.model, frame, file, version=version, name=name)
            maps[key] = (built, frame)
            if key in CHECKED:
                tasks[key, "check"] = f"check={file}"
            if version == "1.4":
                tasks[key, "carla"] = f"carla={file}"
    answers = judge("asam_and_carla", *tasks.values())
    result = {key: (*value, {}) for key, value in maps.items()}
    for (key, kind), task in tasks.items():
        result[key][2][kind] = answers[task]
    return result


@pytest.mark.parametrize("key", CHECKED)
def test_asams_checker_reports_no_issue(judged, key):
    answer = judged(key)[2]["check"]
    assert answer["issues"] == []
    # Rules of other versions are skipped, none may break down.
    assert set(answer["status"].values()) <= {"completed", "skipped"}
    completed = list(answer["status"].values()).count("completed")
    assert completed >= 20


@pytest.fixture(params=[*PLACES, *further(*MORE_PLACES)])
def in_carla(request, judged):
    built, frame, answers = judged(f"{request.param}=1.4")
    return built, frame, answers["carla"]


def test_carla_finds_no_dead_end_but_where_the_map_ends(in_carla):
    built, _, answer = in_carla
    network = built.network
    ways = [road for road in built.model.roads if road.junction >= 0]
    assert len(answer["waypoints"]) > 200
    assert len(answer["topology"]) >= len(ways) / 2
    ends = {junction.id for junction in network.junctions if junction.kind == "dead_end"}
    border = [
        network.lane_by_id[name].centre[-1]
        for road in network.roads
        if road.to_junction in ends
        for name in road.lanes
    ]
    for road, lane, _, x, y, _, _ in answer["dead_ends"]:
        assert min(math.hypot(x - end[0], y - end[1]) for end in border) < 2.5, (road, lane)


def middles(model):
    """Lines along the middles of lanes, in the direction of their traffic."""
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            s = np.linspace(section.s, end, max(2, int((end - section.s) * 4)))
            for lane in section.lanes:
                if lane.kind in ("driving", "bus"):
                    line = road.place(s, road.middle(section, lane, s))[:, :2]
                    yield shapely.LineString(line if lane.forward else line[::-1])


def test_carla_puts_waypoints_in_the_middle_of_our_lanes(in_carla):
    """To 3 cm across, headings along the lane."""
    built, _, answer = in_carla
    lines = list(middles(built.model))
    tree = shapely.STRtree(lines)
    checked = 0
    for road, lane, _, x, y, _, yaw in answer["waypoints"]:
        point = shapely.Point(x, y)
        near = [lines[k] for k in tree.query(point, predicate="dwithin", distance=0.03)]
        fits = False
        for line in near:
            ahead = line.interpolate(min(line.project(point) + 0.5, line.length))
            back = line.interpolate(max(line.project(point) - 0.5, 0.0))
            heading = math.atan2(ahead.y - back.y, ahead.x - back.x)
            turn = (heading + math.radians(yaw) + math.pi) % (2 * math.pi) - math.pi
            fits |= abs(turn) < 0.2
        assert fits, (road, lane, x, y)
        checked += 1
    assert checked > 100


def test_carla_knows_where_people_cross(in_carla):
    built, _, answer = in_carla
    corners = np.array(answer["crosswalks"])
    crossings = [lane for lane in built.network.lanes if lane.kind == "crossing"]
    outlines, start = [], 0
    for k in range(1, len(corners)):  # outlines stand one after the other, each closed
        if k > start and np.allclose(corners[k], corners[start], atol=1e-4):
            outlines.append(shapely.Polygon(corners[start:k, :2]))
            start = k + 1
    assert len(outlines) == len(crossings)
    for lane in crossings:
        best = max(o.intersection(lane.polygon).area / o.union(lane.polygon).area for o in outlines)
        assert best > 0.95, lane.id


def test_carla_lists_every_signal_and_the_anchor(in_carla):
    built, frame, answer = in_carla
    marks = {int(mark[0]): mark for mark in answer["landmarks"]}
    # Heads for people on foot are for no lane: CARLA sets them up, but stops nobody at them.
    lights = {signal.id for signal in built.model.signals if signal.type == "1000002"}
    assert set(marks) == {signal.id for signal in built.model.signals} - lights
    latitude, longitude = answer["origin"]
    metre = 111_194.9
    assert abs(latitude - frame.latitude) * metre < 0.1
    assert abs(longitude - frame.longitude) * metre * math.cos(math.radians(latitude)) < 0.1


def test_carlas_heights_are_ours_where_a_road_is_one_lane(judged):
    """CARLA reads no superelevation: only on reference lines does it know the height.

    The reference line of a connecting road runs in the middle of its lane.
    """
    built, _, answers = judged("two-avenues=1.4")
    ways = {road.id for road in built.model.roads if road.junction >= 0}
    checked = 0
    for road, _, _, x, y, z, _ in answers["carla"]["waypoints"]:
        if road in ways:
            assert abs(z - 0.04 * (x + y) / math.sqrt(2.0)) < 0.02
            checked += 1
    assert checked > 50
    assert np.ptp([lane.centre[:, 2].mean() for lane in built.network.lanes]) > 2.0


@pytest.fixture(scope="session")
def town_judged(town, tmp_path_factory, judge):
    """Return {side=version: {judge: answer}} for the town that was made by hand."""
    folder = tmp_path_factory.mktemp("town")
    tasks = {}
    for side in ("right", "left"):
        for version in ("1.8", "1.4"):
            file = folder / f"{side}-{version}.xodr"
            write_opendrive(town(side), SiteFrame(48.7, 9.18), file, version=version, name="town")
            if (side, version) in TOWNS:
                tasks[side, version, "check"] = f"check={file}"
            if version == "1.4":
                tasks[side, version, "carla"] = f"carla={file}"
    answers = judge("asam_and_carla", *tasks.values())
    return {key: answers[task] for key, task in tasks.items()}


@pytest.mark.parametrize(("side", "version"), TOWNS)
def test_asams_checker_reports_no_issue_of_a_town_made_by_hand(town_judged, side, version):
    answer = town_judged[side, version, "check"]
    assert answer["issues"] == []
    completed = list(answer["status"].values()).count("completed")
    assert completed >= (20 if version == "1.8" else 9)


@pytest.mark.parametrize("side", ["right", "left"])
def test_carla_drives_through_a_town_made_by_hand(town, town_judged, side):
    model, answer = town(side), town_judged[side, "1.4", "carla"]
    lines = shapely.MultiLineString(list(middles(model)))
    assert len(answer["waypoints"]) > 100
    for *_, x, y, _, _ in answer["waypoints"]:
        assert lines.distance(shapely.Point(x, y)) < 0.03
    # Lanes end where the streets end, and a median leads nowhere.
    for _, _, _, x, y, _, _ in answer["dead_ends"]:
        assert math.hypot(x + 1, y + 4) > 45 or abs(x + 12) < 3, (x, y)
    corners = np.array(answer["crosswalks"])[:, :2]
    for area in model.areas:
        if area.kind == "crosswalk":
            road = model.road_by_id[area.road]
            x, y, heading = road.curve.at(area.s)[0]
            c, sn = math.cos(heading), math.sin(heading)
            for u, v, _ in area.corners:
                place = (x + u * c - v * sn, y + u * sn + v * c)
                assert np.hypot(*(corners - place).T).min() < 0.01
    assert {int(mark[0]) for mark in answer["landmarks"]} == {s.id for s in model.signals}
