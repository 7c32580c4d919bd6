"""Studies of robustness, end to end on a small place."""

import json
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.detections import detected_class, joined, write_detections
from urbantwin.experiments.study.judging import judged_recording
from urbantwin.fidelity.readers import open_recording

from ..whole_page import whole_page
from .conftest import Line

SPAN = {"seconds": 1.2, "start": 0.6, "every": 2}
FACTORS = {"pose_error_m": [0, 0.5], "outage_unit": ["none", "corner"]}


@pytest.fixture(scope="module")
def grid(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study") / "grid.yaml"
    fields = {"twin": str(line.twin.folder), "seeds": [1, 4], **SPAN, "factors": FACTORS}
    path.write_text(yaml.safe_dump({**fields, "design": "factorial"}))
    return path


@pytest.fixture(scope="module")
def made(grid: Path) -> ut.experiment.Study:
    return ut.experiment.run(grid, grid.parent / "study", workers=1, progress=False)


@pytest.mark.thorough
def test_a_wrong_pose_moves_points_and_a_dead_sensor_has_none(made: ut.experiment.Study) -> None:
    assert made.manifest["recordings"] == 8
    rows = {
        (row["factor"], row["figure"]): row
        for row in made.effects.to_pylist()
        if row["class"] == "all"
    }
    # The same beams meet the same objects, whatever is believed of the sensor's pose.
    assert rows["pose_error_m", "points"]["difference"] == 0
    assert rows["pose_error_m", "seen"]["difference"] == 0
    assert rows["pose_error_m", "in_box"]["base_mean"] > 0.9
    assert rows["pose_error_m", "in_box"]["difference"] < -0.1
    assert rows["outage_unit", "points"]["level_mean"] == 0
    assert rows["outage_unit", "seen"]["difference"] == -1
    assert all(row["seeds"] == 2 for row in rows.values())
    told = {row["level"]: row["seen"] for row in made.summary()["effects"]}
    assert told["outage_unit = corner"] == "-100.0 (-100.0 to -100.0)"
    page = whole_page((made.folder / "report" / "study.html").read_text())
    assert "-100.0 to -100.0" in page.cells


def test_the_base_is_what_record_sees(
    line: Line, made: ut.experiment.Study, tmp_path: Path
) -> None:
    folder = made.folder / "motions" / "seed-4"
    alone = ut.record(
        line.twin, folder, tmp_path / "dataset", start=0.6, every=2, seed=4, workers=1,
        pictures=False, progress=False,
    )  # fmt: skip
    boxes = alone.boxes
    counted = pc.and_(pc.is_null(boxes["ignored"]), pc.greater_equal(boxes["num_points"], 5))
    rows = [row for row in boxes.filter(counted).to_pylist() if detected_class(row["class"])]
    told = {
        row["class"]: row
        for row in made.cells.to_pylist()
        if row["seed"] == 4 and row["cell"] == "base"
    }
    assert told["all"]["objects"] == len(rows) > 0
    for name in {detected_class(row["class"]) for row in rows}:
        mine = [row["num_points"] for row in rows if detected_class(row["class"]) == name]
        assert told[name]["points"] == pytest.approx(np.mean(mine))
        assert told[name]["seen"] == 1


@pytest.mark.thorough
def test_a_run_that_is_cut_off_goes_on_and_ends_the_same(
    grid: Path, made: ut.experiment.Study, tmp_path: Path
) -> None:
    out = tmp_path / "study"
    begun: set[str] = set()

    def cut(share: float, doing: str) -> None:
        begun.add(doing.partition(":")[0])
        if len([one for one in begun if one.startswith("seed")]) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ut.experiment.run(grid, out, workers=1, progress=cut)
    assert not (out / "report").exists()
    before = {path: path.stat().st_mtime_ns for path in (out / "cells").iterdir()}
    assert len(before) == 3
    ut.experiment.run(grid, out, workers=1, progress=False)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    both = [(one / "report" / "SHA256SUMS").read_bytes() for one in (out, made.folder)]
    assert both[0] == both[1]
    assert not (out / "work").exists()


@pytest.mark.thorough
def test_one_more_level_leaves_what_is_done(grid: Path, made: ut.experiment.Study) -> None:
    """Also what is known of the others: no motion, and two recordings of each seed, are new."""
    fields = yaml.safe_load(grid.read_text(encoding="utf-8"))
    fields["factors"]["pose_error_m"].append(0.1)
    more = grid.with_name("more.yaml")
    more.write_text(yaml.safe_dump({**fields, "seeds": [4]}))
    before = {path: path.stat().st_mtime_ns for path in made.folder.rglob("*.parquet")
              if "motions" in path.parts} | {
        path: path.stat().st_mtime_ns for path in (made.folder / "cells").iterdir()
    }  # fmt: skip
    again = ut.experiment.run(more, made.folder, workers=1, progress=False)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert again.manifest["recordings"] == 6
    assert len(list((made.folder / "cells").iterdir())) == 10


def test_a_plan_says_how_long_it_takes_and_does_nothing(
    grid: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["experiment", "run", str(grid), "-o", str(out), "--plan", "--json"]) == 0
    said = capsys.readouterr()
    assert "2 seeds x 4 cells = 8 recordings of 3 frames by 1 sensor; nothing is" in said.err
    low, high = json.loads(said.out)["reckoned_minutes"]
    assert 0 < low <= high
    assert not out.exists()


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"sync_jiter_s": [0, 1]}, "expected 'sync_jitter_s'"),
        ({"outage_unit": ["none", "roof"]}, "there is no sensor 'roof' in the rig"),
        ({"traffic_density": [1, 20]}, "expected 0.05 to 10"),
    ],
)
def test_what_cannot_be_studied_is_one_line_before_anything_is_done(
    grid: Path, tmp_path: Path, factors: dict[str, object], said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    fields = {**yaml.safe_load(grid.read_text(encoding="utf-8")), "factors": factors}
    path = tmp_path / "grid.yaml"
    path.write_text(yaml.safe_dump(fields))
    assert main(["experiment", "run", str(path), "--quiet"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"model": "cars", "classes": ["car", "bicycle"]}, "names bicycle, which the model cars"),
        ({"model": "floors"}, "floors: has no output of boxes; expected a model of"),
        ({"model": "twin"}, "model.yaml: is not there"),
        (
            {"design": "factorial", "factors": {
                name: [k / 100 for k in range(50)] for name in ("sway_m", "missing", "latency_s")
            }},
            "factors (line 3): 125000 combinations of levels; expected at most 100000",
        ),
    ],
)  # fmt: skip
def test_a_detector_that_cannot_judge_is_told_before_anything_is_driven(
    grid: Path, tmp_path: Path, fields: dict[str, object], said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    pytest.importorskip("torch", reason="torch is not installed: pip install 'urbantwin[detector]'")
    from urbantwin.learn.model import Design, Model, new_network, write_model

    (tmp_path / "twin").mkdir()
    for name, design in {
        "cars": Design(("car",), range_m=32.0, cell_m=0.8, width=0.25),
        "floors": Design((), range_m=32.0, cell_m=0.8, width=0.25, points=("road",)),
    }.items():
        (tmp_path / name).mkdir()
        write_model(tmp_path / name, Model(design, new_network(design).eval(), {}))
    path = tmp_path / "grid.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(grid.read_text(encoding="utf-8")), **fields}))
    assert main(["experiment", "run", str(path), "--plan"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


@pytest.mark.thorough
def test_a_recording_is_judged_as_evaluate_judges_it(line: Line, tmp_path: Path) -> None:
    """Precision of boxes and the tracks made of them, by the commands one after the other."""
    draw = np.random.default_rng(2)
    rows = []
    for frame in line.dataset:
        told = frame.boxes.to_pylist()
        kept = [k for k, one in enumerate(told) if one["num_points"] and draw.random() < 0.8]
        kept = [k for k in kept if detected_class(told[k]["class"])]
        box = frame.box_array[kept]
        box[:, :2] += draw.normal(0, 0.4, (len(kept), 2))
        names = [detected_class(told[k]["class"]) for k in kept]
        rows.append((box, names, draw.uniform(0.2, 0.9, len(kept))))
    times = line.dataset.times_s
    found = joined(line.dataset.names, rows, times)
    write_detections(tmp_path / "found", found, {})
    boxes = ut.model.evaluate(tmp_path / "found", line.dataset, tmp_path / "boxes", progress=False)
    tracks = ut.model.track(tmp_path / "found", tmp_path / "tracks", progress=False)
    followed = ut.model.evaluate(tracks, line.dataset, tmp_path / "followed", progress=False)
    verdict = judged_recording(open_recording(line.dataset.folder), found, times.tolist())
    assert any(row["ap"] > 0 for row in verdict.figures.values())
    for name, row in verdict.figures.items():
        if name == "all":
            continue
        judge = boxes.figures[name]
        assert row["ap"] == judge["ap"]["within_1_m" if name != "truck" else "within_2_m"]["ap"]
        assert row["ap_overlap"] == judge["ap"]["bev_iou_0.5"]["ap"]
        for key in ("hota", "mota", "idf1"):
            assert row[key] == (followed.manifest["tracking"] or {}).get(name, {}).get(key, 0.0)
    # Judged by more objects than are seen, as a faulty recording is by its base's, less is found.
    more = frozenset(
        (row["frame"], row["track"])
        for row in line.dataset.boxes.to_pylist()
        if row["ignored"] is None
    )
    harder = judged_recording(open_recording(line.dataset.folder), found, times.tolist(), base=more)
    assert harder.objects["all"] == sum(
        detected_class(row["class"]) is not None
        for row in line.dataset.boxes.to_pylist()
        if row["ignored"] is None
    )
    assert harder.objects["all"] > verdict.objects["all"]
    assert harder.figures["all"]["seen"] < 1
