"""Frames of rigs that ride or sway, and of sensors that fail, against Open3D ray by ray."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.lidar import Scanner
from urbantwin.lidar.actor_path import ActorPath, PosedActor
from urbantwin.lidar.beams import dead_beams
from urbantwin.lidar.pattern import beam_directions
from urbantwin.lidar.placement import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.traffic.assets import asset_names

CAR = asset_names("car")[0]
ROLLING = {name: name == "rolling_shutter" for name in (
    "noise", "dropout", "quantisation", "rolling_shutter", "footprint", "glass",
    "retroreflection", "blooming", "sun", "weather", "crosstalk",
)}  # fmt: skip
SPEED, TURN = 15.0, 0.5


def ego_pose(time_s):
    """The carrier on a circle through the crossing, in closed form."""
    yaw = TURN * time_s
    radius = SPEED / TURN
    return Pose.from_ypr((radius * np.sin(yaw), radius * (1 - np.cos(yaw)), 0.0), yaw)


def ego(track=1):
    times = np.linspace(-0.2, 0.3, 501)
    poses = [ego_pose(time_s) for time_s in times]
    path = ActorPath(
        times, np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])
    )
    velocity = np.array([SPEED, 0.0, 0.0])
    return PosedActor(track, "car", CAR, 0, path.at(0.0), velocity, path)


def riding(mesh, frame="site", **more):
    one = {
        "name": "roof", "model": "VLP-16", "forward_m": 0.3, "left_m": -0.2, "height_m": 2.5,
        "yaw_deg": 20.0, "pitch_deg": 4.0, "effects": ROLLING,
    }  # fmt: skip
    spec = {"frame": frame, "ride": {"track": 1}, "sensors": [one], **more}
    return place_rig(RigSpec.model_validate(spec), mesh, file="rig.yaml")


def cast(mesh, origins, directions):
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
    return scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()


def expected_points(mesh, rig, frame, pose_at):
    """Where every reported ray hits, by its firing time: directions in the sensor, ranges."""
    sensor = rig.sensors[0]
    fan = beam_directions(sensor.sensor, sensor.columns, turns_per_second=sensor.turns_per_second)
    beams = fan[frame.ring, frame.column]
    poses = [pose_at(float(time_s)) for time_s in frame.time_s]
    rotation = np.stack([pose.rotation for pose in poses])
    origin = np.stack([pose.translation for pose in poses])
    directions = np.einsum("nij,nj->ni", rotation, beams)
    return beams, origin, directions, cast(mesh, origin, directions)


def assert_same(off):
    """The sensor's pose is taken once for all channels of a column: 35 us, 3 mm at 40 m.

    And at a silhouette a hair's breadth decides what is hit.
    """
    assert np.median(off) < 1e-3
    assert np.mean(off > 4e-3) < 1e-3


def test_a_riding_sensor_sees_from_where_it_is(street):
    rig = riding(street)
    frame = Scanner(street, rig, 1).scan(0, [ego()])
    mount = rig.sensors[0].carrier_SE3_sensor
    assert np.ptp(frame.time_s) > 0.09
    _, origin, directions, range_m = expected_points(
        street, rig, frame, lambda time_s: ego_pose(time_s) @ mount
    )
    assert len(frame.points) > 10_000
    wanted = origin + directions * range_m[:, None]
    off = np.linalg.norm(frame.points[:, :3] - wanted, axis=1)
    assert_same(off)


def test_without_deskew_points_are_as_measured(street):
    rig = riding(street, deskew=False)
    frame = Scanner(street, rig, 1).scan(0, [ego()])
    mount = rig.sensors[0].carrier_SE3_sensor
    beams, _, _, range_m = expected_points(
        street, rig, frame, lambda time_s: ego_pose(time_s) @ mount
    )
    wanted = (ego_pose(0.0) @ mount).apply(beams * range_m[:, None])
    off = np.linalg.norm(frame.points[:, :3] - wanted, axis=1)
    assert_same(off)
    straight = Scanner(street, riding(street), 1).scan(0, [ego()])
    assert np.abs(straight.points[:, :3] - frame.points[:, :3]).max() > 1.0


@pytest.mark.parametrize("name", ["sensor", "level"])
def test_the_frame_of_the_points_is_that_of_the_frames_time(street, name):
    rig, in_site = riding(street, name), riding(street)
    actors = [ego()]
    moved = Scanner(street, rig, 1).scan(0, actors).points[:, :3]
    fixed = Scanner(street, in_site, 1).scan(0, actors).points[:, :3]
    sensor = ego_pose(0.0) @ rig.sensors[0].carrier_SE3_sensor
    frame = sensor if name == "sensor" else Pose.from_ypr(sensor.translation, np.radians(20.0))
    np.testing.assert_allclose(frame.apply(moved), fixed, atol=2e-4)


def test_the_carrier_is_neither_hit_nor_labelled(street):
    """A sensor that looks down onto its carrier's roof sees the road."""
    rig = riding(street)
    low = replace(rig.sensors[0], carrier_SE3_sensor=Pose.from_ypr((0, 0, 1.7), 0.0, 0.3))
    rig = replace(rig, sensors=(low,))
    other = PosedActor(2, "car", CAR, 0, Pose.from_ypr((12.0, 1.0, 0.0)), np.zeros(3))
    frame = Scanner(street, rig, 1).scan(0, [ego(), other])
    assert set(np.unique(frame.instance)) == {0, 2}
    assert [box.track for box in frame.boxes] == [2]
    distance = np.linalg.norm(frame.points[:, :2] - ego_pose(0).translation[:2], axis=1)
    assert distance[frame.instance == 0].min() > 2.0
    alone = Scanner(street, rig, 1).scan(0, [ego()])
    assert len(alone.boxes) == 0


