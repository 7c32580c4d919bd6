"""A measured background beside what frames were made from, and as a recording sees it."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.measured_background import measured_background
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, beam_directions, place_rig
from urbantwin.lidar.measured import MeasuredBackground, with_background
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id


def quad(corners, name="road"):
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id(name), material_id("asphalt")
    )


def ground():
    return quad([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]])


def wall():
    return quad([[12, -40, 0], [12, 40, 0], [12, 40, 30], [12, -40, 30]], "building")


def rig(**more):
    sensor = {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 3, **more}
    return place_rig(RigSpec.model_validate({"frame": "sensor", "sensors": [sensor]}), ground())


def spherical(channels=8, columns=90):
    elevation = np.radians(np.linspace(-20, 10, channels))[:, None]
    azimuth = np.radians(np.arange(columns) * 360 / columns)
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation) + 0 * azimuth,
        ],
        axis=-1,
    ).reshape(-1, 3)


def test_modes_spread_and_drop_out_are_those_that_frames_were_made_with():
    """Every beam: a surface with 3 cm of noise, lost in 3 looks of 10, hidden in a fifth."""
    aim, generator = spherical(), np.random.default_rng(1)
    true = generator.uniform(8.0, 90.0, len(aim))
    frames = []
    for _ in range(200):
        range_m = true + generator.normal(0, 0.03, len(aim))
        hidden = generator.random(len(aim)) < 0.2
        range_m[hidden] = generator.uniform(2.0, 7.0, hidden.sum())
        kept = hidden | (generator.random(len(aim)) < 0.7)
        frames.append(Frame(aim[kept] * range_m[kept, None], np.full(kept.sum(), 51.0)))
    found = measured_background(frames, aim, (8, 90), intensity_scale=255.0)
    assert np.abs(found.range_m.ravel() - true).max() < 0.02
    assert np.median(found.sigma_m) == pytest.approx(0.03, rel=0.05)
    assert found.returned.mean() == pytest.approx(0.7, abs=0.01)
    assert found.intensity == pytest.approx(0.2, abs=1e-6)


def test_a_twin_without_a_wall_that_was_measured_records_the_wall(tmp_path):
    with_wall = LabelledMesh.concatenate([ground(), wall()])
    real = Scanner(with_wall, rig(effects=False), 0).scan(0, [])
    (mounted,) = rig(effects=False).sensors
    aim = beam_directions(mounted.sensor, mounted.columns)
    frame = Frame(real.points[:, :3].astype(float), real.points[:, 3].astype(float))
    found = measured_background([frame] * 3, aim.reshape(-1, 3), aim.shape[:2])
    found.save(tmp_path / "measured.npz")
    loaded = MeasuredBackground.load(tmp_path / "measured.npz")
    bare = rig(effects=False)
    one = replace(bare, sensors=(replace(bare.sensors[0], measured=loaded),))
    twin = Scanner(ground(), one, 0).scan(0, [])
    assert len(twin.points) == len(real.points)
    assert np.abs(twin.points - real.points).max() < 2e-3
    for points, seen in (
        (Scanner(ground(), bare, 0).scan(0, []).points, True),
        (twin.points, False),
    ):
        behind = (points[:, 0] > 12.5) & (np.abs(points[:, 1]) < 30)
        assert behind.any() == seen


def test_drop_out_of_a_measured_background_is_met_over_frames():
    (mounted,) = rig().sensors
    shape = (mounted.sensor.channels, mounted.columns)
    flat = np.full(shape, 20.0, np.float32)
    measured = MeasuredBackground(flat, flat / 1000, flat / 50, flat / 100)
    one = replace(rig(), sensors=(replace(mounted, measured=measured),))
    points = Scanner(ground(), one, 0).scan(0, []).points
    count = flat.size
    assert len(points) / count == pytest.approx(0.4, abs=4 * np.sqrt(0.24 / count))
    assert np.linalg.norm(points[:, :3], axis=1) == pytest.approx(20.0, abs=0.15)


def test_a_background_of_another_sensor_is_not_taken():
    image = np.ones((4, 100), np.float32)
    measured = MeasuredBackground(image, image, image, image)
    with pytest.raises(InputError, match="4 channels by 100 columns"):
        with_background(rig(), measured)
    (mounted,) = with_background(rig(), flat_background()).sensors
    assert mounted.measured is not None


def flat_background():
    (mounted,) = rig().sensors
    image = np.ones((mounted.sensor.channels, mounted.columns), np.float32)
    return MeasuredBackground(image, image, image, image)


def test_what_is_no_background_is_said(tmp_path):
    file = tmp_path / "measured.npz"
    with pytest.raises(InputError, match="not found"):
        MeasuredBackground.load(file)
    file.write_bytes(b"nothing")
    with pytest.raises(InputError):
        MeasuredBackground.load(file)
    image = np.ones((2, 3), np.float32)
    np.savez(file, range_m=image, sigma_m=image, returned=image * 2, intensity=image)
    with pytest.raises(InputError, match="out of bounds"):
        MeasuredBackground.load(file)
    with pytest.raises(InputError, match="no point"):
        measured_background([], spherical(), (8, 90))
