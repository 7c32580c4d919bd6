"""Point-wise flow: closed forms of moving bodies, and the bodies that the next frame meets."""

import shutil

import numpy as np
import open3d
import pyarrow as pa
import pytest

import urbantwin as ut
from urbantwin.dataset.point_flow import flow_of
from urbantwin.dataset.track_paths import TrackPaths
from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.traffic.assets import asset_mesh

ROAD, CAR, OUTLIER = 40, 10, 1


def table(track, time_s, **columns):
    """Rows of one track; what is not given is 0."""
    zero = np.zeros(len(time_s))
    names = ("x", "y", "z", "yaw", "pitch", "roll")
    return pa.table(
        {"track": np.full(len(time_s), track), "time_s": time_s}
        | {name: np.asarray(columns.get(name, zero), float) for name in names}
    )


def paths(*tables):
    return TrackPaths(pa.concat_tables(tables), gap_s=0.15, beyond_s=0.1)


def test_a_body_that_turns_at_a_constant_rate():
    """A car on a circle of 20 m at 8 m/s, seen at steps: it turns about the middle."""
    rate = 8.0 / 20.0
    times = np.arange(0.0, 2.0, 0.1)
    angle = rate * times
    way = table(7, times, x=20 * np.sin(angle), y=20 - 20 * np.cos(angle), yaw=angle)
    draw = np.random.default_rng(1)
    points = draw.uniform(-2, 2, (50, 3))
    measured = np.repeat([0.3, 0.4], 25)  # of two sensors, half a turn apart
    site_SE3_now = Pose.from_ypr([5.0, -3.0, 2.0], 0.7, 0.1, -0.05)
    flow = flow_of(
        points,
        np.full(50, CAR, np.uint16),
        np.full(50, 7, np.uint16),
        measured,
        paths(way),
        {7: 0.5},
        site_SE3_now,
    )
    centre = np.array([0.0, 20.0, 0.0])
    for point, got, since in zip(points, flow, 0.5 - measured, strict=True):
        there = site_SE3_now.apply(point[None])[0]
        after = rotation_from_ypr(rate * since, 0, 0) @ (there - centre) + centre
        expected = site_SE3_now.inverse().apply(after[None])[0] - point
        np.testing.assert_allclose(got, expected, atol=1e-6)


def test_what_stands_has_no_flow_but_that_of_who_looks():
    points = np.array([[10.0, 0, 0], [0, 4, 1], [3, 3, 3]])
    semantic = np.array([ROAD, ROAD, OUTLIER], np.uint16)
    now, then = Pose.from_ypr([0, 0, 0]), Pose.from_ypr([2.0, 0, 0], np.pi / 2)
    some = (points, semantic, np.zeros(3, np.uint16), np.zeros(3), paths(table(1, [0.0, 0.1])), {})
    np.testing.assert_array_equal(flow_of(*some, now)[:2], 0.0)
    with_ego = flow_of(*some, now, then.inverse())
    # From 2 m ahead and turned left, what was 10 m ahead is 8 m to the right.
    np.testing.assert_allclose(points[:2] + with_ego[:2], [[0, -8, 0], [4, 2, 1]], atol=1e-6)
    assert np.isnan(with_ego[2]).all()


def test_nobody_knows_the_flow_of_who_leaves_or_is_put_elsewhere():
    away = table(1, [0.0, 0.1, 5.0, 5.1], x=[0, 1, 90, 91])  # absent for five seconds
    put = table(2, [0.0, 0.1, 0.2], x=[0, 1, 300])  # 3,000 m/s
    stays = table(3, [0.0, 60.0])  # parked: its first and its last step alone
    instance = np.array([1, 2, 3, 4, 5], np.uint16)
    flow = flow_of(
        np.zeros((5, 3)),
        np.full(5, CAR, np.uint16),
        instance,
        np.full(5, 0.05),
        paths(away, put, stays),
        {1: 5.05, 2: 0.19, 3: 30.0, 4: 0.1},  # 4 is not in the table, 5 not in the next frame
        Pose.from_ypr([0, 0, 0]),
    )
    assert np.isnan(flow).all(axis=1).tolist() == [True, True, False, True, True]
    np.testing.assert_array_equal(flow[2], 0.0)


def test_points_of_a_recorded_car_go_as_fast_as_it_drives(dataset):
    """The car of the fixture drives 10 m/s east: each point for as long as is left of its turn."""
    frames = ut.open(dataset)
    checked = 0
    for frame in frames[2:-1]:
        on = np.flatnonzero(frame.instance == 4)
        following = frame.next.boxes.to_pylist()
        seen = [one["observed_s"] for one in following if one["track"] == 4]
        if not len(on) or not seen:
            continue
        lasts = 0.1 + seen[0] - frame.time[on].astype(float)
        east = frame.site_SE3_dataset.inverse().rotation @ [10.0, 0, 0]
        expected = lasts[:, None] * east
        np.testing.assert_allclose(frame.flow()[on], expected, atol=2e-4)
        checked += len(on)
    assert checked > 100
    assert np.isnan(frames[-1].flow()).all()


def test_moved_points_lie_on_the_body_that_the_next_frame_meets(dataset):
    """The mesh of the car, put where it drives; not where any box or table of ours has it."""
    frames = ut.open(dataset)
    mesh = asset_mesh("car-sedan", 0)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    still, moved = [], []
    for frame in frames[3:-1]:
        on = frame.instance == 4
        seen = [one for one in frame.next.boxes.to_pylist() if one["track"] == 4]
        middle_x = -8 + 10 * (frame.next.time_s + seen[0]["observed_s"])
        for found, shift in ((still, 0.0), (moved, frame.flow()[on])):
            site = frame.site_SE3_dataset.apply(frame.points[on, :3] + shift)
            body = site - [middle_x, 8.0, 0.0]
            found.append(scene.compute_distance(body.astype(np.float32)).numpy())
    assert np.percentile(np.concatenate(moved), 90) < 0.06  # the sensor's noise
    assert np.percentile(np.concatenate(still), 90) > 4 * np.percentile(np.concatenate(moved), 90)


@pytest.mark.parametrize("without", [True, False])
def test_boxes_alone_give_nearly_the_same(dataset, tmp_path, without):
    folder = tmp_path / "dataset"
    shutil.copytree(dataset, folder)
    if without:
        for name in ("trajectories", "tracklets", "tracks", "poses"):
            (folder / f"{name}.parquet").unlink()
    old, new = ut.open(folder), ut.open(dataset)
    for number in (3, 6):
        away = np.abs(old[number].flow() - new[number].flow()).max(axis=1)
        walks = new[number].instance == 12  # its tight box swings with its legs
        assert np.nanmax(away[~walks]) < 2e-3
        assert np.nanmax(away[walks]) < (0.06 if without else 1e-9)
