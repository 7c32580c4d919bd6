"""Filters of boxes and frames, against plain loops over the rows; and several datasets as one."""

import math
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.dataset.reading import Frames

from .conftest import Line


def rows_of(frames: Frames) -> list[dict[str, Any]]:
    return [row for frame in frames for row in frame.boxes.to_pylist()]


def key(row: dict[str, Any]) -> tuple[str, int]:
    return row["frame"], row["track"]


def range_of(dataset: ut.Dataset, row: dict[str, Any]) -> float:
    site = dataset[row["frame"]].site_SE3_dataset.apply([[row["x"], row["y"], row["z"]]])[0]
    eye = np.array(dataset.manifest["rig"]["sensors"][0]["site_SE3_sensor"])[:2, 3]
    return float(math.dist(site[:2], eye))


@pytest.mark.parametrize(
    ("asked", "meets"),
    [
        ({"classes": ["car", "pedestrian"]}, lambda d, r: r["class"] in ("car", "pedestrian")),
        ({"classes": "car"}, lambda d, r: r["class"] == "car"),
        ({"min_points": 3}, lambda d, r: r["num_points"] >= 3),
        ({"within_m": 30}, lambda d, r: range_of(d, r) <= 30),
        ({"beyond_m": 30}, lambda d, r: range_of(d, r) >= 30),
        ({"max_occlusion": 0.5}, lambda d, r: r["occlusion"] is not None and r["occlusion"] <= 0.5),
        ({"max_truncation": 0.0}, lambda d, r: r["truncation"] <= 0),
        ({"counted": True}, lambda d, r: r["ignored"] is None),
        ({"difficulty": ("easy", "hard")}, lambda d, r: r["difficulty"] in ("easy", "hard")),
        ({"tracks": [1, 2, 5]}, lambda d, r: r["track"] in (1, 2, 5)),
        ({"tracks": []}, lambda d, r: False),
        (
            {"within_m": 40.0, "min_points": 1, "max_occlusion": 0.9},
            lambda d, r: range_of(d, r) <= 40
            and r["num_points"] >= 1
            and r["occlusion"] is not None
            and r["occlusion"] <= 0.9,
        ),
    ],
)  # fmt: skip
def test_boxes_are_those_that_a_loop_finds(line: Line, asked: Any, meets: Any) -> None:
    dataset = line.dataset
    every = rows_of(dataset)
    assert len(every) == dataset.boxes.num_rows > 20
    wanted = [key(row) for row in every if meets(dataset, row)]
    found = dataset.where(**asked)
    assert [key(row) for row in rows_of(found)] == wanted
    assert len(found) == len(dataset)  # frames stay
    np.testing.assert_array_equal(found[2].points, dataset[2].points)
    shown = dataset.where(**asked, with_boxes=True)
    assert list(shown.names) == [n for n in dataset.names if any(n == one for one, _ in wanted)]
    assert len(dataset[2].box_array) == dataset[2].boxes.num_rows


def test_filters_are_chained_and_both_hold(line: Line) -> None:
    dataset = line.dataset
    one = dataset.where(min_points=1).where(within_m=40).where(frames=dataset.names[1:5], every=2)
    both = dataset.where(min_points=1, within_m=40, frames=dataset.names[1:5], every=2)
    assert one.names == both.names == (dataset.names[1], dataset.names[3])
    assert [key(row) for row in rows_of(one)] == [key(row) for row in rows_of(both)]
    assert len(rows_of(one)) < len(rows_of(dataset.where(frames=dataset.names[1:5], every=2)))
    assert [frame.name for frame in one[::-1]] == [dataset.names[3], dataset.names[1]]
    assert one[dataset.names[3]].time_s == dataset[3].time_s
    with pytest.raises(IndexError):
        one[2]


def test_frames_by_split_and_time(line: Line) -> None:
    dataset = line.dataset
    for split in ("train", "val"):
        file = dataset.folder / "ImageSets" / f"{split}.txt"
        assert list(dataset.where(split=split).names) == file.read_text().split()
    some = dataset.where(start=0.2, stop=0.4)
    assert some.times_s.tolist() == [t for t in dataset.times_s.tolist() if 0.2 <= t <= 0.4]
    assert dataset.windows(3, step=2) == [range(0, 3), range(2, 5)]
    # A gap ends a run of frames.
    gap = dataset.where(frames=[n for n in dataset.names if n != dataset.names[2]])
    assert gap.windows(3) == [range(2, 5)]
    assert gap.windows(9) == []


