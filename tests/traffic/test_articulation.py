"""Bodies of vehicles that bend: on circles, by the geometry of chords and of towed axles."""

from itertools import pairwise

import numpy as np

from urbantwin.traffic.assets import Body, asset, asset_names
from urbantwin.traffic.paths.bending import on_rails, towed

RADIUS_M = 25.0


def test_bodies_of_a_tram_are_chords_of_the_circle_that_its_track_is():
    angle = np.linspace(-2.0, 3.0, 4000)
    track = RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    nose = np.linspace(80.0, 110.0, 7)
    for name in asset_names("tram"):
        bodies = asset(name).bodies
        poses = on_rails(bodies, track, nose)
        for body, (middle, yaw) in zip(bodies, poses, strict=True):
            front, rear = body.guides_m
            sagitta = RADIUS_M * np.cos((rear - front) / 2 / RADIUS_M)
            # Heading: the tangent at the arc's middle.
            at = (nose - (front + rear) / 2) / RADIUS_M - 2.0
            np.testing.assert_allclose(np.cos(yaw - at - np.pi / 2), 1.0, atol=1e-5)
            off = (front + rear) / 2 - body.middle_m
            np.testing.assert_allclose(
                np.linalg.norm(middle, axis=1), np.hypot(sagitta, off), atol=2e-3
            )
        # Two bodies share the joint between them.
        for (a, one), (b, other) in pairwise(zip(bodies, poses, strict=True)):
            assert np.isclose(a.guides_m[1], b.guides_m[0])
            tail = one[0] - _unit(one[1]) * (asset(a.asset).length / 2)
            nose_of_next = other[0] + _unit(other[1]) * (asset(b.asset).length / 2)
            assert np.linalg.norm(tail - nose_of_next, axis=1).max() < 0.7


def test_a_straight_tram_is_as_long_as_the_catalogue_says():
    track = np.array([[0.0, 0.0], [100.0, 0.0]])
    for name in asset_names("tram"):
        whole = asset(name)
        poses = on_rails(whole.bodies, track, np.array([60.0]))
        ends = [
            (middle[0, 0] + asset(b.asset).length / 2, middle[0, 0] - asset(b.asset).length / 2)
            for b, (middle, _) in zip(whole.bodies, poses, strict=True)
        ]
        assert np.isclose(ends[0][0], 60.0)
        assert np.isclose(ends[-1][1], 60.0 - whole.length)
        gaps = [a[1] - b[0] for a, b in pairwise(ends)]
        assert min(gaps) > 0.1


def test_a_towed_axle_settles_on_the_circle_of_pythagoras():
    """A trailer behind a joint on a circle runs on one of radius sqrt(R2 - bar2)."""
    bar, angle = 8.0, np.linspace(0.0, 9.0, 600)
    nose = RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle)])
    bodies = (Body("tractor", 3.0, (1.4, 5.0)), Body("trailer", 10.0, (4.0, 4.0 + bar)))
    yaw = angle + np.pi / 2
    length = 16.0
    poses = towed(bodies, nose - _unit(yaw) * length / 2, yaw, length_m=length)
    first, trailer = poses
    joint = first[0] + _unit(first[1]) * (3.0 - 4.0)
    joint_radius = np.linalg.norm(joint[-1])
    axle = trailer[0] + _unit(trailer[1]) * (10.0 - (4.0 + bar))
    assert np.isclose(np.linalg.norm(axle[-1]), np.sqrt(joint_radius**2 - bar**2), atol=0.03)
    np.testing.assert_allclose(np.linalg.norm(joint - axle, axis=1), bar, atol=1e-6)


def test_a_towed_body_that_is_not_moved_stays():
    middle = np.zeros((5, 2))
    bodies = (Body("tractor", 3.0, (1.4, 5.0)), Body("trailer", 10.0, (4.0, 12.0)))
    poses = towed(bodies, middle, np.full(5, 0.3), length_m=16.0)
    for at, yaw in poses:
        assert np.ptp(at, axis=0).max() < 1e-9
        np.testing.assert_allclose(yaw, 0.3)


def _unit(yaw):
    return np.column_stack([np.cos(yaw), np.sin(yaw)])
