"""Errors of reported poses and of the radio, against their distributions in closed form."""

import numpy as np
import pytest
from scipy import stats

from urbantwin.dataset.fleet.node_table import (
    Purpose,
    normal_draws,
    pose_errors,
    received,
    reported_pose,
    uniform_draws,
)
from urbantwin.geometry import Pose
from urbantwin.site.nodes import PoseErrorSpec, RadioSpec

RATE = 10.0
FRAMES = range(4000)


def spec(**parts) -> PoseErrorSpec:
    return PoseErrorSpec.model_validate(parts)


def test_bias_and_drift_are_what_they_are_said_to_be():
    asked = spec(bias={"forward_m": 0.3, "yaw_deg": 2.0}, drift={"left_m": 0.01, "roll_deg": 0.1})
    found = pose_errors(asked, 1, [0, 10, 250], RATE)
    for row, time_s in zip(found, (0.0, 1.0, 25.0), strict=True):
        expected = [0.3, 0.01 * time_s, 0.0, np.radians(2), 0.0, np.radians(0.1 * time_s)]
        np.testing.assert_allclose(row, expected, atol=1e-15)


def test_noise_is_white_and_normal():
    found = pose_errors(spec(noise={"forward_m": 0.2, "yaw_deg": 1.0}), 3, FRAMES, RATE)
    for axis, sigma in ((0, 0.2), (3, np.radians(1.0))):
        assert stats.kstest(found[:, axis], stats.norm(0, sigma).cdf).pvalue > 1e-3
        lagged = np.corrcoef(found[1:, axis], found[:-1, axis])[0, 1]
        assert abs(lagged) < 4 / np.sqrt(len(FRAMES))
    assert abs(np.corrcoef(found[:, 0], found[:, 3])[0, 1]) < 4 / np.sqrt(len(FRAMES))
    assert not found[:, [1, 2, 4, 5]].any()


def test_a_walk_grows_with_the_root_of_time():
    """Its spread after 4 and after 36 seconds, over many nodes."""
    asked = spec(walk={"left_m": 0.5})
    ends = np.array([pose_errors(asked, seed, [0, 40, 360], RATE)[:, 1] for seed in range(400)])
    assert not ends[:, 0].any()
    for column, time_s in ((1, 4.0), (2, 36.0)):
        ratio = np.sum(ends[:, column] ** 2) / (0.5**2 * time_s)
        assert stats.chi2.ppf(1e-4, 400) < ratio < stats.chi2.ppf(1 - 1e-4, 400)
    steps = np.diff(pose_errors(asked, 1, FRAMES, RATE)[:, 1])
    assert stats.kstest(steps, stats.norm(0, 0.5 / np.sqrt(RATE)).cdf).pvalue > 1e-3


def test_a_frame_has_its_error_whichever_others_there_are():
    asked = spec(noise={"up_m": 1.0}, walk={"yaw_deg": 1.0})
    whole = pose_errors(asked, 9, range(100), RATE)
    np.testing.assert_array_equal(pose_errors(asked, 9, [7, 42, 99], RATE), whole[[7, 42, 99]])
    assert (pose_errors(asked, 10, range(100), RATE) != whole)[:, 2].all()
    assert pose_errors(asked, 9, [], RATE).shape == (0, 6)


def test_an_error_is_along_the_axes_of_the_node():
    node = Pose.from_ypr([10.0, 20.0, 1.0], np.pi / 2)
    wrong = reported_pose(node, np.array([1.0, 0.5, 0.1, np.pi / 2, 0.0, 0.0]))
    np.testing.assert_allclose(wrong.translation, [9.5, 21.0, 1.1])
    np.testing.assert_allclose(wrong.rotation, np.diag([-1.0, -1.0, 1.0]), atol=1e-15)


def test_frames_are_lost_and_late_as_often_as_asked():
    sent = np.arange(len(FRAMES)) / RATE
    asked = RadioSpec(latency_s=0.1, jitter_s=0.02, loss=0.1)
    lost, arrival = received(asked, 4, FRAMES, sent)
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], len(FRAMES), 0.1)
    assert low < lost.sum() < high
    late = arrival - sent
    assert stats.kstest(late, stats.norm(0.1, 0.02).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(lost[1:], lost[:-1])[0, 1]) < 4 / np.sqrt(len(FRAMES))
    some = received(asked, 4, [5, 17], sent[[5, 17]])
    np.testing.assert_array_equal(some.arrival_s, arrival[[5, 17]])


def test_nothing_arrives_before_it_is_sent_nor_in_an_outage():
    sent = np.arange(100) / RATE
    asked = RadioSpec.model_validate(
        {"jitter_s": 0.5, "outages": [{"start_s": 1.0, "stop_s": 2.0}, {"start_s": 9.0}]}
    )
    lost, arrival = received(asked, 4, range(100), sent)
    assert (arrival >= sent).all()
    np.testing.assert_array_equal(np.flatnonzero(lost), [*range(10, 20), *range(90, 100)])


@pytest.mark.parametrize("purpose", Purpose)
def test_numbers_of_two_purposes_have_nothing_in_common(purpose):
    mine = uniform_draws(5, purpose, 500)
    assert (mine > 0).all()
    assert (mine < 1).all()
    np.testing.assert_array_equal(uniform_draws(5, purpose, 20), mine[:20])
    others = [uniform_draws(5, one, 500) for one in Purpose if one is not purpose]
    assert not any(np.isin(mine, other).any() for other in others)
    assert stats.kstest(normal_draws(5, purpose, 500).ravel(), "norm").pvalue > 1e-3
