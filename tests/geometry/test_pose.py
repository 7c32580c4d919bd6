import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from urbantwin.geometry import Pose, rotation_from_ypr, ypr_from_rotation

ANGLES = st.floats(-math.pi, math.pi)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_rotation_is_intrinsic_zyx(yaw, pitch, roll):
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    ours = rotation_from_ypr(yaw, pitch, roll)
    np.testing.assert_allclose(ours, expected, atol=1e-12)
    np.testing.assert_allclose(rotation_from_ypr(*ypr_from_rotation(ours)), ours, atol=1e-9)


def test_signs_as_documented():
    ahead, left = [[1.0, 0, 0]], [[0, 1.0, 0]]
    assert Pose.from_ypr([0, 0, 0], yaw=math.pi / 2).apply(ahead)[0] == pytest.approx([0, 1, 0])
    assert Pose.from_ypr([0, 0, 0], pitch=0.1).apply(ahead)[0][2] < 0  # nose down
    assert Pose.from_ypr([0, 0, 0], roll=0.1).apply(left)[0][2] > 0  # right side lower


@given(ANGLES, ANGLES, st.lists(st.floats(-100, 100), min_size=6, max_size=6))
def test_chain_and_inverse(yaw_a, yaw_b, numbers):
    a_from_b = Pose.from_ypr(numbers[:3], yaw_a, 0.1, -0.2)
    b_from_c = Pose.from_ypr(numbers[3:], yaw_b, -0.3, 0.4)
    points = np.array([[1.0, 2, 3], [-4, 5, -6]])
    both = (a_from_b @ b_from_c).apply(points)
    np.testing.assert_allclose(both, a_from_b.apply(b_from_c.apply(points)), atol=1e-9)
    np.testing.assert_allclose(a_from_b.inverse().apply(a_from_b.apply(points)), points, atol=1e-9)
