"""Lanelet2 files that are wrong: one line that says what and where."""

import math
import re
import runpy
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.lanelet2 import anchor_of, is_lanelet2, read_lanelet2
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive import read_opendrive, write_opendrive

DRAW = SimpleNamespace(**runpy.run_path(str(Path(__file__).with_name("lanelet_town.py"))))
FRAME = SiteFrame(*DRAW.ANCHOR)


def street():
    town = DRAW.LaneletMap()
    lines = [town.way([(0, t), (40, t)], type="line_thin") for t in (0.0, -3.5)]
    town.only = town.lanelet(*lines)
    town.lines = lines
    return town


@pytest.fixture
def complaint(tmp_path):
    """Return a function: a map, or the text of a file -> the line that a person reads."""

    def read(town, frame=FRAME):
        path = tmp_path / "map.osm"
        if isinstance(town, str):
            path.write_text(town)
        else:
            town.write(path)
        with pytest.raises(InputError) as caught:
            read_lanelet2(path, frame)
        text = str(caught.value)
        assert "\n" not in text
        assert text.startswith(str(path))
        return text

    return read


def test_the_street_itself_is_right(tmp_path):
    model, notes = read_lanelet2(street().write(tmp_path / "map.osm"), FRAME)
    assert len(model.roads) == 1
    assert notes["lanelets"] == 1


@pytest.mark.parametrize("first", [1048750101261440000, 2**63 - 100, -(2**63), -9, 2**53 + 1])
def test_ids_of_64_bits_with_a_sign_survive_every_file(tmp_path, first):
    """Lanelet2's ids are int64; the format's own example map has 19 digits."""
    path = street().write(tmp_path / "map.osm")
    tree = ElementTree.parse(path)
    texts = [e.get(key) for e in tree.iter() for key in ("id", "ref") if e.get(key)]
    new = {old: str(first + k) for k, old in enumerate(dict.fromkeys(texts))}
    for item in tree.iter():
        for key in ("id", "ref"):
            if item.get(key):
                item.set(key, new[item.get(key)])
    tree.write(path)
    (lanelet,) = (int(e.get("id")) for e in tree.iter("relation"))
    model, _ = read_lanelet2(path, FRAME)
    model.save(tmp_path / "lane_model.json")
    write_opendrive(model, FRAME, tmp_path / "map.xodr", name="ids")
    for found in (
        model,
        LaneModel.load(tmp_path / "lane_model.json"),
        read_opendrive(tmp_path / "map.xodr").model,
    ):
        assert [road.ways for road in found.roads] == [(lanelet,)]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "is not XML"),
        ("nonsense", "is not XML"),
        ("<osm><node id='1' lat='49'", "is not XML"),
        ("<html/>", "not <osm>"),
        ("<osm/>", "has no lanelets"),
        (
            "<osm><way id='1'><tag k='highway' v='residential'/></way></osm>",
            "is a street map of OpenStreetMap",
        ),
        ("<osm><way id='one'/></osm>", "id='one'"),
        (
            "<!DOCTYPE osm [<!ENTITY a SYSTEM 'file:///etc/hostname'>]><osm>&a;</osm>",
            "declares a document type or entities",
        ),
    ],
)
def test_what_is_no_lanelet2_map(complaint, text, what):
    assert what in complaint(text)


def test_a_file_that_is_not_there(tmp_path):
    for path in (tmp_path / "none.osm", tmp_path):
        with pytest.raises(InputError, match=r"not found|is a folder"):
            read_lanelet2(path, FRAME)
        assert not is_lanelet2(path)


def test_a_bound_that_is_missing(complaint):
    for members, what in (
        ([("way", 1, "left")], "no ways of role right"),
        ([], "no ways of role left"),
        ([("way", 5, "left"), ("way", 99, "right")], "refers to way 99"),
    ):
        town = street()
        town.relations[town.only] = (
            [(kind, town.lines[0] if ref == 5 else ref, role) for kind, ref, role in members],
            {"type": "lanelet"},
        )
        text = complaint(town)
        assert f"relation {town.only}" in text
        assert what in text or "refers to way 1," in text


def test_bounds_that_are_one_way_or_two_or_a_point(complaint):
    town = street()
    left, right = town.lines
    for pair, what in (
        ([left, left], "is its left and its right bound"),
        ([left, town.way([(0, 9)])], "fewer than two points"),
    ):
        town.relations[town.only] = (
            [("way", way, role) for way, role in zip(pair, ("left", "right"), strict=True)],
            {"type": "lanelet"},
        )
        text = complaint(town)
        assert f"relation {town.only}" in text
        assert what in text
    twice = [("way", left, "left"), ("way", right, "left"), ("way", right, "right")]
    town.relations[town.only] = (twice, {"type": "lanelet"})
    assert "2 ways of role left" in complaint(town)


def test_a_node_that_is_missing_or_nowhere(complaint):
    town = street()
    gone = town.ways[town.lines[1]][0][0]
    (x, _, z), tags = town.nodes[gone]
    town.nodes[gone] = ((x, math.nan, z), tags)
    text = complaint(town)
    assert f"relation {town.only} at " in text
    assert f": node {gone} has no finite" in text
    del town.nodes[gone]
    text = complaint(town)
    assert f"relation {town.only}" in text
    assert f"refers to node {gone}" in text


