"""What ``urbantwin record`` can change of a rig, and what it says of rigs that cannot record."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from urbantwin.cli import main
from urbantwin.traffic.motion import MOTION_VERSION

STANDING = {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0}
RIDING = {"name": "a", "model": "VLP-16", "forward_m": 0.0, "left_m": 0.0, "above_roof_m": 0.2}


@pytest.fixture(scope="module")
def recorded(twin, motion, tmp_path_factory):
    """Record with options: ``recorded(rig, *options)`` -> exit code, manifest, folder."""
    base = tmp_path_factory.mktemp("options")
    manifest = {"kind": "motion", "version": MOTION_VERSION, **motion.manifest}
    replace(motion, manifest=manifest).save(base / "motion")
    count = iter(range(1000))

    def record(rig, *options, start=0.5, stop=0.6):
        folder = base / str(next(count))
        folder.mkdir()
        file = folder / "rig.yaml"
        file.write_text(yaml.safe_dump({"rate_hz": 10.0, "frame": "site", **rig}))
        fixed = ["--rig", file, "-o", folder / "out", "--no-pictures", "-q", "--seed", "1"]
        span = ["--start", start, "--stop", stop, "--workers", "1"]
        arguments = ["record", twin.folder, base / "motion", *fixed, *span, *options]
        code = main([str(one) for one in arguments])
        manifest = folder / "out" / "dataset.json"
        return code, json.loads(manifest.read_text()) if code == 0 else None, folder / "out"

    return record


def points_of(folder, index=5):
    return np.load(folder / "points" / f"{index:06d}.npy")


def test_without_effects_the_road_is_where_it_is(recorded):
    code, manifest, out = recorded({"sensors": [STANDING]}, "--effects", "none")
    assert code == 0
    assert not any(manifest["rig"]["sensors"][0]["effects"].values())
    points, labels = points_of(out), np.fromfile(out / "semantic" / "000005.label", "<u4")
    road = points[(labels & 0xFFFF) == 40]
    assert len(road) > 1000
    assert np.abs(road[:, 2]).max() < 1e-4
    rays = np.load(out / "rays" / "000005.npy")
    assert np.abs(rays["time"]).max() == 0.0


def test_one_effect_alone(recorded):
    _, manifest, out = recorded({"sensors": [STANDING]}, "--effects", "none,noise")
    effects = manifest["rig"]["sensors"][0]["effects"]
    assert [name for name, on in effects.items() if on] == ["noise"]
    labels = np.fromfile(out / "semantic" / "000005.label", "<u4")
    road = points_of(out)[(labels & 0xFFFF) == 40]
    assert 1e-3 < np.abs(road[:, 2]).max() < 0.2


def test_weather_of_one_recording(recorded):
    _, clear, _ = recorded({"sensors": [STANDING]})
    options = ("--weather", "fog", "--visibility", "25")
    _, fog, _ = recorded({"sensors": [STANDING]}, *options)
    assert fog["rig"]["conditions"]["weather"] == "fog"
    assert fog["rig"]["conditions"]["visibility_m"] == 25.0
    assert clear["rig"]["conditions"]["weather"] == "clear"
    far = [counts["counts"]["points_by_class"].get("road", 0) for counts in (clear, fog)]
    assert far[1] < 0.9 * far[0]


def test_sensors_apart_see_what_they_see_together(recorded):
    other = STANDING | {"name": "b", "east_m": 10.0, "height_m": 4.0}
    rig = {"sensors": [STANDING, other]}
    _, together, out = recorded(rig)
    _, _, apart = recorded(rig, "--separate")
    rays = np.load(out / "rays" / "000005.npy")
    assert len(together["rig"]["sensors"]) == 2
    for number, name in enumerate("ab"):
        own = points_of(apart / name)
        np.testing.assert_array_equal(own, points_of(out)[rays["sensor"] == number])


def test_a_rig_on_a_car(recorded):
    rig = {"ride": {"class": "car"}, "sensors": [RIDING]}
    code, manifest, out = recorded(rig, "--ride", "4")
    assert code == 0
    assert manifest["rig"]["carrier"] == 4
    assert manifest["dataset_SE3_site"] is None
    assert len(manifest["frames"][0]["dataset_SE3_site"]) == 4
    tracks = np.fromfile(out / "semantic" / "000005.label", "<u4") >> 16
    assert 4 not in np.unique(tracks)
    assert len(points_of(out)) > 1000
    boxes = (out / "labels" / "000005.txt").read_text().split()
    assert boxes.count("car") == 1


BAD = {
    "leaves": ({"ride": {"track": 4}, "sensors": [RIDING]}, (), 0.0,
               "ride: car 4, which carries the rig, is there from 0.2 to 1.1 s"),
    "unknown": ({"ride": {"track": 5}, "sensors": [RIDING]}, (), 0.5, "no track 5"),
    "no bus": ({"ride": {"class": "bus"}, "sensors": [RIDING]}, (), 0.5, "the motion has no bus"),
    "by option": ({"ride": {"track": 4}, "sensors": [RIDING]}, ("--ride", "bus"), 0.5, "no bus"),
    "stands": ({"sensors": [STANDING]}, ("--ride", "4"), 0.5, "the rig is static"),
    "effect": ({"sensors": [STANDING]}, ("--effects", "fog"), 0.5, "there is no effect 'fog'"),
    "weather": ({"sensors": [STANDING]}, ("--weather", "hail"), 0.5, "is 'hail'; expected 'clear'"),
    "visibility": ({"sensors": [STANDING]}, ("--visibility", "0"), 0.5, "expected more than 0"),
    "deep": ({"sensors": [STANDING | {"height_m": None, "up_m": -2.0}]}, (), 0.5,
             "sensors[0].up_m: -2 m is under the ground, which is at 0.00 m there"),
    "altitude": ({"sensors": [STANDING | {"height_m": None, "altitude_m": 9.0}]}, (), 0.5,
                 "the site has no DEM"),
}  # fmt: skip


@pytest.mark.parametrize(("rig", "options", "start", "words"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_recorded_is_told_in_one_line(recorded, capsys, rig, options, start, words):
    code, _, out = recorded(rig, *options, start=start)
    told = capsys.readouterr().err
    assert code == 2
    assert words in told
    assert told.count("\n") == 1
    assert not out.exists()
