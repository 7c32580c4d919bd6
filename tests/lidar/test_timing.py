"""When sensors fire: the makers' firing times, phases, rates, clocks, and turns that are lost."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.geometry import Pose
from urbantwin.lidar import MountedSensor, sensor
from urbantwin.lidar.timing import span_of, sweeps_of, turns_of
from urbantwin.site.rig import Effects

FRAMES = 300


@pytest.fixture(scope="module")
def mounted():
    """What makes a sensor in the middle of nowhere."""

    def make(model="OS1-128", **given):
        entry = sensor(model)
        given = {"columns": entry.columns, "effects": Effects(), "rate_hz": 10.0, **given}
        given.setdefault("turns_per_second", given["rate_hz"])
        given.setdefault("frame_window_s", 1 / given["rate_hz"])
        return MountedSensor("a", entry, site_SE3_sensor=Pose.from_ypr(np.zeros(3)), **given)

    return make


def firing(one, frame, seed=0):
    """True times (C, K) of every ray of the only turn of a frame, from the motion's start."""
    (sweep,) = sweeps_of(one, frame, seed)
    return frame / one.rate_hz + sweep.ring_time_s[:, None] + sweep.column_time_s


def test_the_columns_of_a_turn_are_evenly_spread_over_it(mounted):
    time_s = firing(mounted(columns=512), 7)
    assert time_s.shape == (128, 512)
    assert time_s[0] == pytest.approx(0.7 + np.arange(512) / 5120, abs=1e-12)


def test_channels_fire_as_the_maker_says(mounted):
    # VLP-16 User Manual, 9.4: laser n of a sequence fires n x 2.304 us after its begin.
    time_s = firing(mounted("VLP-16"), 0)
    assert time_s[:, 0] == pytest.approx(2.304e-6 * np.arange(16), abs=1e-12)
    # One column later, a turn of 0.1 s in 1800 columns.
    assert time_s[3, 1] == pytest.approx(0.1 / 1800 + 3 * 2.304e-6, abs=1e-12)


def test_unknown_firing_times_are_all_the_columns_own(mounted):
    assert np.ptp(firing(mounted("HDL-64E"), 0), axis=0).max() == 0


@pytest.mark.parametrize("rate_hz", [5.0, 7.5, 10.0, 20.0])
@pytest.mark.parametrize("phase_deg", [0.0, 0.2, 90.0, 123.4, 359.9])
def test_a_locked_encoder_stands_at_its_phase_when_frames_begin(mounted, rate_hz, phase_deg):
    one = mounted("VLP-16", rate_hz=rate_hz, phase_deg=phase_deg)
    for frame in (0, 1, 299, 35_999):
        (sweep,) = sweeps_of(one, frame, 0)
        time_s = sweep.column_time_s
        assert time_s.min() >= -1e-9
        assert time_s.max() < 1 / rate_hz
        # The encoder's angle when column k fires is that of the column.
        angle = phase_deg + 360 * rate_hz * time_s
        miss = (angle - np.arange(1800) * 0.2 + 180) % 360 - 180
        assert np.abs(miss).max() < 1e-6
        assert sweep.first_column == int(np.ceil(phase_deg / 0.2 - 1e-6)) % 1800


def test_two_locked_sensors_look_into_their_phases_at_the_same_time(mounted):
    """Half a turn apart, they sweep the same direction half a turn apart in time, for ever."""
    ahead = mounted(clock_drift_ppm=40.0)
    behind = replace(ahead, phase_deg=180.0, clock_drift_ppm=-25.0, number=1)
    for frame in (0, 10, 36_000):
        between = np.abs(firing(ahead, frame)[0] - firing(behind, frame)[0])
        assert between == pytest.approx(0.05, abs=1e-9)


def test_unlocked_sensors_begin_anywhere_and_drift_apart(mounted):
    fast = mounted(phase_lock=False, clock_drift_ppm=100.0)
    slow = replace(fast, clock_drift_ppm=-100.0, number=1)

    def turns(one):
        every = [turn for n in range(6000) for turn in absolute(one, n)]
        return np.array([number for number, _ in every]), np.array([start for _, start in every])

    def absolute(one, frame):
        return [(t.number, t.start_s + frame / 10) for t in turns_of(one, frame, 3)]

    for one, rate in ((fast, 10 * (1 + 1e-4)), (slow, 10 * (1 - 1e-4))):
        number, start = turns(one)
        assert (np.diff(number) == 1).all()
        assert np.diff(start) == pytest.approx(1 / rate, abs=1e-9)
    # Where they begin in the first frame is anywhere.
    starts = [turns_of(replace(fast, number=n), 0, seed)[0].start_s for n in range(8)
              for seed in range(25)]  # fmt: skip
    assert np.histogram(starts, bins=5, range=(0, 0.1))[0].min() > 20


def test_a_frame_has_as_many_turns_as_the_sensor_makes(mounted):
    count = {
        spin: [len(sweeps_of(mounted(turns_per_second=spin), n, 0)) for n in range(20)]
        for spin in (5.0, 10.0, 20.0, 15.0)
    }
    assert count[5.0] == [1, 0] * 10
    assert count[10.0] == [1] * 20
    assert count[20.0] == [2] * 20
    assert sum(count[15.0]) == 30
    second = sweeps_of(mounted(turns_per_second=20.0), 4, 0)[1]
    assert second.column_time_s[0] == pytest.approx(0.05)
    assert np.ptp(second.column_time_s) < 0.05


