"""Sensors found in points alone, against worlds whose rays are cast by closed forms."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.fidelity.discovery import discover, write_frames, write_rig
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar import load_sensor, sensor
from urbantwin.progress import untold

from .closed_form_street import scan

discovery = importlib.import_module("urbantwin.fidelity.discovery.discover")


@pytest.fixture(scope="module")
def fused():
    """Two frames of two sensors, neither upright, with the sensor and ring of every point."""
    random = np.random.default_rng(4)
    rig = [
        (sensor("HDL-32E"), (-8.0, -5.0, 3.6), (30.0, 4.0, -2.0), 400),
        (sensor("VLP-16"), (9.0, -2.0, 2.4), (-70.0, -1.5, 2.0), 400),
    ]
    frames, sensors, rings = [], [], []
    for turn in range(2):
        parts = [scan(*one, random, 0.13 * turn) for one in rig]
        frames.append(np.concatenate([points for points, _ in parts]))
        rings.append(np.concatenate([ring for _, ring in parts]))
        sensors.append(np.repeat([0, 1], [len(points) for points, _ in parts]))
    return rig, frames, sensors, rings


@pytest.fixture(scope="module")
def found(fused):
    _, frames, _, _ = fused
    models = [sensor(name) for name in ("VLP-16", "VLP-16-Hi-Res", "HDL-32E")]
    return discover(frames[:1], ["0"], models=models)


@pytest.mark.thorough
def test_two_tilted_sensors_are_found(fused, found):
    rig, *_ = fused
    assert len(found.sensors) == 2
    for one, (model, place, angles, columns) in zip(found.sensors, rig, strict=True):
        assert model.name in one.models
        np.testing.assert_allclose(one.place, place, atol=0.05)
        axis = rotation_from_ypr(*np.radians(angles))[:, 2]
        assert np.degrees(np.arccos(axis @ one.fit.seen_from.axis)) < 0.1
        assert one.columns == columns
        assert not one.dual
        off = np.abs(one.place - place)
        assert (off < 4 * one.sigma_m).all()
        assert one.sigma_tilt_deg < 0.2


@pytest.mark.thorough
def test_a_sensor_that_was_missed_is_found_in_what_the_others_leave(fused):
    """The search among all points is made to miss one of two."""
    (_, place, *_), *_ = fused[0][1:]
    frames, names = fused[1][:1], ["0"]
    models = [sensor(name) for name in ("VLP-16", "VLP-16-Hi-Res", "HDL-32E")]
    every = discovery._found(frames, names, models, 24, 0, untold)
    of = [one for one in every.fits if not np.allclose(one[0].seen_from.place, place, atol=0.3)]
    assert len(of) == 1
    missing = discovery._fitted(frames, names, of, untold)
    assert missing.discovery.on_rings < 0.9
    whole = discovery._with_missed(frames, names, models, missing, 0, untold).discovery
    assert len(whole.sensors) == 2
    np.testing.assert_allclose(whole.sensors[1].place, place, atol=0.05)
    assert "VLP-16" in whole.sensors[1].models
    assert not whole.warnings
    # Of several sensors one may be missed though most points are on rings; of one, many are off.
    assert replace(whole, on_rings=0.84).warnings
    assert not replace(whole, sensors=whole.sensors[:1], on_rings=0.84).warnings


@pytest.mark.thorough
def test_several_turns_in_one_cloud_are_told_and_their_sensors_found(fused, found):
    (_, vlp16), *_ = fused
    random = np.random.default_rng(9)
    cloud = np.concatenate([scan(*vlp16, random, 0.0)[0] for _ in range(3)])
    models = [sensor(name) for name in ("VLP-16", "VLP-16-Hi-Res")]
    crowded = discover([cloud], ["0"], models=models)
    assert [one.models for one in crowded.sensors] == [found.sensors[1].models]
    assert not any(one.dual for one in crowded.sensors)
    assert crowded.turns == pytest.approx(3.0, rel=0.1)
    (warned,) = crowded.warnings
    assert "several turns were put together" in str(warned)
    assert found.turns == pytest.approx(1.0, abs=0.1)
    assert not found.warnings


def test_points_get_their_sensor_and_ring(fused, found):
    _, frames, sensors, rings = fused
    rays = found.rays(frames[1])
    mine = rays.sensor >= 0
    assert mine.mean() > 0.97
    right = rays.sensor[mine] == sensors[1][mine]
    assert right.mean() > 0.97
    assert (rays.ring[mine] == rings[1][mine])[right].mean() > 0.999


def test_the_order_of_points_does_not_matter(fused, found):
    _, frames, _, _ = fused
    order = np.random.default_rng(0).permutation(len(frames[0]))
    rays, shuffled = found.rays(frames[0]), found.rays(frames[0][order])
    np.testing.assert_array_equal(rays.sensor[order], shuffled.sensor)


def test_what_was_found_is_a_rig_and_frames(fused, found, tmp_path: Path):
    _, frames, _, _ = fused
    write_rig(found, tmp_path / "rig.yaml")
    document = yaml.safe_load((tmp_path / "rig.yaml").read_text())
    assert [one["name"] for one in document["sensors"]] == ["sensor-1", "sensor-2"]
    np.testing.assert_allclose(document["sensors"][0]["up_m"], 3.6, atol=0.05)
    folder = tmp_path / "rings"
    folder.mkdir()
    written = write_frames(found, [Frame(frames[0], name="0.bin")], folder)
    assert written["frames"] == 1
    again = open_recording(folder).read(0)
    rays = found.rays(frames[0])
    np.testing.assert_array_equal(again.sensor, rays.sensor)
    np.testing.assert_array_equal(again.ring, rays.ring)
    on = again.sensor == 0
    assert again.column[on].min() >= 0
    assert again.column[on].max() < 400


@pytest.mark.thorough
def test_a_model_that_nobody_knows_is_measured(tmp_path: Path):
    random = np.random.default_rng(1)
    points, _ = scan(sensor("VLP-16"), (0.0, 0.0, 2.0), (0.0, 2.0, 1.0), 600, random)
    found = discover([points], ["0"], models=[sensor("OS1-128")])
    (one,) = found.sensors
    assert one.models == ()
    np.testing.assert_allclose(one.place, [0, 0, 2.0], atol=0.1)
    seen = np.sort(one.fit.unit.elevation_deg[one.fit.looks > 5])
    nearest = np.abs(seen[:, None] - np.arange(-15, 16, 2)).min(axis=1)
    assert len(seen) > 8
    assert nearest.max() < 0.3
    (unit,) = write_rig(found, tmp_path / "rig.yaml")
    assert load_sensor(unit).channels == one.fit.unit.table_deg.size


def test_frames_that_tell_nothing_are_refused_in_one_line(fused):
    _, frames, _, _ = fused
    near = frames[0][np.abs(frames[0] - [6.0, 3.0, 0.0]).max(axis=1) < 1.5]
    with pytest.raises(InputError, match="no ring is left"):
        discover([near], ["0"])
    with pytest.raises(InputError, match="expected metres"):
        discover([frames[0] * 1000], ["0"])
    with pytest.raises(InputError, match="expected z that points up"):
        discover([frames[0] * [1, -1, -1]], ["0"])
    # Forty boxes here, and forty elsewhere.
    random = np.random.default_rng(2)
    places = [
        np.concatenate([(c + random.uniform(0, [1, 1, 3], (60, 3))) for c in centres])
        for centres in (np.column_stack([random.uniform(-30, 30, (2, 60)).T, np.zeros(60)])
                        for _ in range(2))
    ]  # fmt: skip
    with pytest.raises(InputError, match="do not show the same place"):
        discover(places, ["0", "1"])
