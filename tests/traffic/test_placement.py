"""Actors on analytic ground."""

from functools import partial

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.traffic.actor_rows import KeptRows, actor_rows
from urbantwin.traffic.assets import asset
from urbantwin.traffic.demand.demand import Trip
from urbantwin.traffic.paths.placement import Ground, stand
from urbantwin.traffic.prescribed import usual_asset

WHEELS = np.array([[1.4, 0.75, 0.0], [1.4, -0.75, 0.0], [-1.3, 0.75, 0.0], [-1.3, -0.75, 0.0]])
NO_ROADS = RoadNetwork("right", (), (), (), (), ())


def sheet(height, *, half=60.0, step=1.0):
    """A square of ground with the height of a function of x and y."""
    axis = np.arange(-half, half + step / 2, step)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    n = len(axis)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + 1, corner + n + 1]),
            np.column_stack([corner, corner + n + 1, corner + n]),
        ]
    )
    return LabelledMesh.build(np.column_stack([x, y, height(x, y)]), faces, 40, 1)


def placed(ground, contacts, xy, yaw, lane=None, names=("nowhere",)):
    lane = np.zeros(len(xy), np.int32) if lane is None else lane
    return stand(ground, contacts, xy, yaw, ground.ceiling(xy, lane, names))


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.08, 0.0), (0.0, -0.06), (0.09, 0.07)])
def test_wheels_touch_an_inclined_plane_at_any_heading(slope) -> None:
    ground = Ground(sheet(lambda x, y: 2 + slope[0] * x + slope[1] * y), NO_ROADS)
    yaw = np.linspace(-np.pi, np.pi, 25)
    xy = np.column_stack([np.linspace(-30, 30, 25), np.linspace(20, -25, 25)])
    z, pitch, roll = placed(ground, WHEELS, xy, yaw)
    for k in range(len(yaw)):
        pose = Pose.from_ypr([*xy[k], z[k]], yaw[k], pitch[k], roll[k])
        wheels = pose.apply(WHEELS)
        assert np.abs(wheels[:, 2] - (2 + wheels[:, :2] @ slope)).max() < 1e-4
        # The body's up is the plane's normal (Stewart, Calculus, 12.5).
        normal = np.array([-slope[0], -slope[1], 1]) / np.sqrt(1 + np.dot(slope, slope))
        np.testing.assert_allclose(pose.rotation[:, 2], normal, atol=1e-4)


def test_uphill_lifts_the_nose_and_a_higher_left_side_rolls_right_side_down() -> None:
    ground = Ground(sheet(lambda x, y: 0.05 * x), NO_ROADS)
    xy, yaw = np.zeros((2, 2)), np.array([0.0, -np.pi / 2])
    _, pitch, roll = placed(ground, WHEELS, xy, yaw)
    assert pitch[0] == pytest.approx(-np.arctan(0.05), abs=1e-6)
    assert roll[0] == pytest.approx(0, abs=1e-6)
    assert pitch[1] == pytest.approx(0, abs=1e-6)
    assert roll[1] == pytest.approx(np.arctan(0.05), abs=1e-6)


def test_wheels_stay_within_two_centimetres_on_a_smooth_crest() -> None:
    # A crest of 400 m radius, tighter than any that a road for 50 km/h has.
    ground = Ground(sheet(lambda x, y: -(x**2) / 800 + 0.02 * y), NO_ROADS)
    xy = np.column_stack([np.linspace(-20, 20, 41), np.zeros(41)])
    z, pitch, roll = placed(ground, WHEELS, xy, np.full(41, 0.3))
    for k in range(41):
        wheels = Pose.from_ypr([*xy[k], z[k]], 0.3, pitch[k], roll[k]).apply(WHEELS)
        height = -(wheels[:, 0] ** 2) / 800 + 0.02 * wheels[:, 1]
        assert np.abs(wheels[:, 2] - height).max() < 0.02


def test_two_wheels_give_pitch_and_one_foot_neither() -> None:
    ground = Ground(sheet(lambda x, y: 0.06 * x + 0.04 * y), NO_ROADS)
    xy, yaw = np.array([[3.0, 2.0]]), np.zeros(1)
    z, pitch, roll = placed(ground, np.array([[0.6, 0, 0], [-0.6, 0, 0.0]]), xy, yaw)
    assert (pitch[0], roll[0]) == (pytest.approx(-np.arctan(0.06), abs=1e-6), 0.0)
    assert z[0] == pytest.approx(0.26, abs=1e-4)
    z, pitch, roll = placed(ground, np.zeros((1, 3)), xy, yaw)
    assert (z[0], pitch[0], roll[0]) == (pytest.approx(0.26, abs=1e-4), 0.0, 0.0)


def strip(name, z):
    return Lane(
        name, "r", "driving", 3.5, 13.9, np.array([[-50.0, 0, z], [50.0, 0, z]]),
        np.zeros((0, 2)), 0, ("car",), (), "",
    )  # fmt: skip


def test_an_actor_under_a_bridge_stays_under_it() -> None:
    flat, deck = sheet(lambda x, y: 0 * x), sheet(lambda x, y: 0 * x + 6.0, half=10)
    roads = RoadNetwork("right", (), (strip("below", 0.0), strip("deck", 6.0)), (), (), ())
    ground = Ground(LabelledMesh.concatenate([flat, deck]), roads)
    xy, yaw = np.array([[1.0, 0.5], [1.0, 0.5], [1.0, 0.5]]), np.zeros(3)
    names = ("below", "deck", "unknown")
    z, _, _ = placed(ground, WHEELS, xy, yaw, np.array([0, 1, 2], np.int32), names)
    np.testing.assert_allclose(z, [0.0, 6.0, 6.0], atol=1e-5)


def test_an_actor_beyond_the_ground_has_no_height() -> None:
    ground = Ground(sheet(lambda x, y: 0 * x), NO_ROADS)
    xy = np.array([[0.0, 0.0], [59.5, 0.0], [80.0, 0.0]])
    z, pitch, roll = placed(ground, WHEELS, xy, np.zeros(3))
    assert list(np.isnan(z)) == [False, True, True]
    assert not np.isnan([pitch, roll]).any()


def test_poses_beside_the_ground_count_within_the_region_alone() -> None:
    """A bus that turns around beyond the region leaves the ground with its front: no warning."""
    trip = Trip("car", usual_asset("car", 0), 0.0, ("r",))
    x = np.array([0.0, 50.0, 70.0, 90.0])  # ground ends at x = 60
    columns = {
        "trip": np.zeros(4, np.int32), "step": np.arange(4, dtype=np.int32),
        "xy": np.column_stack([x, 0 * x]), "yaw": np.zeros(4), "distance": x,
        "speed": np.full(4, 9.0), "lane": np.zeros(4, np.int32),
    }  # fmt: skip
    rows_of = partial(
        actor_rows, trips=[trip], lanes=("nowhere",), step_s=0.1, asset=asset,
        ground=Ground(sheet(lambda x, y: 0 * x), NO_ROADS),
    )  # fmt: skip
    for reach, left_out in ((40.0, 0), (80.0, 1), (100.0, 2)):
        kept = KeptRows(None, shapely.box(-reach, -9, reach, 9))
        assert kept.stood(columns, rows_of) == left_out
        assert [table.num_rows for table in kept] == [2]