def dropped(tmp_path, town):
    """What is dropped of a map that is read all the same, and how many lanelets are left."""
    _, notes = read_lanelet2(town.write(tmp_path / "map.osm"), FRAME)
    return notes["dropped"], notes["lanelets"]


def test_a_light_that_refers_to_a_missing_way_is_dropped_alone(tmp_path):
    town = street()
    there = town.way([(39, -1), (39, -2)], type="traffic_light")
    light = town.relation(
        [("way", 77, "refers"), ("way", there, "refers")],
        type="regulatory_element",
        subtype="traffic_light",
    )
    members, tags = town.relations[town.only]
    town.relations[town.only] = ([*members, ("relation", light, "regulatory_element")], tags)
    model, notes = read_lanelet2(town.write(tmp_path / "map.osm"), FRAME)
    (words,) = notes["dropped"]
    place = rf"relation {light} at 4[89]\.\d{{5}}, 8\.40\d{{3}}"
    assert re.fullmatch(f"{place}: refers to way 77, which the file lacks", words)
    assert len(model.signals) == 1


#: What may be wrong with one lanelet.
FAULTS = {
    "no right bound": lambda town, one: town.relations[one][0].pop(),
    "a way that is missing": lambda town, one: town.ways.pop(town.relations[one][0][0][1]),
    "a point that is missing": lambda town, one: town.nodes.pop(inner_node(town, one)),
    "a point that is nowhere": lambda town, one: town.nodes.update(
        {inner_node(town, one): ((0.0, math.nan, 0.0), {})}
    ),
    "no width": lambda town, one: town.ways.update(
        {town.relations[one][0][1][1]: town.ways[town.relations[one][0][0][1]]}
    ),
    "a point on another continent": lambda town, one: town.nodes.update(
        {inner_node(town, one): ((2e6, 0.0, 0.0), {})}
    ),
}


def inner_node(town, one):
    return town.ways[town.relations[one][0][0][1]][0][1]


@pytest.mark.parametrize("name", FAULTS)
def test_one_bad_lanelet_is_dropped_and_the_others_are_read(tmp_path, name):
    town = street()
    bad = town.between([(40, 50), (60, 51), (80, 50)], [(40, 46.5), (60, 47.5), (80, 46.5)])
    assert dropped(tmp_path, town) == ([], 2)
    FAULTS[name](town, bad)
    (words,), left = dropped(tmp_path, town)
    assert left == 1
    assert re.match(rf"relation {bad} at 49\.\d{{5}}, 8\.40\d{{3}}: ", words)


def test_an_id_that_is_no_number_costs_its_element_alone(tmp_path):
    path = street().write(tmp_path / "map.osm")
    path.write_text(path.read_text().replace("</osm>", "<way id='one'/></osm>"))
    _, notes = read_lanelet2(path, FRAME)
    assert notes["lanelets"] == 1
    assert len(notes["dropped"]) == 1
    assert "id='one'" in notes["dropped"][0]


def test_a_map_of_another_town(complaint):
    assert "km from the site's anchor" in complaint(street(), SiteFrame(48.0, 11.0))


def test_a_map_of_walkways_alone(complaint):
    town = DRAW.LaneletMap()
    town.between([(0, 0), (9, 0)], [(0, -2), (9, -2)], subtype="walkway")
    assert "no lanelets that vehicles may use" in complaint(town)


def test_a_map_without_degrees_has_no_anchor(tmp_path):
    path = street().write(tmp_path / "map.osm", local=True)
    with pytest.raises(InputError, match="no latitudes and longitudes"):
        anchor_of(path)


def test_what_is_left_out_is_counted(tmp_path):
    town = street()
    town.between([(0, 30), (40, 30)], [(0, 28), (40, 28)], subtype="walkway", one_way="no")
    town.between([(0, 60), (40, 60)], [(0, 58), (40, 58)], subtype="rail")
    town.between([(0, 90), (9, 90)], [(0, 88), (9, 88)], subtype="crosswalk", one_way="no")
    town.relation([("way", town.lines[0], "outer")], type="multipolygon", subtype="vegetation")
    bump = town.way([(9, 0), (9, -3.5), (9.4, -3.5)], type="speed_bump")
    town.relation([("way", bump, "refers")], type="regulatory_element", subtype="speed_bump")
    members, tags = town.relations[town.only]
    town.relations[town.only] = ([*members, ("relation", 999, "regulatory_element")], tags)
    model, notes = read_lanelet2(town.write(tmp_path / "map.osm"), FRAME)
    assert notes["left_out_lanelets_walkways_apart_from_streets"] == 1
    assert notes["left_out_lanelets_of_subtype_rail"] == 1
    assert notes["crosswalks_without_a_street"] == 1
    assert notes["left_out_areas_of_subtype_vegetation"] == 1
    assert notes["left_out_regulatory_elements_of_subtype_speed_bump"] == 1
    assert not model.signals
    assert notes["missing_regulatory_elements"] == 1


def test_a_lanelet_for_both_directions_is_listed_with_its_place(tmp_path):
    town = street()
    town.relations[town.only][1]["one_way"] = "no"
    _, notes = read_lanelet2(town.write(tmp_path / "map.osm"), FRAME)
    (words,) = notes["reinterpreted"]
    assert re.fullmatch(
        rf"relation {town.only} at \d+\.\d{{5}}, 8\.4\d{{4}}: one_way=no: .*", words
    )
