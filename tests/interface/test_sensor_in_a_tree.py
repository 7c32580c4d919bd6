"""A tree where a pole would stand: `init` proposes another place, and `build` moves or tells."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.geometry import SiteFrame
from urbantwin.lidar import place_rig
from urbantwin.lidar.sight import rig_coverage
from urbantwin.site import RigSpec, load_site
from urbantwin.taxonomy import semantic_id

from ..site.conftest import LATITUDE, LONGITUDE, OSM

PLACE = {"lat": LATITUDE, "lon": LONGITUDE, "radius": 80.0}


def with_tree(place: np.ndarray) -> str:
    """The crossing with a large old tree at a place of the site frame."""
    longitude, latitude = SiteFrame(LATITUDE, LONGITUDE).lonlat_from_site(place[None])[0]
    tags = {"natural": "tree", "height": "16", "diameter_crown": "12"}
    text = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
    node = f'<node id="6" lat="{latitude}" lon="{longitude}">{text}</node>'
    return OSM.replace('<way id="10">', node + '<way id="10">')


def place_of(site: Path) -> np.ndarray:
    one = load_site(site).rig.sensors[0]
    return np.array([one.east_m, one.north_m])


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bare")
    (folder / "map.osm").write_text(OSM)
    return ut.init(folder, osm=folder / "map.osm", progress=False, **PLACE).path


@pytest.fixture(scope="module")
def overgrown(bare: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of the bare crossing, and in the map a tree where its sensor stands."""
    folder = tmp_path_factory.mktemp("overgrown")
    (folder / "map.osm").write_text(with_tree(place_of(bare)))
    (folder / "site.yaml").write_text(bare.read_text(encoding="utf-8"))
    return folder / "site.yaml"


@pytest.fixture(scope="module")
def built(overgrown: Path) -> ut.Twin:
    return ut.build(overgrown, pictures=False, progress=False)


def seen_of_street(twin: ut.Twin, place: dict[str, float]) -> float:
    """Share of the street within 50 m that a sensor covers 1 m above it: `lidar.sight.coverage`."""
    one = {"name": "pole", "model": "OS1-128", "columns": 1024, **place}
    rig = place_rig(RigSpec.model_validate({"sensors": [one]}), twin.mesh)
    found = rig_coverage(rig, twin.mesh, (-50, -50, 50, 50), cell_m=2.0)
    road = found.cells.semantic == semantic_id("road")
    return float((found.per_frame("facing") >= 1.0)[road].mean())


def test_a_proposed_sensor_stands_clear_of_a_tree(bare: Path, overgrown: Path, tmp_path: Path):
    here = ut.init(tmp_path, osm=overgrown.parent / "map.osm", progress=False, **PLACE).path
    assert np.linalg.norm(place_of(here) - place_of(bare)) > 6.0 + 3.0
    assert " % is in sight" in here.read_text()


def test_a_build_moves_a_proposed_sensor_out_of_a_tree(overgrown: Path, built: ut.Twin):
    one = built.rig_spec().sensors[0]
    place = np.array([one.east_m, one.north_m])
    crown = built.mesh.select(built.mesh.semantic == semantic_id("vegetation"))
    assert np.linalg.norm(crown.vertices[:, :2] - place, axis=1).min() > 3.0
    pose = {
        name: getattr(one, name)
        for name in ("east_m", "north_m", "height_m", "yaw_deg", "pitch_deg")
    }
    assert seen_of_street(built, pose) > 0.8
    assert built.manifest["notes"]["sensors"]["seen"] > 0.8
    assert not [told for told in built.warnings if told.about.startswith("sensor")]
    # The twin's own site holds the place where it stands now, which is nobody's proposal.
    kept = yaml.safe_load((built.folder / "rig.yaml").read_text())["sensors"][0]
    assert "proposed" not in kept
    proposed = yaml.safe_load(overgrown.read_text(encoding="utf-8"))["rig"]["sensors"][0]
    ways = [proposed[key] - kept[key] for key in ("east_m", "north_m", "height_m")]
    moved = built.summary()["sensors_moved_from_their_proposal_m"]
    assert moved == {one.name: pytest.approx(math.hypot(*ways), abs=0.06)}
    assert kept["east_m"] == one.east_m


@pytest.mark.thorough
def test_a_twin_whose_sensor_moved_is_made_again_from_what_it_was_made_from(
    overgrown: Path, built: ut.Twin, tmp_path: Path
):
    """The scene's clutter keeps clear of where the sensor was proposed, not of where it went."""
    site = dict(built.manifest["made_from"]["site"])
    assert site["rig"]["sensors"][0]["proposed"] is True
    assert site["rig"]["sensors"][0]["east_m"] == place_of(overgrown)[0]
    (tmp_path / "map.osm").write_bytes((overgrown.parent / "map.osm").read_bytes())
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site))
    again = ut.build(tmp_path / "site.yaml", pictures=False, progress=False)
    assert again.manifest["files"] == built.manifest["files"]


@pytest.mark.thorough
def test_a_build_leaves_a_sensor_that_somebody_placed_and_tells_what_hides_the_junction(
    overgrown: Path, built: ut.Twin, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    rig = tmp_path / "rig.yaml"
    one = yaml.safe_load(overgrown.read_text(encoding="utf-8"))["rig"]["sensors"][0]
    given = {key: value for key, value in one.items() if key not in ("proposed", "effects")}
    # Within the crown, and beside the trunk: inside that it would be refused.
    given |= {"east_m": given["east_m"] + 1.0, "height_m": 9.0}
    rig.write_text(yaml.safe_dump({"sensors": [given]}))
    told = ut.rig.coverage(built, tmp_path / "coverage", rig=rig, cell=2.0, pictures=False)
    assert told.manifest["sight"]["seen"] < 0.5
    words = next(line for line in capfd.readouterr().err.splitlines() if "warning:" in line)
    assert "sensor pole: sees" in words
    assert "behind trees and hedges" in words
    assert "it would see" in words
    better = told.manifest["sight"]["by_sensor"]["pole"]["better"]
    pose = {key: value for key, value in better.items() if key != "seen"}
    assert (
        seen_of_street(built, pose) > seen_of_street(built, {key: given[key] for key in pose}) + 0.3
    )
