"""A map of the roads at the command line: from the file to a dataset, and what is wrong with it."""

import json
import shutil

import numpy as np
import pytest
import yaml

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive import write_opendrive


@pytest.fixture(scope="module")
def map_file(open_avenues_twin, tmp_path_factory):
    """The example's roads as OpenDRIVE, as somebody might hand them over."""
    folder, twin = tmp_path_factory.mktemp("map"), open_avenues_twin
    model = LaneModel.load(twin.folder / "lane_model.json")
    write_opendrive(model, twin.frame, folder / "avenues.xodr", name="avenues")
    return folder / "avenues.xodr"


@pytest.fixture(scope="module")
def begun(map_file, run_once, tmp_path_factory):
    """What `init` makes of it, and what it tells."""
    folder = tmp_path_factory.mktemp("begun") / "site"
    outcome = run_once("init", map_file, "-o", folder, "--json")
    assert outcome.code == 0, outcome.err
    return folder, json.loads(outcome.out)


@pytest.fixture
def site(begun, tmp_path):
    return shutil.copytree(begun[0], tmp_path / "site")


@pytest.mark.thorough
def test_from_a_map_to_frames(begun, site, run_here, tmp_path):
    twin, motion = tmp_path / "twin", tmp_path / "motion"
    assert begun[1]["name"] == "Long Avenue / Cross Street"
    assert begun[1]["next"] == f"urbantwin run {begun[0] / 'site.yaml'}"
    fields = yaml.safe_load((site / "site.yaml").read_text())
    fields |= {"region": {"radius_m": 60}, "closed_loop": False}
    fields["traffic"] |= {"duration_s": 1, "warmup_s": 20, "per_hour": {"car": 300}}
    fields["rig"]["sensors"][0]["columns"] = 512
    (site / "site.yaml").write_text(yaml.safe_dump(fields))
    outcome = run_here("build", site / "site.yaml", "-o", twin, "--no-pictures")
    assert outcome.code == 0, outcome.err
    assert "left_out" not in outcome.out or "without a name" not in outcome.out
    outcome = run_here("drive", twin, "-o", motion, "--json")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["actors"]["car"] > 0
    out = tmp_path / "dataset"
    outcome = run_here(
        "record", twin, motion, "-o", out, "--stop", "0.2", "--no-pictures", "--workers", "1"
    )
    assert outcome.code == 0, outcome.err
    points = np.load(out / "points" / "000000.npy")
    assert len(points) > 1000
    manifest = json.loads((out / "dataset.json").read_text())
    assert "avenues.xodr" in json.dumps(manifest["inputs"])


def test_inspect_tells_what_a_map_holds(map_file, run_here, shared_data):
    found = json.loads(run_here("info", map_file, "--json").out)
    assert (found["kind"], found["format"], found["version"]) == ("roads", "OpenDRIVE", "1.8")
    assert found["signals"] > 8
    assert found["metres_of_lanes"]["driving"] > 500
    assert found["georeference"].startswith("+proj=tmerc")
    lanelets = shared_data / "tracks" / "karlsruhe-k733" / "k733.lanelet2.osm"
    found = json.loads(run_here("info", lanelets, "--json").out)
    assert found["format"] == "Lanelet2"
    assert found["lanelets"] == 38
    extract = shared_data / "osm" / "perth_stretched_lights.osm"
    assert json.loads(run_here("info", extract, "--json").out)["kind"] == "osm"


@pytest.mark.thorough
def test_the_folder_may_come_first_too(map_file, begun, run_here, tmp_path):
    outcome = run_here("init", tmp_path / "a", "--roads", map_file)
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "a" / "site.yaml").read_text() == (begun[0] / "site.yaml").read_text()


@pytest.mark.thorough
def test_an_extract_may_come_with_it(map_file, run_here, two_avenues, tmp_path):
    extract = next(two_avenues.glob("*.osm"))
    outcome = run_here("init", map_file, "-o", tmp_path / "a", "--osm", extract)
    assert outcome.code == 0, outcome.err
    fields = yaml.safe_load((tmp_path / "a" / "site.yaml").read_text())
    assert fields["osm"]["file"] == extract.name
    assert fields["roads"]["file"] == "avenues.xodr"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("here",), ["--osm", "--roads"]),
        (("nowhere.xodr", "-o", "here"), ["nowhere.xodr"]),
        (("empty.xodr", "-o", "here"), ["empty.xodr"]),
        (("here", "--roads", "map.pdf"), ["map.pdf", "unknown ending"]),
        (("map.xodr", "-o", "here", "--roads", "map.xodr"), ["second map"]),
        (("map.xodr", "-o", "here", "--lat", "91", "--lon", "0"), ["--lat"]),
        (("map.xodr", "-o", "here", "--lat", "10", "--lon", "10"), ["map.xodr", "km away"]),
        (("map.xodr", "-o", "here", "--radius", "9999"), ["9999"]),
    ],
)
def test_what_is_wrong_is_told_in_a_line(
    map_file, run_here, tmp_path, monkeypatch, arguments, words
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(map_file, tmp_path / "map.xodr")
    (tmp_path / "empty.xodr").write_bytes(b"")
    (tmp_path / "map.pdf").write_bytes(b"%PDF")
    outcome = run_here("init", *arguments)
    assert outcome.code == 2
    for word in words:
        assert word in outcome.err
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "here").exists()


def test_a_site_without_a_map_is_told_in_a_line(run_here, tmp_path):
    (tmp_path / "site.yaml").write_text(
        "anchor: {latitude: 48.7, longitude: 9.18}\n"
        "rig: {sensors: [{name: a, model: VLP-16, east_m: 9, north_m: 9, height_m: 4}]}\n"
    )
    outcome = run_here("build", tmp_path / "site.yaml", "-o", tmp_path / "twin")
    assert outcome.code == 2
    assert outcome.err.count("\n") == 1
    assert "osm: is missing; expected an OpenStreetMap extract, or else a map" in outcome.err


def test_a_map_far_away_is_told_with_the_distance(site, run_here, tmp_path):
    fields = yaml.safe_load((site / "site.yaml").read_text())
    frame = SiteFrame(fields["anchor"]["latitude"], fields["anchor"]["longitude"])
    longitude, latitude = frame.lonlat_from_site([[0.0, 1500.0]])[0]
    fields["anchor"] = {"latitude": float(latitude), "longitude": float(longitude)}
    (site / "site.yaml").write_text(yaml.safe_dump(fields))
    outcome = run_here("build", site / "site.yaml", "-o", tmp_path / "twin")
    assert outcome.code == 2
    assert "has no road within the region: the nearest is 1" in outcome.err
    assert not (tmp_path / "twin").exists()
