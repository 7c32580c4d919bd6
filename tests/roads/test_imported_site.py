"""From a file to a site and back to lanes: OpenDRIVE and Lanelet2, with and without a place."""

import dataclasses
import shutil

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported import (
    build_imported_roads,
    init_site_of_map,
    is_map_of_roads,
    prepared_map,
    read_map,
)
from urbantwin.roads.imported.junction_proposal import busiest_junction, paved_area
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.site import load_site
from urbantwin.twin import build_twin, load_twin

from ..interface.conftest import line
from .tee import EAST, JUNCTION, SOUTH, WEST, tee

__all__ = ["line"]

FRAME = SiteFrame(48.7, 9.18)
KINDS = ("driving", "bus", "bicycle", "sidewalk")


@pytest.fixture
def write_map(tmp_path):
    """Return a function that writes a model as OpenDRIVE, with or without its georeference."""

    def write(model, *, frame=FRAME, placed=True, name="map.xodr"):
        path = tmp_path / name
        write_opendrive(model, frame, path, name="tee")
        if not placed:
            text = path.read_text()
            start, end = text.index("<geoReference>"), text.index("</geoReference>")
            path.write_text(text[:start] + text[end + len("</geoReference>") :])
        return path

    return write


def sensors(path):
    rig = yaml.safe_load(path.read_text())["rig"]
    return [np.array([s["east_m"], s["north_m"]]) for s in rig["sensors"]]


def test_a_map_with_a_georeference_is_a_site_at_its_junction(write_map, tmp_path):
    """The junction is drawn at x 400, y -250 of the map's frame."""
    path = write_map(tee(signals=True, at=(400.0, -250.0)))
    site = load_site(init_site_of_map(tmp_path / "site", path))
    assert site.osm is None
    assert site.roads.path.parent == tmp_path / "site"
    assert site.anchor_m is None
    place = FRAME.site_from_lonlat([[site.longitude, site.latitude]])[0]
    assert np.linalg.norm(place - [400.0, -250.0]) < 5.0
    assert site.name == "Long Street / Short Street"
    imported = read_map(site.roads.path, site.frame, site.anchor_m)
    paved = paved_area(imported.model)
    (pole,) = sensors(site.file)
    assert shapely.distance(paved, shapely.Point(pole)) >= 2.0
    assert 10.0 <= np.linalg.norm(pole) <= 30.0
    assert site.traffic.per_hour["pedestrian"] > 0


def test_a_map_without_a_georeference_says_so_and_is_placed_by_its_own_metres(write_map, tmp_path):
    path = write_map(tee(at=(5000.0, 7000.0)), placed=False)
    target = init_site_of_map(tmp_path / "site", path)
    text = target.read_text()
    assert "does not say where on earth" in text
    assert "0, 0 is assumed" in text
    site = load_site(target)
    assert (site.latitude, site.longitude) == (0.0, 0.0)
    assert np.linalg.norm(np.array(site.anchor_m) - [5000.0, 7000.0]) < 5.0
    imported = read_map(site.roads.path, site.frame, site.anchor_m)
    roads = {road.id: road for road in imported.model.roads}
    start = roads[EAST].curve.at([0.0])[0, :2] + site.anchor_m
    assert np.allclose(start, tee(at=(5000.0, 7000.0)).road_by_id[EAST].curve.at([0.0])[0, :2])
    assert "none in the map" in imported.notes["georeference"]


def test_where_it_is_can_be_said(write_map, tmp_path):
    path = write_map(tee(), placed=False)
    target = init_site_of_map(tmp_path / "site", path, latitude=35.6, longitude=139.7)
    site = load_site(target)
    assert (site.latitude, site.longitude) == (35.6, 139.7)
    assert "0, 0 is assumed" not in target.read_text()


def test_a_site_of_a_map_loads_as_itself_again(write_map, tmp_path):
    site = load_site(init_site_of_map(tmp_path / "site", write_map(tee(), placed=False)))
    again = tmp_path / "site" / "again.yaml"
    again.write_text(yaml.safe_dump(site.resolved()))
    other = load_site(again)
    assert other.resolved() == site.resolved()
    assert other.roads == site.roads
    assert [item["kind"] for item in site.inputs()] == ["roads"]


