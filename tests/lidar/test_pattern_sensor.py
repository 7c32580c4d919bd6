"""Sensors whose pattern does not repeat, from their file to labelled frames."""

import json
import shutil

import numpy as np
import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, sensor
from urbantwin.lidar.rig import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.traffic.assets import asset_mesh
from urbantwin.twin.sensor_files import copy_sensor_files

PERIOD_S = 1.0
LINES = 3
POINTS_PER_SECOND = 60_000


def rosette(time_s, line):
    """Return unit vectors (T, 3) of a wide rosette, each line turned a little further."""
    phase = 2 * np.pi * np.asarray(time_s) / PERIOD_S
    first, second = 37 * phase + 0.2 * line, -21 * phase + 0.2 * line
    azimuth = np.radians(30.0) * (np.cos(first) + np.cos(second))
    up = np.radians(16.0) * (np.sin(first) + np.sin(second))
    return np.stack([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], -1)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Return the sensor's file, with the pattern beside it."""
    folder = tmp_path_factory.mktemp("rosette")
    time_s = np.arange(20_000) / 20_000 * PERIOD_S
    beams = [rosette(time_s, line) for line in range(LINES)]
    np.savez(
        folder / "rosette.npz",
        time_s=np.tile(time_s, LINES),
        azimuth_deg=np.degrees([np.arctan2(b[:, 1], b[:, 0]) for b in beams]).ravel(),
        elevation_deg=np.degrees([np.arcsin(b[:, 2]) for b in beams]).ravel(),
        line=np.repeat(np.arange(LINES), len(time_s)),
    )
    value = {"name": "Rose", "maker": "me", "pattern": "rosette.npz", "range_min_m": 0.1}
    value |= {"points_per_second": POINTS_PER_SECOND, "range_max_m": 90}
    value |= dict.fromkeys(
        [
            "reference_reflectivity",
            "reference_range_m",
            "range_sigma_m",
            "range_resolution_m",
            "wavelength_nm",
        ]
    )
    (folder / "rose.yaml").write_text(yaml.safe_dump(value))
    return folder / "rose.yaml"


def rig_of(file, street, **more):
    one = {"name": "a", "model": str(file), "east_m": 2.0, "north_m": -3.0, "height_m": 6.0}
    one |= {"yaw_deg": 40.0, "pitch_deg": 12.0, "effects": False}
    spec = RigSpec.model_validate({"frame": "site", "sensors": [one | more]})
    return place_rig(spec, street, file="rig.yaml")


def test_the_file_gives_a_sensor(file):
    rose = sensor(file)
    assert (rose.channels, rose.columns) == (LINES, POINTS_PER_SECOND // LINES // 10)
    assert rose.pattern.period_s == pytest.approx(PERIOD_S)


@pytest.mark.parametrize("index", [0, 3, 14])
def test_frames_are_a_recast_of_the_closed_form(file, street, crowd, index):
    """Open3D judges: every beam of the frame's own part, at street and actors as they stand."""
    open3d = pytest.importorskip("open3d")
    rig = rig_of(file, street)
    actors = crowd(30, seed=5, spread=30.0)
    frame = Scanner(street, rig, seed=1).scan(index, actors)

    pose, count = rig.sensors[0].site_SE3_sensor, rig.sensors[0].columns
    time_s = index / 10 + np.arange(count) / (10 * count)
    beams = np.concatenate([rosette(time_s, line) for line in range(LINES)]) @ pose.rotation.T
    meshes = [street]
    for one in actors:
        mesh = asset_mesh(one.asset, one.phase)
        vertices = one.site_SE3_asset.apply(mesh.vertices)
        meshes.append(LabelledMesh.build(vertices, mesh.faces, mesh.semantic, mesh.material))
    world = LabelledMesh.concatenate(meshes)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(world.vertices.astype(np.float32), world.faces.astype(np.uint32))
    origin = np.broadcast_to(pose.translation, beams.shape)
    found = scene.cast_rays(np.concatenate([origin, beams], axis=1).astype(np.float32))
    judged = found["t_hit"].numpy()
    expected = (judged > 0.1) & (judged < 90)

    ray = frame.ring.astype(int) * count + frame.column
    agree = np.isin(np.flatnonzero(expected), ray)
    assert expected.sum() > 3000
    # Chords of the file's points leave the arc by 0.001 deg: a few rays pass another edge.
    assert agree.mean() > 0.999
    range_m = np.linalg.norm(frame.points[:, :3] - pose.translation, axis=1)
    near = np.abs(range_m - judged[ray]) < 0.02
    assert near.mean() > 0.995
    assert (frame.instance > 0).sum() > 100


def test_frames_differ_and_do_not_depend_on_their_order(file, street, crowd):
    rig, actors = rig_of(file, street), crowd(5, seed=2)
    scanner = Scanner(street, rig, seed=1)
    frames = [scanner.scan(index, actors) for index in (4, 0, 10)]
    again = Scanner(street, rig, seed=1).scan(4, actors)
    assert np.array_equal(frames[0].points, again.points)
    assert not np.array_equal(frames[0].points, frames[1].points)
    # A period is ten frames: without noise, frame 10 is frame 0.
    assert frames[2].points == pytest.approx(frames[1].points, abs=1e-4)


def test_a_twin_keeps_the_pattern_too(file, street, tmp_path):
    site, twin = tmp_path / "site", tmp_path / "twin"
    shutil.copytree(file.parent, site)
    twin.mkdir()
    one = {"name": "a", "model": "rose.yaml", "east_m": 0.0, "north_m": 0.0, "height_m": 5.0}
    spec = RigSpec.model_validate({"sensors": [one]})
    kept = RigSpec.model_validate(copy_sensor_files(spec, site / "site.yaml", twin))
    shutil.rmtree(site)
    found = place_rig(kept, street, file=twin / "rig.yaml").sensors[0].sensor
    assert found.pattern.sha256 == sensor(file).pattern.sha256
    assert json.dumps(kept.model_dump()).count(str(tmp_path)) == 0


def test_a_rig_gives_it_no_columns(file, street):
    with pytest.raises(InputError, match=r"columns: Rose scans a pattern"):
        rig_of(file, street, columns=1024)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"pattern": 3}, "pattern: is not a file's name"),
        ({"pattern": "none.npz"}, "none.npz: not found"),
        ({"channels": [[0, 0]]}, "channels: is not for a sensor with a pattern"),
        ({"points_per_second": 0}, "points_per_second: 0 is not a rate"),
        ({"points_per_second": float("nan")}, "points_per_second: nan"),
        ({"points_per_second": 1e9}, "33333333 points per line"),
        ({"rate_hz": "fast"}, "rate_hz"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_wrong_file_is_one_clear_line(file, tmp_path, change, told):
    shutil.copy(file.parent / "rosette.npz", tmp_path)
    path = tmp_path / "rose.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | change))
    with pytest.raises(InputError, match=told) as caught:
        sensor(path)
    assert "\n" not in str(caught.value)
