"""The sway of poles, against what a damped oscillator and a cantilever do."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad
from scipy.optimize import brentq

from urbantwin.geometry import Pose
from urbantwin.lidar.sensor_path import SLOPE_OF_FIRST_MODE, TONES, SwayingPath, displacement
from urbantwin.site.rig import SwaySpec

SWAY = SwaySpec(rms_m=0.02, frequency_hz=1.5, damping=0.05)
TIMES = np.arange(0.0, 4000.0, 0.05)


@pytest.fixture(scope="module")
def motion() -> np.ndarray:
    return displacement(SWAY, TIMES, seed=3, pole=0)


def test_displacement_has_the_rms_that_is_asked_for(motion):
    np.testing.assert_allclose(motion.std(axis=0), SWAY.rms_m, rtol=0.03)
    np.testing.assert_allclose(motion.mean(axis=0), 0.0, atol=0.0005)
    assert abs(np.corrcoef(motion.T)[0, 1]) < 0.1  # The two directions do not know each other.
    assert np.abs(motion).max() <= SWAY.rms_m * np.sqrt(2 * TONES)


def test_power_lies_where_an_oscillator_has_it(motion):
    """Shares of power by frequency against the integral of the oscillator's response."""

    def response(ratio):
        return 1.0 / ((1 - ratio**2) ** 2 + (2 * SWAY.damping * ratio) ** 2)

    total = quad(response, 0, 4, points=[1.0], limit=500)[0]
    frequency, power = signal.periodogram(motion[:, 0], fs=20.0)
    for low, high in [(0.0, 1.2), (1.2, 1.45), (1.45, 1.55), (1.55, 1.8), (1.8, 6.0)]:
        wanted = quad(response, low / 1.5, high / 1.5, points=[1.0], limit=500)[0] / total
        found = power[(frequency >= low) & (frequency < high)].sum() / power.sum()
        assert found == pytest.approx(wanted, abs=1.5 / TONES)


def test_slope_of_a_cantilevers_first_mode():
    """From the mode's own equation: cos(b) cosh(b) = -1, and its shape at the free end."""
    b = brentq(lambda x: np.cos(x) * np.cosh(x) + 1, 1.5, 2.5)
    ratio = (np.cos(b) + np.cosh(b)) / (np.sin(b) + np.sinh(b))
    deflection = np.cosh(b) - np.cos(b) - ratio * (np.sinh(b) - np.sin(b))
    slope = b * (np.sinh(b) + np.sin(b) - ratio * (np.cosh(b) - np.cos(b)))
    assert pytest.approx(slope / deflection, rel=1e-4) == SLOPE_OF_FIRST_MODE


def test_a_pole_leans_the_way_it_moves():
    rest = Pose.from_ypr((4.0, 5.0, 6.0), 0.7, 0.1, -0.05)
    path = SwayingPath(rest, SWAY, 6.0, 10.0, seed=1, pole=2)
    times = np.linspace(-0.1, 0.1, 41)
    rotation, translation = path.true_poses(times)
    moved = displacement(SWAY, 10.0 + times, 1, 2)
    np.testing.assert_allclose(translation[:, :2] - (4, 5), moved, atol=1e-12)
    np.testing.assert_allclose(translation[:, 2], 6.0)
    # Where the pole's own upright points after it leaned.
    upright = (rotation @ rest.rotation.T)[:, :, 2]
    np.testing.assert_allclose(upright[:, :2], moved * SLOPE_OF_FIRST_MODE / 6.0, rtol=1e-4)
    reported, place = path.reported_poses(times)
    np.testing.assert_array_equal(place, np.tile(rest.translation, (41, 1)))
    np.testing.assert_array_equal(reported[7], rest.rotation)
    assert not path.is_fixed


def test_frames_join_up_and_poles_differ():
    """A time is the same whichever frame asks for it; another pole or seed moves otherwise."""
    pose = Pose.from_ypr((0, 0, 5))
    one = SwayingPath(pose, SWAY, 5.0, 1.0, 9, 0).true_poses(np.array([0.1]))
    next_ = SwayingPath(pose, SWAY, 5.0, 1.1, 9, 0).true_poses(np.array([0.0]))
    np.testing.assert_allclose(one[1], next_[1], atol=1e-12)
    for seed, pole in [(9, 1), (10, 0)]:
        other = SwayingPath(pose, SWAY, 5.0, 1.0, seed, pole).true_poses(np.array([0.1]))
        assert np.abs(other[1] - one[1]).max() > 1e-4


def test_sensors_on_one_pole_swing_together(ground_mesh, rig_of):
    sway = {"rms_m": 0.01}
    sensors = ({"sway": sway}, {"east_m": 0.3, "height_m": 6.0, "sway": sway}, {"north_m": 30.0})
    rig = rig_of(ground_mesh(), *sensors)
    paths = [one.path(12, 5) for one in rig.sensors]
    first, second = (path.true_poses(np.zeros(1))[1][0] for path in paths[:2])
    np.testing.assert_allclose(second - first, (0.3, 0, 1), atol=1e-12)
    assert paths[2].is_fixed
