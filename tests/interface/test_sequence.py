"""`urbantwin dataset sequence`: what it writes and refuses, and that it continues."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
import shapely

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.dataset.reading import Frame

from ..reliability.small_site import bytes_of
from .conftest import Line

TABLES = ("tracks", "tracklets", "trajectories", "poses")


def without_tables(line: Line, folder: Path) -> Path:
    """A dataset as an older version left it."""
    shutil.copytree(line.dataset.folder, folder)
    for name in TABLES:
        (folder / f"{name}.parquet").unlink()
    return folder


def test_the_tables_are_those_of_the_dataset_and_csv_says_the_same(
    line: Line, tmp_path: Path
) -> None:
    out = tmp_path / "sequence"
    assert (
        main(["dataset", "sequence", str(line.dataset.folder), "-o", str(out), "--csv", "--quiet"])
        == 0
    )
    made = ut.open(out)
    assert isinstance(made, ut.dataset.SequenceFiles)
    assert made.lanes.equals(line.dataset.lanes)
    for name in TABLES:
        table = getattr(made, name)
        assert table.equals(getattr(line.dataset, name))
        written = pyarrow.csv.read_csv(out / f"{name}.csv")
        assert written.num_rows == table.num_rows > 0
        assert written.column_names == table.column_names
    assert ut.dataset.verify(out, progress=False)
    told = ut.info(out, progress=False)
    assert (told["kind"], told["tracks"]) == ("sequence", made.tracks.num_rows)
    assert not made.manifest["flow"]


def test_an_older_dataset_gets_trajectories_of_its_motion(line: Line, tmp_path: Path) -> None:
    old = without_tables(line, tmp_path / "old" / "dataset")
    alone = ut.dataset.sequence(old, tmp_path / "alone", flow=True, progress=False)
    assert not alone.manifest["trajectories"]
    made = ut.dataset.sequence(
        old, tmp_path / "with", motion=line.motion, flow=True, progress=False
    )
    for name in TABLES:
        assert getattr(made, name).equals(getattr(line.dataset, name)), name
    frame = line.dataset[2]
    np.testing.assert_array_equal(made.flow(frame.name), frame.flow())
    other = ut.drive(line.twin, tmp_path / "other" / "motion", seed=5, progress=False)
    with pytest.raises(ut.InputError, match="has other actors"):
        ut.dataset.sequence(old, tmp_path / "no", motion=other, progress=False)


def test_an_interrupted_run_goes_on(
    line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = ut.dataset.sequence(line.dataset, tmp_path / "whole", flow=True, progress=False)
    computed: list[str] = []
    flow = Frame.flow

    def counted(frame: Frame, *, ego: bool = False) -> np.ndarray:
        computed.append(frame.name)
        if len(computed) == 4:
            raise KeyboardInterrupt
        return flow(frame, ego=ego)

    monkeypatch.setattr(Frame, "flow", counted)
    out = tmp_path / "out" / "sequence"
    with pytest.raises(KeyboardInterrupt):
        ut.dataset.sequence(line.dataset, out, flow=True, progress=False)
    assert not out.exists()
    assert computed == list(line.dataset.names[:4])
    ut.dataset.sequence(line.dataset, out, flow=True, progress=False)
    assert computed[4:] == list(line.dataset.names[3:])
    assert bytes_of(out) == bytes_of(whole.folder)
    assert [path.name for path in out.parent.iterdir()] == ["sequence"]


def test_what_cannot_be_followed(
    line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "sequence", str(line.motion.folder), "-o", str(tmp_path / "a")]) == 2
    assert "dataset.json" in capsys.readouterr().err
    damaged = tmp_path / "dataset"
    shutil.copytree(line.dataset.folder, damaged)
    with (damaged / "trajectories.parquet").open("r+b") as stream:
        stream.truncate(900)
    assert main(["dataset", "sequence", str(damaged), "-o", str(tmp_path / "b"), "--quiet"]) == 2
    assert "trajectories.parquet: is not readable" in capsys.readouterr().err
    (damaged / "boxes.parquet").write_bytes(b"PAR1")
    assert main(["dataset", "sequence", str(damaged), "-o", str(tmp_path / "b"), "--quiet"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "b").exists()
    with pytest.raises(ut.InputError, match="--ego: goes with the flow; expected --flow"):
        ut.dataset.sequence(line.dataset, tmp_path / "d", ego=True, progress=False)
    # Nothing that others wrote is replaced.
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "mine.txt").write_text("mine")
    assert main(["dataset", "sequence", str(line.dataset.folder), "-o", str(tmp_path / "c")]) == 2


def test_lanes_are_those_of_the_twin_and_actors_drive_on_them(line: Line) -> None:
    table = line.dataset.lanes
    assert table["id"].to_pylist() == sorted(lane.id for lane in line.twin.lanes)
    rows = {row["id"]: row for row in table.to_pylist()}
    for lane in line.twin.lanes:
        row = rows[lane.id]
        middle = np.column_stack([row["x"], row["y"], row["z"]])
        np.testing.assert_array_equal(middle, lane.centre)
        assert set(row["successors"]) <= rows.keys()
    cars = [
        row for row in line.dataset.trajectories.to_pylist()
        if row["class"] == "car" and rows.get(row["lane"], {}).get("kind") == "driving"
    ]  # fmt: skip
    away = [
        shapely.LineString(
            np.column_stack([rows[one["lane"]]["x"], rows[one["lane"]]["y"]])
        ).distance(shapely.Point(one["x"], one["y"]))
        for one in cars
    ]
    assert len(cars) > 20
    assert np.percentile(away, 90) < 1.0
