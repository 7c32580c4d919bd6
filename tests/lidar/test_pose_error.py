"""Poses that are reported wrong: the process that they follow, and what it does to points."""

import numpy as np
import pytest

from urbantwin.dataset.sweep_table import sweep_rows
from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.lidar import Scanner
from urbantwin.lidar.sensor_path import pose_error
from urbantwin.site.rig import PoseErrorSpec

EXACT = {"model": "VLP-16", "columns": 900, "effects": False}


def pose_of(row, kind):
    turn = rotation_from_ypr(*(row[f"{kind}_{name}"] for name in ("yaw", "pitch", "roll")))
    return Pose(turn, np.array([row[f"{kind}_{name}"] for name in "xyz"]))


def test_what_wanders_is_a_gauss_markov_process():
    """Its variance and its correlation over time, over many sensors and axes."""
    spec = PoseErrorSpec(rms_m=0.1, rms_deg=0.2, memory_s=5.0)
    times = np.arange(0.0, 400.0, 0.5)
    found = np.stack([pose_error(spec, times, 3, sensor) for sensor in range(40)])
    size = np.repeat([0.1, np.radians(0.2)], 3)
    whitened = found / size
    assert whitened.std() == pytest.approx(1.0, rel=0.05)
    assert np.abs(whitened.mean(axis=(0, 1))).max() < 0.1
    for lag in (2, 10, 20):  # 1, 5 and 10 s
        told = (whitened[:, lag:] * whitened[:, :-lag]).mean()
        assert told == pytest.approx(np.exp(-lag * 0.5 / 5.0), abs=0.06)
    flat = whitened.transpose(0, 2, 1).reshape(240, -1)
    others = np.corrcoef(flat)[~np.eye(240, dtype=bool)]
    assert np.abs(others).mean() < 0.15  # neither axes nor sensors know of each other


def test_what_drifts_goes_off_steadily_and_begins_right():
    spec = PoseErrorSpec(drift_m_per_min=0.6, drift_deg_per_min=3.0)
    off = pose_error(spec, np.array([0.0, 30.0, 60.0]), 1, 0)
    np.testing.assert_array_equal(off[0], 0.0)
    np.testing.assert_allclose(off[2], 2 * off[1])
    assert np.linalg.norm(off[2, :3]) == pytest.approx(0.6)
    assert np.linalg.norm(off[2, 3:]) == pytest.approx(np.radians(3.0))
    ways = np.stack([pose_error(spec, np.array([60.0]), 1, one)[0, :3] for one in range(400)])
    assert np.abs(ways.mean(axis=0)).max() < 0.06  # every direction alike


@pytest.mark.parametrize("sway", [None, {"rms_m": 0.02}])
def test_points_lie_where_the_sensor_is_believed_to_be(street, rig_of, sway):
    """The same points as without, carried from the true pose to the reported one."""
    wrong = {"rms_m": 0.3, "rms_deg": 2.0, "memory_s": 10.0, "drift_m_per_min": 6.0}
    rigs = [
        rig_of(street, {**EXACT, **more, "sway": sway}, frame="site")
        for more in ({}, {"pose_error": wrong})
    ]
    frames = [Scanner(street, rig, seed=4) for rig in rigs]
    for index in (0, 37):
        plain, moved = (one.scan(index, []) for one in frames)
        (row,), (usual,) = (sweep_rows(rig, index, 4) for rig in (rigs[1], rigs[0]))
        true, reported = pose_of(row, "true"), pose_of(row, "reported")
        assert true.translation == pytest.approx(pose_of(usual, "true").translation, abs=1e-9)
        believed = pose_of(usual, "reported")
        assert np.linalg.norm(reported.translation - believed.translation) > 0.05
        assert len(plain.points) == len(moved.points) > 1000
        there = (reported @ believed.inverse()).apply(plain.points[:, :3].astype(np.float64))
        # What is not known of a turn's first moment is what it wanders within the turn.
        np.testing.assert_allclose(moved.points[:, :3], there, atol=0.02 if sway else 1e-4)


def test_every_sensor_is_wrong_in_its_own_way(street, rig_of):
    wrong = {"pose_error": {"rms_m": 0.3}}
    rig = rig_of(street, {**EXACT, **wrong}, {**EXACT, **wrong})
    rows = sweep_rows(rig, 3, 4)
    assert rows[0]["true_x"] == rows[1]["true_x"]
    assert abs(rows[0]["reported_x"] - rows[1]["reported_x"]) > 0.01
