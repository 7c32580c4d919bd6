"""A demand from who is present in seconds of frames, found again from end to end."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.traffic.calibration import calibrate_observation, momentary
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.calibration.presence import Presence, corrected, passed_per_hour
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.traffic.observed import read_observation
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.twin import Twin

COLUMNS = "track_id time_s class x y yaw_rad length width height".split()
ASKED, SECONDS = 1500.0, 40
SITE = Path(__file__).parents[2] / "examples/hannover/site.yaml"


@pytest.mark.thorough
def test_as_many_drive_as_were_observed(
    crossing_twin: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Forty seconds of a simulation with 1500 cars an hour, of which nothing but places is told."""
    traffic = {**crossing_twin.site["traffic"], "warmup_s": 30.0, "seed": 7}
    truth = simulated_tracks(
        crossing_twin,
        {**traffic, "per_hour": {"car": ASKED}},
        float(SECONDS),
        shapely.box(-90, -90, 90, 90),
        scratch=tmp_path,
        told=lambda _: None,
    )
    rows = [
        (
            *(number, second, "car"),
            *(np.interp(second, one.time_s, one.xy[:, k]) for k in (0, 1)),
            *(np.interp(second, one.time_s, np.unwrap(one.yaw)), *one.track.size),
        )
        for number, one in enumerate(truth)
        for second in range(SECONDS)
        if one.time_s[0] <= second <= one.time_s[-1]
    ]
    observed = tmp_path / "observed"
    observed.mkdir()
    with (observed / "tracks.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([COLUMNS, *rows])
    told = {"kind": "observation", "frames": SECONDS, "rate_hz": 1.0}
    (observed / "observation.json").write_text(json.dumps(told))
    # The site's streets are those of the crossing: what is built of a site is tested elsewhere.
    monkeypatch.setitem(crossing_twin.site["traffic"], "warmup_s", 30.0)
    monkeypatch.setattr(momentary, "built", lambda *_: crossing_twin)
    monkeypatch.setattr(momentary, "_TRIAL_S", 180.0)  # two cycles
    monkeypatch.setattr(momentary, "_ROUNDS", 1)
    report = calibrate_observation(observed, SITE, tmp_path / "calibrated")
    written = yaml.safe_load((tmp_path / "calibrated/traffic.yaml").read_text())
    # They stand and drive as those who are simulated, and are as tall.
    assert "size" not in written
    assert written.get("drivers", {}).get("car", {}).keys() <= {"standing_gap_spread_m"}
    written = written["per_hour"]
    assert {name for name, value in written.items() if value} == {"car"}
    assert written["car"] == pytest.approx(ASKED, rel=0.35)
    (car,) = (row for row in report["demand"] if row.get("class") == "car")
    assert car["present"] == pytest.approx(len(rows) / SECONDS, rel=0.2)
    assert car["present_simulated"] == pytest.approx(car["present"], rel=0.3)
    assert yaml.safe_load((tmp_path / "calibrated/site.yaml").read_text())["name"] == "hannover"


def car_along(times: np.ndarray, x: np.ndarray, name: str = "car") -> SeenTrack:
    xy = np.column_stack([x, np.zeros_like(x)])
    none = np.zeros_like(times)
    track = RecordedTrack("1", name, times, xy, none, none, np.array([4.0, 1.8, 1.5]))
    return SeenTrack(track, times, xy, none, none)


def test_who_leaves_is_counted_as_often_as_it_leaves() -> None:
    times = np.arange(0.0, 100.0)
    through = car_along(times[:40], np.linspace(-60, 60, 40))
    twice = car_along(times, 60 * np.sin(times / 8))  # four times
    waits = car_along(times, np.zeros(100))
    ends = car_along(times[:30], np.linspace(-30, 20, 30))  # where its road ends
    walks = car_along(times[:40], np.linspace(-60, 60, 40), "pedestrian")
    area = shapely.box(-50, -5, 50, 5)
    for tracks, count in (([through], 1), ([twice], 4), ([waits], 0), ([ends], 1), ([walks], 0)):
        assert passed_per_hour(tracks, area, 100.0) == pytest.approx(36.0 * count)


def test_no_more_are_asked_for_than_pass_where_they_queue() -> None:
    def present(motors: int, people: int) -> Presence:
        counts = {"car": np.full(10, motors), "pedestrian": np.full(10, people)}
        return Presence(10, counts, {})

    asked = {"car": 2000.0, "pedestrian": 100.0}
    recorded, simulated = present(30, 9), present(24, 6)
    free = corrected(asked, recorded, simulated, passed=1950.0)
    full = corrected(asked, recorded, simulated, passed=1500.0)
    assert free["car"] == pytest.approx(2000 * 30.5 / 24.5)
    assert full["car"] == pytest.approx(1500.0)
    assert free["pedestrian"] == full["pedestrian"] == pytest.approx(100 * 9.5 / 6.5)
    # Fewer are present than simulated: that holds, too.
    assert corrected(asked, present(6, 9), simulated, passed=1500.0)["car"] < 1500.0


def test_demand_is_of_where_sensors_see_nearly_all(tmp_path: Path) -> None:
    corners = [(0, 0), (90, 0), (90, 90), (0, 90)]
    rows = [(k, 0.0, "car", x, y, 0.0, 4.3, 1.8, 1.5) for k, (x, y) in enumerate(corners)]
    with (tmp_path / "tracks.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([COLUMNS, *rows])
    told = {"kind": "observation", "frames": 1, "rate_hz": 1.0}
    for more, near in (({}, False), ({"sensors": [[10.0, 10.0], [20.0, 10.0]]}, True)):
        (tmp_path / "observation.json").write_text(json.dumps({**told, **more}))
        area = momentary.seen_well(read_observation(tmp_path)[0])
        assert area.contains(shapely.Point(20, 30))
        assert area.contains(shapely.Point(80, 80)) != near
        assert not area.contains(shapely.Point(-1, 10))
