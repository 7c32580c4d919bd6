"""Campaigns, end to end on a small place."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.dataset as pads
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main

from ..reliability.small_site import bytes_of
from ..whole_page import whole_page
from .conftest import Line

WEATHER = {"dry": {}, "fog": {"weather": "fog", "visibility_m": 60}}
#: Rides on a train, of which there is none here.
RIDING = {
    "ride": {"class": "tram"},
    "sensors": [{"name": "roof", "model": "VLP-16", "forward_m": 0, "left_m": 0, "height_m": 3.5}],
}


@pytest.fixture(scope="module")
def grid(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    path = folder / "grid.yaml"
    fields = {
        "sites": {"a": str(line.twin.folder)},
        "seeds": [1, 2],
        "weather": WEATHER,
        "duration_s": 0.4,
        "split": {"by": "scenario", "shares": [50, 50]},
        "shards": {"format": "parquet", "megabytes": 0.3},
    }
    path.write_text(yaml.safe_dump(fields, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def made(grid: Path) -> ut.experiment.Campaign:
    return ut.experiment.run(grid, workers=1, progress=False)


@pytest.mark.thorough
def test_all_datasets_are_read_as_one(made: ut.experiment.Campaign) -> None:
    again = ut.open(made.folder)
    assert isinstance(again, ut.experiment.Campaign)
    assert len(again) == 2 * 2 * 4
    assert again.sequences[0] == "a-1-own-dry-none"
    assert [one["weather"] for one in again.levels] == ["dry", "fog", "dry", "fog"]
    fog = again.where(weather="fog", seed=2)
    assert set(fog.sequences) == {"a-2-own-fog-none"}
    # Fog of 60 m hides most of what a dry day shows, of the same traffic.
    far = [
        sum(np.count_nonzero(np.hypot(*frame.points[:, :2].T) > 40) for frame in again.where(
            weather=weather
        ))
        for weather in WEATHER
    ]  # fmt: skip
    assert far[1] < far[0] / 4
    parts = {part: set(again.where(split=part).sequences) for part in ("train", "val")}
    assert {len({name[2] for name in names}) for names in parts.values()} == {1}  # a seed each
    assert not parts["train"] & parts["val"]
    with pytest.raises(ut.InputError, match="has no weather 'fgo'; expected dry, fog"):
        again.at(weather="fgo")
    with pytest.raises(ut.InputError, match="has no axis 'wether'"):
        again.at(wether="fog")


def test_a_cell_is_what_record_records(
    line: Line, made: ut.experiment.Campaign, tmp_path: Path
) -> None:
    alone = ut.record(
        line.twin, made.folder / "motions/a-2-none", tmp_path / "dataset", weather="fog",
        visibility=60, seed=2, split="1,0", workers=1, pictures=False, progress=False,
    )  # fmt: skip
    assert bytes_of(alone.folder) == bytes_of(made.folder / "datasets" / "a-2-own-fog-none")


def test_the_index_tells_what_there_is(made: ut.experiment.Campaign) -> None:
    rows = made.manifest["datasets"]
    assert made.manifest["counts"]["frames"] == sum(row["frames"] for row in rows) == 16
    for row, dataset in zip(rows, made.datasets, strict=True):
        assert row["points"] == sum(len(frame.points) for frame in dataset)
        files = [one for one in dataset.folder.rglob("*") if one.is_file()]
        assert row["bytes"] == sum(one.stat().st_size for one in files)
    assert "fog" in whole_page((made.folder / "index" / "campaign.html").read_text()).cells
    assert ut.dataset.verify(made.folder, progress=False)
    assert ut.info(made.folder, progress=False)["cells"] == 4


def test_any_reader_of_parquet_reads_the_shards(made: ut.experiment.Campaign) -> None:
    files = sorted((made.folder / "shards").glob("*.parquet"))
    assert len(files) > 2
    shards = pads.dataset([str(one) for one in files])
    assert shards.count_rows() == len(made)
    fog = shards.to_table(filter=(pads.field("weather") == "fog") & (pads.field("seed") == 1))
    wanted = {frame.name: frame for frame in made.where(weather="fog", seed=1)}
    for row in fog.to_pylist():
        frame = wanted.pop(row["frame"])
        assert row["x"] == frame.points[:, 0].tolist()
        assert row["semantic"] == frame.semantic.tolist()
        boxes = frame.boxes.to_pylist()
        assert sorted(one["track"] for one in row["boxes"]) == sorted(x["track"] for x in boxes)
        assert row["part"] == ("train" if "a-1" in made.where(split="train").sequences[0] else
                               "val")  # fmt: skip
    assert not wanted
    first = pads.dataset(str(files[-1])).to_table(columns=["dataset"])["dataset"].to_pylist()
    assert len(set(first)) > 1  # of several recordings


@pytest.mark.thorough
def test_another_level_makes_what_is_new_alone(grid: Path, made: ut.experiment.Campaign) -> None:
    before = {
        path: path.stat().st_mtime_ns
        for path in made.folder.rglob("*")
        if path.is_file() and {"datasets", "motions"} & set(path.parts)
    }
    fields = yaml.safe_load(grid.read_text(encoding="utf-8"))
    grid.write_text(
        yaml.safe_dump({**fields, "weather": {**WEATHER, "wet": {"wet_ground": 1.0}}}),
        encoding="utf-8",
    )
    again = ut.experiment.run(grid, made.folder, workers=1, most=1, progress=False)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert len(again.manifest["datasets"]) == 5
    told = ut.experiment.run(grid, made.folder, plan=True).summary()
    assert told["left"] == {"twin": 0, "motion": 0, "dataset": 1}
    assert told["by"] == "what 5 recordings took"


def test_what_fails_is_told_and_all_else_is_made(
    line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tram.yaml").write_text(yaml.safe_dump(RIDING))
    (tmp_path / "ball.yaml").write_text(
        yaml.safe_dump({"events": [{"event": "debris", "at_s": 0.1, "place": {"street": "No"}}]})
    )
    path = tmp_path / "grid.yaml"
    fields = {
        "sites": {"a": str(line.twin.folder)},
        "rigs": ["own", "tram.yaml"],
        "scenarios": ["none", "ball.yaml"],
        "duration_s": 0.4,
    }
    path.write_text(yaml.safe_dump(fields))
    assert main(["experiment", "run", str(path), "--workers", "1", "--json"]) == 1
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert told["datasets"] == 1
    assert len(told["failed"]) == 3
    assert any("a-1-tram-clear-none" in one and "tram" in one for one in told["failed"])
    assert sum("motions/a-1-ball" in one for one in told["failed"]) == 2
    error = said.err.splitlines()[-1]
    assert "3 of 4 cells failed; the same command tries them again" in error
    assert "Traceback" not in said.err
    (tmp_path / "other.yaml").write_text(path.read_text())
    out = str(tmp_path / "campaign")
    assert main(["experiment", "run", str(tmp_path / "other.yaml"), "-o", out, "--quiet"]) == 2
    assert "holds the campaign of grid.yaml; expected another folder" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_cluster_makes_the_same_bytes(
    grid: Path, made: ut.experiment.Campaign, tmp_path: Path
) -> None:
    pytest.importorskip("ray", reason="ray is not installed: pip install 'urbantwin[ray]'")
    path = tmp_path / grid.name
    fields = yaml.safe_load(grid.read_text(encoding="utf-8"))
    del fields["shards"], fields["split"]
    split = {"shares": [1, 0]}  # as datasets have it that are of one part as a whole
    path.write_text(yaml.safe_dump({**fields, "seeds": [1], "weather": WEATHER, "split": split}))
    there = ut.experiment.run(path, ray="local", workers=2, progress=False)
    assert len(there.datasets) == 2
    for row in there.manifest["datasets"]:
        assert bytes_of(there.folder / row["path"]) == bytes_of(made.folder / row["path"])


@pytest.mark.thorough
def test_a_split_is_of_the_cells_of_the_grid_and_goes_with_it(
    grid: Path, made: ut.experiment.Campaign, tmp_path: Path
) -> None:
    fields = yaml.safe_load(grid.read_text(encoding="utf-8"))
    place = tmp_path / "campaign"
    shutil.copytree(made.folder, place)
    grid = tmp_path / grid.name
    grid.write_text(yaml.safe_dump({**fields, "weather": {"dry": {}}}))
    ut.experiment.run(grid, place, workers=1, progress=False)
    assert (place / "datasets" / "a-1-own-fog-none").is_dir()
    mine = tmp_path / "mine" / "split.json"
    mine.parent.mkdir()
    told = ut.dataset.split(place, mine, progress=False).told
    listed = [Path(one["path"]).name for one in told["datasets"]]
    assert sorted(listed) == ["a-1-own-dry-none", "a-2-own-dry-none"]
    by_time = {**fields, "weather": {"dry": {}}, "split": {"shares": [50, 50]}}
    grid.write_text(yaml.safe_dump({**by_time, "seeds": [1]}))
    again = ut.experiment.run(grid, place, workers=1, progress=False)
    assert not (place / "split.json").exists()
    # Of a split in time each dataset has frames of both parts.
    assert len(again.where(split="train")) == len(again.where(split="val")) == 2
    own = mine.read_text().replace("../campaign/", "")
    (place / "split.json").write_text(own)
    ut.experiment.run(grid, place, workers=1, progress=False)
    assert (place / "split.json").read_text() == own


@pytest.mark.thorough
def test_a_rig_may_leave_a_dataset_for_each_sensor(
    line: Line, made: ut.experiment.Campaign, tmp_path: Path
) -> None:
    place = {"model": "VLP-16", "height_m": 4.0, "tilt_deg": 5}
    sensors = [
        {"name": "north", "east_m": 0, "north_m": 14, "yaw_deg": -90, **place},
        {"name": "south", "east_m": 0, "north_m": -14, "yaw_deg": 90, **place},
    ]
    rig = {"rate_hz": 10, "fused": False, "sensors": sensors}
    (tmp_path / "pair.yaml").write_text(yaml.safe_dump(rig))
    grid = tmp_path / "grid.yaml"
    fields = {"sites": {"a": str(line.twin.folder)}, "rigs": ["own", "pair.yaml"]}
    split = {"by": "scenario", "shares": [50, 50]}
    fields |= {"seeds": [1, 2], "duration_s": 0.4, "split": split}
    fields["shards"] = {"format": "parquet"}
    grid.write_text(yaml.safe_dump(fields))
    shutil.copytree(made.folder, tmp_path / "campaign")  # of the same motions
    pair = ut.experiment.run(grid, tmp_path / "campaign", workers=1, progress=False)
    assert [one["sensor"] for one in pair.levels] == ["fused", "north", "south"] * 2
    names = ("a-1-own-clear-none", "a-1-pair-clear-none-north", "a-1-pair-clear-none-south")
    assert tuple(dict.fromkeys(pair.sequences))[:3] == names
    assert len(pair.where(sensor="south", seed=2)) == 4
    # A cell is what `record` records, and both sensors of it are in one part.
    motion = pair.folder / "motions" / "a-2-none"
    ut.record(
        line.twin, motion, tmp_path / "alone", rig=tmp_path / "pair.yaml", seed=2,
        split="1,0", workers=1, pictures=False, progress=False,
    )  # fmt: skip
    assert bytes_of(tmp_path / "alone") == bytes_of(
        pair.folder / "datasets" / "a-2-pair-clear-none"
    )
    parts = [set(pair.where(split=part).sequences) for part in ("train", "val")]
    assert list(map(len, parts)) == [3, 3]
    assert not parts[0] & parts[1]
    rows = (pair.folder / "index" / "cells.csv").read_text().splitlines()
    assert len(rows) == 7
    assert '"pair","clear","north",4,' in rows[2]
    assert main(["dataset", "verify", str(pair.folder), "--quiet"]) == 0
    assert ut.open(pair.folder).at(sensor="north").levels[0]["rig"] == "pair"
    shards = pads.dataset(pair.folder / "shards", exclude_invalid_files=True)
    names = shards.to_table(columns=["sensor_name"])["sensor_name"].to_pylist()
    assert {name: names.count(name) for name in names} == {"fused": 8, "north": 8, "south": 8}
    again = ut.experiment.run(grid, pair.folder, workers=1, plan=True, progress=False)
    assert again.plan["left"]["dataset"] == 0
