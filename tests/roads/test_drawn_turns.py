"""Turns that a sketch draws through a junction are what traffic drives, in every format."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame, smoothed, tightest_bend
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.site.sketch import read_sketch

from ..thorough import further
from .conftest import Road

FRAME = SiteFrame(52.5, 13.4)
#: Two lanes from west to east that pass south of a post, drawn along their middle.
PAST_THE_POST = [(-15, -3), (-9, -3.6), (-4, -5.4), (0, -6.2), (4, -5.4), (9, -3.6), (15, -3)]
#: One lane from the west's left lane to the north, drawn from lane to lane.
TO_THE_NORTH = [(-15, -1.4), (-8, -1.2), (-2, 1.2), (1.5, 6), (2.8, 10), (3, 15)]
TURNS = {"east": (PAST_THE_POST, 2), "north": (TO_THE_NORTH, 1)}
STREETS = [
    ("west in", [(-90, -3), (-15, -3)], {"lanes": 2, "turns": "left;through|through"}),
    ("east out", [(15, -3), (90, -3)], {"lanes": 2}),
    ("north out", [(3, 15), (3, 90)], {}),
    ("south in", [(0, -90), (0, -18)], {}),
]
LINE = [(0, -18), (0, -10), (1, 0), (3, 15)]


def feature(kind, points, **properties):
    geometry = {"type": "LineString", "coordinates": points}
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def features(*, crossing=False):
    drawn = [feature("street", points, name=name, **more) for name, points, more in STREETS]
    drawn += [feature("turn", points, lanes=lanes) for points, lanes in TURNS.values()]
    drawn.append(feature("turn", LINE))
    if crossing:
        drawn.append(feature("crossing", [(-18, -9), (-18, 3)], signals="yes"))
        drawn.append(feature("crossing", [(18, -9), (18, 3)], signals="yes"))
    return drawn


def mirrored(drawn):
    """Return a sketch for traffic on the left: what lies north lies south, lanes the other way."""
    for one in drawn:
        points = one["geometry"]["coordinates"]
        one["geometry"]["coordinates"] = [(x, -y) for x, y in points]
        if turns := one["properties"].get("turns"):
            words = turns.replace("left", "right").split("|")[::-1]
            one["properties"]["turns"] = "|".join(words)
    return drawn


def written(folder, drawn):
    path = folder / "sketch.geojson"
    value = {"type": "FeatureCollection", "crs": "site", "features": drawn}
    path.write_text(json.dumps(value))
    return path


def built(folder, drawn, side="right", elevation=None):
    return build_roads(
        read_sketch(written(folder, drawn), FRAME),
        FRAME,
        shapely.Point(0, 0).buffer(60),
        elevation or Elevation.flat(),
        driving_side=side,
        out=folder / "n.net.xml",
    )


def across(line, x):
    """Return the y of a polyline (N, 2) where it passes x."""
    order = np.argsort(line[:, 0])
    return float(np.interp(x, line[order, 0], line[order, 1]))


def ways_of_opendrive(path):
    """Return the middles (N, 2) of connecting roads' lanes by a reader of its own."""
    found = []
    for element in ElementTree.parse(path).getroot().iter("road"):
        road = Road(element)
        if road.junction == "-1":
            continue
        stations = np.linspace(0.0, road.length, 80)
        found.append(np.array([road.reference(s)[:2] for s in stations]))
    return found


def ways_of_sumo(path):
    return [
        np.array([point.split(",")[:2] for point in lane.get("shape").split()], float)
        for edge in ElementTree.parse(path).getroot().iter("edge")
        if edge.get("function") == "internal"
        for lane in edge.iter("lane")
    ]


def ends_near(line, first, last):
    return min(np.linalg.norm(line[0] - first), np.linalg.norm(line[-1] - last)) < 9.0


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("crossing", [False, True])
def test_ways_run_beside_the_line_in_every_format(tmp_path, side, crossing):
    drawn, sign = features(crossing=crossing), 1.0
    if side == "left":
        drawn, sign = mirrored(drawn), -1.0
    roads = built(tmp_path, drawn, side)
    write_opendrive(roads.model, FRAME, tmp_path / "n.xodr", name="n")
    for ways in (ways_of_opendrive(tmp_path / "n.xodr"), ways_of_sumo(tmp_path / "n.net.xml")):
        flat = [line * [1.0, sign] for line in ways]
        # South of the post, beside it: one lane on each side of the line, 3.25 m apart.
        passing = [line for line in flat if line[:, 0].min() < -6 and line[:, 0].max() > 6]
        south = sorted(across(line, 0.0) for line in passing if across(line, 0.0) < -2.0)
        np.testing.assert_allclose(south, [-6.2 - 1.625, -6.2 + 1.625], atol=0.6)
        # To the north, on the line itself.
        north = [
            line
            for line in flat
            if line[:, 1].max() > 9 and line[:, 0].min() < -4 and line[:, 1].min() > -4
        ]
        assert north
        for line in north:
            inner = line[(line[:, 0] > -12) & (line[:, 1] < 12)]
            off = shapely.distance(shapely.LineString(TO_THE_NORTH), shapely.points(inner))
            assert off.max() < 0.75


@pytest.mark.parametrize("version", ["1.4", *further("1.8")])
def test_asams_checker_reports_no_issue(tmp_path, judge, version):
    roads = built(tmp_path, features(crossing=True))
    write_opendrive(roads.model, FRAME, tmp_path / "n.xodr", version=version, name="n")
    answer = judge("asam_and_carla", f"check={tmp_path / 'n.xodr'}")
    (found,) = answer.values()
    assert found["issues"] == []
    assert list(found["status"].values()).count("completed") >= (20 if version == "1.8" else 9)


def test_ways_are_as_smooth_as_cars_drive_them(tmp_path):
    roads = built(tmp_path, features(crossing=True))
    for lane in roads.network.lanes:
        if lane.kind == "connection" and lane.length > 8.0:
            radius, _ = tightest_bend(smoothed(lane.centre[:, :2], 0.05, step_m=0.5))
            assert radius > 5.0, lane.id


def test_the_junction_and_its_height_follow(tmp_path):
    """Who drives past the post is on the junction, and on the ground of a slope."""
    y, x = np.mgrid[-120:121, -120:121].astype(float)
    roads = built(tmp_path, features(), elevation=Elevation(-120.0, -120.0, 1.0, 0.05 * x))
    (junction,) = (j for j in roads.network.junctions if j.id.startswith("cluster"))
    area = shapely.Polygon(junction.polygon)
    for x, y in PAST_THE_POST[1:-1]:
        assert area.contains(shapely.Point(x, y))
    for lane in roads.network.lanes:
        if lane.kind == "connection":
            np.testing.assert_allclose(lane.centre[:, 2], 0.05 * lane.centre[:, 0], atol=0.3)


def test_a_turn_of_its_two_ends_is_as_gentle_as_it_can_be(tmp_path):
    drawn = features()
    for one in drawn:
        if one["properties"]["kind"] == "turn":
            points = one["geometry"]["coordinates"]
            one["geometry"]["coordinates"] = [points[0], points[-1]]
    roads = built(tmp_path, drawn)
    ways = [lane.centre for lane in roads.network.lanes if lane.kind == "connection"]
    straight = [line for line in ways if line[0, 0] < -10 and line[-1, 0] > 10]
    assert len(straight) == 2
    for line in straight:
        assert np.ptp(line[:, 1]) < 0.3
