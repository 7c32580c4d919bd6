"""What is read of how people drive: made tracks whose figures are known."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.traffic.calibration.free_speed import free_speeds
from urbantwin.traffic.calibration.lane_place import lane_offset
from urbantwin.traffic.calibration.measured import measured
from urbantwin.traffic.calibration.passages import Passage, SeenTrack
from urbantwin.traffic.calibration.queue_discharge import discharge_headways
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.twin import Twin

STEP_S = 0.1


def track(
    name: str,
    actor_class: str,
    begin_s: float,
    xy: np.ndarray,
    speed: np.ndarray,
    yaw: float = 0.0,
) -> SeenTrack:
    times = begin_s + STEP_S * np.arange(len(xy))
    yaws = np.full(len(xy), yaw)
    size = np.array([4.5, 1.8, 1.5])
    recorded = RecordedTrack(name, actor_class, times, xy, yaws, np.full(len(xy), np.nan), size)
    return SeenTrack(recorded, times, xy, yaws, speed)


def straight(name: str, actor_class: str, begin_s: float, speed: np.ndarray) -> SeenTrack:
    along = np.concatenate([[0.0], np.cumsum(speed[:-1] * STEP_S)])
    return track(name, actor_class, begin_s, np.column_stack([along, 0 * along]), speed)


def passage(seen: SeenTrack, passed_s: float) -> Passage:
    return Passage(seen, np.full(len(seen.time_s), "a_0", object), "a", "b", "a_0", passed_s)


def test_who_stands_has_no_way_however_its_place_errs(crossing_twin: Twin) -> None:
    """A minute of standing with a tracker's errors, then 20 m at 10 m/s: ten speeds, all alike."""
    random = np.random.default_rng(1)
    speed = np.r_[np.zeros(600), np.full(200, 10.0)]
    one = straight("1", "car", 0.0, speed)
    one.xy[:600] += 0.15 * random.standard_normal((600, 2))
    one.xy[600:] += one.xy[599] - one.xy[600]
    found = measured([one], [], crossing_twin.roads, 0.0, 62.0)
    (speeds,) = found.speeds
    assert len(speeds) == pytest.approx(10, abs=1)
    assert np.allclose(speeds, 10.0)


def test_a_queue_discharges_by_those_who_stood_in_it() -> None:
    stood = np.r_[np.zeros(200), np.full(100, 8.0)]
    passes = np.full(300, 8.0)
    queue = [
        passage(straight(str(k), "car", 0.0, stood), 21.0 + at)
        for k, at in enumerate((0.0, 2.1, 4.3))
    ]
    lorry = passage(straight("3", "truck", 0.0, stood), 29.0)
    behind = passage(straight("4", "car", 0.0, stood), 33.0)
    free = passage(straight("5", "car", 10.0, passes), 35.0)
    found = discharge_headways([free, *queue, behind, lorry], 0.0, 100.0)
    assert found == {"a": pytest.approx([2.1, 2.2])}
    assert discharge_headways(queue, 0.0, 23.0) == {}


def test_free_is_who_has_nobody_close_ahead_be_it_a_bicycle() -> None:
    first = straight("1", "car", 0.0, np.full(100, 12.0))
    near = straight("2", "car", 1.0, np.full(100, 9.0))
    later = straight("3", "car", 20.0, np.full(100, 11.0))
    ridden = straight("4", "bicycle", 34.0, np.full(300, 4.0))
    held_up = straight("5", "car", 50.0, np.r_[np.full(100, 9.5), np.full(50, 4.5)])
    waited = straight("6", "car", 80.0, np.r_[np.full(60, 9.0), np.zeros(50), np.full(30, 7.0)])
    limits = {"b": 10.0}
    tracks = [first, near, later, ridden, held_up, waited]
    passed = [passage(one, 1.0) for one in tracks if one is not ridden]
    found = free_speeds(tracks, passed, limits, 0.0, 100.0)
    assert found == {"b": pytest.approx([1.2, 1.1])}