def test_frames_with_gaps_between_them_take_one_turn_each(mounted):
    one = mounted(rate_hz=2.0, turns_per_second=10.0, frame_window_s=0.1)
    for frame in range(20):
        (sweep,) = sweeps_of(one, frame, 0)
        assert sweep.column_time_s.min() == 0
        assert sweep.column_time_s.max() < 0.1
        assert sweep.turn == 5 * frame


def test_late_data_are_older(mounted):
    (sweep,) = sweeps_of(mounted(latency_s=0.25), 10, 0)
    assert sweep.turn == 8
    assert sweep.column_time_s[0] == pytest.approx(-0.2)
    # Nothing was measured before the motion's start.
    assert [len(turns_of(mounted(latency_s=0.25), n, 0)) for n in range(4)] == [0, 0, 1, 1]
    (turn,) = turns_of(mounted(latency_s=0.25), 10, 0)
    assert turn.arrival_s == pytest.approx(-0.2 + 0.1 + 0.25)


@pytest.mark.parametrize("locked", [True, False])
def test_frames_by_clocks_hold_the_turns_that_their_clock_dates_into_them(mounted, locked):
    for offset_s, drift_ppm in ((0.25, 0.0), (-0.13, 0.0), (0.04, 500.0), (0.1, 0.0)):
        one = mounted(
            framed_by_clock=True,
            phase_lock=locked,
            clock_offset_s=offset_s,
            clock_drift_ppm=drift_ppm,
            latency_s=0.4,  # of no account
        )
        numbers = []
        for frame in range(40, 60):
            for turn in turns_of(one, frame, 0):
                true_s = frame / 10 + turn.start_s
                dated = true_s * (1 + drift_ppm * 1e-6) + offset_s
                assert frame / 10 - 1e-6 <= dated < (frame + 1) / 10 + 1e-6
                numbers.append(turn.number)
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_the_clock_is_ahead_by_its_offset_and_gains_by_its_drift(mounted):
    one = mounted(clock_offset_s=0.002, clock_drift_ppm=30.0)
    for frame in (0, 9000):
        (sweep,) = sweeps_of(one, frame, 0)
        true = frame / 10 + sweep.column_time_s
        told = frame / 10 + sweep.reported(sweep.column_time_s)
        assert told - true == pytest.approx(0.002 + 30e-6 * true, abs=1e-12)


def test_turns_begin_with_the_jitter_that_was_asked(mounted):
    one = mounted(time_jitter_s=0.004)
    late = [turns_of(one, n, 1)[0].start_s for n in range(2000)]
    assert np.std(late) == pytest.approx(0.004, rel=0.07)
    assert abs(np.mean(late)) < 0.004 / 10
    assert np.abs(late).max() <= 0.012
    # Another sensor, another seed: other draws.
    for other in ([turns_of(replace(one, number=1), n, 1)[0].start_s for n in range(2000)],
                  [turns_of(one, n, 2)[0].start_s for n in range(2000)]):  # fmt: skip
        assert abs(np.corrcoef(late, other)[0, 1]) < 0.08


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_turns_are_lost_as_often_as_was_asked(mounted, share):
    one = mounted(dropped_frames=share)
    kept = sum(len(sweeps_of(one, n, 0)) for n in range(2000))
    assert kept == pytest.approx(2000 * (1 - share), abs=4 * np.sqrt(2000 * share * (1 - share)))
    assert sum(turn.dropped for n in range(2000) for turn in turns_of(one, n, 0)) == 2000 - kept


def test_the_order_in_which_frames_are_asked_for_changes_nothing(mounted):
    one = mounted(time_jitter_s=0.004, dropped_frames=0.3, phase_lock=False)
    forwards = [turns_of(one, n, 5) for n in range(40)]
    assert [turns_of(one, n, 5) for n in reversed(range(40))] == forwards[::-1]


def test_without_rolling_shutter_all_rays_see_the_moment_of_the_frame(mounted):
    one = mounted("VLP-16", effects=Effects.none(), phase_deg=77.0)
    for frame in (0, 3, 1234):
        assert (firing(one, frame) == frame / 10).all()


@pytest.mark.parametrize("effects", [Effects(), Effects.none()])
def test_the_span_of_a_frame_holds_every_firing(mounted, effects):
    # Pandar64's channels fire before the time that the maker counts a column from.
    rig = [
        mounted("Pandar64", effects=effects),
        mounted("VLP-16", effects=effects, latency_s=0.14, time_jitter_s=0.002, number=1),
    ]
    for frame in range(1, 30):
        low, high = span_of(rig, frame, 0)
        every = np.concatenate([(firing(one, frame) - frame / 10).ravel() for one in rig])
        assert low - 1e-12 <= every.min()
        assert every.max() <= high + 1e-12
        assert low <= 0 <= high
        assert high - low < 0.3
