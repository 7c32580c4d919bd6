"""Suites: the same bytes again, and what is said of what is not."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.experiments.suite.motion_print import MotionPrint, changes_between
from urbantwin.traffic.motion import Motion

from .conftest import Line

CYCLIST: dict[str, Any] = {"event": "passage", "at_s": 2.0, "place": {"x": 0.0, "y": 0.0}}


def run(folder: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, Any]:
    code = main(["experiment", "suite", str(folder), "--quiet", "--json", *options])
    return code, json.loads(capsys.readouterr().out)["cases"]


def write(path: Path, *events: dict[str, Any]) -> None:
    path.write_text(yaml.safe_dump({"events": list(events)}), encoding="utf-8")


@pytest.mark.thorough
def test_a_suite_is_the_same_until_a_scenario_is_another(
    line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "suite.yaml").write_text(
        yaml.safe_dump({"twin": str(line.twin.folder), "seconds": 4})
    )
    write(tmp_path / "cyclist.yaml", {**CYCLIST, "speed": 5.0})
    code, cases = run(tmp_path, capsys, "--accept")
    assert (code, [one["state"] for one in cases]) == (0, ["accepted", "accepted"])
    write(tmp_path / "cyclist.yaml", {**CYCLIST, "speed": 4.0})
    write(tmp_path / "nobody.yaml", {**CYCLIST, "event": "near_miss", "pet_s": 1, "within_s": 0})
    code, cases = run(tmp_path, capsys)
    assert code == 1
    by_name = {one["case"]: one for one in cases}
    assert by_name["traffic-seed-1"] == {"case": "traffic-seed-1", "state": "same"}
    assert by_name["nobody-seed-1"]["state"] == "failed"
    assert "cannot be staged" in by_name["nobody-seed-1"]["why"]
    changed = by_name["cyclist-seed-1"]
    assert (changed["state"], changed["actors_that_differ"]) == ("changed", 1)
    assert changed["first"].startswith("bicycle ")
    page = (tmp_path / "changes.md").read_text()
    assert "event 1, passage: asked.speed was 5.0, is 4.0" in page


def moved(motion: Motion, track: int, from_s: float, metres: float) -> Motion:
    rows = motion.actors.to_pylist()
    for row in rows:
        if row["track"] == track and row["time_s"] >= from_s:
            row["y"] += metres
    return replace(motion, rows=pa.Table.from_pylist(rows, schema=motion.actors.schema))


@pytest.mark.parametrize(("metres", "change"), [(0.25, "moved"), (1e-12, "turned")])
def test_who_differs_and_from_when_on_is_said_to_the_bit(
    line: Line, metres: float, change: str
) -> None:
    motion = line.motion
    row = motion.actors.to_pylist()[-1]
    from_s = round(row["time_s"] - 3 * motion.step_s, 6)
    other = moved(motion, row["track"], from_s, metres)
    first, second = MotionPrint.of(motion), MotionPrint.of(other)
    assert changes_between(first, first) == {}
    found = changes_between(first, second)
    assert found["from_s"] == pytest.approx(from_s)
    assert found["first"] == {"track": row["track"], "class": row["class"], "change": change}
    assert len(found["actors"]) == 1
    assert found["actors"][0].get("most_m", 0.0) == pytest.approx(round(metres, 3), abs=1e-3)


def test_who_is_gone_and_added_is_said(line: Line) -> None:
    motion = line.motion
    track = motion.actors["track"][0].as_py()
    without = motion.actors.filter(pa.array(motion.actors["track"].to_numpy() != track))
    prints = MotionPrint.of(motion), MotionPrint.of(replace(motion, rows=without))
    for (before, after), change in ((prints, "gone"), (prints[::-1], "added")):
        (row,) = changes_between(before, after)["actors"]
        assert (row["track"], row["change"]) == (track, change)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (None, "holds no suite.yaml"),
        ({"twin": "nowhere"}, "nowhere' is not found"),
        ({"twin": "a" * 300}, "a' is not found"),
        ({"seeds": [1]}, "twin"),
        ({"twin": ".", "seeds": [1, 1]}, "names a seed twice"),
    ],
)
def test_a_suite_that_is_wrong_is_refused(
    tmp_path: Path, fields: dict[str, Any] | None, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if fields is not None:
        (tmp_path / "suite.yaml").write_text(yaml.safe_dump(fields))
    assert main(["experiment", "suite", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "expected").exists()


def test_what_was_accepted_opens(tmp_path: Path, line: Line) -> None:
    from urbantwin.experiments.suite.accepted import Accepted

    kept = {"a": MotionPrint.of(line.motion)}
    Accepted.write(tmp_path / "expected", kept, {"urbantwin": "0"})
    again = Accepted.open(tmp_path / "expected")
    found = again.of("a")
    assert found is not None
    assert changes_between(kept["a"], found) == {}
    assert again.differs({"urbantwin": "1"}) == ["urbantwin: 0 before, 1 now"]
    assert ut.open(tmp_path / "expected").kind == "suite"