@pytest.mark.parametrize("beside", [0.0, -0.9])
def test_bicycles_are_found_where_they_ride_in_a_lane(crossing_twin: Twin, beside: float) -> None:
    roads = crossing_twin.roads
    lane = next(one for one in roads.lanes if one.road and {"car", "bicycle"} <= set(one.allowed))
    line = lane.centre[:, :2]
    ahead = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    left = np.array([-ahead[1], ahead[0]])
    along = np.arange(5.0, 45.0, 0.5)
    xy = line[0] + along[:, None] * ahead + beside * left
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    tracks = [track(str(k), "bicycle", 10.0 * k, xy, np.full(len(xy), 5.0), yaw) for k in range(12)]
    offset, count = lane_offset(tracks, roads, 1e3)
    assert (offset, count) == (pytest.approx(beside, abs=0.02), 12)
    assert lane_offset(tracks, roads, 45.0) == (None, 5)
    other_side = replace(roads, driving_side="left")
    assert lane_offset(tracks, other_side, 1e3)[0] == pytest.approx(-beside, abs=0.02)


def test_times_of_who_has_stood_are_told_apart(crossing_twin: Twin) -> None:
    """15 m of road from bumper to bumper at 10 m/s; one of two who follow has stood before."""
    times = np.arange(0.0, 12.0, STEP_S)
    stood_s = 5.0
    pairs = []
    for number, stands in enumerate((False, True)):
        speed = np.where(stands & (times < stood_s), 0.0, 10.0)
        behind = straight(f"{number} behind", "car", 0.0, speed)
        ahead = straight(f"{number} ahead", "car", 0.0, speed)
        ahead.xy[:, 0] += 15.0 + 4.5
        lanes = np.full(len(times), f"a_{number}", object)
        pairs += [Passage(one, lanes, "a", "b", f"a_{number}", 30.0) for one in (behind, ahead)]
    found = measured([one.seen for one in pairs], pairs, crossing_twin.roads, 0.0, 12.0)
    assert found.following == pytest.approx([1.5, 1.5])
    assert found.driving == pytest.approx([1.5])


def test_accelerations_to_the_side_are_told_way_by_way(crossing_twin: Twin) -> None:
    """v2/r on circles of 12 and 40 m."""
    passages = []
    for way, radius, speed in (("b", 12.0, 6.0), ("c", 40.0, 6.0)):
        yaw = speed / radius * np.arange(0.0, 0.5 * np.pi * radius / speed + 2.0, STEP_S)
        yaw = np.minimum(yaw, 0.5 * np.pi)
        xy = radius * np.column_stack([np.sin(yaw), 1 - np.cos(yaw)])
        seen = track(way, "car", 0.0, xy, np.full(len(yaw), speed))
        seen.yaw[:] = yaw
        lanes = np.full(len(yaw), "a_0", object)
        passages.append(Passage(seen, lanes, "a", way, "a_0", 0.0))
    found = measured([one.seen for one in passages], passages, crossing_twin.roads, 0.0, 20.0)
    assert set(found.bends) == {("a", "b"), ("a", "c")}
    assert found.bends["a", "b"] == pytest.approx([3.0], rel=0.05)
    assert found.bends["a", "c"] == pytest.approx([0.9], rel=0.05)
    assert found.turning == {way: pytest.approx([6.0]) for way in found.bends}


def test_the_first_of_a_queue_tells_how_cars_set_out(crossing_twin: Twin) -> None:
    """1.8 m/s2 after a red; who is behind waits for it, and a truck is left out."""
    passages = []
    for number, (name, stands_s, rate) in enumerate(
        (("car", 8.0, 1.8), ("car", 10.0, 0.9), ("truck", 40.0, 0.7), ("car", 42.0, 0.6))
    ):
        times = np.arange(0.0, stands_s + 14.0, STEP_S)
        speed = np.minimum(rate * np.maximum(times - stands_s, 0.0), 12.0)
        seen = straight(str(number), name, 0.0, speed)
        lanes = np.full(len(times), "a_0", object)
        passages.append(Passage(seen, lanes, "a", "b", "a_0", stands_s + 3.0))
    found = measured([one.seen for one in passages], passages, crossing_twin.roads, 0.0, 60.0)
    assert found.leading == pytest.approx([1.8], rel=0.02)
    assert sorted(found.accelerations) == pytest.approx([0.6, 0.9, 1.8], rel=0.02)
