"""A sensor's pose found from one frame: of made streets whose rays Open3D casts, and a real one."""

import importlib
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment import (
    Guess,
    align,
    aligned_poses,
    ground_plane,
    write_aligned_rig,
)
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def box(middle, size, name):
    x, y, z = np.array([-1, 1]) / 2 * np.array(size)[:, None] + np.array(middle)[:, None]
    corners = np.array([[a, b, c] for a in x for b in y for c in z])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))]
    return LabelledMesh.build(corners, faces, semantic_id(name), material_id("concrete"))


def slope(reach=80.0, east=0.03, north=-0.02):
    xy = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * reach
    corners = np.column_stack([xy, xy @ [east, north]])
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )


def street():
    """A sloping street with houses of several sizes and poles, none placed evenly."""
    houses = [((-18, 14, 5), (14, 9, 14)), ((9, 19, 4), (17, 8, 12)), ((21, -15, 6), (11, 13, 16))]
    houses += [((-14, -19, 3), (19, 7, 10)), ((33, 9, 4), (6, 12, 12))]
    poles = [((5, 8, 3), (0.3, 0.3, 9)), ((-7, -9, 3), (0.3, 0.3, 9)), ((13, -6, 3), (0.4, 0.4, 9))]
    parts = [box(*one, "building") for one in houses] + [box(*one, "pole") for one in poles]
    return LabelledMesh.concatenate([slope(), *parts])


