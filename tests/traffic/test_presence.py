"""Flows from who is present, in a place where everybody stays for a known time."""

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.calibration.presence import Flows, Presence, corrected, presence_of
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
    # One stays the longer, the more come; and of the classes one arm has none.
    stay_s = {"a": 20.0, "b": 45.0}

    def present(flows):
        arms = {
            name: np.array([q / 3600 * stay_s[name] * (1 + q / 2000)])
            for name, q in flows.arms.items()
        }
        return Presence(1, {"car": sum(arms.values()) * 0.9, "van": sum(arms.values()) * 0.1}, arms)

    true = Flows({"car": 1080.0, "van": 120.0}, {"a": 900.0, "b": 300.0})
    recorded = present(true)
    flows = Flows({"car": 500.0, "van": 500.0}, {"a": 400.0, "b": 400.0})
    for _ in range(8):
        flows = corrected(flows, recorded, present(flows))
    assert flows.arms["a"] == pytest.approx(900, rel=0.05)
    assert flows.arms["b"] == pytest.approx(300, rel=0.05)
    # Motor vehicles are as many as the arms carry.
    assert sum(flows.per_hour().values()) == pytest.approx(sum(flows.arms.values()), rel=1e-3)
    assert {row["road"] for row in flows.traffic()["counts"]} == {"a", "b"}
