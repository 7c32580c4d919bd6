"""Gaps, speeds and heights of those who are seen for moments, where they are known."""

import numpy as np
import pytest
import shapely

from urbantwin.traffic.calibration.momentary_drivers import momentary_drivers
from urbantwin.traffic.observed import ObservedTracks

AREA = shapely.box(-500, -500, 500, 500)
LENGTH_M, MOMENTS = 4.3, 12


def looks(rows):
    """Rows of track, class, time, x, y, yaw, height, speed."""
    track, name, time_s, x, y, yaw, height, speed = (
        np.array(one) for one in zip(*rows, strict=True)
    )
    size = np.column_stack([np.full(len(track), LENGTH_M), np.full(len(track), 1.8), height])
    xy = np.column_stack([x, y]).astype(float)
    return ObservedTracks(
        track.astype(int), name.astype(object), time_s, xy, yaw, size, speed, speed < 0.3
    )


def street(rng, moments, *, gap_m=2.0, gap_sd=0.6, speed_m_s=12.0, tall_m=1.7):
    """Queues of four at one moment each, cars that drive alone, and people."""
    rows, track = [], 0
    for moment in range(moments):
        yaw = rng.uniform(-np.pi, np.pi)
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        at = np.array([-300.0 + 50 * (moment % 12), -200.0])
        for _ in range(4):
            rows.append((track, "car", moment, *at, yaw, 1.5, 0.0))
            track += 1
            at = at + ahead * (LENGTH_M + max(rng.normal(gap_m, gap_sd), 0.1))
        for place in range(2):
            speed = rng.normal(speed_m_s, 1.0)
            rows.append((track, "car", moment, 100.0 * place, 200.0, 0.0, 1.5, speed))
            track += 1
        for _ in range(3):
            rows.append(
                (track, "pedestrian", moment, 0.0, 100.0, 0.0, rng.normal(tall_m, 0.1), 1.3)
            )
            track += 1
    return looks(rows)


@pytest.fixture
def simulated():
    return street(np.random.default_rng(1), 300)


@pytest.mark.thorough
def test_who_is_as_in_the_simulation_changes_nothing(simulated):
    for seed in range(2, 12):
        asked, rows = momentary_drivers(
            street(np.random.default_rng(seed), MOMENTS), simulated, MOMENTS, AREA, {}
        )
        car = asked.get("drivers", {}).get("car", {})
        assert set(car) <= {"standing_gap_spread_m"}
        assert car["standing_gap_spread_m"] == pytest.approx(0.6, abs=0.35)
        assert "size" not in asked
        assert len(rows) == 4


def test_gaps_speeds_and_heights_that_differ(simulated):
    other = street(np.random.default_rng(3), 40, gap_m=3.1, gap_sd=0.9, speed_m_s=7.0, tall_m=1.5)
    asked, _ = momentary_drivers(other, simulated, 40, AREA, {})
    car = asked["drivers"]["car"]
    assert car["standing_gap_m"] == pytest.approx(3.1, abs=0.3)
    assert car["standing_gap_spread_m"] == pytest.approx((0.9**2 - 0.25**2) ** 0.5, abs=0.2)
    assert car["speed_factor"] == pytest.approx(7.0 / 12.0, abs=0.05)
    assert asked["drivers"]["van"] == car
    assert asked["size"] == {"pedestrian": {"height": pytest.approx(1.5 / 1.7, abs=0.02)}}


def test_what_a_site_has_is_what_is_changed():
    """The simulation had these drivers: what differs is beside theirs."""
    site = {"drivers": {"car": {"standing_gap_m": 3.0, "speed_factor": 0.8, "headway_s": 1.5}}}
    simulated = street(np.random.default_rng(1), 300, gap_m=3.0, speed_m_s=10.0)
    other = street(np.random.default_rng(3), 60, gap_m=2.0, speed_m_s=14.0)
    asked, _ = momentary_drivers(other, simulated, 60, AREA, site)
    car = asked["drivers"]["car"]
    assert car["standing_gap_m"] == pytest.approx(2.0, abs=0.3)
    assert car["speed_factor"] == pytest.approx(0.8 * 14.0 / 10.0, abs=0.06)
    assert car["headway_s"] == 1.5


def test_too_few_tell_nothing(simulated):
    asked, rows = momentary_drivers(
        street(np.random.default_rng(4), 2, gap_m=5.0, speed_m_s=5.0), simulated, 2, AREA, {}
    )
    assert asked == {}
    assert [row["what"] for row in rows] == ["height of cars, m"]


def test_nobody_is_free_behind_somebody(simulated):
    """All drive behind each other: no speed is told, however slow they are."""
    rows = [
        (30 * moment + k, "car", moment, 12.0 * k, 0.0, 0.0, 1.5, 5.0)
        for moment in range(12)
        for k in range(30)
    ]
    first = [row for row in rows if row[0] % 30 != 29]
    asked, told = momentary_drivers(looks(first), simulated, 12, AREA, {})
    assert [row["count"] for row in told if "nobody holds up" in row["what"]] == [12]
    assert "standing_gap_m" not in asked["drivers"]["car"]
