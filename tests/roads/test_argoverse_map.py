"""The vector map of an Argoverse 2 log in Pittsburgh as a lane model, by the file alone."""

import json
import math
import re
import runpy
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.interface.inspection import summary_of as summary
from urbantwin.roads.argoverse import anchor_of
from urbantwin.roads.argoverse.read import translate
from urbantwin.roads.imported import is_map_of_roads, read_map
from urbantwin.roads.marking.paint import zebra_of_area

from ..real_files import argoverse_map
from ..thorough import further

RULER = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "lanelet_ruler.py")))
ANCHOR = (40.462723, -79.951023)
#: City coordinates plus this are EPSG:32617: published with the log, to the millimetre.
CITY = np.array([583710.007, 4477260.000])
#: Within an intersection that the border of the map cuts off: nothing leads to it.
CUT_OFF = 38117303


class Drawn:
    """Lane segments in metres around the anchor, read without the project's reader."""

    def __init__(self, path):
        data = json.loads(path.read_text())
        self.plane = Transformer.from_crs("EPSG:32617", SiteFrame(*ANCHOR).proj, always_xy=True)
        self.crossings = data["pedestrian_crossings"].values()
        self.segments = {v["id"]: v for v in data["lane_segments"].values()}
        self.lanelets = {k: (k,) for k in self.segments}

    def metres(self, points):
        xy = np.array([[p["x"], p["y"]] for p in points]) + CITY
        return np.column_stack(self.plane.transform(*xy.T))

    def side(self, key, name):
        return self.metres(self.segments[key][f"{name}_lane_boundary"])

    def line(self, key):
        return self.side(key, "left")

    def area(self, key):
        ring = np.vstack([self.side(key, "left"), self.side(key, "right")[::-1]])
        return shapely.make_valid(shapely.Polygon(ring))

    def followers(self):
        return {
            (k, j) for k, v in self.segments.items() for j in v["successors"] if j in self.segments
        }


@pytest.fixture(scope="module")
def path(shared_data):
    return argoverse_map(shared_data, "lanes")


@pytest.fixture(scope="module")
def few(path, tmp_path_factory):
    """The map's lanes within 30 m of the anchor, which are read in a sixth of the time."""
    data, drawn = json.loads(path.read_text()), Drawn(path)
    near = shapely.Point(0, 0).buffer(30)
    data["lane_segments"] = {
        key: value
        for key, value in data["lane_segments"].items()
        if near.intersects(drawn.area(value["id"]))
    }
    part = tmp_path_factory.mktemp("few") / path.name
    part.write_text(json.dumps(data))
    return part


@pytest.fixture(scope="module")
def pittsburgh(path):
    return translate(path, SiteFrame(*ANCHOR)), Drawn(path)


def test_boundaries_are_borders_of_lanes_within_5_cm(pittsburgh):
    read, drawn = pittsburgh
    beside = defaultdict(set)
    for a, b in RULER.lane_links(read.model):
        beside[a].add(b)
        beside[b].add(a)
    away = {}
    for key in set(drawn.segments) - {CUT_OFF}:
        keys = set(read.lanes[key])
        # Where a road ends obliquely, the rest of a lane lies in those that it is joined to, over a
        # short section at its end perhaps.
        for _ in range(2):
            keys |= {other for k in keys for other in beside[k]}
        for name in ("left", "right"):
            rows = [
                RULER.lane_border(read.model, k, left=name == "left")[:, :2] for k in sorted(keys)
            ]
            line = shapely.segmentize(shapely.LineString(drawn.side(key, name)), 0.25)
            points = shapely.points(shapely.get_coordinates(line))
            far = float(shapely.distance(shapely.MultiLineString(rows), points).max())
            away[key] = max(away.get(key, 0.0), far)
    assert len(away) == 182
    assert max(away.values()) < 0.05
    assert np.percentile(list(away.values()), 95) < 0.005


