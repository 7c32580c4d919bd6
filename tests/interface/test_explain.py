"""Why objects are missed that were found: a truck that is put before a car."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.detections import detected_class, joined, write_detections

from ..whole_page import whole_page
from .conftest import Line

#: Between the sensor, at (12, -12), and the car.
CAR, TRUCK = ("car", -2.0, 2.0), ("truck", 4.0, -4.0)
NAMES = ("base", "scenario=truck")


def standing(actor: str, x: float, y: float) -> dict[str, object]:
    """Somebody who stands at a place all the time, across the line of sight."""
    times = [0.0, 0.6, 1.2, 1.9]
    way = {"time_s": times, "x": [x] * 4, "y": [y] * 4, "yaw_deg": [45.0] * 4}
    return {"event": "trajectory", "at_s": 0.0, "actor": actor, **way}


@pytest.fixture(scope="module")
def pair(line: Line, tmp_path_factory: pytest.TempPathFactory) -> ut.experiment.Variation:
    folder = tmp_path_factory.mktemp("explain")
    for name, who in (("base", [CAR]), ("truck", [CAR, TRUCK])):
        events = [standing(*one) for one in who]
        (folder / f"{name}.yaml").write_text(yaml.safe_dump({"events": events}))
    run = folder / "run.yaml"
    traffic = {"seconds": 2.0, "scenario": "base.yaml"}
    fields = {"twin": str(line.twin.folder), "traffic": traffic, "record": {"stop": 0.1}}
    run.write_text(yaml.safe_dump(fields))
    changes = f"scenario={folder / 'truck.yaml'}"
    return ut.experiment.vary(
        run, folder / "pair", changes=changes, workers=1, pictures=False, progress=False
    )


@pytest.fixture(scope="module")
def found(pair: ut.experiment.Variation, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """What a detector says that finds whoever has five points."""
    folder = tmp_path_factory.mktemp("found")
    for name in NAMES:
        rows = []
        for frame in pair.dataset(name):
            told = frame.boxes.to_pylist()
            kept = [
                row
                for row, one in enumerate(told)
                if one["num_points"] >= 5 and detected_class(one["class"])
            ]
            names = [detected_class(told[row]["class"]) for row in kept]
            rows.append((frame.box_array[kept], names, np.full(len(kept), 0.8)))
        frames = pair.dataset(name).names
        write_detections(folder / name, joined(frames, rows), {"urbantwin": "labels"})
    return [folder / name for name in NAMES]


@pytest.mark.thorough
def test_the_car_behind_the_truck_is_hidden_by_that_truck(
    pair: ut.experiment.Variation, found: list[Path], tmp_path: Path
) -> None:
    made = ut.experiment.explain(pair, tmp_path / "why", detections=found, progress=False)
    (variant,) = pair.manifest["variants"]
    (truck,) = variant["proof"]["actors"]["added"]
    (car,) = ut.open(pair.folder / "base" / "motion").manifest["events"][0]["tracks"]
    rows = [row for row in made.changes.to_pylist() if row["track"] == car]
    assert len(rows) == len(pair.base) == 2
    for row in rows:
        assert (row["change"], row["reason"]) == ("found to missed", "hidden")
        assert (row["by"], row["by_track"]) == ("truck", truck)
        assert row["points_base"] >= 5 > row["points_variant"]
        assert (made.folder / row["picture"]).read_bytes().startswith(b"\x89PNG")
    # Whoever else is missed now lost its points, and to the truck: nothing else has changed.
    lost = [row for row in made.changes.to_pylist() if row["change"] == "found to missed"]
    assert {(row["reason"], row["by_track"]) for row in lost} == {("hidden", truck)}
    counts = made.manifest["variants"][NAMES[1]]["found to missed"]
    assert counts == {"hidden": len(lost)}
    assert (made.folder / "changes.csv").read_text().count("\n") == made.changes.num_rows + 1
    page = (made.folder / "explanation.html").read_text()
    assert any(f"truck {truck} hides" in cell for cell in whole_page(page).cells)
    assert isinstance(ut.open(made), ut.experiment.Explanation)


def test_the_same_twice_writes_the_same_bytes(
    pair: ut.experiment.Variation, found: list[Path], tmp_path: Path
) -> None:
    options = [str(pair.folder), "--quiet", "--drawn", "1"]
    for one in found:
        options += ["--detections", str(one)]
    for name in ("one", "other"):
        assert main(["experiment", "explain", *options, "-o", str(tmp_path / name)]) == 0
    both = [(tmp_path / name / "SHA256SUMS").read_bytes() for name in ("one", "other")]
    assert both[0] == both[1]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["nowhere", "--model", "m"],
            "is not there; expected a folder that `urbantwin experiment vary`",
        ),
        (["PAIR"], "neither a model nor detections are given"),
        (["PAIR", "--detections", "BASE"], "1 are given for 2 recordings; expected one each of"),
        (["PAIR", "--model", "m", "--detections", "BASE"], "is given beside detections"),
        (["PAIR", "--model", "BASE"], "model"),
        (["PAIR", "--detections", "BASE", "--detections", "nothing"], "is not there"),
        (["PAIR", "--detections", "BASE", "--detections", "BASE", "--score", "2"], "0 to 1"),
        (["PAIR", "--detections", "BASE", "--detections", "BASE", "--by", "luck"], "overlap"),
    ],
)
def test_what_cannot_be_explained_is_one_line(
    pair: ut.experiment.Variation, found: list[Path], tmp_path: Path, arguments: list[str],
    said: str, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    names = {"PAIR": str(pair.folder), "BASE": str(found[0])}
    out = tmp_path / "out"
    told = [names.get(one, one) for one in arguments]
    assert main(["experiment", "explain", *told, "-o", str(out), "--quiet"]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not out.exists()
