"""Ways through a junction lead round posts and islands, or a line tells that they cannot."""

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.round_standing import standing_on_ground
from urbantwin.site.sketch import read_sketch
from urbantwin.taxonomy import semantic_classes

from .test_drawn_turns import FRAME, TURNS, feature, features, written

POST = shapely.Point(0.0, -4.0).buffer(0.15)


def island(*corners):
    one = feature("island", [])
    one["geometry"] = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
    return one


def built(folder, drawn, standing=()):
    return build_roads(
        read_sketch(written(folder, drawn), FRAME),
        FRAME,
        shapely.Point(0, 0).buffer(60),
        Elevation.flat(),
        driving_side="right",
        standing=standing,
        out=folder / "n.net.xml",
    )


def undrawn():
    """Return the junction with ways of which nothing but the ends is drawn."""
    drawn = features()
    for one in drawn:
        if one["properties"]["kind"] == "turn":
            points = one["geometry"]["coordinates"]
            one["geometry"]["coordinates"] = [points[0], points[-1]]
    return drawn


def ways(roads):
    return [
        shapely.LineString(lane.centre[:, :2])
        for lane in roads.network.lanes
        if lane.kind == "connection"
    ]


def eastward(roads):
    """Return the two lanes from west to east, the northern first."""
    found = [
        line
        for line in ways(roads)
        if line.coords[0][0] < -10 and line.coords[-1][0] > 10 and line.coords[-1][1] < 0
    ]
    return sorted(found, key=lambda line: -line.coords[0][1])


def test_both_lanes_lead_round_a_post_side_by_side(tmp_path):
    before = eastward(built(tmp_path, undrawn()))
    assert min(line.distance(POST) for line in before) < 0.9
    roads = built(tmp_path, undrawn(), [POST])
    after = eastward(roads)
    assert min(line.distance(POST) for line in after) > 0.99
    # They still lie a lane apart, and begin and end in their lanes.
    near = [shapely.intersection(line, shapely.LineString([(0, -20), (0, 20)])).y for line in after]
    assert near[0] - near[1] == pytest.approx(3.25, abs=0.4)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_allclose(old.coords[0], new.coords[0], atol=0.05)
        np.testing.assert_allclose(old.coords[-1], new.coords[-1], atol=0.05)
    assert roads.warnings == ()


def test_an_island_of_the_sketch_is_led_round_too(tmp_path):
    corners = [(-2, -3.6), (2, -3.6), (2, -2.4), (-2, -2.4)]
    roads = built(tmp_path, [*undrawn(), island(*corners)])
    area = shapely.Polygon(corners)
    assert min(line.distance(area) for line in eastward(roads)) > 0.9


def test_what_cannot_be_passed_is_told_in_one_line(tmp_path):
    wall = shapely.box(-0.2, -14, 0.2, 14)
    (warning,) = built(tmp_path, undrawn(), [wall]).warnings
    text = str(warning)
    assert text.startswith("ways through junctions: 3 lead through static objects, at ")
    assert "\n" not in text


def test_a_junction_of_one_node_is_led_through_so_too(tmp_path):
    drawn = [
        feature("street", [(-90, 0), (0, 0), (90, 0)], lanes=2, lanes_back=2),
        feature("street", [(0, -90), (0, 0), (0, 90)], lanes=2, lanes_back=2),
    ]
    post = shapely.Point(0.5, -5.6).buffer(0.1)
    before, after = (
        [
            line
            for line in ways(built(tmp_path, drawn, standing))
            if line.coords[0][0] < -5 and line.coords[-1][0] > 5
        ]
        for standing in ((), [post])
    )
    assert len(before) == len(after) == 2
    assert min(line.distance(post) for line in before) < 0.9
    assert min(line.distance(post) for line in after) > 0.99


def test_what_stands_beside_moves_nothing(tmp_path):
    far = [shapely.Point(x, y).buffer(0.15) for x, y in ((-8.0, -12.0), (0.0, 30.0))]
    plain = built(tmp_path, undrawn())
    beside = built(tmp_path, undrawn(), far)
    assert [line.wkt for line in ways(plain)] == [line.wkt for line in ways(beside)]


def test_what_somebody_drew_is_kept(tmp_path):
    place = TURNS["east"][0][3]
    post = shapely.Point(place[0], place[1] + 1.6).buffer(0.15)
    roads = built(tmp_path, features(), [post])
    plain = built(tmp_path, features())
    assert [line.wkt for line in ways(plain)] == [line.wkt for line in ways(roads)]
    assert [warning.about for warning in roads.warnings] == ["ways through junctions"]


def test_only_what_a_car_meets_stands_in_its_way():
    """A post, a curb below the knee, a sign above heads and a hedge, on ground that is 5 m up."""
    kinds = [("pole", 0.0, 3.0), ("pole", 0.0, 0.3), ("traffic-sign", 2.4, 3.0)]
    kinds.append(("vegetation", 0.0, 2.0))
    vertices, faces, semantic = [], [], []
    for k, (name, low, high) in enumerate(kinds):
        faces.append([3 * k, 3 * k + 1, 3 * k + 2])
        x = 10.0 * k
        vertices += [[x, 0, 5 + low], [x + 0.2, 0, 5 + low], [x, 0, 5 + high]]
        semantic.append(semantic_classes()[name].id)
    mesh = LabelledMesh(
        np.array(vertices),
        np.array(faces, np.int32),
        np.array(semantic, np.uint16),
        np.zeros(len(faces), np.uint8),
        np.zeros(len(faces), np.int32),
    )
    elevation = Elevation(-50.0, -50.0, 1.0, np.full((101, 101), 5.0))
    (found,) = standing_on_ground(mesh, elevation)
    assert found.bounds == pytest.approx((0.0, 0.0, 0.2, 0.0))
