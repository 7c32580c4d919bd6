"""Frames that are not evenly spaced: told or found, and what a gap does to tracks and counts."""

import csv
import json
from itertools import pairwise

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.traffic.calibration.momentary import _spans_s
from urbantwin.traffic.calibration.presence import presence_of
from urbantwin.traffic.observed import read_frame_times, read_observation, spacing_summary
from urbantwin.traffic.observed.association import tracks_of
from urbantwin.traffic.observed.box_fit import SeenObject, unseen_above
from urbantwin.traffic.observed.frame_times import FrameTimes, evenly_spaced
from urbantwin.traffic.observed.observed_track import observed_track
from urbantwin.traffic.observed.spacing import found_times
from urbantwin.traffic.observed.written import spacing_warnings

SENSOR = np.array([0.0, 0.0])
HALF_M = 22.0


def thing(frame, x, y, yaw=0.0, long=0.5, wide=0.45, top=1.7, moves=1.0):
    """An object of which all sides are seen."""
    c, s = np.cos(yaw), np.sin(yaw)
    side = np.linspace(-0.5, 0.5, 12)
    half = np.full(12, 0.5)
    plan = np.vstack(
        [np.column_stack(one) for one in ((side, half), (side, -half), (half, side), (-half, side))]
    ) * [long, wide]
    return SeenObject(frame, plan @ [[c, s], [-s, c]] + [x, y], top, top, 0.3, SENSOR, moves, yaw)


def town(times, seed, walkers=14, cars=5):
    """Frames of people who walk straight on and of cars that drive, at moments; nobody waits.

    Who leaves a square on one side comes back on the other as somebody else, of another height.
    """
    rng = np.random.default_rng(seed)
    count = walkers + cars
    place = rng.uniform(-HALF_M, HALF_M, (count, 2))
    yaw = rng.uniform(0, 2 * np.pi, count)
    speed = np.where(np.arange(count) < walkers, rng.uniform(1.1, 1.6, count), 7.0)
    frames = []
    for number, at in enumerate(times):
        gone = place + (speed * at)[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw)])
        rounds, inside = np.divmod(gone + HALF_M, 2 * HALF_M)
        who = (rounds @ [7.0, 13.0] + np.arange(count)) % 11 / 11
        found = []
        for k, (x, y) in enumerate(inside - HALF_M):
            if rng.random() < 0.1:  # hidden
                continue
            if k < walkers:
                found.append(thing(number, x, y, yaw[k], top=1.5 + 0.4 * who[k]))
            else:
                tall = 1.4 + 0.5 * who[k]
                found.append(thing(number, x, y, yaw[k], 4.3, 1.8, tall))
        frames.append(found)
    return frames


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["even", "all gaps", "some gaps"])
def test_gaps_are_found_by_what_moves(kind, seed):
    rng = np.random.default_rng(seed)
    after = {"even": 0.0, "all gaps": 1.0, "some gaps": 0.4}[kind]
    truth = rng.random(17) < after
    times = np.concatenate([[0.0], np.cumsum(np.where(truth, rng.uniform(6, 40, 17), 1.0))])
    found = found_times(town(times, seed), 1.0)
    assert (found.gap == truth).mean() >= (1.0 if kind == "even" else 0.9)
    assert found.confidence.mean() > 0.9
    np.testing.assert_array_equal(found.time_s, np.arange(18.0))


def test_where_hardly_anybody_moves_frames_are_taken_as_told():
    times = np.cumsum(np.full(12, 20.0))
    assert not found_times(town(times, 1, walkers=0, cars=0), 1.0).gap.any()


