"""Angles as they are within half a turn of zero, against directions in the plane."""

from __future__ import annotations

import math

import numpy as np
import pytest

from urbantwin.geometry import wrapped


@pytest.mark.parametrize(("turn", "unit"), [(math.tau, 1.0), (360.0, math.pi / 180)])
def test_points_where_the_angle_did(turn: float, unit: float) -> None:
    angle = np.random.default_rng(1).uniform(-5 * turn, 5 * turn, 1000)
    numbers = np.array([wrapped(float(one), turn) for one in angle])
    for found in (wrapped(angle, turn), numbers):
        assert np.all(np.abs(found) <= turn / 2)
        direction = np.arctan2(np.sin(angle * unit), np.cos(angle * unit))
        np.testing.assert_allclose(found * unit, direction, atol=1e-12)


def test_leaves_a_number_within_half_a_turn_as_it_is() -> None:
    for angle in (0.0, 0.1, -0.1, 3.0, -3.1, 77.7):
        assert wrapped(angle, 360.0) == angle
    assert wrapped(math.nextafter(0.0, 1.0)) > 0.0
