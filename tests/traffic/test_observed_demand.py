"""A demand from who is present in seconds of frames, found again from end to end."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.traffic.calibration import calibrate_observation, momentary
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.twin import Twin

ASKED, SECONDS = 1500.0, 40
SITE = Path(__file__).parents[2] / "examples/hannover/site.yaml"


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
        (number, second, "car", *(np.interp(second, one.time_s, one.xy[:, k]) for k in (0, 1)))
        for number, one in enumerate(truth)
        for second in range(SECONDS)
        if one.time_s[0] <= second <= one.time_s[-1]
    ]
    observed = tmp_path / "observed"
    observed.mkdir()
    with (observed / "tracks.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([("track_id", "time_s", "class", "x", "y"), *rows])
    told = {"kind": "observation", "frames": SECONDS, "rate_hz": 1.0}
    (observed / "observation.json").write_text(json.dumps(told))
    # The site's streets are those of the crossing: what is built of a site is tested elsewhere.
    monkeypatch.setitem(crossing_twin.site["traffic"], "warmup_s", 30.0)
    monkeypatch.setattr(momentary, "built", lambda *_: crossing_twin)
    monkeypatch.setattr(momentary, "_TRIAL_S", 40.0)
    monkeypatch.setattr(momentary, "_ROUNDS", 1)
    report = calibrate_observation(observed, SITE, tmp_path / "calibrated")
    written = yaml.safe_load((tmp_path / "calibrated/traffic.yaml").read_text())["per_hour"]
    assert {name for name, value in written.items() if value} == {"car"}
    assert written["car"] == pytest.approx(ASKED, rel=0.35)
    (car,) = (row for row in report["demand"] if row.get("class") == "car")
    assert car["present"] == pytest.approx(len(rows) / SECONDS, rel=0.2)
    assert car["present_simulated"] == pytest.approx(car["present"], rel=0.3)
    assert yaml.safe_load((tmp_path / "calibrated/site.yaml").read_text())["name"] == "hannover"
