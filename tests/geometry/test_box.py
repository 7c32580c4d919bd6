import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.geometry import bounding_box, box_corners, points_in_box

SIZES = st.floats(0.1, 20)
BOXES = st.tuples(
    *[st.floats(-100, 100)] * 3, SIZES, SIZES, SIZES, st.floats(-math.pi, math.pi)
).map(np.array)


@given(BOXES)
def test_the_bounds_of_a_boxs_corners_are_the_box(box):
    np.testing.assert_allclose(bounding_box(box_corners(box), box[6]), box, atol=1e-9)


@given(BOXES, st.integers(0, 2**32 - 1))
def test_inside_is_where_the_point_was_put(box, seed):
    local = np.random.default_rng(seed).uniform(-0.75, 0.75, (50, 3))
    c, s = math.cos(box[6]), math.sin(box[6])
    offset = local * box[3:6]
    x = box[0] + offset[:, 0] * c - offset[:, 1] * s
    y = box[1] + offset[:, 0] * s + offset[:, 1] * c
    inside = points_in_box(np.column_stack([x, y, box[2] + offset[:, 2]]), box)
    clear = (np.abs(np.abs(local) - 0.5) > 1e-6).all(axis=1)
    assert (inside == (np.abs(local) < 0.5).all(axis=1))[clear].all()


def test_yaw_turns_counter_clockwise():
    corners = box_corners(np.array([0, 0, 0, 4.0, 2.0, 1.0, math.pi / 2]))
    assert corners[:, 1].max() == pytest.approx(2.0)
    assert corners[:, 0].max() == pytest.approx(1.0)
    # The first corner is the front left one; heading north, that is north-west.
    assert corners[0] == pytest.approx([-1.0, 2.0, -0.5])


def test_margin():
    box = np.array([0, 0, 0, 2.0, 2.0, 2.0, 0.0])
    point = np.array([[1.015, 0, 0]])
    assert not points_in_box(point, box)[0]
    assert points_in_box(point, box, margin=0.02)[0]
