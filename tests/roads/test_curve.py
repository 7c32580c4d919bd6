"""Reference lines and profiles against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from urbantwin.roads.model.curve import FILLET_DEVIATION_M, filleted, splined, turned
from urbantwin.roads.model.profile import fitted


def joints(curve):
    """Place and heading before and after every joint."""
    for k in range(1, len(curve.pieces)):
        s = curve.starts[k]
        yield curve.at(s - 1e-7)[0], curve.at(s + 1e-7)[0]


def test_a_right_angle_becomes_an_arc_that_lanes_inside_can_follow():
    curve = filleted(np.array([[0.0, 0], [40, 0], [40, 40]]), left=7.0, right=0.0)
    assert [bool(piece.curvature) for piece in curve.pieces] == [False, True, False]
    radius = 1 / curve.pieces[1].curvature
    assert radius == pytest.approx(8.0)  # 7 m of lanes and 1 m left
    middle = curve.at(curve.length / 2)[0]
    assert middle[:2] == pytest.approx([32 + 8 * math.sqrt(0.5), 8 - 8 * math.sqrt(0.5)])
    assert curve.at(curve.length)[0] == pytest.approx([40, 40, math.pi / 2])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(2, 60), st.floats(-0.5, 0.5)), min_size=1, max_size=8))
def test_rounded_polylines_have_no_kink_and_stay_near(legs):
    points, heading = [np.zeros(2)], 0.3
    for length, turn in legs:
        points.append(points[-1] + length * np.array([math.cos(heading), math.sin(heading)]))
        heading += turn
    points = np.array(points)
    curve = filleted(points, left=4.0, right=4.0)
    for before, after in joints(curve):
        assert np.abs(before - after).max() < 1e-5
    assert curve.at(0)[0, :2] == pytest.approx(points[0], abs=1e-9)
    assert curve.at(curve.length)[0, :2] == pytest.approx(points[-1], abs=1e-6)
    sharpest = max((abs(turn) for _, turn in legs), default=0)
    inner = 5.0 * (1 / math.cos(sharpest / 2) - 1)  # the arc that lanes inside need
    allowed = max(FILLET_DEVIATION_M, inner)
    near = curve.at(curve.locate(points)[0])[:, :2]
    assert np.linalg.norm(near - points, axis=1).max() <= allowed + 1e-6


def test_a_spline_through_a_circle_is_that_circle():
    angle = np.linspace(0, math.pi / 2, 7)
    points = 12.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    curve = splined(points, math.pi / 2, math.pi)
    at = curve.at(np.linspace(0, curve.length, 200))
    assert np.abs(np.hypot(at[:, 0], at[:, 1]) - 12.0).max() < 0.004
    assert curve.length == pytest.approx(12 * math.pi / 2, abs=0.003)
    for before, after in joints(curve):
        assert np.abs(before - after).max() < 1e-5


def curvature(curve):
    s = np.linspace(0, curve.length, 2000)
    return np.gradient(np.unwrap(curve.at(s)[:, 2]), s)


@settings(max_examples=60, deadline=None)
@given(st.floats(-1.9, 1.9), st.floats(6, 40), st.floats(6, 40))
def test_a_turn_meets_both_ends_without_a_jump_of_curvature(turn, before, after):
    corner = before * np.array([1.0, 0.0])
    end = corner + after * np.array([math.cos(turn), math.sin(turn)])
    curve = turned(np.zeros(3), np.array([*end, turn]))
    assert curve.at(0)[0] == pytest.approx([0, 0, 0], abs=1e-9)
    assert curve.at(curve.length)[0] == pytest.approx([*end, turn], abs=1e-6)
    bend = curvature(curve)
    # It bends less where it meets the lanes; cubics cannot start quite straight.
    assert abs(bend[[0, -1]]).max() < 0.5 * np.abs(bend).max() + 0.01
    for joint, (left, right) in enumerate(joints(curve)):
        assert np.abs(left - right).max() < 1e-5, joint
    # No detour: hardly longer than the two straight legs that it cuts across.
    assert curve.length <= 1.1 * (before + after)


def test_a_right_turn_is_nearly_as_wide_as_the_arc_that_fits():
    curve = turned(np.zeros(3), np.array([12.0, -12.0, -math.pi / 2]))
    # The circle through both ends has 12 m; without a jump of curvature it must be tighter inside.
    assert 1 / np.abs(curvature(curve)).max() > 0.6 * 12.0


def test_a_straight_way_is_straight():
    curve = turned(
        np.array([3.0, 4.0, 0.7]), np.array([3 + 20 * math.cos(0.7), 4 + 20 * math.sin(0.7), 0.7])
    )
    assert curve.length == pytest.approx(20.0, abs=1e-6)
    assert np.abs(curvature(curve)).max() < 1e-6


def test_the_length_of_a_cubic_is_its_arc_length():
    points = np.array([[0.0, 0], [5, 1], [8, 6], [7, 12]])
    for piece in splined(points, 0.0, 2.0).pieces:

        def speed(p, piece=piece):
            du = sum(k * piece.u[k] * p ** (k - 1) for k in (1, 2, 3))
            dv = sum(k * piece.v[k] * p ** (k - 1) for k in (1, 2, 3))
            return math.hypot(du, dv)

        assert piece.length == pytest.approx(quad(speed, 0, 1)[0], abs=1e-7)


def test_stations_and_offsets_lead_back():
    curve = filleted(np.array([[0.0, 0], [30, 5], [50, 30], [90, 31]]), left=5.0, right=5.0)
    s, t = np.linspace(0.5, curve.length - 0.5, 50), np.linspace(-4, 4, 50)
    found = curve.locate(curve.beside(s, t))
    assert found[0] == pytest.approx(s, abs=1e-3)
    assert found[1] == pytest.approx(t, abs=1e-6)


def test_points_beyond_the_ends_are_measured_straight_on():
    curve = filleted(np.array([[0.0, 0], [30, 0]]), left=5.0, right=5.0)
    s, t = curve.locate([[-4.0, 2.0], [37.0, -1.0]])
    assert s == pytest.approx([-4.0, 37.0])
    assert t == pytest.approx([2.0, -1.0])


def test_profiles_keep_to_their_samples_without_a_kink():
    s = np.linspace(0, 120, 121)
    value = 2.0 * np.sin(s / 15.0)
    profile = fitted(s, value, tolerance=0.004)
    assert np.abs(profile.at(s) - value).max() <= 0.004
    for knot in profile.start[1:]:
        assert profile.at(knot - 1e-7) == pytest.approx(profile.at(knot + 1e-7), abs=1e-5)
        assert profile.slope(knot - 1e-7) == pytest.approx(profile.slope(knot + 1e-7), abs=1e-5)
    assert len(fitted(s, 0.03 * s, tolerance=0.004).start) == 1