def test_lanes_cover_what_the_segments_cover(pittsburgh):
    read, drawn = pittsburgh
    ours = shapely.union_all(
        [
            RULER.lane_area(read.model, (road.id, k, lane.id))
            for road in read.model.roads
            for k, section in enumerate(road.sections)
            for lane in section.lanes
        ]
    )
    theirs = shapely.union_all([drawn.area(key) for key in drawn.segments])
    assert ours.intersection(theirs).area > 0.995 * theirs.area
    assert ours.difference(theirs).area < 0.005 * theirs.area


def test_lanes_follow_as_the_map_says(pittsburgh):
    read, drawn = pittsburgh
    want = {pair for pair in drawn.followers() if CUT_OFF not in pair}
    assert len(want) == 204
    assert RULER.lanelet_links(read.model, read.lanes, drawn) == want


@pytest.mark.parametrize("seed", [1, *further(0)], ids=["holes", "wrong marks"])
def test_a_map_with_holes_or_wrong_marks_of_intersections_is_read_all_the_same(
    path, tmp_path, seed
):
    data = json.loads(path.read_text())
    draw = np.random.default_rng(seed)
    for key in draw.permutation(sorted(data["lane_segments"]))[:40]:
        if seed % 2:
            del data["lane_segments"][key]
        else:
            data["lane_segments"][key]["is_intersection"] ^= True
    worse = tmp_path / path.name
    worse.write_text(json.dumps(data))
    read, drawn = translate(worse, SiteFrame(*ANCHOR)), Drawn(worse)
    left_out = set(drawn.segments) - set(read.lanes)
    assert len(left_out) <= 3
    assert read.notes.get("left_out_lanelets_that_make_no_road", 0) == len(left_out)
    links = RULER.lanelet_links(read.model, read.lanes, drawn)
    assert links == {pair for pair in drawn.followers() if not left_out & set(pair)}


def test_segments_of_intersections_are_ways_through_junctions(pittsburgh):
    read, drawn = pittsburgh
    roads = {
        key: [read.model.road_by_id[r] for r, _, _ in rows] for key, rows in read.lanes.items()
    }
    within = {k for k, v in drawn.segments.items() if v["is_intersection"] and k in roads}
    through = {k for k in within if all(road.junction >= 0 for road in roads[k])}
    # Others are cut off by the border of the map: ends of streets.
    after = {a for a, _ in drawn.followers()}
    before = {b for _, b in drawn.followers()}
    assert within & after & before <= through
    assert len(through) > 50
    for key in set(roads) - within:
        if shapely.LineString(drawn.line(key)).length > 15.0:
            assert any(road.junction < 0 for road in roads[key])


def test_lanes_are_at_the_heights_of_the_boundaries(pittsburgh):
    read, drawn = pittsburgh
    off = []
    for key, rows in read.lanes.items():
        lines = [RULER.lane_border(read.model, rows[0], left=left) for left in (True, False)]
        for name, line in zip(("left", "right"), lines, strict=True):
            ours = shapely.LineString(line)
            points = drawn.segments[key][f"{name}_lane_boundary"]
            for point, (x, y) in zip(points, drawn.metres(points), strict=True):
                at = shapely.line_interpolate_point(ours, ours.project(shapely.Point(x, y)))
                if math.hypot(at.x - x, at.y - y) < 0.05:
                    off.append(at.z - point["z"])
    off = np.array(off) - np.median(off)
    assert len(off) > 600
    assert np.sqrt(np.mean(off**2)) < 0.05


