"""OpenSCENARIO XML, out and in; ASAM's checker judges it (`make judges`)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.traffic import Motion
from urbantwin.traffic.events import load_scenario
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.formats import openscenario_rows
from urbantwin.traffic.run import with_more

from .conftest import Line

PLACE = {"x": 0.0, "y": 0.0}
EVENTS = [
    {"event": "passage", "at_s": 1.0, "place": PLACE},
    {
        "event": "trajectory",
        "at_s": 0.3,
        "actor": "obstacle",
        "asset": "cone",
        "time_s": [0.3, 1.5],
        "x": [4.0, 4.0],
        "y": [30.0, 30.0],
        "yaw_deg": [20.0, 20.0],
    },
]


@pytest.fixture(scope="module")
def motion(line: Line) -> Motion:
    return with_more(line.twin, line.motion, EVENTS)


@pytest.fixture(scope="module")
def file(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("xosc")
    motion.save(folder / "motion")
    made = ut.export(folder / "motion", "openscenario", folder / "out.xosc", progress=False)
    return made.path


def test_the_checker_finds_nothing_wrong(file: Path, judge: Callable[..., Any]) -> None:
    (answer,) = judge("asam_and_carla", f"check={file}").values()
    assert answer["issues"] == []
    assert answer["status"]["check_asam_xosc_xml_valid_schema"] == "completed"


def test_what_was_put_in_comes_back_where_it_was(line: Line, motion: Motion, file: Path) -> None:
    told = load_scenario(file, line.twin, 2.0)
    assert [one["event"] for one in told] == ["trajectory", "trajectory"]
    again = with_more(line.twin, line.motion, told)
    before, after = (one.actors.to_pandas() for one in (motion, again))
    mine = ["time_s", "track", "class", "asset"]
    pd.testing.assert_frame_equal(before[mine], after[mine])
    for name in ("x", "y", "z", "speed"):
        assert np.abs(before[name] - after[name]).max() < 0.02, name


def test_every_actor_that_moves_is_in_the_file(motion: Motion, file: Path) -> None:
    counts = motion.actors.to_pandas().groupby("track").size()
    rows = openscenario_rows(file, TracksSpec(tracks=file.name))
    found = pd.Series(rows.track).value_counts()
    assert {f"track-{track}": count for track, count in counts.items() if count > 1} == dict(
        found.items()
    )


def test_a_file_that_begins_after_the_motion_is_refused(
    line: Line, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = tmp_path / "late.xosc"
    late.write_text(file.read_text(encoding="utf-8"))
    arguments = ["drive", str(line.twin.folder), "-o", str(tmp_path / "m"), "--seconds", "0.2"]
    assert main([*arguments, "--scenario", str(late)]) == 2
    said = capsys.readouterr().err
    assert "late.xosc" in said
    assert "the motion" in said
    late.write_text("<OpenSCENARIO/>")
    assert main([*arguments, "--scenario", str(late)]) == 2
    assert "has no tracks" in capsys.readouterr().err
