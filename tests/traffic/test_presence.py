"""Flows from who is present, in a place where everybody stays for a known time."""

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.calibration.presence import (
    Presence,
    arms_of,
    corrected,
    corrected_arms,
    first_flows,
    flows_of_arms,
    misfit,
    passes_an_arm,
    presence_of,
)
from urbantwin.traffic.recorded.track import RecordedTrack

ROAD = shapely.box(0, -2, 100, 2)


def driven(flow_per_hour, speed, seconds, seed, name="car"):
    """Return vehicles that come at random and drive 200 m, 100 m of them in the area."""
    rng = np.random.default_rng(seed)
    tracks = []
    for number, start in enumerate(rng.uniform(0, seconds, round(flow_per_hour * seconds / 3600))):
        times = start + np.arange(0, 200 / speed, 0.2)
        xy = np.column_stack([(times - start) * speed - 50, np.zeros(len(times))])
        size = np.array([4.5, 1.8, 1.5])
        track = RecordedTrack(str(number), name, times, xy, 0 * times, 0 * times + np.nan, size)
        tracks.append(SeenTrack(track, times, xy, 0 * times, np.full(len(times), speed)))
    return tracks


def test_the_number_present_is_flow_times_stay():
    # 720 an hour for 100 m at 8 m/s: 2.5 at a time, whenever one looks.
    moments = np.arange(100.0, 3500.0, 1.0)
    found = presence_of(driven(720, 8.0, 3600, 1), moments, ROAD, {"a": ROAD})
    assert found.classes["car"].mean() == pytest.approx(720 / 3600 * 100 / 8, rel=0.05)
    np.testing.assert_array_equal(found.arms["a"], found.classes["car"])
    # Means of spans much longer than a stay scatter as Poisson counts do, each of a stay.
    spread = found.spread(100)["arms"]["a"]
    assert spread == pytest.approx(1 / np.sqrt(2.5 * 100 / 12.5), rel=0.35)


def test_people_who_stand_are_nobody():
    moments = np.arange(0.0, 60.0)
    standing = driven(600, 0.1, 60, 2, "pedestrian")
    assert presence_of(standing, moments, ROAD, {}).classes["pedestrian"].sum() == 0


def test_flows_are_found_where_queues_keep_people_longer():
    # One stays the longer, the more come.
    stay_s = {"car": 30.0, "van": 30.0, "pedestrian": 45.0}

    def present(q):
        classes = {
            name: np.array([flow / 3600 * stay_s[name] * (1 + flow / 4000)])
            for name, flow in q.items()
        }
        motors = classes["car"] + classes["van"]
        return Presence(1, classes, {"a": 0.75 * motors, "b": 0.25 * motors})

    true = {"car": 1080.0, "van": 120.0, "pedestrian": 300.0}
    recorded = present(true)
    flows = first_flows(recorded)
    for _ in range(8):
        flows = corrected(flows, recorded, present(flows))
    assert flows["pedestrian"] == pytest.approx(300, rel=0.02)
    assert flows["car"] + flows["van"] == pytest.approx(1200, rel=0.02)
    assert flows_of_arms(flows, recorded)["a"] == pytest.approx(900, rel=0.02)


def test_flows_of_arms_are_found_by_who_waits_on_them_and_who_waits_nowhere() -> None:
    """One stays the longer on an arm the more come, and 9 s beyond it; the first guess is wrong."""
    true = {"a": 1500.0, "b": 300.0, "c": 700.0}

    def present(arms: dict[str, float]) -> Presence:
        on = {name: np.array([q / 3600 * (8 + 15 * q / 1500)]) for name, q in arms.items()}
        beyond = sum(arms.values()) / 3600 * 9
        return Presence(1, {"car": sum(on.values()) + beyond}, on)

    recorded, arms = present(true), dict.fromkeys(true, 800.0)
    assert misfit(recorded, present(arms)) > 0.5
    for _ in range(12):
        arms = corrected_arms(arms, recorded, present(arms), arms)
    assert arms == pytest.approx(true, rel=0.1)
    assert misfit(recorded, present(arms)) < 0.1
    # No more are asked for than pass, and a little more.
    full = corrected_arms(
        {"a": 1000.0}, present({"a": 2000.0}), present({"a": 900.0}), {"a": 510.0}
    )
    assert full["a"] == pytest.approx(600.0)


def test_who_passes_an_arm_is_told_from_who_drives_elsewhere() -> None:
    tracks = driven(600, 8.0, 600, 3)
    assert passes_an_arm(tracks, {"a": ROAD}) == 1.0
    assert passes_an_arm(tracks, {"a": shapely.box(0, 50, 100, 60)}) == 0.0
    assert passes_an_arm([], {"a": ROAD}) == 0.0


def test_roads_behind_an_arm_are_no_arms(crossing_twin) -> None:
    arms = arms_of(crossing_twin.roads, shapely.box(-90, -90, 90, 90))
    roads = {road.id: road for road in crossing_twin.roads.roads}
    assert len(arms) >= 3
    starts = {roads[name].from_junction for name in arms}
    (middle,) = {roads[name].to_junction for name in arms}
    assert middle not in starts