def test_kinds_marks_and_crossings(pittsburgh):
    read, drawn = pittsburgh
    model = read.model

    def lanes(key):
        return [model.road_by_id[r].sections[k].by_id[i] for r, k, i in read.lanes[key]]

    for key, segment in drawn.segments.items():
        if key != CUT_OFF:
            kind = {"VEHICLE": "driving", "BIKE": "bicycle"}[segment["lane_type"]]
            assert {lane.kind for lane in lanes(key)} == {kind}
    want = {"SOLID_WHITE": "solid", "DASHED_WHITE": "broken", "NONE": "none"}
    seen = 0
    for key, segment in drawn.segments.items():
        for lane in lanes(key) if segment["right_neighbor_id"] is None and key != CUT_OFF else ():
            # The outer border of the rightmost lane of a street is the segment's right boundary.
            if lane.forward and lane.id < 0 and not segment["is_intersection"]:
                mark = segment["right_lane_mark_type"]
                seen += mark != "NONE"
                assert lane.mark == want[mark] or mark == "NONE"
    assert seen > 10
    crosswalks = [area for area in model.areas if area.kind == "crosswalk"]
    assert len(crosswalks) == len(drawn.crossings) == 11
    ours = [shapely.Polygon(RULER.placed(model, area)[:, :2]) for area in crosswalks]
    for crossing in drawn.crossings:
        ring = np.vstack([drawn.metres(crossing["edge1"]), drawn.metres(crossing["edge2"])[::-1]])
        area = shapely.Polygon(ring)
        assert max(area.intersection(one).area for one in ours) > 0.99 * area.area


def test_crossings_are_painted_where_nobody_walks(pittsburgh):
    read, drawn = pittsburgh
    walks = []
    for crossing in drawn.crossings:
        ring = np.vstack([drawn.metres(crossing["edge1"]), drawn.metres(crossing["edge2"])[::-1]])
        walks.append(shapely.Polygon(ring))
    stripes = [
        shapely.Polygon(quad)
        for area in read.model.areas
        for quad in zebra_of_area(read.model, area)
    ]
    paint = shapely.union_all(stripes)
    for walk in walks:
        # Half of it is paint; oblique ones are painted as the rectangle around them.
        assert 0.4 * walk.area < paint.intersection(walk).area < 0.7 * walk.area
    assert paint.intersection(shapely.union_all(walks)).area > 0.8 * paint.area


