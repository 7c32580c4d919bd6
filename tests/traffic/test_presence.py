"""Flows from who is present, in a place where everybody stays for a known time."""

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.calibration.presence import (
    Presence,
    corrected,
    first_flows,
    flows_of_arms,
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