def test_over_a_gap_nobody_is_followed_but_who_stands_in_most_frames():
    # A van parks beside the road; a car waits where another waited before the gap.
    frames = [
        [
            thing(k, 9.0, 8.0, 0.0, 4.4, 1.8, 1.5),
            thing(k, 2.0, 14.0, 0.0, 4.9, 2.0, 2.1, moves=0.1),
        ]
        for k in range(4)
    ]
    times = FrameTimes(np.array([0.0, 1.0, 31.0, 32.0]), np.array([False, True, False]))
    tracks = sorted(tracks_of(frames, times), key=lambda one: one.seen[0].top)
    assert [[one.frame for one in track.seen] for track in tracks] == [[0, 1], [2, 3], [0, 1, 2, 3]]
    assert len(tracks_of(frames, evenly_spaced(4, 1.0))) == 2


def test_speeds_are_by_the_seconds_that_passed():
    frames = [[thing(k, 2.0 + x, 8.0, 0.0, 4.4, 1.8, 1.5)] for k, x in enumerate((0, 10, 25, 30))]
    times = FrameTimes(np.array([0.0, 1.0, 2.5, 3.0]), np.zeros(3, bool))
    (track,) = tracks_of(frames, times)
    assert observed_track(track.seen, None, times.time_s).speed == pytest.approx(10.0)


def written(path, rows):
    path.write_text("frame,seconds\n" + "\n".join(f"{name},{at}" for name, at in rows) + "\n")
    return path