def test_its_name_says_where_on_earth_it_lies(few, tmp_path):
    assert is_map_of_roads(few)
    latitude, longitude = anchor_of(few)
    assert abs(latitude - ANCHOR[0]) < 2e-3
    assert abs(longitude - ANCHOR[1]) < 2e-3
    with pytest.raises(InputError, match="says itself where on earth"):
        read_map(few, SiteFrame(*ANCHOR), (0.0, 0.0))
    nameless = tmp_path / "map.json"
    nameless.write_bytes(few.read_bytes())
    drawn = Drawn(few)
    x, y = np.subtract(drawn.plane.transform(0.0, 0.0, direction="INVERSE"), CITY)
    moved = read_map(nameless, SiteFrame(*ANCHOR), (float(x), float(y))).model
    there = read_map(few, SiteFrame(*ANCHOR)).model
    for one, two in zip(moved.roads, there.roads, strict=True):
        # The zone's grid and the site's differ in scale and in which way is north: 0.3 m in 100 m.
        gap = one.curve.at([0.0])[0, :2] - two.curve.at([0.0])[0, :2]
        assert np.linalg.norm(gap) < 0.02 * (1.0 + np.linalg.norm(two.curve.at([0.0])[0, :2]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data.update(lane_segments={}), "has no lane segments"),
        (
            lambda data: _first(data)["left_lane_boundary"][0].update(x=math.nan),
            "NaN, which is not",
        ),
        (lambda data: data.update(drivable_areas=[]), None),
        (lambda data: data.update(drivable_areas=[1]), "drivable_areas is not an object"),
        (
            lambda data: [row.update(lane_type="TRAM") for row in data["lane_segments"].values()],
            "lane_type 'TRAM' is unknown",
        ),
    ],
)
def test_what_is_wrong_is_said_in_a_line(few, tmp_path, change, said):
    data = json.loads(few.read_text())
    change(data)
    broken = tmp_path / "log_map_archive_x____PIT_city_1.json"
    broken.write_text(json.dumps(data))
    if said is None:
        assert read_map(broken, SiteFrame(*ANCHOR)).drivable.is_empty
        return
    with pytest.raises(InputError, match=said):
        read_map(broken, SiteFrame(*ANCHOR))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: _first(data).update(lane_type="TRAM"), "lane_type 'TRAM' is unknown"),
        (lambda data: _first(data).update(left_lane_boundary=[]), "is not a line"),
        (lambda data: _first(data)["right_lane_boundary"][0].pop("y"), "is not a line"),
        (lambda data: _first(data).update(id="a"), "has id 'a'"),
        (lambda data: _first(data).update(successors=3), "successors is not a list"),
        (lambda data: _first(data)["left_lane_boundary"].__delitem__(slice(1, None)), "not a line"),
        (
            lambda data: _first(data).update(left_lane_boundary=[{"x": 1, "y": 2, "z": 0}] * 2),
            "without length",
        ),
        (lambda data: data["lane_segments"].update(again=_first(data)), "has the id of another"),
        (lambda data: _area(data).update(area_boundary=None), "area_boundary is not a line"),
        (lambda data: _area(data)["area_boundary"].__delitem__(slice(2, None)), "fewer than three"),
    ],
)
def test_one_bad_element_is_dropped_and_the_map_is_read(few, tmp_path, change, said):
    data = json.loads(few.read_text())
    name = next(iter(data["lane_segments"]))
    area = next(iter(data["drivable_areas"]))
    change(data)
    broken = tmp_path / "log_map_archive_x____PIT_city_1.json"
    broken.write_text(json.dumps(data))
    found = read_map(broken, SiteFrame(*ANCHOR))
    (words,) = found.notes["dropped"]
    assert said in words
    kind = f"drivable area {area}" if "area" in words.partition(":")[0] else f"lane segment {name}"
    assert re.match(rf"{kind}( at x = -?\d+\.\d, y = -?\d+\.\d)?: ", words)
    assert found.model.roads


def test_drivable_areas_are_where_the_file_says_with_and_without_a_city(few, tmp_path):
    drawn = Drawn(few)
    areas = json.loads(few.read_text())["drivable_areas"].values()
    outlines = [shapely.Polygon(drawn.metres(area["area_boundary"])) for area in areas]
    expected = shapely.union_all(outlines)
    assert expected.area > 5_000
    frame = SiteFrame(*ANCHOR)
    assert read_map(few, frame).drivable.symmetric_difference(expected).area < 20
    nameless = tmp_path / "map.json"
    nameless.write_bytes(few.read_bytes())
    own = [[[p["x"] - 7, p["y"] + 3] for p in area["area_boundary"]] for area in areas]
    moved = read_map(nameless, frame, (7.0, -3.0)).drivable
    plain = shapely.union_all([shapely.Polygon(one) for one in own])
    assert moved.symmetric_difference(plain).area < 20


def _first(data):
    return next(iter(data["lane_segments"].values()))


def _area(data):
    return next(iter(data["drivable_areas"].values()))


@pytest.mark.thorough
def test_it_is_described(path):
    found = summary(path)
    assert (found["kind"], found["format"]) == ("roads", "Argoverse 2")
    assert found["crosswalks"] == 11
    assert "40.46" in found["georeference"]


def test_other_json_is_no_map(tmp_path):
    other = tmp_path / "other.json"
    other.write_text('{"type": "FeatureCollection"}')
    assert not is_map_of_roads(other)
    with pytest.raises(InputError, match="has no lane segments"):
        read_map(other, SiteFrame(*ANCHOR))
    other.write_text("{")
    with pytest.raises(InputError, match="is not JSON"):
        read_map(other, SiteFrame(*ANCHOR))
