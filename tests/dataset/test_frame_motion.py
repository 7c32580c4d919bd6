"""Where actors go during a frame, against closed forms."""

import numpy as np
import pytest

from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.motion_interpolation import posed_actors, rows_at

CAR = {"class": "car", "asset": "car-sedan"}


def row(time_s, track, **given):
    return {"time_s": time_s, "track": track, **CAR, **given}


@pytest.fixture
def bend(twin, motion_of):
    """Steps of 0.1 s: 1 turns at 0.5 rad/s and 10 m/s; 2 leaves, 3 comes, 4 is put elsewhere."""
    rows = []
    for step in range(6):
        time_s = round(0.1 * step, 9)
        yaw = 3.0 + 0.5 * time_s
        rows.append(
            row(time_s, 1, x=20 * np.sin(yaw), y=-20 * np.cos(yaw), yaw=yaw, pitch=0.02, speed=10)
        )
        if step < 3:
            rows.append(row(time_s, 2, x=step * 1.0, speed=4.0))
        else:
            rows.append(row(time_s, 3, x=step * 1.0))
        rows.append(row(time_s, 4, x=step * 1.0 + (500.0 if step >= 4 else 0.0)))
    return motion_of(twin, sorted(rows, key=lambda r: (r["time_s"], r["track"])), steps=6)


def on_bend(time_s):
    yaw = 3.0 + 0.5 * time_s
    return np.array([20 * np.sin(yaw), -20 * np.cos(yaw), 0.0]), yaw


def actors_at(motion, time_s, start_s=0.0, stop_s=0.1):
    moved = FrameMotions(motion).around(time_s, start_s, stop_s)
    actors = posed_actors(moved.rows, moved.paths())
    return {actor.track: actor for actor in actors}


@pytest.mark.parametrize("time_s", [0.1, 0.2, 0.25, 0.33])
def test_a_path_leads_through_the_steps_around_the_frame(bend, time_s):
    path = actors_at(bend, time_s, -0.07, 0.12)[1].way
    for later in np.linspace(-0.07, 0.12, 20):
        place, yaw = on_bend(time_s + later)
        pose = path.at(later)
        # A chord of 1 m on a circle of 20 m is off by 6 mm at most.
        assert np.linalg.norm(pose.translation - place) < 0.0127
        assert np.exp(1j * yaw) == pytest.approx(
            complex(*pose.rotation[:2, 0]) / np.hypot(*pose.rotation[:2, 0]), abs=1e-6
        )
    for step in np.round(np.arange(6) * 0.1, 9):
        if -0.07 <= step - time_s <= 0.12:
            assert path.at(step - time_s).translation == pytest.approx(on_bend(step)[0], abs=1e-9)


@pytest.mark.parametrize("time_s", [0.0, 0.2, 0.237, 0.5])
def test_at_the_frames_time_it_is_the_frames_own_pose(bend, time_s):
    for actor in actors_at(bend, time_s, -0.05, 0.1).values():
        pose = actor.way.at(0.0)
        assert pose.translation == pytest.approx(actor.site_SE3_asset.translation, abs=1e-12)
        assert pose.rotation == pytest.approx(actor.site_SE3_asset.rotation, abs=1e-12)
    alone = {a.track: a.site_SE3_asset.translation for a in posed_actors(rows_at(bend, time_s))}
    assert set(alone) == set(actors_at(bend, time_s))


def test_its_velocity_is_that_of_its_path(bend):
    """Whatever its speedometer says: 3 has none, and moves 1 m in a step."""
    actors = actors_at(bend, 0.3)
    assert actors[3].velocity == pytest.approx([10.0, 0, 0])
    step = (on_bend(0.4)[0] - on_bend(0.3)[0]) / 0.1
    assert actors[1].velocity == pytest.approx(step)
    assert actors_at(bend, 0.2)[2].velocity == pytest.approx([4.0, 0, 0])


def test_beyond_the_last_step_it_goes_on_as_before(bend):
    path = actors_at(bend, 0.5, 0.0, 0.1)[1].way
    step = on_bend(0.5)[0] - on_bend(0.4)[0]
    assert path.at(0.05).translation == pytest.approx(on_bend(0.5)[0] + step / 2)
    yaw = np.arctan2(*path.at(0.05).rotation[1::-1, 0])
    assert np.exp(1j * yaw) == pytest.approx(np.exp(1j * on_bend(0.55)[1]), abs=1e-6)


def test_before_the_first_step_it_came_as_it_goes_on(bend):
    path = actors_at(bend, 0.0, -0.1, 0.1)[1].way
    step = on_bend(0.1)[0] - on_bend(0.0)[0]
    assert path.at(-0.05).translation == pytest.approx(on_bend(0.0)[0] - step / 2)


def test_who_leaves_goes_on_and_who_comes_has_come(bend):
    leaving = actors_at(bend, 0.2, 0.0, 0.1)[2]
    assert leaving.way.at(0.05).translation == pytest.approx([2.2, 0, 0])
    assert leaving.path is None or leaving.path.time_s.max() <= 1e-9
    coming = actors_at(bend, 0.3, -0.1, 0.1)[3]
    assert coming.way.at(0.05).translation == pytest.approx([3.5, 0, 0])
    assert coming.way.at(-0.05).translation == pytest.approx([2.5, 0, 0])


def test_who_is_put_elsewhere_does_not_fly_there(bend):
    before = actors_at(bend, 0.3, -0.1, 0.1)[4]
    assert before.way.at(0.09).translation == pytest.approx([3.9, 0, 0])
    after = actors_at(bend, 0.4, -0.1, 0.1)[4]
    assert after.way.at(-0.09).translation == pytest.approx([503.1, 0, 0])
    assert 4 not in actors_at(bend, 0.35)


def test_steps_finer_than_a_turn_are_all_there(twin, motion_of):
    """An actor that brakes: ten steps within a turn."""
    times = np.round(np.arange(41) * 0.01, 9)
    rows = [row(t, 1, x=15 * t - 4 * t**2, speed=15 - 8 * t) for t in times]
    motion = motion_of(twin, rows, steps=41, step_s=0.01)
    path = actors_at(motion, 0.2, 0.0, 0.1)[1].way
    for later in np.linspace(0, 0.1, 37):
        t = 0.2 + later
        assert abs(path.at(later).translation[0] - (15 * t - 4 * t**2)) < 2e-4


def test_a_time_outside_the_motion_is_refused(bend):
    for time_s in (-0.1, 0.6):
        with pytest.raises(ValueError, match="outside"):
            FrameMotions(bend).around(time_s)


def test_no_actors(twin, motion_of):
    moved = FrameMotions(motion_of(twin, [], steps=6)).around(0.2, -0.1, 0.2)
    assert moved.paths() == []
    assert len(moved.rows) == 0