def test_a_signalised_junction_goes_before_a_larger_one_without():
    quiet, busy = tee(), tee(signals=True, at=(800.0, 0.0))
    step = 1000

    def moved(link):
        return link and dataclasses.replace(link, id=link.id + step)

    roads = [
        dataclasses.replace(
            road,
            id=road.id + step,
            junction=road.junction + step if road.junction >= 0 else -1,
            predecessor=moved(road.predecessor),
            successor=moved(road.successor),
        )
        for road in busy.roads
    ]
    junction = dataclasses.replace(
        busy.junctions[0],
        id=JUNCTION + step,
        connections=tuple(
            dataclasses.replace(c, incoming=c.incoming + step, connecting=c.connecting + step)
            for c in busy.junctions[0].connections
        ),
    )
    both = dataclasses.replace(
        quiet,
        roads=(*quiet.roads, *roads),
        junctions=(*quiet.junctions, junction),
        signals=tuple(dataclasses.replace(s, road=s.road + step) for s in busy.signals),
    )
    found = busiest_junction(both)
    assert found.signals == 3
    assert np.linalg.norm(np.array(found.place) - [800.0, 0.0]) < 5.0
    assert busiest_junction(both, lambda place: place[0] < 400.0).signals == 0


def test_a_map_of_one_street_is_a_site_in_its_middle(write_map, tmp_path):
    alone = dataclasses.replace(tee(crosswalk=False).road_by_id[EAST], predecessor=None)
    model = dataclasses.replace(tee(crosswalk=False), roads=(alone,), junctions=())
    site = load_site(init_site_of_map(tmp_path / "site", write_map(model)))
    place = FRAME.site_from_lonlat([[site.longitude, site.latitude]])[0]
    assert np.allclose(place, alone.curve.at([alone.length / 2])[0, :2], atol=0.05)


def test_the_kinds_of_osm_files_are_told_apart(shared_data, tmp_path):
    lanelets = shared_data / "tracks" / "karlsruhe-k733" / "k733.lanelet2.osm"
    assert is_map_of_roads(lanelets)
    assert not is_map_of_roads(shared_data / "osm" / "munich.osm")
    assert is_map_of_roads(tmp_path / "any.xodr")


def test_real_lanelet2_becomes_roads_that_sumo_drives(shared_data, tmp_path):
    """The streets of K733 in Karlsruhe: Durlacher Allee and Ostring, two carriageways each."""
    lanelets = shared_data / "tracks" / "karlsruhe-k733" / "k733.lanelet2.osm"
    site = load_site(init_site_of_map(tmp_path / "site", lanelets))
    assert site.name == "Durlacher Allee / Ostring"
    imported = read_map(site.roads.path, site.frame, site.anchor_m)
    prepared = prepared_map(imported, site.region, None)
    roads = build_imported_roads(prepared, site.frame, out=tmp_path / "n.net.xml")
    driven = [lane for lane in roads.network.lanes if lane.kind == "driving"]
    assert len(driven) >= 16
    assert len([lane for lane in roads.network.lanes if lane.kind == "connection"]) >= 16
    for item in prepared.notes["left_out"]:
        assert item["metres"] < 100


@pytest.fixture(scope="module")
def both_twins(line, tmp_path_factory):
    """A small site as built from OpenStreetMap, and from the OpenDRIVE written of that."""
    folder = tmp_path_factory.mktemp("both") / "site"
    shutil.copytree(line.site.parent, folder, ignore=shutil.ignore_patterns("two-avenues"))
    fields = yaml.safe_load((folder / "site.yaml").read_text())
    first = line.twin
    model = LaneModel.load(first.folder / "lane_model.json")
    write_opendrive(model, first.frame, folder / "map.xodr", name="example")
    (folder / "site.yaml").write_text(yaml.safe_dump(fields | {"roads": "map.xodr"}))
    return first, build_twin(load_site(folder / "site.yaml"), folder / "second")