def test_a_carrier_that_is_not_there_is_told(street):
    with pytest.raises(InputError, match=r"track 1.* not in this frame|track 1.* not there"):
        Scanner(street, riding(street), 1).scan(0, [])


def test_a_swaying_sensor_sees_what_its_true_pose_sees(street, rig_of):
    one = {"model": "VLP-16", "effects": ROLLING, "sway": {"rms_m": 0.02}, "pitch_deg": 5.0}
    rig = rig_of(street, one, frame="site")
    still = rig_of(street, {**one, "sway": None}, frame="site")
    sensor = rig.sensors[0]
    trembles = []
    scanner, steady = Scanner(street, rig, 4), Scanner(street, still, 4)
    for index in (0, 7):
        frame = scanner.scan(index, [])
        path = sensor.path(index, 4)

        def pose_at(time_s, path=path):
            rotation, place = path.true_poses(np.array([time_s]))
            return Pose(rotation[0], place[0])

        beams, _, _, range_m = expected_points(street, rig, frame, pose_at)
        wanted = sensor.site_SE3_sensor.apply(beams * range_m[:, None])
        off = np.linalg.norm(frame.points[:, :3] - wanted, axis=1)
        assert_same(off)
        # Of the ground, whose height is known.
        ground = frame.points[frame.semantic == 40, 2]
        trembles.append(float(np.abs(ground).max()))
        level = steady.scan(index, [])
        assert np.abs(level.points[level.semantic == 40, 2]).max() < 1e-4
    assert min(trembles) > 0.02


def test_dead_beams_report_nothing_and_change_no_other(street, rig_of, crowd):
    outage = {"sector_deg": [20.0, 100.0], "channels": ["3-9"], "start_s": 0.5}
    one = {"model": "VLP-16"}
    actors = crowd(20, seed=2)
    rig = rig_of(street, {**one, "outages": [outage]})
    sound, broken = Scanner(street, rig_of(street, one), 1), Scanner(street, rig, 1)
    for index, fails in [(4, False), (5, True)]:
        all_of_it, some = sound.scan(index, actors), broken.scan(index, actors)
        dead = dead_beams(rig.sensors[0], index / 10.0)
        assert (dead is not None) == fails
        kept = np.ones(len(all_of_it.points), bool)
        if dead is not None:
            kept = ~dead[all_of_it.ring, all_of_it.column]
            assert 0.1 < 1 - kept.mean() < 0.5
        np.testing.assert_array_equal(some.points, all_of_it.points[kept])
        np.testing.assert_array_equal(some.instance, all_of_it.instance[kept])