def test_points_on_boxes_that_are_left(line: Line) -> None:
    frame = max(line.dataset.where(min_points=2), key=lambda one: one.boxes.num_rows)
    tracks = frame.boxes["track"].to_pylist()
    assert frame.on_boxes.sum() == sum(frame.boxes["num_points"].to_pylist()) > 0
    assert set(frame.instance[frame.on_boxes].tolist()) == set(tracks)


def test_every_field_of_the_points_has_its_name(line: Line) -> None:
    frame = line.dataset[3]
    for axis, name in enumerate(("x", "y", "z", "intensity")):
        np.testing.assert_array_equal(getattr(frame, name), frame.points[:, axis])
    for name in ("sensor", "ring", "column", "time", "echo"):
        np.testing.assert_array_equal(getattr(frame, name), frame.rays[name])
    cloud = frame.cloud
    assert cloud.dtype.names is not None
    for name in cloud.dtype.names:
        np.testing.assert_array_equal(cloud[name], getattr(frame, name))
    assert len(cloud.dtype.names) == 11


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"classes": ["cra"]}, r"classes: 'cra' is no class.*car"),
        ({"difficulty": "simple"}, r"'simple' is no level; expected easy, moderate, hard"),
        ({"split": "best"}, r"has no split 'best'; expected test, train, val"),
        ({"sequences": ["rain"]}, r"no sequence 'rain'; expected dataset"),
        ({"frames": ["999999"]}, r"no frame '999999'"),
        ({"within_m": -1}, r"within_m: is -1; expected a number, 0 or more"),
        ({"min_points": float("nan")}, r"min_points: is nan"),
        ({"max_occlusion": "all"}, r"max_occlusion: is 'all'"),
        ({"tracks": ["3"]}, r"tracks: '3' is no track; expected 1 to 65535"),
        ({"tracks": 0}, r"tracks: 0 is no track"),
        ({"every": 0}, r"every: is 0; expected 1 or more"),
        ({"start": float("inf")}, r"start: is inf"),
    ],
)
def test_what_does_not_exist_is_told_in_a_line(line: Line, asked: Any, told: str) -> None:
    with pytest.raises(ut.InputError, match=told) as caught:
        line.dataset.where(**asked)
    assert "\n" not in str(caught.value)


def test_a_split_that_names_a_frame_that_is_not_there(line: Line, tmp_path: Path) -> None:
    shutil.copytree(line.dataset.folder, tmp_path / "dataset")
    (tmp_path / "dataset" / "ImageSets" / "val.txt").write_text("000001\n000777\n")
    with pytest.raises(ut.InputError, match=r"val.txt: line 2: names frame 000777"):
        ut.open(tmp_path / "dataset").where(split="val")


def test_several_datasets_are_one_list_of_frames(line: Line, tmp_path: Path) -> None:
    for name in ("dry", "rain"):
        shutil.copytree(line.dataset.folder, tmp_path / "all" / name)
    both = ut.open(tmp_path / "all")
    assert isinstance(both, ut.Datasets)
    assert len(both) == 2 * len(line.dataset)
    assert both.sequences == ("dry",) * len(line.dataset) + ("rain",) * len(line.dataset)
    rain = both.where(sequences="rain", min_points=1)
    assert {frame.dataset.folder.name for frame in rain} == {"rain"}
    assert [key(row) for row in rows_of(rain)] == [
        key(row) for row in rows_of(line.dataset.where(min_points=1))
    ]
    # Frames of two datasets do not follow each other.
    assert len(both.windows(len(line.dataset))) == 2
    # One that is called as `run` calls it does not hide the others.
    shutil.copytree(line.dataset.folder, tmp_path / "all" / "dataset")
    assert len(ut.open(tmp_path / "all").datasets) == 3
    with pytest.raises(ut.InputError, match="2 frames 000001"):
        both["000001"]
    with pytest.raises(ut.InputError, match="given twice"):
        ut.Datasets([line.dataset, line.dataset.folder])
    with pytest.raises(ut.InputError, match="holds no dataset"):
        ut.Datasets.open(tmp_path / "all" / "dry" / "points")


def test_a_selection_is_pickled_without_what_was_read(line: Line) -> None:
    some = line.dataset.where(min_points=1, split="train")
    before = len(pickle.dumps(some))
    wanted = rows_of(some)
    assert len(pickle.dumps(some)) == before < 60_000
    again = pickle.loads(pickle.dumps(some))
    assert rows_of(again) == wanted
    np.testing.assert_array_equal(again[1].points, some[1].points)
