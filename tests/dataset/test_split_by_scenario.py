"""Whole scenarios in one part each: found by motion, by traffic and by who goes where."""

import json
import os
import shutil

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.dataset.split import read_split_document
from urbantwin.dataset.split.scenarios import scenarios_of
from urbantwin.dataset.split.sources import datasets_at
from urbantwin.errors import InputError
from urbantwin.interface.parts import chosen_frames
from urbantwin.lidar import place_rig


def rows_of(number, *, more=()):
    """Two cars on ways of their own."""
    generator = np.random.default_rng(number)
    start, way = generator.uniform(-30, 0, (2, 2)), generator.uniform(3, 12, (2, 2))
    rows = []
    for step in range(12):
        time_s = round(0.1 * step, 9)
        cars = [(k + 1, *(start[k] + way[k] * time_s)) for k in range(2)]
        rows += [
            {"time_s": time_s, "track": track, "class": "car", "asset": "car-sedan", "x": x, "y": y}
            for track, x, y in (*cars, *((9, 20.0 + 5 * time_s, -9.0) for _ in more))
        ]
    return rows


@pytest.fixture(scope="module")
def folder(twin, motion_of, rig_spec, tmp_path_factory):
    """Four motions, one of them three times: by another rig, and with one actor more."""
    place = tmp_path_factory.mktemp("scenarios")
    small = place_rig(rig_spec(rate_hz=5.0), twin.mesh)
    other = rig_spec().sensors[0].model_dump() | {"name": "other", "east_m": 25.0, "north_m": 5.0}
    elsewhere = place_rig(rig_spec(sensors=[other], rate_hz=10.0), twin.mesh)
    made = {
        "first/dataset": (motion_of(twin, rows_of(1)), small),
        "first/rain": (motion_of(twin, rows_of(1)), elsewhere),
        "varied/dataset": (motion_of(twin, rows_of(1, more=[9])), elsewhere),
        **{f"seed{k}/dataset": (motion_of(twin, rows_of(k)), small) for k in (2, 3, 4)},
    }
    for name, (motion, rig) in made.items():
        record(twin, motion, rig, place / name, workers=1, seed=len(name))
    return place


def test_recordings_of_one_scenario_are_found(folder):
    found = scenarios_of(datasets_at([folder]))
    names = [[one.folder.relative_to(folder).as_posix() for one in mine.sources] for mine in found]
    assert names == [
        ["first/dataset", "first/rain", "varied/dataset"],
        ["seed2/dataset"],
        ["seed3/dataset"],
        ["seed4/dataset"],
    ]
    assert found[0].because == ("the same motion", "actors go the same ways")


@pytest.mark.parametrize(("shared", "scenarios"), [((1,), 2), ((1, 2), 1)])
def test_one_actor_on_the_same_way_is_chance(
    twin, motion_of, rig_spec, tmp_path, shared, scenarios
):
    """Whoever is first at a stop line drives off with its light, whatever the seed."""
    rig = place_rig(rig_spec(rate_hz=5.0), twin.mesh)
    other = [row for row in rows_of(1) if row["track"] in shared]
    other += [row for row in rows_of(5) if row["track"] not in shared]
    for name, rows in (("one", rows_of(1)), ("other", other)):
        ordered = sorted(rows, key=lambda row: (row["time_s"], row["track"]))
        record(twin, motion_of(twin, ordered), rig, tmp_path / name, workers=1)
    assert len(scenarios_of(datasets_at([tmp_path]))) == scenarios


def test_no_scenario_is_in_two_parts(folder, tmp_path):
    here = shutil.copytree(folder, tmp_path / "all")
    made = ut.dataset.split(here, progress=False)
    assert "seed2/dataset" in str(made.summary())
    assert made.path == here / "split.json"
    told = json.loads(made.path.read_text())
    part_of = {row["scenario"]: row["part"] for row in told["datasets"]}
    assert all(row["part"] == part_of[row["scenario"]] for row in told["datasets"])
    assert set(part_of.values()) == {"train", "val", "test"}
    assert part_of[1] == "train"  # the longest, and the largest share
    assert {row["path"] for row in told["datasets"]} == {
        f"{name}/dataset" for name in ("first", "varied", "seed2", "seed3", "seed4")
    } | {"first/rain"}
    assert str(tmp_path) not in made.path.read_text()
    assert told["sites_in_several_parts"] == 1
    text = made.path.read_text()
    assert ut.dataset.split(here, progress=False).path.read_text() == text
    kept = {
        seed: ut.dataset.split(here, seed=seed, progress=False).told["datasets"]
        for seed in range(6)
    }
    assert len({json.dumps(one) for one in kept.values()}) > 1


