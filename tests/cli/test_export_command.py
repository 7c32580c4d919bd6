"""Exports, opened by the programs that they are for."""

import json
import re
import shutil
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from lxml import etree
from pyproj import Transformer

from urbantwin.roads.netconvert import sumo_binary, sumo_environment
from urbantwin.twin import load_twin


@pytest.fixture
def twin(two_avenues_twin):
    return two_avenues_twin.folder


def test_opendrive_is_written_in_the_version_asked_for(twin, run_here, tmp_path):
    for asked, minor in (([], "8"), (["--version", "1.4"], "4")):
        path = tmp_path / f"map{minor}.xodr"
        done = run_here("export", twin, "--to", "opendrive", *asked, "-o", path)
        assert done.code == 0, done.err
        header = ElementTree.parse(path).getroot().find("header")
        assert (header.get("revMajor"), header.get("revMinor")) == ("1", minor)
        assert header.find("geoReference").text == load_twin(twin).frame.proj


def test_geojson_is_where_the_lanes_are(twin, run_here, tmp_path):
    path = tmp_path / "lanes.geojson"
    assert run_here("export", twin, "--to", "geojson", "-o", path).code == 0
    document = json.loads(path.read_text())
    network, frame = load_twin(twin).roads, load_twin(twin).frame
    layers = [feature["properties"]["layer"] for feature in document["features"]]
    counts = {layer: layers.count(layer) for layer in set(layers)}
    crossings = sum(lane.kind == "crossing" for lane in network.lanes)
    walking = sum(lane.kind == "walkingarea" for lane in network.lanes)
    areas = sum(lane.polygon.area > 0 for lane in network.lanes)  # a corner may be a mere point
    assert counts["lane"] == areas - crossings
    assert counts["centre_line"] == len(network.lanes) - crossings - walking
    assert counts["crossing"] == crossings
    heads = [one for one in load_twin(twin).lane_model.signals if one.dynamic]
    assert counts["signal"] == len(heads)
    # pyproj's own reading of the frame leads back to the lanes.
    back = Transformer.from_crs("EPSG:4326", frame.proj, always_xy=True)
    for feature in document["features"]:
        if feature["properties"]["layer"] == "centre_line":
            lon, lat = np.array(feature["geometry"]["coordinates"]).T
            xy = np.column_stack(back.transform(lon, lat))
            lane = network.lane_by_id[feature["properties"]["id"]]
            assert np.abs(xy - lane.centre[:, :2]).max() < 0.005
        if feature["geometry"]["type"] == "Polygon":
            ring = shapely.LinearRing(feature["geometry"]["coordinates"][0])
            assert ring.is_ccw  # RFC 7946, 3.1.6


def test_sumo_runs_the_exported_folder_as_it_is(twin, planned_once, run_here, tmp_path):
    folder = tmp_path / "sumo"
    for _ in range(2):  # an older export is replaced
        assert run_here("export", twin, "--to", "sumo", "-o", folder).code == 0
    done = subprocess.run(
        [sumo_binary("sumo"), "-c", folder / "twin.sumocfg", "--end", "2"],
        capture_output=True,
        text=True,
        check=False,
        env=sumo_environment(),
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    configured = etree.parse(folder / "twin.sumocfg").find("input/net-file").get("value")
    assert (folder / configured).read_bytes() == (twin / "network.net.xml").read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--to", "collada"], "one of opendrive, geojson, sumo, carla, plan"),
        (["--to", "opendrive", "--version", "1.6"], "one of 1.8, 1.4"),
        (["--to", "sumo", "--version", "1.4"], "expected none"),
        ([], "--to"),
    ],
)
def test_wrong_options_are_told_in_one_line(twin, run_here, tmp_path, options, words):
    done = run_here("export", twin, *options, "-o", tmp_path / "out")
    assert done.code == 2
    assert words in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_what_is_no_twin_is_told_in_one_line(run_here, tmp_path):
    done = run_here("export", tmp_path, "--to", "geojson", "-o", tmp_path / "x.geojson")
    assert done.code == 2
    assert len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_format_that_nobody_knows_is_told_whatever_is_exported(run_here, tmp_path):
    done = run_here("export", tmp_path, "--to", "kity")
    assert done.code == 2
    assert len(done.err.strip().splitlines()) == 1
    assert "'kity' is not a format" in done.err
    assert all(name in done.err for name in ("opendrive", "tracks", "kitti", "challenge"))


def test_a_format_of_something_else_is_told(twin, run_here, tmp_path):
    done = run_here("export", twin, "--to", "kitti", "-o", tmp_path / "out")
    assert done.code == 2
    assert "is a twin, and kitti is of a dataset" in done.err
    assert "opendrive" in done.err.rpartition("expected")[2]
    assert not list(tmp_path.iterdir())


def test_a_folder_of_somebodys_own_is_left_alone(twin, run_here, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    assert run_here("export", twin, "--to", "sumo", "-o", tmp_path).code == 2
    assert run_here("export", twin, "--to", "geojson", "-o", tmp_path).code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_every_format_is_named_in_the_help(run_here):
    from urbantwin.exports import FORMATS
    from urbantwin.exports.frames import DATASET_FORMATS

    done = run_here("export", "--help")
    for name in (*FORMATS, *DATASET_FORMATS):
        assert re.search(rf"\b{name}\b", done.out), name


def test_a_street_s_name_does_not_make_folders(twin, run_here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    manifest = json.loads((twin / "twin.json").read_text())
    renamed = tmp_path / "renamed"
    shutil.copytree(twin, renamed)
    (renamed / "twin.json").write_text(json.dumps({**manifest, "name": "High Street / A\\B: C?"}))
    assert run_here("export", renamed, "--to", "opendrive").code == 0
    assert [path.name for path in tmp_path.glob("*.xodr")] == ["High Street-A-B-C.xodr"]
