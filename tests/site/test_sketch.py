"""A sketch by hand is the map that it stands for."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.site import load_site
from urbantwin.site.sketch import read_sketch

FRAME = SiteFrame(52.5, 13.4)
EXAMPLE = Path(__file__).parents[2] / "examples/hannover"


def line(kind, *points, **properties):
    return {
        "type": "Feature",
        "properties": {"kind": kind, **properties},
        "geometry": {"type": "LineString", "coordinates": [list(point) for point in points]},
    }


def written(folder, *features, crs="site"):
    value = {"type": "FeatureCollection", "features": list(features)}
    path = folder / "sketch.geojson"
    path.write_text(json.dumps(value | ({"crs": crs} if crs else {})))
    return path


def crossroads():
    """Two streets that cross 1 m off the anchor, one of them drawn as two with ends 0.8 m apart."""
    return [
        line("street", (-90, 1), (-0.5, 1), name="west", lanes=2, lanes_back=1, turns="left|right"),
        line("street", (0.3, 1), (90, 1), name="east", lanes=1, lanes_back=1),
        line("street", (0, -90), (0, 90), name="north", lanes="1", lanes_back=1.0),
        line("stop_line", (-18, 1), (-18, -5)),
        line("crossing", (-14, -7), (-14, 9), signals="yes", width_m=3),
    ]


def place(extract, node):
    return FRAME.site_from_lonlat([extract.nodes[node]])[0]


def test_lines_meet_where_they_cross_and_where_ends_are_near(tmp_path):
    extract = read_sketch(written(tmp_path, *crossroads()), FRAME)
    west, east, north = (set(extract.ways[k].nodes) for k in (1, 2, 3))
    (shared,) = west & east & north
    assert np.linalg.norm(place(extract, shared) - [0.0, 1.0]) < 0.5
    tags = extract.ways[1].tags
    assert (tags["lanes:forward"], tags["lanes:backward"], tags["oneway"]) == ("2", "1", "no")
    assert tags["turn:lanes:forward"] == "left|right"


def test_marks_are_nodes_of_the_street_they_lie_on(tmp_path):
    extract = read_sketch(written(tmp_path, *crossroads()), FRAME)
    found = {}
    for node, tags in extract.node_tags.items():
        assert node in extract.ways[1].nodes
        found[tags["highway"]] = (place(extract, node), tags)
    np.testing.assert_allclose(found["traffic_signals"][0], [-18, 1], atol=0.02)
    # It stops those who come to the junction, which is ahead on the way as it was drawn.
    assert found["traffic_signals"][1]["traffic_signals:direction"] == "forward"
    np.testing.assert_allclose(found["crossing"][0], [-14, 1], atol=0.02)
    assert found["crossing"][1]["crossing:width"] == "3"
    assert set(extract.ways[4].nodes) & set(extract.ways[1].nodes)


def test_degrees_and_other_systems_give_the_same_places(tmp_path):
    metres = read_sketch(written(tmp_path, *crossroads()), FRAME)
    changed = json.loads(json.dumps(crossroads()))
    for feature in changed:
        xy = feature["geometry"]["coordinates"]
        feature["geometry"]["coordinates"] = FRAME.lonlat_from_site(xy).tolist()
    degrees = read_sketch(written(tmp_path, *changed, crs=None), FRAME)
    named = {"type": "name", "properties": {"name": FRAME.proj_with_datum}}
    other = read_sketch(written(tmp_path, *crossroads(), crs=named), FRAME)
    for extract in (degrees, other):
        assert extract.ways == metres.ways
        for node in metres.nodes:
            np.testing.assert_allclose(
                place(extract, node), place(metres, node), atol=0.011, err_msg=str(node)
            )


def test_ways_through_meet_at_their_ends_alone(tmp_path):
    drawn = [
        line("street", (-90, 0), (-10, 0)),
        line("street", (10, 0), (90, 0)),
        line("street", (0, -90), (0, -10)),
        line("street", (0, 10), (0, 90)),
        line("turn", (-10, 0), (10, 0)),
        line("turn", (0, -10), (0, 10)),
    ]
    extract = read_sketch(written(tmp_path, *drawn), FRAME)
    assert not set(extract.ways[5].nodes) & set(extract.ways[6].nodes)
    assert extract.ways[5].nodes[0] == extract.ways[1].nodes[-1]
    built = build_roads(
        extract, FRAME, shapely.Point(0, 0).buffer(40), Elevation.flat(),
        driving_side="right", out=tmp_path / "n.net.xml",
    )  # fmt: skip
    # They cross, so they are one junction; nobody turns from one to the other.
    assert len([j for j in built.network.junctions if j.id.startswith("cluster")]) == 1
    through = [lane for lane in built.network.lanes if lane.kind == "connection"]
    for lane in through:
        ahead = lane.centre[-1, :2] - lane.centre[0, :2]
        assert min(abs(ahead)) < 0.5


@pytest.mark.parametrize(
    ("feature", "expected"),
    [
        (line("stret", (0, 0), (1, 1)), "kind: is 'stret'; expected 'street'"),
        (line("street", (0, 0), (9, 9), lane=2), "lane: is not a field"),
        (line("street", (0, 0), (9, 9), lanes=0), "has 0 lanes"),
        (line("street", (0, 0), (9, 9), lanes=2, turns="left"), "for 1 lanes"),
        (line("street", (0, 0), (9, 9), turns="links"), "turns 'links'"),
        (line("street", (0, 0), (9, 9), lane_width_m=30), "a lane of '30' m"),
        (line("street"), "has no coordinates"),
        (line("street", (5, 5), (5, 5)), "has 1 different points"),
        (line("island", (0, 0), (9, 9)), "is drawn as LineString; expected Polygon"),
        (line("stop_line", (50, 40), (50, 44)), "lies on no street"),
        (line("crossing", (50, 40), (50, 44)), "crosses no street"),
        (line("street", (0, 0), (9e5, 9)), "is not near the anchor"),
        ({"type": "Feature", "geometry": None, "properties": {}}, "is no feature"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, feature, expected):
    path = written(tmp_path, *crossroads(), feature)
    with pytest.raises(InputError) as told:
        read_sketch(path, FRAME)
    assert expected in str(told.value)
    assert str(told.value).startswith(f"{path}: features[5]")


def arms():
    """Four arms of two lanes in and one or two out, 15 m from the middle, without ways through."""
    return [
        line("street", (-90, -3), (-15, -3), name="west in", lanes=2),
        line("street", (-15, 4), (-90, 4), name="west out", lanes=2),
        line("street", (15, -3), (90, -3), name="east out", lanes=2),
        line("street", (3, 15), (3, 90), name="north out"),
        line("street", (-3, -90), (-3, -15), name="south", lanes_back=1),
    ]


@pytest.mark.parametrize(
    ("turns", "expected"),
    [
        ([[(15, -3), (0, -1), (-15, -3)]], "is drawn against the way that it is driven"),
        ([[(-15, -3), (0, -2), (9, -3)]], "ends where no street starts: 6.0 m from that of east"),
        ([[(-8, -3), (0, -2), (15, -3)]], "begins where no street ends: 7.0 m from that of west"),
        ([[(-15, 3), (0, -2), (15, -3)]], "begins where no street ends"),
        ([[(-15, -3), (6, 6), (6, -6), (-2, 4), (15, -3)]], "crosses itself"),
        ([[(-15, -3), (0, -3), (3, 15)]], "bends to a radius of"),
        ([[(-15, -3), (-2, -3), (0, 5), (2, -3), (15, -3)]], "bends to a radius of"),
        ([[(-15, -3), (15, -3)]] * 2, "leads from and to the same streets as features[5] (turn)"),
        ([[(-15, -3), (0, -1), (15, -3)], [(-15, -1.4), (15, -1.4)]], "the same streets as"),
    ],
)
def test_turns_that_nobody_could_drive_are_told_in_one_line(tmp_path, turns, expected):
    path = written(tmp_path, *arms(), *(line("turn", *points) for points in turns))
    with pytest.raises(InputError) as told:
        read_sketch(path, FRAME)
    text = str(told.value)
    assert expected in text
    assert text.startswith(f"{path}: features[{4 + len(turns)}] (turn) at")
    assert "\n" not in text


def test_turns_of_two_ways_are_two(tmp_path):
    path = written(tmp_path, *arms(), line("turn", (-15, -3), (15, -3), lanes_back=1))
    with pytest.raises(InputError, match="has 1 lanes back; expected a turn of its own"):
        read_sketch(path, FRAME)


def test_turns_may_end_beside_the_middle_of_streets_and_have_heights(tmp_path):
    drawn = [
        line("turn", (-15.9, -1.5, 31.0), (0, -1, 32.0), (14.5, -4.5, 30.0)),
        # A street of two ways is left and entered at the same end.
        line("turn", (-3, -15), (-5, -6), (-6, 2), (-8, 3.8), (-15, 4)),
        line("turn", (-15, -3), (-5, -6), (-3.2, -15)),
    ]
    extract = read_sketch(written(tmp_path, *arms(), *drawn), FRAME)
    for number, (first, last) in zip((6, 7, 8), ((1, 3), (5, 2), (1, 5)), strict=True):
        nodes = extract.ways[number].nodes
        assert nodes[0] in extract.ways[first].nodes
        assert nodes[-1] in extract.ways[last].nodes


def test_metres_without_a_word_are_no_degrees(tmp_path):
    far = line("street", (-200, 1), (300, 1))
    with pytest.raises(InputError, match='"crs": "site"'):
        read_sketch(written(tmp_path, far, crs=None), FRAME)
    with pytest.raises(InputError, match="holds no streets"):
        read_sketch(written(tmp_path, line("wall", (0, 0), (9, 9))), FRAME)
    with pytest.raises(InputError, match="which nobody knows"):
        read_sketch(written(tmp_path, far, crs="mine"), FRAME)


@pytest.mark.thorough
def test_the_example_is_the_place_that_its_recording_shows():
    site = load_site(EXAMPLE / "site.yaml")
    extract = read_sketch(site.sketch.path, site.frame)
    lanes = {
        way.tags.get("name"): int(way.tags["lanes"])
        for way in extract.ways.values()
        if way.tags.get("junction") != "yes" and "lanes" in way.tags
    }
    # As the recording's description counts them.
    assert (lanes["north-east in"], lanes["north-east out"]) == (4, 2)
    assert (lanes["north-west in"], lanes["west in"], lanes["west out"]) == (3, 4, 2)
    assert (lanes["south-east in, left"], lanes["south-east in, right"]) == (2, 1)
    assert sum(way.tags.get("junction") == "yes" for way in extract.ways.values()) == 9
