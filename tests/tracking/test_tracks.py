"""Tracks of road users whose ways are known, from detections that err, miss and invent."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import urbantwin as ut
from urbantwin.detections import Detections, joined, read_detections, write_detections
from urbantwin.geometry import Pose, wrapped
from urbantwin.tracking import tracked
from urbantwin.tracking.estimation import estimates
from urbantwin.tracking.kalman import begun, measured, predicted
from urbantwin.tracking.road_user import group_of

Floats = NDArray[np.float64]
CAR, BUS, PERSON = (4.4, 1.8, 1.5), (12.0, 2.5, 3.1), (0.6, 0.7, 1.7)


class Street:
    """Road users on known ways, and what a detector says of them."""

    def __init__(self, times: Floats) -> None:
        self.times, self.who = times, list[tuple[str, Floats]]()

    def add(self, name: str, size: tuple[float, float, float], at: Callable[[Floats], Any]) -> None:
        """Add one; ``at`` gives x, y and yaw."""
        x, y, yaw = (np.broadcast_to(one, self.times.shape) for one in at(self.times))
        sides = [np.full(len(self.times), value) for value in (size[2] / 2, *size)]
        self.who.append((name, np.column_stack([x, y, *sides, yaw])))

    def detections(
        self,
        seen: Callable[[int, float], bool] = lambda who, time_s: True,
        *,
        noise_m: float = 0.0,
        flips: float = 0.0,
        missed: float = 0.0,
        invented: int = 0,
        names: Callable[[str, int], str] = lambda name, frame: name,
    ) -> Detections:
        """Return what is found."""
        rng = np.random.default_rng(7)
        found = []
        for frame, time_s in enumerate(self.times):
            boxes, kinds, scores = [], [], []
            for who, (name, way) in enumerate(self.who):
                if not seen(who, float(time_s)) or rng.random() < missed:
                    continue
                box = way[frame].copy()
                box[:3] += rng.normal(0, noise_m, 3) * [1, 1, 0.3]
                box[3:6] *= np.exp(rng.normal(0, noise_m / 4, 3))
                box[6] += rng.normal(0, noise_m / 4) + np.pi * (rng.random() < flips)
                boxes.append(box)
                kinds.append(names(name, frame))
                scores.append(0.8)
            for _ in range(rng.poisson(invented)):
                place = [*rng.uniform(-40, 40, 2), 0.8]
                boxes.append(np.array([*place, *CAR, rng.uniform(-3, 3)]))
                kinds.append("car")
                scores.append(0.4)
            found.append((np.reshape(boxes, (-1, 7)), kinds, np.array(scores)))
        names_of = [f"{k:06d}" for k in range(len(self.times))]
        return joined(names_of, found, self.times)

    def error(self, tracks: Detections, who: int) -> tuple[Floats, Floats, set[int]]:
        """Return how far the nearest track is, its heading off, and which tracks it was."""
        way = self.who[who][1]
        away, off, numbers = [], [], set[int]()
        for frame in range(len(self.times)):
            mine = tracks.of(frame)
            if not len(mine):
                continue
            gap = np.linalg.norm(mine.box[:, :2] - way[frame, :2], axis=1)
            near = int(gap.argmin())
            if gap[near] < (1.0 if self.who[who][0] == "pedestrian" else 2.0):
                away.append(gap[near])
                off.append(abs(float(wrapped(mine.box[near, 6] - way[frame, 6]))))
                numbers.add(int(mine.track[near]))
        return np.array(away), np.array(off), numbers


def crossing(rate: float = 10.0, seconds: float = 12.0) -> Street:
    """Return a street: a car that turns, a bus, a car that waits, two people side by side."""
    street = Street(np.arange(round(seconds * rate)) / rate)
    turn = 0.25
    street.add("car", CAR, lambda t: (20 * np.sin(turn * t), -20 * np.cos(turn * t), turn * t))
    street.add("bus", BUS, lambda t: (-40 + 7 * t, 6.0, 0.0))
    street.add("car", CAR, lambda t: (-10.0, -30.0, 2.0))
    street.add("pedestrian", PERSON, lambda t: (5.0, -6 + 1.3 * t, np.pi / 2))
    street.add("pedestrian", PERSON, lambda t: (6.2, -6 + 1.3 * t, np.pi / 2))
    return street


@pytest.mark.parametrize("smooth", [False, True])
def test_everybody_has_one_track_one_class_one_size_and_a_front(smooth: bool) -> None:
    street = crossing()
    found = street.detections(
        noise_m=0.2,
        flips=0.15,
        missed=0.15,
        invented=2,
        names=lambda name, frame: "truck" if name == "bus" and frame % 5 == 0 else name,
    )
    tracks = tracked(found, street.times, smooth=smooth)
    assert sorted(tracks.class_names[int((tracks.track == k).argmax())] for k in range(5)) == [
        "bus", "car", "car", "pedestrian", "pedestrian",
    ]  # fmt: skip
    assert tracks.track.max() == 4  # what is invented is nobody
    for who, (name, way) in enumerate(street.who):
        away, off, numbers = street.error(tracks, who)
        assert len(numbers) == 1
        mine = tracks.only(tracks.track == min(numbers))
        assert set(mine.class_names) == {name}
        assert len(np.unique(mine.box[:, 3:6], axis=0)) == 1
        np.testing.assert_allclose(mine.box[0, 3:6], way[0, 3:6], rtol=0.05)
        assert off.max() < np.pi / 2
        # One detection is off by 0.25 m (a Rayleigh distribution's mean).
        assert away.mean() < (0.15 if smooth else 0.22)
        assert len(mine) > 0.95 * len(street.times)


@pytest.mark.parametrize("rate", [2.0, 25.0])
def test_frames_of_any_rate(rate: float) -> None:
    street = crossing(rate)
    tracks = tracked(street.detections(noise_m=0.15), street.times)
    assert [len(street.error(tracks, who)[2]) for who in range(5)] == [1] * 5
    assert tracks.track.max() == 4


def test_who_is_hidden_for_a_second_keeps_its_track_and_the_gap_is_marked() -> None:
    street = crossing()

    def hidden(who: int, time_s: float) -> bool:
        return not 5.0 <= time_s < 6.2

    found = street.detections(hidden, noise_m=0.1)
    tracks, smooth = (tracked(found, street.times, smooth=one) for one in (False, True))
    frames = (street.times >= 5.0) & (street.times < 6.2)
    for who in range(5):
        assert len(street.error(tracks, who)[2]) == 1
    for told, most in ((tracks, 1.5), (smooth, 0.3)):
        assert told.filled is not None
        np.testing.assert_array_equal(np.unique(told.frame[told.filled]), np.flatnonzero(frames))
        assert told.filled.sum() == 5 * frames.sum()
        assert told.score[told.filled].max() < told.score[~told.filled].min()
        gone = told.only(told.filled)
        for who in range(5):
            assert street.error(gone, who)[0].max() < most


def test_longer_gaps_are_joined_when_looking_back_alone() -> None:
    street = crossing()
    found = street.detections(lambda who, time_s: not 5.0 <= time_s < 6.5, noise_m=0.1)
    from urbantwin.tracking import Linking

    short = Linking(gap_s=0.5)
    assert tracked(found, street.times, how=short).track.max() == 9
    assert tracked(found, street.times, how=short, smooth=True).track.max() == 4


def test_a_sensor_that_rides_is_taken_back(tmp_path: Path) -> None:
    street = crossing()
    found = street.detections(noise_m=0.1)
    poses = [
        Pose.from_ypr([8 * t, 2.0, 0.5], yaw=0.1 * t, pitch=0.0, roll=0.0) for t in street.times
    ]
    box = found.box.copy()
    for row, frame in enumerate(found.frame):
        back = poses[frame].inverse()
        box[row, :3] = back.apply(box[row, :3])
        box[row, 6] -= 0.1 * street.times[frame]
    seen = replace(found, box=box)
    still, riding = tracked(found, street.times), tracked(seen, street.times, poses=poses)
    np.testing.assert_array_equal(still.track, riding.track)
    for frame in (0, 60, 119):
        world = poses[frame].apply(riding.of(frame).box[:, :3])
        np.testing.assert_allclose(world, still.of(frame).box[:, :3], atol=1e-6)


def test_a_turn_is_foreseen_as_the_arc_that_it_is() -> None:
    user = group_of("car")
    state, covariance = begun(np.array([[0.0, 0.0, 0.0, 0.3]]), user)
    state[0, 4:] = [8.0, 0.4]
    after, _, jacobian = predicted(state, covariance, np.array([0.1]), user)
    radius = 8.0 / 0.4
    turned = 0.3 + 0.4 * 0.1
    arc = radius * np.array([np.sin(turned) - np.sin(0.3), np.cos(0.3) - np.cos(turned)])
    np.testing.assert_allclose(after[0, :2], arc, atol=2e-3)
    assert after[0, 3] == pytest.approx(turned, abs=2e-3)
    for k in range(6):
        step = np.eye(6)[k] * 1e-6
        ahead = predicted(state + step, covariance, np.array([0.1]), user)[0]
        np.testing.assert_allclose((ahead - after)[0] / 1e-6, jacobian[0, :, k], atol=1e-5)


def test_smoothing_is_the_least_squares_of_all_at_once() -> None:
    user, times = group_of("pedestrian"), np.array([0.0, 0.1, 0.3, 0.4, 0.9, 1.0])
    rng = np.random.default_rng(3)
    frames = np.array([0, 1, 2, 4, 5])  # nobody saw it in frame 3
    seen = np.column_stack([rng.normal(0, 0.3, (5, 3)), np.zeros(5)])
    made = estimates([frames], [seen], user, times, smooth=True)[0]
    # x and its speed alone: the inverse of all covariances at once, with no recursion.
    first, start = begun(seen[:1], user)
    pick = np.ix_([0, 4], [0, 4])
    normal, right = np.zeros((12, 12)), np.zeros(12)
    normal[:2, :2] = np.linalg.inv(start[0][pick])
    right[:2] = normal[:2, :2] @ first[0, [0, 4]]
    for step in range(5):
        zero = np.zeros((1, 6, 6))
        _, noise, way = predicted(np.zeros((1, 6)), zero, np.diff(times)[step : step + 1], user)
        weight = np.linalg.inv(noise[0][pick])
        both = np.hstack([-way[0][pick], np.eye(2)])
        span = slice(2 * step, 2 * step + 4)
        normal[span, span] += both.T @ weight @ both
    for frame, look in zip(frames[1:], seen[1:], strict=True):
        normal[2 * frame, 2 * frame] += 1 / measured(user)[0]
        right[2 * frame] += look[0] / measured(user)[0]
    whole = np.linalg.solve(normal, right).reshape(6, 2)
    np.testing.assert_allclose(made.state[:, 0], whole[:, 0], atol=1e-9)
    np.testing.assert_allclose(made.velocity[:, 0], whole[:, 1], atol=1e-9)


def test_a_folder_is_tracked_the_same_each_time_and_bad_ones_are_one_line(tmp_path: Path) -> None:
    street = crossing(seconds=3.0)
    found = street.detections(noise_m=0.1, missed=0.1, invented=1)
    write_detections(tmp_path / "found", found, {"by": "a test"})
    made = ut.model.track(tmp_path / "found", tmp_path / "tracked", progress=False)
    again = ut.model.track(tmp_path / "found", tmp_path / "again", progress=False)
    assert made.counts == {"bus": 1, "car": 2, "pedestrian": 2}
    for name in ("detections.parquet", "detections.json"):
        assert (made.folder / name).read_bytes() == (again.folder / name).read_bytes()
    back = read_detections(made.folder)
    assert back.filled is not None
    assert back.filled.tolist() == made.found.filled.tolist()
    np.testing.assert_array_equal(back.track, made.found.track)

    write_detections(tmp_path / "untimed", replace(found, time_s=None), {})
    with pytest.raises(ut.InputError, match="does not say when its frames were taken"):
        ut.model.track(tmp_path / "untimed", tmp_path / "x", progress=False)
    assert ut.model.track(tmp_path / "untimed", tmp_path / "x", rate=10.0, progress=False).counts
    write_detections(tmp_path / "back", replace(found, time_s=street.times[::-1].copy()), {})
    with pytest.raises(ut.InputError, match="time does not go on"):
        ut.model.track(tmp_path / "back", tmp_path / "y", progress=False)
    one = joined(["a"], [(np.zeros((0, 7)), [], np.zeros(0))], np.zeros(1))
    write_detections(tmp_path / "one", one, {})
    with pytest.raises(ut.InputError, match="too few to track"):
        ut.model.track(tmp_path / "one", tmp_path / "z", progress=False)
    none = joined(["a", "b"], [(np.zeros((0, 7)), [], np.zeros(0))] * 2, np.arange(2.0))
    assert not len(tracked(none, np.arange(2.0), smooth=True))
