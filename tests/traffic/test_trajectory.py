"""Smoothed paths against the curves that they were made from."""

import numpy as np
import pytest
import scipy.signal

from urbantwin.traffic.paths.trajectory import _fitted, _hat, smoothed

STEP_S = 0.1


def driven(path, heading, speed, *, length=4.0, walks=False):
    """Sample a path of arc length in SUMO's terms, and smooth it."""
    distance = np.concatenate([[0.0], np.cumsum(speed[1:]) * STEP_S])
    yaw = heading(distance)
    front, angle = path(distance), np.degrees(np.pi / 2 - yaw) % 360
    out = smoothed(front, angle, speed, step_s=STEP_S, length_m=length, walks=walks)
    nose = out.xy + length / 2 * np.column_stack([np.cos(out.yaw), np.sin(out.yaw)])
    return out, nose, front, yaw


def circle(radius):
    def path(s):
        return radius * np.column_stack([np.sin(s / radius), 1 - np.cos(s / radius)])

    return path, lambda s: s / radius


@pytest.mark.parametrize("radius", [6.0, 12.0, 40.0])
def test_a_curve_keeps_its_radius(radius: float) -> None:
    out, nose, front, yaw = driven(*circle(radius), np.full(60, 6.0))
    assert np.linalg.norm(nose - front, axis=1).max() < 0.08
    assert np.abs(out.yaw - yaw).max() < np.radians(1.0)


def test_the_heading_does_not_jump_at_north() -> None:
    out, _, _, _ = driven(*circle(15.0), np.full(200, 5.0))
    assert np.ptp(out.yaw) == pytest.approx(199 * 0.5 / 15, abs=0.02)
    assert np.abs(np.diff(out.yaw)).max() < 0.04


def test_a_leap_becomes_a_slant() -> None:
    def leaping(s):
        return np.column_stack([s + 0.9 * (s > 20), 0.4 * (s > 20)])

    out, _, _, _ = driven(leaping, lambda s: 0 * s, np.full(100, 5.0))
    steps = np.linalg.norm(np.diff(out.xy, axis=0), axis=1)
    assert steps.max() < 0.5 + 0.25
    assert steps.min() > 0.3
    assert out.xy[-1] - out.xy[0] == pytest.approx([49.5 + 0.9, 0.4], abs=0.05)


def test_who_stands_stands_still_and_keeps_the_heading() -> None:
    speed = np.concatenate([np.linspace(8, 0, 41), np.zeros(50), np.linspace(0, 8, 41)])
    out, nose, front, _ = driven(*circle(30.0), speed)
    still = slice(41, 90)
    assert np.ptp(out.xy[still], axis=0).max() < 1e-9
    assert np.ptp(out.yaw[still]) < 1e-9
    assert np.linalg.norm(nose - front, axis=1).max() < 0.05


def test_who_never_moves_stays_where_it_is() -> None:
    path, heading = (lambda s: np.tile([3.0, 4.0], (len(s), 1))), (lambda s: 0 * s + np.pi / 2)
    out, _, _, _ = driven(path, heading, np.zeros(30))
    np.testing.assert_allclose(out.xy, np.tile([3.0, 2.0], (30, 1)), atol=1e-9)
    np.testing.assert_allclose(out.yaw, np.pi / 2)


def test_walkers_face_where_they_go_whatever_they_are_told() -> None:
    path, _ = circle(5.0)
    wrong = 0.6  # SUMO's angle is the lane's, not the walker's
    out, _, _, _ = driven(path, lambda s: s / 5 + wrong, np.full(150, 1.3), length=0.4, walks=True)
    course = np.gradient(out.xy, axis=0)
    off = np.angle(np.exp(1j * (np.arctan2(course[:, 1], course[:, 0]) - out.yaw)))
    assert np.abs(off).max() < np.radians(6)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_a_short_life_is_no_problem(count: int) -> None:
    out, _, _, _ = driven(*circle(20.0), np.full(count, 9.0))
    assert out.xy.shape == (count, 2)
    assert np.isfinite(out.xy).all()


@pytest.mark.parametrize(("window", "degree"), [(5, 1), (27, 1), (61, 2), (200 - 1, 2)])
def test_local_fits_are_those_of_scipy(window: int, degree: int) -> None:
    values = np.random.default_rng(5).normal(size=200)
    expected = scipy.signal.savgol_filter(values, window, degree, mode="interp")
    np.testing.assert_allclose(_fitted(values, _hat(window, degree)), expected, atol=1e-12)


@pytest.mark.parametrize("leap", [-5.0, 4.0])
def test_who_leaps_along_a_bend_stays_in_it_and_never_turns_back(leap: float) -> None:
    radius, speed = 12.0, np.full(140, 5.0)
    path, heading = circle(radius)

    def place(s):
        return s + leap * (s > 30)

    out, nose, _, _ = driven(lambda s: path(place(s)), lambda s: heading(place(s)), speed)
    assert np.linalg.norm(nose - [0, radius], axis=1) == pytest.approx(radius, abs=0.25)
    ahead = np.column_stack([np.cos(out.yaw), np.sin(out.yaw)])
    steps = (np.diff(out.xy, axis=0) * ahead[:-1]).sum(axis=1)
    assert steps.min() > 0.5 - abs(leap) / 30 * 0.5 - 0.1
    assert steps.max() < 0.5 + abs(leap) / 30 * 0.5 + 0.1
    # It arrives where SUMO has it, and is told as fast as it moves.
    end = np.unwrap(np.arctan2(nose[:, 0], radius - nose[:, 1]))[-1] * radius
    assert end == pytest.approx(place(139 * 0.5), abs=0.1)
    assert out.speed[1:] == pytest.approx(np.hypot(*np.diff(nose, axis=0).T) / STEP_S, abs=0.25)
    assert np.abs(np.diff(out.yaw) / STEP_S * out.speed[1:]).max() < 1.5 * 25 / radius
