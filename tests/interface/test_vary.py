"""Recordings that differ in one factor."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

import urbantwin as ut
from urbantwin.cli import main

from .conftest import Line


@pytest.fixture(scope="module")
def run_file(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vary") / "run.yaml"
    fields = {"twin": str(line.twin.folder), "motion": str(line.motion.folder)}
    path.write_text(yaml.safe_dump({**fields, "record": {"stop": 0.2}}))
    return path


@pytest.fixture(scope="module")
def pair(run_file: Path) -> ut.experiment.Variation:
    return ut.experiment.vary(run_file, changes="sensor.height=1.5", workers=1, progress=False)


def test_only_the_factor_differs_and_nobody_moves(
    line: Line, pair: ut.experiment.Variation
) -> None:
    (row,) = pair.manifest["variants"]
    (changed,) = row["proof"]["changed"]
    assert changed["field"] == "made_from.record.rig.sensors[0].height_m"
    assert (changed["before"], changed["after"]) == (4.0, 1.5)
    assert row["proof"]["same_random_streams"]
    actors = row["proof"]["actors"]
    assert actors["changed"] == actors["added"] == actors["removed"] == []
    assert actors["identical"] == len(set(line.motion.actors["track"].to_pylist()))


def test_the_base_is_what_record_writes(line: Line, pair: ut.experiment.Variation) -> None:
    # The fixture's dataset has the same frames and goes on for longer.
    for frame in pair.base:
        assert np.array_equal(frame.points, line.dataset[frame.name].points)


def test_fates_say_what_the_boxes_say(pair: ut.experiment.Variation) -> None:
    fates = pair.fates.to_pylist()
    for variant, dataset in (
        ("base", pair.base),
        ("sensor.height=1.5", pair.dataset("sensor.height=1.5")),
    ):
        mine = {(x["frame"], x["track"]): x for x in fates if x["variant"] == variant}
        boxes = dataset.boxes.to_pylist()
        assert len(mine) == len(boxes) > 0
        for box in boxes:
            fate = mine[box["frame"], box["track"]]["fate"]
            assert (fate == "seen") == (box["num_points"] > 0)
            if fate == "hidden":
                assert box["num_points_alone"] > 0


def test_who_hides_somebody_stands_between(line: Line, pair: ut.experiment.Variation) -> None:
    at = np.array([12.0, -12.0])  # the site's only sensor
    for row in pair.fates.to_pylist():
        if row["hidden_by_track"] is None:
            continue
        actors = {int(one["track"]): one for one in line.motion.at(row["time_s"])}
        target, other = actors[row["track"]], actors[row["hidden_by_track"]]
        corner = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) / 2
        turn = np.array(
            [
                [np.cos(other["yaw"]), -np.sin(other["yaw"])],
                [np.sin(other["yaw"]), np.cos(other["yaw"])],
            ]
        )
        outline = (corner * [other["length"], other["width"]]) @ turn.T + [other["x"], other["y"]]
        reach = max(target["length"], target["width"]) / 2
        sight = shapely.LineString([at, [target["x"], target["y"]]]).buffer(reach)
        assert sight.intersects(shapely.Polygon(outline))
        assert np.hypot(other["x"] - at[0], other["y"] - at[1]) < reach + np.hypot(
            target["x"] - at[0], target["y"] - at[1]
        )


@pytest.fixture(scope="module")
def one_more(run_file: Path) -> ut.experiment.Variation:
    folder = run_file.parent / "more"
    return ut.experiment.vary(run_file, folder, changes="insert=bicycle", workers=1, progress=False)


def test_one_more_cyclist_changes_nobody_and_is_seen(
    line: Line, one_more: ut.experiment.Variation, tmp_path: Path
) -> None:
    (row,) = one_more.manifest["variants"]
    (changed,) = row["proof"]["changed"]
    assert changed["field"] == "made_from.motion.asked.scenario"
    actors = row["proof"]["actors"]
    assert actors["changed"] == actors["removed"] == []
    assert actors["identical"] == len(set(line.motion.actors["track"].to_pylist()))
    (added,) = actors["added"]
    fates = [one for one in one_more.fates.to_pylist() if one["track"] == added]
    assert {one["variant"] for one in fates} == {"insert=bicycle"}
    assert {one["class"] for one in fates} == {"bicycle"}
    # Nobody is simulated for it, and yet it is what driving with that scenario makes, to the byte.
    made = one_more.folder / "insert=bicycle" / "motion"
    scenario = tmp_path / "scenario.yaml"
    asked = ut.open(made).manifest["asked"]["scenario"]
    scenario.write_text(yaml.safe_dump({"events": asked}))
    again = ut.drive(
        line.twin, tmp_path / "again", scenario=scenario, pictures=False, progress=False
    )
    for name in ("motion.json", "actors.parquet", "signals.parquet"):
        assert (made / name).read_bytes() == (again.folder / name).read_bytes()


@pytest.mark.thorough
def test_a_signal_that_begins_later_shows_the_same_later(
    line: Line, run_file: Path, tmp_path: Path
) -> None:
    program = line.twin.roads.signals[0].program
    later_s = line.motion.manifest["duration_s"] / 2
    factor = f"signal.{program}.offset={later_s:g}"
    made = ut.experiment.vary(
        run_file, tmp_path / "later", changes=factor, workers=1, progress=False
    )
    (row,) = made.manifest["variants"]
    (changed,) = row["proof"]["changed"]
    assert changed["field"] == f"made_from.motion.asked.signal_offsets.{program}"
    before, after = line.motion, ut.open(made.folder / row["name"] / "motion")
    shown = []
    for motion, time_s in ((before, 0.0), (after, later_s)):
        rows = [one for one in motion.signals.to_pylist() if one["signal"] == program]
        rows = [one for one in rows if one["time_s"] <= time_s + 1e-6]
        shown.append({(one["link"], one["x"]): one["state"] for one in rows})
    assert shown[0] == shown[1]
    actors = row["proof"]["actors"]
    assert (actors["differ_from_s"] is None) == (actors["changed"] == [])


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        ("sensor.height", "--set"),
        ("sensor.hight=3", "a sensor has no 'hight'; expected 'height"),
        ("sensor.roof.height=3", "there is no sensor 'roof'; expected"),
        ("sensor.height=tall", "'tall'"),
        ("signal.nowhere.offset=3", "there is no signal program 'nowhere'"),
        ("scenario=nothing.yaml", "not found"),
        ("insert=unicorn", "no class of actors 'unicorn'"),
        ("insert=bicycle@Nowhere Street", "there is no street 'Nowhere Street'"),
        ("weather=hail", "--set"),
        ("colour=red", "--set"),
    ],
)
def test_what_cannot_be_varied_is_refused(
    run_file: Path, tmp_path: Path, factor: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["experiment", "vary", str(run_file), "--set", factor, "-o", str(out)]) == 2
    assert said in capsys.readouterr().err
    assert not list(out.rglob("*.json"))


def test_a_run_that_is_wrong_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("twin: nowhere\nmoton: x\n")
    assert main(["experiment", "vary", str(path), "--set", "sensor.height=3"]) == 2
    assert "moton (line 2)" in capsys.readouterr().err
    path.write_text("twin: nowhere\n")
    assert main(["experiment", "vary", str(path), "--set", "sensor.height=3"]) == 2
    assert "nowhere' is not found" in capsys.readouterr().err
