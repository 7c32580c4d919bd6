"""What of an actor lies beyond a sensor, against closed forms and rays of Open3D."""

import dataclasses
from itertools import pairwise

import numpy as np
import open3d as o3d
import pytest
import shapely

from urbantwin.geometry import Pose
from urbantwin.lidar.borders import Borders, StandingActors, truncations
from urbantwin.lidar.labels import LEVELS, difficulty_of
from urbantwin.lidar.pattern import beam_directions
from urbantwin.lidar.shapes import ActorShape
from urbantwin.lidar.sight.field_of_view import FieldOfView
from urbantwin.traffic.assets import asset_mesh, asset_names

HERE = Pose.from_ypr(np.zeros(3))


def standing(*actors):
    """Actors of shapes and poses."""
    shapes, poses = zip(*actors, strict=True)
    return StandingActors(
        np.array([shape.low for shape in shapes]),
        np.array([shape.high for shape in shapes]),
        np.array([pose.rotation for pose in poses]),
        np.array([pose.translation for pose in poses]),
        [shape.scene for shape in shapes],
    )


@pytest.fixture(scope="module")
def mounted(rig_of, ground_mesh):
    """Return a VLP-16 (15 degrees up and down, 2 apart) 5 m above the origin."""
    return rig_of(ground_mesh(), {"model": "VLP-16"}).sensors[0]


def test_a_wall_that_rises_out_of_the_field(mounted, box_mesh):
    """16 degrees is the border: half a spacing beyond the highest beam. Seen at a solid angle."""
    field = FieldOfView.of(mounted)
    for top in (1.0, 4.0, 8.0, 16.0):
        wall = ActorShape(box_mesh((20, -0.05, 0.0), (20.05, 0.05, top)))
        (found,), (beyond,) = truncations(field, HERE, standing((wall, HERE)))
        highest = np.arctan2(top, 20.0)
        expected = max(0.0, 1 - np.sin(np.radians(16)) / np.sin(highest))
        assert found == pytest.approx(expected, abs=0.03)
        assert not beyond


def test_a_long_train_that_leaves_the_range(mounted, box_mesh):
    reach = mounted.sensor.assumed_range_max_m
    # Along a line 10 m aside, from straight beside the sensor to far beyond its range.
    far = 3 * reach
    train = ActorShape(box_mesh((0, 10, -0.5), (far, 10.1, 0.5)))
    (found,), _ = truncations(FieldOfView.of(mounted), HERE, standing((train, HERE)))
    start = np.arctan2(10, far)
    border = np.arctan2(10, np.sqrt(reach**2 - 100))
    # All its heights count alike in a column; columns stand evenly in azimuth, but the bounds
    # are as high as the near end.
    azimuth = np.linspace(start, np.pi / 2, 20_001)
    height = np.arctan(0.5 / (10 / np.sin(azimuth)))
    expected = height[azimuth < border].sum() / height.sum()
    assert found == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize(("away", "truncation", "far"), [(20, 0, False), (400, 1, True)])
def test_well_inside_and_well_beyond(mounted, box_mesh, away, truncation, far):
    car = ActorShape(box_mesh((-2, -1, -1), (2, 1, 0.5)))
    place = Pose.from_ypr((away, 0, 0), 0.7)
    found, beyond = truncations(FieldOfView.of(mounted), HERE, standing((car, place)))
    assert (found.tolist(), beyond.tolist()) == ([truncation], [far])


def test_too_near_is_truncated(mounted, box_mesh):
    near = dataclasses.replace(mounted.sensor, range_min_m=30.0)
    car = ActorShape(box_mesh((-2, -1, -1), (2, 1, 0.5)))
    field = FieldOfView.of(dataclasses.replace(mounted, sensor=near))
    found, beyond = truncations(field, HERE, standing((car, Pose.from_ypr((10, 3, 0), 0))))
    assert (found.tolist(), beyond.tolist()) == ([1.0], [False])