def test_times_are_read_by_the_names_of_frames(tmp_path):
    file = written(tmp_path / "t.csv", [("b.bin", 11), ("a.bin", 10.0), ("c.bin", 41.5), ("d", 9)])
    found = read_frame_times(file, ["a", "b", "c"])
    np.testing.assert_array_equal(found.time_s, [0.0, 1.0, 31.5])
    np.testing.assert_array_equal(found.gap, [False, True])
    assert found.told
    assert spacing_summary(found, "abc") == {"gaps": 1, "of_pairs": 2, "gap_after": ["b"]}
    assert not spacing_warnings(found)
    (warned,) = spacing_warnings(FrameTimes(found.time_s, found.gap, np.array([0.9, 1.0])))
    assert "1 of 2 pairs have a gap" in str(warned)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("frame,seconds\na,1\nb,1\n", "frame b is not later than a"),
        ("frame,seconds\na,1\n", "does not say when frame b was taken"),
        ("frame,seconds\na,soon\nb,2\n", "line 2: has no time"),
        ("frame,seconds\na\nb,2\n", "line 2: has no time"),
        ("frame,seconds\na,nan\nb,2\n", "line 2: has no time"),
        ("frame,minutes\na,1\nb,2\n", "lacks columns or rows"),
        ("", "lacks columns or rows"),
        ("\0\0", "lacks columns or rows"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_times_that_are_none_are_one_line(tmp_path, text, problem):
    file = tmp_path / "t.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as error:
        read_frame_times(file, ["a", "b"])
    assert problem in str(error.value)
    assert "\n" not in str(error.value)


def observation(folder, rows, **told):
    with (folder / "tracks.csv").open("w", newline="") as stream:
        columns = "track_id time_s class x y yaw_rad length width height".split()
        boxes = [(*row, 0.0, 0.6, 0.6, 1.7) for row in rows]
        csv.writer(stream).writerows([columns, *boxes])
    document = {"kind": "observation", "frames": 4, "rate_hz": 1.0, **told}
    (folder / "observation.json").write_text(json.dumps(document))


def test_of_people_seen_once_as_many_walk_as_of_the_others(tmp_path):
    # Two of three who were seen twice walk; three more were seen once.
    rows = [(1, 0, "pedestrian", 0, 0), (1, 1, "pedestrian", 1.3, 0)]
    rows += [(2, 0, "pedestrian", 5, 5), (2, 1, "pedestrian", 6.3, 5)]
    rows += [(3, 0, "pedestrian", 9, 9), (3, 1, "pedestrian", 9.1, 9)]
    rows += [(4 + k, 30, "pedestrian", 3 * k, 4) for k in range(3)]
    times = {"times_s": [0.0, 1.0, 30.0, 70.0], "groups": [0, 0, 1, 2]}
    observation(tmp_path, rows, **times)
    tracks, found = read_observation(tmp_path)
    area = shapely.box(-50, -50, 50, 50)
    present = presence_of(tracks, found.time_s, area, {}).classes["pedestrian"]
    np.testing.assert_allclose(present, [2, 2, 3 * 2 / 3, 0])
    assert _spans_s(found) == [2.0, 1.0, 1.0]
    # Without a gap whoever is seen once counts, as nobody stood there before or after.
    observation(tmp_path, [(one[0], one[1] / 10, *one[2:]) for one in rows])
    tracks, found = read_observation(tmp_path)
    assert presence_of(tracks, found.time_s, area, {}).classes["pedestrian"][3] == 3


@pytest.mark.parametrize(
    "times",
    [
        {"times_s": [0.0, 1.0], "groups": [0, 0]},
        {"times_s": [0.0, 2.0, 1.0, 3.0], "groups": [0, 0, 0, 0]},
        {"times_s": [0.0, 1.0, 2.0, 3.0], "groups": [0, 2, 2, 1]},
    ],
)
def test_an_observation_without_a_time_for_each_frame_is_refused(tmp_path, times):
    observation(tmp_path, [(1, 0, "car", 0, 0)], **times)
    with pytest.raises(InputError, match="has not a time for each frame"):
        read_observation(tmp_path)


def test_people_are_as_tall_on_average_as_the_rings_leave_open():
    # Posts of 1.5 to 1.9 m at 5 to 30 m from an eye 1.6 or 3.5 m up, rings 0.4 or 2 degrees apart.
    rng = np.random.default_rng(4)
    off, before = [], []
    for _ in range(400):
        tall, away = rng.uniform(1.5, 1.9), rng.uniform(5, 30)
        above, sensor, ring = [], [], []
        for number, (eye, step) in enumerate(((1.6, 2.0), (3.5, 0.4))):
            steps = np.tan(np.radians(np.arange(-30.0, 15.0, step) + rng.uniform(0, step)))
            heights = eye + away * steps
            met = np.flatnonzero((heights > 0.3) & (heights < tall))
            above += heights[met].tolist()
            ring += met.tolist()
            sensor += [number] * len(met)
        top = max(above)
        before.append(top - tall)
        off.append(before[-1] + unseen_above(*map(np.array, (above, sensor, ring)), top))
    assert np.mean(before) < -0.03
    assert abs(np.mean(off)) < 0.008
    assert np.std(off) < np.std(before) * 1.05


@pytest.mark.parametrize(("wide", "long"), [(0.45, 0.75), (0.25, 0.6)])
def test_who_is_seen_once_and_is_deeper_than_a_trunk_is_in_a_step(wide, long):
    found = observed_track([thing(0, 5.0, 5.0, 0.3, 0.6, wide)], None, np.zeros(1))
    assert found.actor_class == "pedestrian"
    assert found.size == (long, 0.6, 1.7)
    more = [thing(k, 5.0, 5.0, 0.3, 0.6, wide) for k in range(2)]
    assert observed_track(more, None, np.arange(2.0)).size[0] == 0.6


def test_the_confidence_is_as_often_right():
    right, told = [], []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        truth = rng.random(15) < 0.5
        times = np.concatenate([[0.0], np.cumsum(np.where(truth, rng.uniform(4, 30, 15), 1.0))])
        found = found_times(town(times, seed, walkers=4, cars=2), 1.0)
        right += (found.gap == truth).tolist()
        told += found.confidence.tolist()
    assert np.mean(right) == pytest.approx(np.mean(told), abs=0.1)
    assert all(one <= other + 0.15 for one, other in pairwise(_by_confidence(told, right)))


def _by_confidence(told, right):
    """Return the shares that are right of the less sure half and of the surer one."""
    order = np.argsort(told)
    half = len(order) // 2
    return [np.mean(np.array(right)[part]) for part in (order[:half], order[half:])]
