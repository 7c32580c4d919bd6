"""Headings against the closed forms of the bicycle model."""

import numpy as np
import pytest

from urbantwin.traffic.paths.trajectory import steered


@pytest.mark.parametrize(("radius", "rear_m"), [(8.0, 1.35), (12.0, 3.0), (40.0, 1.35)])
def test_in_a_steady_curve_the_rear_axle_runs_inside(radius: float, rear_m: float) -> None:
    turn = np.linspace(0, 1.8 * np.pi, 800)
    xy = radius * np.column_stack([np.sin(turn), -np.cos(turn)])
    yaw = steered(xy, turn, rear_m)
    assert (turn - yaw)[-200:] == pytest.approx(np.arcsin(rear_m / radius), abs=2e-3)
    rear = xy - rear_m * np.column_stack([np.cos(yaw), np.sin(yaw)])
    inner = np.sqrt(radius**2 - rear_m**2)
    assert np.hypot(*rear.T)[-200:] == pytest.approx(inner, abs=2e-3)


def test_the_rear_axle_never_slips_to_the_side() -> None:
    way = np.linspace(0, 60, 1200)
    xy = np.column_stack([way, 3.0 * np.sin(way / 6)])
    yaw = steered(xy, np.zeros(len(way)), 1.4)
    rear = xy - 1.4 * np.column_stack([np.cos(yaw), np.sin(yaw)])
    moved, middle = np.diff(rear, axis=0), (yaw[1:] + yaw[:-1]) / 2
    aside = moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle)
    assert np.abs(aside).max() < 0.002 * np.linalg.norm(moved, axis=1).max()


def test_on_a_straight_line_the_heading_is_the_tractrix() -> None:
    way = np.array([0.0, 0.7, 1.0, 2.5, 6.0])
    yaw = steered(np.column_stack([way, 0 * way]), np.full(5, 1.1), 1.4)
    # tan(d/2) = tan(d0/2) exp(-s/a) (Steinhaus, Mathematical Snapshots, on the tractrix).
    expected = 2 * np.arctan(np.tan(1.1 / 2) * np.exp(-way / 1.4))
    np.testing.assert_allclose(yaw, expected, atol=1e-12)


def test_who_stands_keeps_the_heading_and_who_has_no_axle_too() -> None:
    still = np.tile([3.0, 4.0], (5, 1))
    np.testing.assert_array_equal(steered(still, np.full(5, 2.0), 1.3), np.full(5, 2.0))
    moving = np.column_stack([np.arange(5.0), np.arange(5.0)])
    np.testing.assert_array_equal(steered(moving, np.full(5, 2.0), 0.0), np.full(5, 2.0))
