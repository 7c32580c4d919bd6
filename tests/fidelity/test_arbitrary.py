"""The arbitrary site: the dataset's own rig elsewhere, made once, and in every report."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from urbantwin.dataset.manifest import recipe_of_rig
from urbantwin.dataset.rig_of_manifest import rig_of_manifest
from urbantwin.fidelity import compare
from urbantwin.fidelity.arbitrary import arbitrary_recording, recording
from urbantwin.fidelity.arbitrary.recording import kept
from urbantwin.fidelity.arbitrary.rig import likely_rig, standing
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import place_rig
from urbantwin.lidar.enclosure import enclosing
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

from ..real_files import argoverse_log

SLOPE = 0.05
CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
SIDES = [
    *([0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]),
    *([2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]),
]


def street(slope=0.0, *buildings):
    corners = np.array([[-60, -60], [60, -60], [60, 60], [-60, 60]], float)
    ground = np.column_stack([corners, slope * corners[:, 0]])
    meshes = [
        LabelledMesh.build(
            ground, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
        )
    ]
    for x, y in buildings:
        solid = CUBE * [12, 12, 30] + [x - 6, y - 6, -5]
        meshes.append(
            LabelledMesh.build(solid, SIDES, semantic_id("building"), material_id("brick"))
        )
    return LabelledMesh.concatenate(meshes)


def rig(mesh, frame="level"):
    sensors = [
        {"name": "a", "model": "VLP-16", "east_m": 10, "north_m": 0, "height_m": 5, "yaw_deg": 30},
        {
            **{"name": "b", "model": "OS1-128", "east_m": -8, "north_m": 3, "height_m": 4},
            **{"pitch_deg": 6, "returns": "dual", "columns": 512, "clock_drift_ppm": 3},
            "outages": [{"sector_deg": [10, 20]}],
            "sway": {"rms_m": 0.01},
            "effects": {"noise": False},
            "calibration": {"range_noise": 1.3},
        },
    ]
    return place_rig(RigSpec.model_validate({"frame": frame, "sensors": sensors}), mesh)


def riding_rig():
    sensor = {"name": "r", "model": "VLP-32C", "forward_m": 0.4, "left_m": 0, "above_roof_m": 0.3}
    spec = RigSpec.model_validate({"ride": {"class": "car"}, "sensors": [sensor]})
    return place_rig(spec, LabelledMesh.empty(), file="rig.yaml")


@pytest.mark.parametrize("made", [lambda: rig(street()), riding_rig], ids=["stands", "rides"])
def test_a_manifest_gives_its_rig_back(made):
    one = made()
    told = json.loads(json.dumps(recipe_of_rig(one)))
    found = rig_of_manifest(told)
    assert found is not None
    assert json.loads(json.dumps(recipe_of_rig(found))) == told
    # One from before there were calibrations; one of somebody else; one that is damaged.
    older = json.loads(json.dumps(told))
    for sensor in older["rig"]["sensors"]:
        del sensor["calibration"]
    assert rig_of_manifest(older) is not None
    assert rig_of_manifest({"kind": "dataset", "dataset": "another's"}) is None
    del told["rig"]["sensors"][0]["sensor"]["spin"]
    assert rig_of_manifest(told) is None


def test_the_rig_stands_elsewhere_as_it_stood():
    mine = rig(street())
    place = standing(mine, street(SLOPE, (40, 40)))
    for one, before in zip(place.sensors, mine.sensors, strict=True):
        x, y, z = before.site_SE3_sensor.translation
        assert one.site_SE3_sensor.translation == pytest.approx([x, y, z + SLOPE * x])
        assert one.site_SE3_sensor.rotation == pytest.approx(before.site_SE3_sensor.rotation)
    # Where a building is in the way it is turned as a whole: distances stay.
    blocked = street(0.0, (10, 0))
    turned = standing(mine, blocked)
    there = [one.site_SE3_sensor.translation for one in turned.sensors]
    assert not any(enclosing(point, blocked) for point in there)
    assert np.linalg.norm(there[0] - there[1]) == pytest.approx(np.hypot(np.hypot(18, 3), 1))
    assert [point[2] for point in there] == pytest.approx([5, 4])


def test_the_sensor_of_other_peoples_frames(shared_data):
    sweep = open_recording(argoverse_log(shared_data)).read(0)
    spec, told = likely_rig(sweep)
    assert spec["sensors"][0]["model"] == "VLP-32C"
    assert 1.4 < spec["sensors"][0]["height_m"] < 2.4  # on the roof of a car
    assert "nearest to its rings" in told
    cropped = open_recording(shared_data / "lidar/kitti/000008.bin").read(0)
    spec, told = likely_rig(cropped)
    assert spec["sensors"][0]["model"] == "OS1-128"
    assert "the sensor is unknown" in told


def test_what_is_made_is_kept(tmp_path):
    made = []

    def make(folder: Path) -> Path:
        made.append(folder)
        (folder / "twin").mkdir()
        (folder / "frames").mkdir()
        (folder / "frames/dataset.json").write_text(f"{len(made)}")
        return folder / "frames"

    def asked(seed: int, make: Callable[[Path], Path] = make, cache: str = "cache") -> Path:
        return kept("site", {"seed": seed}, make, tmp_path / "scratch", tmp_path / cache)

    first = asked(1)
    assert asked(1) == first
    assert len(made) == 1
    assert [one.name for one in first.parent.iterdir()] == ["site"]
    assert asked(2) != first

    def fail(folder: Path) -> Path:
        (folder / "twin").mkdir()
        raise RuntimeError("no traffic")

    with pytest.raises(RuntimeError):
        asked(3, fail)
    assert len(list((tmp_path / "cache").iterdir())) == 2
    # Where nobody can write, it is made in the scratch of who asks.
    (tmp_path / "file").write_text("")
    assert asked(1, cache="file/cache") == tmp_path / "scratch/frames"
    for seed in range(4, 14):
        newest = asked(seed)
    assert newest.is_dir()
    assert len(list((tmp_path / "cache").iterdir())) == 8


@pytest.fixture
def small_example(tmp_path, monkeypatch):
    """Little of the example, whose streets are no loop: nothing is driven to see how many fit."""
    site = shutil.copytree(recording._site().parent, tmp_path / "example") / "site.yaml"
    fields = yaml.safe_load(site.read_text())
    fields |= {"region": {"radius_m": 40}, "closed_loop": False}
    fields["traffic"]["warmup_s"] = 5
    site.write_text(yaml.safe_dump(fields))
    monkeypatch.setattr(recording, "_site", lambda: site)


def test_every_report_has_an_arbitrary_site(small_example, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    sensor = {"name": "a", "model": "VLP-16", "yaw_deg": 30}
    sensor |= {"east_m": 10, "north_m": -12, "height_m": 5}
    spec = {"frame": "site", "sensors": [sensor]}
    points = np.random.default_rng(0).uniform([-30, -30, 0, 0], [30, 30, 3, 1], (4000, 4))
    for name in ("real", "twin"):
        (tmp_path / name / "points").mkdir(parents=True)
        np.save(tmp_path / name / "points/000000.npy", points.astype(np.float32))
    manifest = {"kind": "dataset", "seeds": {"record": 3}}
    manifest |= recipe_of_rig(place_rig(RigSpec.model_validate(spec), street()))
    (tmp_path / "twin/dataset.json").write_text(json.dumps(manifest))
    told = []
    report = compare(
        tmp_path / "real",
        tmp_path / "twin",
        tmp_path / "report",
        progress=lambda share, what: told.append((share, what)),
    )
    assert report.arbitrary is not None
    assert report.reduction_percent["js_occupancy"] == 100  # the twin is the real frame
    assert report.folders["arbitrary"]["name"] == "two-avenues"
    assert any("arbitrary site: " in what for _, what in told)
    assert [share for share, _ in told] == sorted(share for share, _ in told)
    # Recorded by the twin's sensor, in the twin's frame of reference.
    [folder] = (tmp_path / "cache/urbantwin/arbitrary").iterdir()
    written = json.loads((folder / "two-avenues/dataset.json").read_text())
    assert written["seeds"]["record"] == 3
    [sensor] = written["rig"]["sensors"]
    assert (sensor["model"], sensor["site_SE3_sensor"][0][3]) == ("VLP-16", pytest.approx(10))
    # The second time nothing is made.
    told.clear()
    kept_ones = arbitrary_recording(
        open_recording(tmp_path / "twin"),
        1,
        tmp_path / "scratch",
        lambda share, what: told.append(what),
    )
    assert told == ["arbitrary site: there"]
    assert kept_ones.path == folder / "two-avenues"
    # The sloping street five metres under the sensor, in the frame of reference of the twin.
    frame = kept_ones.read(0)
    assert frame.sensor_places[0] == pytest.approx([10, -12, 5])
    near = np.hypot(*(frame.points[:, :2] - [10, -12]).T) < 22
    assert abs(np.percentile(frame.points[near, 2], 20)) < 1.0