def test_actors_against_rays_of_open3d(mounted):
    """A tilted sensor 5 m up; what is seen is told by the nearest of the sensor's own beams."""
    pose = Pose.from_ypr((1, 2, 5), 0.4, 0.1, 0.03)
    field = FieldOfView.of(mounted)
    beams = beam_directions(mounted.sensor, mounted.columns)
    tops = np.arcsin(beams[..., 2]).mean(axis=1)
    low, high = tops.min() - np.radians(1), tops.max() + np.radians(1)
    rng = np.random.default_rng(8)
    checked, errors = 0, []
    for kind in ("car", "truck", "pedestrian", "bicycle", "bus"):
        mesh = asset_mesh(asset_names(kind)[0], 0)
        shape = ActorShape(mesh)
        for _ in range(8):
            away, around = rng.uniform(2.5, 25), rng.uniform(-3, 3)
            place = Pose.from_ypr(
                (1 + away * np.cos(around), 2 + away * np.sin(around), 0), rng.uniform(-3, 3)
            )
            (found,), _ = truncations(field, pose, standing((shape, place)))
            posed = pose.inverse().apply(place.apply(mesh.vertices))
            scene = o3d.t.geometry.RaycastingScene()
            scene.add_triangles(posed.astype(np.float32), mesh.faces.astype(np.uint32))
            middle = posed[np.unique(mesh.faces)]
            # Only directions near the actor: a cone about its vertices.
            axis = middle.mean(axis=0) / np.linalg.norm(middle.mean(axis=0))
            unit = middle / np.linalg.norm(middle, axis=1, keepdims=True)
            cone = np.arccos(np.clip((unit @ axis).min(), -1, 1)) + 0.01
            aims = _in_cone(rng, axis, cone, 20_000)
            rays = np.concatenate([np.zeros_like(aims), aims], axis=1).astype(np.float32)
            away_m = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
            hit = np.isfinite(away_m)
            up = np.arcsin(aims[hit, 2])
            seen = (up >= low) & (up <= high) & (away_m[hit] >= field.range_m[0])
            errors.append(found - (1 - seen.mean()))
            checked += 0.05 < found < 0.95
    assert checked >= 8
    assert np.abs(errors).max() < 0.05
    assert np.abs(errors).mean() < 0.01


def _in_cone(rng, axis, angle, count):
    """Draw unit vectors (N, 3) evenly over the solid angle of a cone."""
    cosine = rng.uniform(np.cos(angle), 1, count)
    turn = rng.uniform(0, 2 * np.pi, count)
    side = np.cross(axis, [0.3, 0.5, -0.8])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    sine = np.sqrt(1 - cosine**2)
    across = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    return cosine[:, None] * axis + sine[:, None] * across


def test_a_blind_sector_truncates(rig_of, ground_mesh, box_mesh):
    outage = [{"sector_deg": [0, 90], "start_s": 2.0, "stop_s": 4.0}]
    rig = rig_of(ground_mesh(), {"model": "OS1-128", "outages": outage})
    half = ActorShape(box_mesh((10, -1, -0.1), (10.1, 1, 0.1)))
    whole = ActorShape(box_mesh((1, 10, -0.1), (2, 10.1, 0.1)))
    borders = Borders(rig.sensors)
    for time_s, expected in ((0.0, [0, 0]), (2.0, [0.5, 1]), (4.0, [0, 0])):
        found, places = borders.of(time_s, [HERE], standing((half, HERE), (whole, HERE)))
        assert found == pytest.approx(expected, abs=0.05)
        assert places == [None, None]


def test_of_several_sensors_the_best_counts_and_the_region(rig_of, ground_mesh, box_mesh):
    rig = rig_of(ground_mesh(), {"model": "VLP-16"}, {"model": "OS1-128", "east_m": 30.0})
    region = shapely.box(-50, -50, 50, 50)
    car = ActorShape(box_mesh((-2, -1, 0), (2, 1, 1.5)))
    beneath = Pose.from_ypr((1, 0, -4), 0)
    away = Pose.from_ypr((60, 0, -4), 0)
    lost = Pose.from_ypr((20, 900, -4), 0)
    poses = [HERE, Pose.from_ypr((30, 0, 0), 0)]
    every = standing((car, beneath), (car, away), (car, lost))
    alone, _ = Borders(rig.sensors[:1]).of(0.0, poses[:1], every)
    assert alone[0] > 0.9
    shares, places = Borders(rig.sensors, region).of(0.0, poses, every)
    assert shares.tolist() == [0.0, 0.0, 1.0]
    assert places == [None, "outside", "outside"]
    assert Borders(rig.sensors).of(0.0, poses, every)[1] == [None, None, "far"]


def test_levels_go_from_easy_to_hard():
    assert difficulty_of(100, 0.1, 0.0) == "easy"
    assert difficulty_of(20, 0.1, 0.0) == "moderate"
    assert difficulty_of(100, 0.3, 0.0) == "moderate"
    assert difficulty_of(100, 0.1, 0.2) == "moderate"
    assert difficulty_of(5, 0.0, 0.0) == "hard"
    assert difficulty_of(100, 0.99, 0.0) == "hard"
    assert difficulty_of(100, float("nan"), 0.0) == "hard"
    assert difficulty_of(100, 0.0, 0.4) == "hard"
    assert difficulty_of(100, 0.0, 0.6) is None
    assert difficulty_of(0, float("nan"), 0.0) is None
    for easier, harder in pairwise(LEVELS):
        assert easier.least_points > harder.least_points
        assert easier.most_occlusion < harder.most_occlusion
        assert easier.most_truncation < harder.most_truncation