def seen(mesh, pose, noise_m=0.02):
    """What 48 beams see from a pose, in the sensor's frame; Open3D casts the rays."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-30, 12, 48)), np.radians(np.arange(0, 360, 0.5)), indexing="ij"
    )
    aim = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)]
        + [np.sin(elevation)],
        axis=-1,
    ).reshape(-1, 3)
    start = np.broadcast_to(pose.translation, aim.shape)
    rays = np.hstack([start, aim @ pose.rotation.T]).astype(np.float32)
    away = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy().astype(float)
    away += np.random.default_rng(5).normal(0, noise_m, len(away))
    hit = np.isfinite(away) & (away < 70)
    return aim[hit] * away[hit, None]


def off(found, true):
    turned = found.rotation.T @ true.rotation
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    return np.linalg.norm(found.translation - true.translation), angle


#: On a pole, tipped and leaning; 5 m above the ground there.
TRUE = Pose.from_ypr([2.0, -3.0, 5.12], *np.radians([63.0, 12.0, -4.0]))


@pytest.fixture(scope="module")
def points():
    return seen(street(), TRUE)


def test_the_ground_of_a_frame_tells_height_and_tilt(points):
    plane = ground_plane(points)
    up = np.array([-0.03, 0.02, 1.0]) / np.linalg.norm([-0.03, 0.02, 1.0])
    assert np.degrees(np.arccos(plane.normal @ (TRUE.rotation.T @ up))) < 0.3
    assert plane.height_m == pytest.approx(5.0 * up[2], abs=0.03)


def test_a_tipped_sensor_is_found_from_a_rough_guess_and_from_none(points):
    near = shapely.box(-12.0, -12.0, 12.0, 12.0)
    for guess in (Guess(3.6, -4.3, 74.0), None):
        found = align(Frame(points), street(), guess=guess, region=near)
        away, angle = off(found.pose, TRUE)
        assert away < 0.03
        assert angle < 0.1
        assert found.confidence > 0.5
        assert found.found.residual_m < 0.03


def test_standing_proud_of_what_is_there_moves_no_sensor(points):
    """Every house and pole 0.3 m too wide in the twin, as outlines with eaves are."""
    narrow, wide = street(), street()
    for part in (5, 6, 7):  # only one side of the street has something near
        corners = slice(4 + 8 * part, 12 + 8 * part)
        middle = wide.vertices[corners].mean(axis=0)
        wide.vertices[corners, :2] += 0.3 * np.sign(narrow.vertices[corners] - middle)[:, :2]
    for part in range(5):
        corners = slice(4 + 8 * part, 12 + 8 * part)
        middle = wide.vertices[corners].mean(axis=0)
        wide.vertices[corners, :2] += 0.3 * np.sign(narrow.vertices[corners] - middle)[:, :2]
    found = align(Frame(points), wide, guess=Guess(3.6, -4.3, 74.0))
    assert off(found.pose, TRUE)[0] < 0.05
    assert found.found.surface_offset_m == pytest.approx(-0.3, abs=0.05)


def test_a_bare_plane_holds_no_place():
    with pytest.raises(InputError):
        align(Frame(seen(slope(), TRUE)), slope(), guess=Guess(3.0, -3.5, 70.0))


def test_two_places_that_look_alike_are_said():
    twice = street()
    twice = LabelledMesh.concatenate([twice.select(twice.semantic != semantic_id("road"))] * 2)
    copy = slice(len(twice.vertices) // 2, None)
    shift = np.array([70.0, 0.0])
    twice.vertices[copy] += [*shift, shift @ [0.03, -0.02]]
    world = LabelledMesh.concatenate([slope(reach=120.0), twice])
    with pytest.raises(InputError, match="two places 70"):
        align(
            Frame(seen(world, TRUE)),
            world,
            guess=Guess(37.0, -3.0, 63.0, within_m=38.0, within_deg=8.0),
        )


def test_what_is_no_frame_of_a_street_is_said(points):
    with pytest.raises(InputError, match="points within"):
        align(Frame(points[:50]), street())
    with pytest.raises(InputError, match="no ground"):
        align(Frame(points * [1, 1, -1]), street())
    with pytest.raises(InputError, match="no ground"):
        align(Frame(points), street(), guess=Guess(500.0, 0.0, 0.0))


def test_the_rest_of_a_rig_moves_with_its_first_sensor_and_its_file_stays(tmp_path):
    text = {
        "rate_hz": 5,
        "sensors": [
            {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 4}
            | {"heading_deg": 90, "effects": {"noise": False}},
            {"name": "b", "model": "VLP-16", "east_m": 1, "north_m": 0, "up_m": 4.2},
        ],
    }
    file = tmp_path / "rig.yaml"
    file.write_text(yaml.safe_dump(text))
    before = place_rig(RigSpec.model_validate(text), street())
    write_aligned_rig(file, file, aligned_poses(before, TRUE))
    written = yaml.safe_load(file.read_text())
    assert written["rate_hz"] == 5
    assert written["sensors"][0]["effects"] == {"noise": False}
    after = place_rig(RigSpec.model_validate(written), street())
    first, second = (one.site_SE3_sensor for one in after.sensors)
    assert off(first, TRUE) == pytest.approx((0, 0), abs=2e-4)
    apart = [
        a.inverse() @ b for a, b in ((first, second), [s.site_SE3_sensor for s in before.sensors])
    ]
    assert off(*apart) == pytest.approx((0, 0), abs=5e-4)


def test_the_real_sensor_of_argoverse_is_found_from_2_m_and_10_degrees_off(shared_data):
    """The measured ground and the parked objects of its log, filled with our meshes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        argoverse_log = importlib.import_module("argoverse_log")
        argoverse_world = importlib.import_module("argoverse_world")
    log = argoverse_log.Log(shared_data / "lidar" / "argoverse2-pittsburgh")
    sweep = log.sweeps[0]
    standing = [
        argoverse_world.mesh_in_box(one.category, one.size, one.coat).transformed(one.pose)
        for one in log.boxes(sweep)
        if np.linalg.norm(one.velocity) < 0.5
    ]
    world = argoverse_world.World(log, sweep)
    turn, _ = log.city_of_vehicle(np.array([sweep]))
    true = Pose(turn[0].as_matrix(), np.array([3.0, -2.0, 0.0]))
    mesh = LabelledMesh.concatenate([world.ground, *standing]).transformed(true)
    yaw = np.degrees(np.arctan2(true.rotation[1, 0], true.rotation[0, 0]))
    sensors = np.array([log.mounts[name].translation for name, *_ in argoverse_log.SENSORS])
    frame = Frame(log.points(sweep), sensor_places=sensors)
    found = align(frame, mesh, guess=Guess(3.0 + 1.6, -2.0 + 1.2, yaw + 10.0))
    away, angle = off(found.pose, true)
    assert away < 0.10
    assert angle < 0.5
