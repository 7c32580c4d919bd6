"""A frame's points by its labels, and in another frame of reference."""

import numpy as np
import pytest

from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.geometry import Pose

BOXES = Boxes(
    box=np.array([[10.0, 0, 1, 4, 2, 2, np.pi / 2], [10.0, 3, 1, 4, 2, 2, np.pi / 2]]),
    class_names=("car", "pedestrian"),
    track=np.array([3, 4]),
)
#: In the first, in both (the second's centre is nearer), in the second, above, in none.
POINTS = np.array([[10.9, -1.9, 1], [10, 1.9, 1], [10, 4.9, 1.9], [10, 0, 2.1], [0, 0, 1.0]])


def test_points_of_boxes():
    assert BOXES.points_of(POINTS).tolist() == [0, 1, 1, -1, -1]
    assert BOXES.points_of(POINTS, 0.15).tolist() == [0, 1, 1, 0, -1]


def test_foreground_is_of_boxes_and_instances():
    assert Frame(POINTS).foreground() is None
    assert Frame(POINTS, boxes=BOXES).foreground().tolist() == [True, True, True, False, False]
    both = Frame(POINTS, boxes=BOXES, instance=np.array([0, 0, 0, 0, 7]))
    assert both.foreground().tolist() == [True, True, True, False, True]
    assert not Frame(POINTS, instance=np.zeros(5, np.int64)).foreground().any()


def test_moving_a_frame_moves_all_of_it():
    world = Pose.from_ypr([100, 200, 3], yaw=0.4)
    frame = Frame(POINTS, boxes=BOXES, world_SE3_frame=world)
    outer = Pose.from_ypr([5, -2, 1], yaw=2.5)
    moved = frame.moved(outer)
    assert moved.foreground().tolist() == frame.foreground().tolist()
    np.testing.assert_allclose(moved.sensor_places, [[5, -2, 1]])
    np.testing.assert_allclose(
        moved.world_SE3_frame.apply(moved.points), world.apply(POINTS), atol=1e-9
    )


def test_part_of_a_frame():
    frame = Frame(POINTS, intensity=np.arange(5.0), ring=np.arange(5), boxes=BOXES)
    part = frame.only(POINTS[:, 0] > 10)
    assert (part.intensity.tolist(), part.ring.tolist(), part.time_s) == ([0], [0], None)
    assert len(part.boxes) == 2
    with pytest.raises(ValueError, match="ring: 2 values for 5 points"):
        Frame(POINTS, ring=np.arange(2))