def test_a_twin_that_is_exported_and_imported_has_the_same_lanes(both_twins):
    """Of every kind as many, and each where it lay: within 2 cm, heights too."""
    first, second = both_twins
    for kind in KINDS:
        ours, theirs = (
            [lane for lane in twin.roads.lanes if lane.kind == kind and lane.road]
            for twin in both_twins
        )
        assert len(ours) == len(theirs), kind
        if kind == "sidewalk":  # they end at corners, which netconvert draws
            continue
        lines = [shapely.LineString(lane.centre) for lane in theirs]
        for lane in ours:
            middle = lane.centre[len(lane.centre) // 2]
            near = min(lines, key=lambda line: line.distance(shapely.Point(middle)))
            points = lane.centre[1:-1] if len(lane.centre) > 2 else lane.centre
            away = shapely.distance(shapely.points(points[:, :2]), near)
            assert away.max() < 0.02, lane.id
            along = shapely.line_locate_point(near, shapely.points(points[:, :2]))
            z = shapely.get_z(shapely.line_interpolate_point(near, along))
            assert np.abs(z - points[:, 2]).max() < 0.05, lane.id
    assert [len(p.phases) for p in first.roads.programs] == [
        len(p.phases) for p in second.roads.programs
    ]


def test_the_twin_names_the_map_and_its_terms(both_twins):
    _, second = both_twins
    entry = next(item for item in second.manifest["inputs"] if item["kind"] == "roads")
    assert entry["name"] == "map.xodr"
    assert entry["licence"] == "not stated"
    notes = second.manifest["notes"]["roads"]
    assert notes["map"]["format"] == "OpenDRIVE"
    assert notes["left_out"] == []
    assert load_twin(second.folder).site["roads"]["file"] == "map.xodr"


def test_without_an_extract_there_are_ground_roads_and_signals(write_map, tmp_path):
    site = load_site(init_site_of_map(tmp_path / "site", write_map(tee(signals=True))))
    twin = build_twin(site, tmp_path / "twin")
    notes = twin.manifest["notes"]
    assert notes["buildings"]["buildings"] == 0
    assert notes["roads"]["signal_programs"] == 1
    assert notes["surface"]["carriageway_m2"] > 2000
    assert {way for road in twin.roads.roads for way in road.ways} == {WEST, EAST, SOUTH}


def spoilt_site(folder, **fields):
    base = {
        "anchor": {"latitude": FRAME.latitude, "longitude": FRAME.longitude},
        "region": {"radius_m": 100},
        "rig": {
            "sensors": [
                {"name": "a", "model": "VLP-16", "east_m": 12, "north_m": 12, "height_m": 4}
            ]
        },
    }
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump({**base, **fields}))
    return path


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, ["osm", "is missing", "roads"]),
        ({"roads": "nowhere.xodr"}, ["roads.file", "nowhere.xodr", "not found"]),
        ({"roads": "."}, ["roads.file", "is a folder"]),
        ({"roads": {"licence": "CC0"}}, ["roads", "licence without a file"]),
        ({"roads": {"file": "map.xodr", "anchor_m": [1.0]}}, ["roads.anchor_m"]),
        ({"roads": {"fil": "map.xodr"}}, ["roads.fil", "'file'"]),
    ],
)
def test_a_wrong_site_is_told_in_a_line(write_map, tmp_path, fields, words):
    write_map(tee())
    with pytest.raises(InputError) as error:
        load_site(spoilt_site(tmp_path, **fields))
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"roads": "map.txt"}, ["map.txt", "unknown ending", ".xodr"]),
        ({"roads": "broken.xodr"}, ["broken.xodr"]),
        ({"roads": {"file": "map.xodr", "anchor_m": [1.0, 2.0]}}, ["anchor_m", "on earth"]),
        ({"roads": {"file": "map.xodr", "driving_side": "left"}}, ["driving_side", "right"]),
        (
            {"roads": "map.xodr", "anchor": {"latitude": 48.72, "longitude": 9.18}},
            ["map.xodr", "no road within the region", "2.1 km away"],
        ),
        ({"roads": "map.xodr", "osm": "far.osm"}, ["far.osm", "nothing within the region"]),
    ],
)
def test_a_wrong_map_is_told_in_a_line_and_nothing_is_written(write_map, tmp_path, fields, words):
    write_map(tee())
    (tmp_path / "map.txt").write_text("")
    (tmp_path / "broken.xodr").write_text("<OpenDRIVE><road")
    (tmp_path / "far.osm").write_text(
        '<osm version="0.6"><node id="1" lat="10" lon="10"><tag k="a" v="b"/></node></osm>'
    )
    site = load_site(spoilt_site(tmp_path, **fields))
    with pytest.raises(InputError) as error:
        build_twin(site, tmp_path / "twin")
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "twin").exists()