def test_shares_are_met_as_whole_scenarios_allow():
    from urbantwin.dataset.split.scenario_split import _assigned

    for seed in range(20):
        frames = np.random.default_rng(seed).integers(50, 400, 40).tolist()
        part_of = _assigned(frames, {"train": 0.7, "val": 0.15, "test": 0.15}, seed)
        of = {p: sum(f for f, mine in zip(frames, part_of, strict=True) if mine == p)
              for p in ("train", "val", "test")}  # fmt: skip
        for part, share in (("train", 0.7), ("val", 0.15), ("test", 0.15)):
            assert of[part] / sum(frames) == pytest.approx(share, abs=0.02)


def test_a_document_is_refused_when_it_no_longer_fits(folder, tmp_path, twin, motion_of, rig_spec):
    here = shutil.copytree(folder / "seed2", tmp_path / "two")
    made = ut.dataset.split([here, folder / "seed3", folder / "seed4"], tmp_path / "split.json",
                    progress=False)  # fmt: skip
    assert len(read_split_document(made.path).datasets("all")) == 3
    rig = place_rig(rig_spec(rate_hz=5.0), twin.mesh)
    record(twin, motion_of(twin, rows_of(7)), rig, here / "dataset", workers=1)
    with pytest.raises(InputError, match="showed another motion"):
        read_split_document(made.path)
    shutil.rmtree(here)
    with pytest.raises(InputError, match="which is no dataset"):
        read_split_document(made.path)
    too_long = [{"path": "a" * 300, "part": "train"}]  # for any file system
    made.path.write_text(json.dumps({"kind": "split", "datasets": too_long}))
    with pytest.raises(InputError, match="which is no dataset"):
        read_split_document(made.path)
    made.path.write_text('{"kind": "split", "datasets": [{"path": "a", "part": "some"}]}')
    with pytest.raises(InputError, match=r"datasets\[0\]\.part"):
        read_split_document(made.path)


def test_training_takes_a_document(folder, tmp_path):
    made = ut.dataset.split(folder, tmp_path / "split.json", thin=1.0, progress=False)
    document = read_split_document(made.path)
    for part in ("train", "val", "test"):
        chosen = chosen_frames([made.path], part)
        rows = [row for row in made.told["datasets"] if row["part"] == part]
        assert [str(one.resolve()) for one in chosen.folders] == [row["path"] for row in rows]
        assert [list(one) for one in chosen.names] == [row["kept"] for row in rows]
    assert chosen_frames([made.path], "all").names == (None,) * len(document.rows)
    assert chosen_frames([folder / "seed2/dataset"], "train").names == (
        ("000000", "000001", "000002", "000003"),
    )


def test_python_takes_its_parts_and_not_those_of_each_dataset(folder, tmp_path):
    divided = ut.dataset.split(folder, tmp_path / "split.json", by="scenario", progress=False)
    opened = ut.open(divided)
    for part in ("train", "val", "test"):
        mine = {
            row["path"]: row["frames"] for row in divided.told["datasets"] if row["part"] == part
        }
        chosen = opened.where(split=part)
        assert {one.folder.resolve() for one, _, _ in chosen._located} == {
            (tmp_path / path).resolve() for path in mine
        }
        assert len(chosen) == sum(mine.values())
    assert sum(ut.info(divided)["parts"].values()) == len(opened)
    with pytest.raises(InputError, match="no dataset for holdout"):
        opened.where(split="holdout")


def test_one_motion_is_cut_at_the_same_moments_in_all_recordings(folder, tmp_path):
    here = shutil.copytree(folder, tmp_path / "all")
    ut.dataset.split(here, by="time", shares="50,25,25", thin=0.1, progress=False)
    spans = {}
    for name in ("first/dataset", "first/rain", "varied/dataset"):
        manifest = json.loads((here / name / "dataset.json").read_text())
        times = {one["name"]: one["time_s"] for one in manifest["frames"]}
        for part in ("train", "val", "test"):
            for frame in (here / name / f"ImageSets/{part}.txt").read_text().split():
                spans.setdefault(part, []).append(times[frame])
    assert max(spans["train"]) < min(spans["val"]) <= max(spans["val"]) < min(spans["test"])
    assert not ut.dataset.verify(here / "first", progress=False).damages


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["first"], "and 1 more are one scenario (the same motion)"),
        (["seed2", "--by", "scenario"], "is one scenario"),
        (["", "--gap", 3], "--gap"),
        (["", "--by", "time", "-o", "x.json"], "--out"),
        (["", "--by", "moon"], "unknown way"),
        (["nowhere"], "not found"),
        (["", "--thin", "nan"], "--thin"),
    ],
)
def test_what_cannot_be_divided_is_one_line(folder, tmp_path, capsys, options, said):
    before = sorted(os.walk(folder))
    assert (
        main(["dataset", "split", str(folder / options[0]), *map(str, options[1:]), "--quiet"]) == 2
    )
    assert said in capsys.readouterr().err
    assert sorted(os.walk(folder)) == before
