"""Turning round: against the integral of the curvature, and against Dubins's own properties."""

import math

import numpy as np
import pytest

from urbantwin.roads.loop import dubins_path


def walked(curve, start):
    """The end pose by adding up many small steps of the pieces' curvatures."""
    x, y, heading = start
    for piece in curve.pieces:
        steps = 4000
        ds = piece.length / steps
        middle = heading + piece.curvature * ds * (np.arange(steps) + 0.5)
        x, y = x + ds * np.cos(middle).sum(), y + ds * np.sin(middle).sum()
        heading += piece.curvature * piece.length
    return x, y, heading


POSES = np.random.default_rng(3).uniform([-30, -30, -4] * 2, [30, 30, 4] * 2, (60, 6))


@pytest.mark.parametrize("turn", [None, "left", "right"])
def test_it_leads_from_pose_to_pose_on_arcs_of_one_radius(turn):
    for row in POSES:
        start, end = tuple(map(float, row[:3])), tuple(map(float, row[3:]))
        curve = dubins_path(start, end, radius=6.0, turn=turn)
        x, y, heading = walked(curve, start)
        assert math.hypot(x - end[0], y - end[1]) < 1e-3
        assert abs(math.remainder(heading - end[2], math.tau)) < 1e-6
        for piece in curve.pieces:
            assert abs(piece.curvature) == pytest.approx(1 / 6.0) or piece.curvature == 0.0
        assert len(curve.pieces) <= 3


def test_it_is_no_longer_than_any_of_many_other_ways():
    """Line, arc and line through a random pose between is never shorter."""
    random = np.random.default_rng(5)
    start, end = (0.0, 0.0, 0.3), (25.0, 12.0, 2.0)
    shortest = dubins_path(start, end, radius=8.0).length
    for _ in range(200):
        between = tuple(map(float, random.uniform([-20, -20, -4], [40, 40, 4])))
        there = dubins_path(start, between, radius=8.0).length
        assert there + dubins_path(between, end, radius=8.0).length > shortest - 1e-9


@pytest.mark.parametrize(("apart", "radius"), [(3.2, 7.0), (8.0, 7.0), (14.0, 7.0), (30.0, 7.0)])
def test_between_two_lanes_it_is_a_drop_that_turns_left(apart, radius):
    curve = dubins_path((0.0, 0.0, 0.0), (0.0, apart, math.pi), radius=radius, turn="left")
    points = curve.at(np.linspace(0, curve.length, 400))
    # Symmetrical about the street's middle, and round to the left by half a turn in all.
    np.testing.assert_allclose(points[:, 1], apart - points[::-1, 1], atol=1e-6)
    assert points[-1, 2] == pytest.approx(math.pi)
    if apart >= 2 * radius:
        assert curve.length == pytest.approx(math.pi * radius + apart - 2 * radius)
    else:
        # Three circles that touch: the way of a drop, from the triangle of their centres.
        half = math.acos((apart + 2 * radius) / (4 * radius))
        assert curve.length == pytest.approx(radius * (math.pi + 4 * half))


def test_senseless_requests_are_refused():
    with pytest.raises(ValueError, match="radius"):
        dubins_path((0, 0, 0), (1, 1, 1), radius=0.0)
    with pytest.raises(ValueError, match="itself"):
        dubins_path((0, 0, 0), (0, 0, 0))
