"""Actors between two steps of the motion, against closed forms."""

import numpy as np
import pytest

from urbantwin.dataset.motion_interpolation import posed_actors, rows_at

CAR = {"class": "car", "asset": "car-sedan"}


@pytest.fixture
def turning(twin, motion_of):
    """Track 1 drives over the cut of the yaw; 2 leaves, 3 comes, 4 is put elsewhere."""
    return motion_of(
        twin,
        [
            {"time_s": 0.0, "track": 1, **CAR, "x": 1.0, "y": 2.0, "yaw": 3.1, "speed": 4.0},
            {"time_s": 0.0, "track": 2, **CAR},
            {"time_s": 0.0, "track": 4, **CAR, "x": 0.0},
            {
                "time_s": 0.5,
                "track": 1,
                **CAR,
                "x": 3.0,
                "y": 1.0,
                "z": 0.4,
                "yaw": -3.1,
                "pitch": 0.1,
                "speed": 8.0,
                "phase": 3,
            },
            {"time_s": 0.5, "track": 3, **CAR},
            {"time_s": 0.5, "track": 4, **CAR, "x": 500.0},
        ],
        steps=2,
        step_s=0.5,
    )


def test_at_a_step_the_steps_own_rows_are_given(turning):
    assert rows_at(turning, 0.0)["track"].tolist() == [1, 2, 4]
    assert rows_at(turning, 0.5 + 1e-9)["track"].tolist() == [1, 3, 4]
    assert rows_at(turning, 0.5)["x"].tolist() == [3, 0, 500]


def test_between_two_steps_positions_and_angles_go_straight(turning):
    (row,) = rows_at(turning, 0.125)
    assert row["track"] == 1
    assert [row["x"], row["y"], row["z"]] == pytest.approx([1.5, 1.75, 0.1])
    assert row["pitch"] == pytest.approx(0.025)
    assert row["speed"] == pytest.approx(5)
    # 3.1 to -3.1 is 0.083 rad the short way round, through pi.
    short = 2 * np.pi - 6.2
    assert np.exp(1j * row["yaw"]) == pytest.approx(np.exp(1j * (3.1 + short / 4)))


def test_what_cannot_be_mixed_is_that_of_the_nearer_step(turning):
    assert rows_at(turning, 0.2)["phase"].tolist() == [0]
    assert rows_at(turning, 0.3)["phase"].tolist() == [3]


def test_a_time_outside_the_motion_is_refused(turning):
    for time_s in (-0.1, 0.6):
        with pytest.raises(ValueError, match="outside"):
            rows_at(turning, time_s)


def test_velocity_is_the_speed_along_the_heading(turning):
    actor = posed_actors(rows_at(turning, 0.5))[0]
    assert actor.velocity[:2] == pytest.approx(
        8 * np.cos(0.1) * np.array([np.cos(-3.1), np.sin(-3.1)])
    )
    # Positive pitch tips the nose down.
    assert actor.velocity[2] == pytest.approx(-8 * np.sin(0.1))
    assert actor.site_SE3_asset.translation.tolist() == [3, 1, 0.4]
