"""Correction files as people write them: every mistake is one line that names the feature."""

import json

import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.corrections import SetTags, read_corrections

FRAME = SiteFrame(48.7, 9.18)
REGION = shapely.Point(0, 0).buffer(100)
HERE = {"type": "Point", "coordinates": [9.1801, 48.7001]}
LINE = {"type": "LineString", "coordinates": [[9.18, 48.7], [9.1805, 48.7]]}
POLE = {"action": "add", "what": "pole"}


def written(folder, *features, **more):
    file = folder / "corrections.geojson"
    listed = [
        {"type": "Feature", "properties": properties, "geometry": geometry}
        for properties, geometry in features
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": listed, **more}))
    return file


@pytest.mark.parametrize(
    ("properties", "geometry", "says"),
    [
        ({}, HERE, r"feature 1: action: is missing|action: is missing"),
        ({"action": "ad"}, HERE, r"action: is 'ad'; expected 'add'"),
        ({"action": "add", "what": "poel"}, HERE, r"what: is 'poel'; expected 'pole'"),
        ({"action": "move", "what": "wall"}, LINE, "what: is 'wall'; expected one of curb"),
        (POLE, None, r"feature 1 \(add pole\): is not drawn; expected Point"),
        (POLE, LINE, "is drawn as LineString; expected Point"),
        (POLE | {"height_m": 80}, HERE, "height_m: 80, as a pole; expected 1 to 40 m"),
        (POLE | {"hight_m": 8}, HERE, "hight_m: is not a field .* expected 'height_m'"),
        (POLE | {"height_m": "tall"}, HERE, "height_m: is 'tall'; expected a number"),
        (POLE, {"type": "Point", "coordinates": [48.7001, 9.1801]}, "latitude comes first in it"),
        (POLE, {"type": "Point", "coordinates": [9.1801, 48.7101]}, "10.. m outside the region"),
        (POLE, {"type": "Point", "coordinates": [500.0, 1.0]}, "not in degrees"),
        (POLE, {"type": "Point", "coordinates": [float("nan"), 1.0]}, "JSON|near the anchor"),
        (POLE, {"type": "Point", "coordinates": "here"}, "not two numbers"),
        (POLE, {"type": "Point"}, "not two numbers|no coordinates"),
        (POLE, "a point", "geometry that is none"),
        ({"action": "tag", "tags": {"lanes": "3"}}, HERE, "element: is missing"),
        ({"action": "tag", "element": "street 3", "tags": {"lanes": "3"}}, HERE, "way/123"),
        ({"action": "tag", "element": "way/3", "tags": {}}, HERE, "names no tags"),
        ({"action": "tag", "element": "way/3", "tags": {"lanes": [3]}}, HERE, "no tag's"),
        ({"action": "tag", "element": "way/3", "tags": "lanes=3"}, HERE, "not JSON"),
        ({"action": "remove"}, HERE, "element: is missing"),
        ({"action": "remove", "what": "wall"}, HERE, "a point without radius_m"),
        ({"action": "add", "what": "lane", "side": "right", "kind": "bicycle"}, None, "not drawn"),
        (
            {"action": "add", "what": "lane", "side": "right", "kind": "bus", "element": "node/3"},
            None,
            "is of node/3; expected a way",
        ),
        (
            {"action": "add", "what": "lane", "side": "up", "kind": "bus", "element": "way/3"},
            None,
            "side: is 'up'; expected 'left' or 'right'",
        ),
        (
            {"action": "add", "what": "lane", "side": "left", "kind": "bus", "width_m": 1},
            LINE,
            "width_m: 1, as a lane of kind bus; expected 2 to 8 m",
        ),
        (
            {"action": "add", "what": "wall", "kind": "fence", "material": "gold"},
            LINE,
            "material: 'gold', as a fence; expected one of wood, metal",
        ),
    ],
)
def test_mistakes_are_one_line(tmp_path, properties, geometry, says):
    file = written(tmp_path, (properties, geometry))
    with pytest.raises(InputError, match=says) as error:
        read_corrections(file, FRAME, REGION)
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not JSON"),
        ("[]", "not a JSON object"),
        ('{"type": "Feature"}', "no FeatureCollection"),
        ('{"type": "FeatureCollection", "features": []}', "holds no corrections"),
        ('{"type": "FeatureCollection", "features": [7]}', "feature 1: is no feature"),
        ('{"type": "FeatureCollection", "features": [{}], "crs": "EPSG:9"}', "nobody knows"),
    ],
)
def test_other_files_are_refused(tmp_path, text, says):
    file = tmp_path / "corrections.geojson"
    file.write_text(text)
    with pytest.raises(InputError, match=says):
        read_corrections(file, FRAME, REGION)


@pytest.mark.parametrize(
    "address",
    [
        "https://www.openstreetmap.org/way/17#map=19/13.06877/80.27209",
        "https://www.openstreetmap.org/way/17/history",
        "https://www.openstreetmap.org/edit?editor=id&way=17#map=19/13.06877/80.27209",
        "https://www.openstreetmap.org/edit?way=17",
    ],
)
def test_an_element_is_named_by_its_address(tmp_path, address):
    tag = {"action": "tag", "element": address, "tags": {"lanes": "3"}}
    (one,) = read_corrections(written(tmp_path, (tag, None)), FRAME, REGION)
    assert str(one.asked.element) == "way/17"


@pytest.mark.parametrize(
    "address",
    ["https://www.openstreetmap.org/edit?editor=id#map=19/1/2", "https://example.org/way/17",
     "https://www.openstreetmap.org/changeset/17", "way/17/history"],
)  # fmt: skip
def test_what_is_no_address_of_an_element_is_told(tmp_path, address):
    tag = {"action": "tag", "element": address, "tags": {"lanes": "3"}}
    with pytest.raises(InputError, match="such as way/123"):
        read_corrections(written(tmp_path, (tag, None)), FRAME, REGION)


def test_what_editors_write_is_read(tmp_path):
    """QGIS: numbers as text, ids, empty values, tags as JSON in a text; geojson.io: its colours."""
    pole = POLE | {
        "height_m": "8",
        "fid": 3,
        "stroke": "#f00",
        "note": "by the kiosk",
        "kind": None,
    }
    tag = {"action": "tag", "element": "https://www.openstreetmap.org/way/17"}
    tag["tags"] = '{"lanes": 3, "oneway": true, "maxspeed": null}'
    file = written(tmp_path, (pole, HERE), (tag, None), crs={"properties": {"name": "CRS84"}})
    first, second = read_corrections(file, FRAME, REGION)
    assert (first.number, first.asked.height_m) == (1, 8)
    assert isinstance(second.asked, SetTags)
    assert str(second.asked.element) == "way/17"
    assert second.asked.tags == {"lanes": "3", "oneway": "yes", "maxspeed": None}
    east, north = shapely.get_coordinates(first.shapes[0])[0]
    assert (east, north) == pytest.approx((7.36, 11.12), abs=0.05)
