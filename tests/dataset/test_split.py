"""Training, validation and test cut in time: gaps, shares, thinning; written anew in place."""

import itertools
import json
import os
import shutil

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.artefact import verify
from urbantwin.dataset import SplitAsked, record
from urbantwin.dataset.card import PICTURE_OF_SPLIT
from urbantwin.dataset.split import check_split, shares_of, split_in_time
from urbantwin.dataset.split.actor_places import Recorded
from urbantwin.drawing.pictures import redraw_split
from urbantwin.errors import InputError
from urbantwin.lidar import place_rig

from ..box_tables import write_table

PARTS = ("train", "val", "test")
POSE = np.eye(4).tolist()
COLUMNS = ("x", "y", "z", "length", "width", "height", "yaw", "vx", "vy", "observed_s")


def lists(folder):
    return {part: (folder / f"ImageSets/{part}.txt").read_text().split() for part in PARTS}


def table_of(path, rows):
    """``boxes.parquet`` of (frame, track, x, y) and what else differs from a car at rest."""
    usual = dict.fromkeys(COLUMNS, 0.0) | {"length": 4.0, "ignored": None, "parked": False}
    full = [
        {**usual, "frame": f"{frame:06d}", "track": track, "x": x, "y": y, **more}
        for frame, track, x, y, more in rows
    ]
    write_table(path, full)


def recorded(tmp_path, count, rows, step_s=0.1):
    table_of(tmp_path / "boxes.parquet", rows)
    frames = [{"name": f"{k:06d}", "time_s": k * step_s} for k in range(count)]
    return Recorded(tmp_path, frames, POSE)


def passing(count, step_s=0.1, speed=8.0):
    """One car passes at 8 m/s, one stands, one is parked."""
    return [
        row
        for k in range(count)
        for row in (
            (k, 1, speed * k * step_s, 0.0, {}),
            (k, 2, 5.0, 9.0, {}),
            (k, 30_001, 3.0, -5.0, {"parked": True}),
        )
    ]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 10, 100, 601])
@pytest.mark.parametrize("shares", [(70, 15, 15), (80, 20), (98, 1, 1), (1, 1, 1), (1, 0, 9)])
def test_parts_are_pieces_of_time_in_their_order(tmp_path, count, shares):
    one = recorded(tmp_path, count, passing(count))
    split = split_in_time([one], SplitAsked(shares_of(shares)))
    parts = split.frames(one.frames)
    told = split.told_of(one.frames)
    every = [name for part in PARTS for name in parts[part]]
    assert every == sorted(set(every))  # in time, and no frame twice
    wanted = [part for part, share in zip(PARTS, (*shares, 0)[:3], strict=True) if share]
    assert all(parts[part] for part in wanted[:count])
    assert not any(parts[part] for part in PARTS if part not in wanted)
    assert told["frames_in_gaps"] == count - len(every)
    for before, after in itertools.pairwise(wanted):
        if parts[before] and parts[after]:
            apart = (int(parts[after][0]) - int(parts[before][-1])) * 0.1
            assert apart >= told["gap_s"] - 1e-6
    if count >= 100 and shares == (70, 15, 15):
        assert parts["val"][0] == f"{round(0.7 * count):06d}"


def test_the_gap_is_as_long_as_the_scene_needs_to_change(tmp_path):
    """A car of 4 m at 8 m/s leaves its place within half a second: the closed form."""
    one = recorded(tmp_path, 400, passing(400))
    told = split_in_time([one], SplitAsked()).told_of(one.frames)
    assert told["scene_changes_in_s"] == told["gap_s"] == pytest.approx(0.5, abs=0.11)
    assert told["where_they_stood"][0] == {"from": "train", "to": "val", "moving": 1, "still": 0}
    assert told["actors"] == {
        "train": 2, "val": 2, "test": 2, "in train and val": 2, "in train and test": 2,
        "in val and test": 2,
    }  # fmt: skip
    assert told["parked"]["in train and test"] == 1


def test_who_waits_needs_a_longer_gap(tmp_path):
    """It drives for 1 s and waits for 9; its length takes 0.5 s: (10 - t) / 10 of looks t apart.

    A tenth is left after 9 s; the waiting times that are tried are a tenth apart.
    """
    way = np.cumsum([0.8 if k % 100 < 10 else 0.0 for k in range(1200)])
    rows = [(k, 1, float(way[k]), 0.0, {}) for k in range(1200)]
    told = split_in_time([recorded(tmp_path, 1200, rows)], SplitAsked()).told
    assert 9.0 <= told["scene_changes_in_s"] < 10.0


def test_a_short_recording_says_what_its_gap_is_worth(tmp_path):
    from urbantwin.dataset.split.time_split import warnings_of_split

    one = recorded(tmp_path, 100, passing(100, speed=0.3))
    told = split_in_time([one], SplitAsked()).told_of(one.frames)
    assert told["scene_changes_in_s"] is None
    assert told["gap_s"] <= 0.1 * 9.9 + 0.1
    (warning,) = warnings_of_split(told)
    assert "1 of 1 moving actors stand in val where they stood in train" in str(warning)
    for count, missing in ((1, "val and test"), (2, "test")):
        few = recorded(tmp_path, count, passing(count))
        (warning,) = warnings_of_split(split_in_time([few], SplitAsked()).told_of(few.frames))
        assert f"no frame for {missing}" in str(warning)


def test_the_cuts_stay_where_the_gap_differs(tmp_path):
    """A variant of a recording whose scene changes slower never reaches over the other's cut."""
    fast = recorded(tmp_path, 300, passing(300))
    one = split_in_time([fast], SplitAsked()).frames(fast.frames)
    slow = recorded(tmp_path, 300, passing(300, speed=1.5))
    other = split_in_time([slow], SplitAsked()).frames(slow.frames)
    assert one != other
    for first, second in ((one, other), (other, one)):
        assert max(first["train"]) < min(second["val"])
        assert max(first["val"]) < min(second["test"])


def test_frames_in_which_nobody_moved_are_left_out(tmp_path):
    """Nobody moves but for frames 20 to 29 (1 m a frame), and somebody turns in frame 40."""
    rows = [(k, 1, float(np.clip(k - 19, 0, 10)), 0.0, {}) for k in range(60)]
    rows += [(k, 2, 30.0, 5.0, {"yaw": 1.0 if k >= 40 else 0.0}) for k in range(60)]
    rows += [(k, 3, 90.0 + 5 * k, 0.0, {"ignored": "far"}) for k in range(60)]  # out of reach
    rows += [(k, 4, 7.0, 7.0, {}) for k in range(50, 60)]  # comes in frame 50
    # Seen later than the frame's time: it stands, though its box does not.
    rows += [(k, 5, 2.0 + k % 2, 2.0, {"vx": 1.0, "observed_s": float(k % 2)}) for k in range(60)]
    one = recorded(tmp_path, 60, rows)
    split = split_in_time([one], SplitAsked(shares_of("100,0"), moved_m=1.5))
    kept = [int(name) for name in split.frames(one.frames)["train"]]
    assert kept == [0, 21, 23, 25, 27, 29, 40, 50]
    told = split.told_of(one.frames)
    assert told["thinned"] == {
        "moved_m": 1.5, "frames_left_out": {"train": 52, "val": 0, "test": 0}
    }  # fmt: skip


@pytest.mark.parametrize(
    ("shares", "said"),
    [("70", "no shares"), ("a,b", "no shares"), ("0,50,50", "nothing is left to train on"),
     ("nan,1", "no shares"), ("-1,2", "no shares"), ("1,1,1,1", "no shares"), ("", "no shares"),
     ((1, None), "no shares"), ("1e308,1e308", "no shares")],
)  # fmt: skip
def test_shares_that_are_none_are_refused(shares, said):
    with pytest.raises(InputError, match=said):
        shares_of(shares)


def test_a_gap_that_leaves_nothing_is_refused_before_any_work():
    times = [0.1 * k for k in range(50)]
    check_split(times, SplitAsked(gap_s=0.3))
    with pytest.raises(InputError, match="leave no frame for val"):
        check_split(times, SplitAsked(gap_s=2.0))
    for wrong in (-1.0, float("nan"), 1e9):
        with pytest.raises(InputError):
            SplitAsked(gap_s=wrong)


def test_a_dataset_is_divided_anew_as_it_would_have_been_recorded(
    twin, motion, rig, dataset, tmp_path, digests
):
    asked = SplitAsked(shares_of("40,30,30"), 0.2, 0.4)
    record(twin, motion, rig, tmp_path / "other", workers=1, seed=5, split=asked)
    again = shutil.copytree(dataset, tmp_path / "dataset")
    before = lists(again)
    told = ut.dataset.split(again, shares="40,30,30", gap=0.2, thin=0.4, progress=False)
    assert digests(again) == digests(tmp_path / "other")
    assert lists(again) != before
    assert not any(one.damages for one in verify(again))
    assert "gap_s: 0.2" in str(told.summary())
    assert told.summary()["frames"] == {k: len(v) for k, v in lists(again).items()}
    ut.dataset.split(again, progress=False)
    assert digests(again) == digests(dataset)
    assert [one.name for one in tmp_path.iterdir() if one.name.startswith(".")] == []


@pytest.mark.thorough
def test_card_and_picture_tell_the_split_that_there_is(dataset, tmp_path):
    old, new = (shutil.copytree(dataset, tmp_path / name) for name in ("old", "new"))
    ut.dataset.card(old, progress=False)
    kept = {path: path.read_bytes() for path in old.rglob("*") if path.is_file()}
    other = shutil.copytree(old, tmp_path / "other", copy_function=os.link)
    ut.dataset.split(other, shares="40,30,30", gap=0.2, progress=False)
    ut.dataset.split(new, shares="40,30,30", gap=0.2, progress=False)
    train = f"| `train` | {len(lists(new)['train'])} |"
    assert train in (new / "README.md").read_text()
    assert train not in (old / "README.md").read_text()
    (new / "pictures").mkdir()
    redraw_split(new)
    picture = f"pictures/{PICTURE_OF_SPLIT}"
    assert (other / picture).read_bytes() == (new / picture).read_bytes()
    assert (other / picture).read_bytes() != (old / picture).read_bytes()
    assert {path: path.read_bytes() for path in kept} == kept
    ut.dataset.split(other, progress=False)
    for name in (picture, "README.md"):
        assert (other / name).read_bytes() == (old / name).read_bytes()
    (other / "README.md").write_text("mine")
    ut.dataset.split(other, shares="40,60", progress=False)
    assert (other / "README.md").read_text() == "mine"
    assert [bad.name for one in verify(other) for bad in one.damages] == ["README.md"]


@pytest.mark.thorough
def test_sensors_apart_are_cut_at_the_same_moments(twin, motion, tmp_path, rig_spec, digests):
    first = rig_spec().sensors[0].model_dump()
    second = {**first, "name": "far", "east_m": 30.0}
    apart = place_rig(rig_spec(sensors=[first, second], fused=False), twin.mesh)
    record(twin, motion, apart, tmp_path / "parts", workers=1)
    out = tmp_path / "again"
    record(twin, motion, apart, out, workers=1, split=SplitAsked(moved_m=0.4))
    assert lists(out / "pole") == lists(out / "far")
    ut.dataset.split(tmp_path / "parts", thin=0.4, progress=False)
    assert digests(out) == digests(tmp_path / "parts")
    with pytest.raises(InputError, match="inside a dataset"):
        ut.dataset.split(out / "pole", progress=False)


def test_an_old_dataset_of_two_parts_gets_three(dataset, tmp_path):
    """As the version before wrote it: no test part, no split in the manifest."""
    old = shutil.copytree(dataset, tmp_path / "dataset")
    manifest = json.loads((old / "dataset.json").read_text())
    del manifest["split"], manifest["counts"]["test"]
    del manifest["tables_sha256"]["ImageSets/test.txt"]
    (old / "dataset.json").write_text(json.dumps(manifest))
    (old / "ImageSets/test.txt").unlink()
    (old / "SHA256SUMS").unlink()
    from urbantwin.artefact import write_inventory
    from urbantwin.dataset.split import frames_of_part

    write_inventory(old)
    assert frames_of_part(old, "test") == []
    assert ut.open(old).summary()["test"] == 0
    ut.dataset.split(old, progress=False)
    assert lists(old) == lists(dataset)
    assert not any(one.damages for one in verify(old))


def test_what_is_damaged_stays_so(dataset, tmp_path):
    hurt = shutil.copytree(dataset, tmp_path / "dataset")
    with (hurt / "points/000003.npy").open("r+b") as stream:
        stream.seek(500)
        stream.write(b"????")
    ut.dataset.split(hurt, shares="50,50", progress=False)
    assert [bad.name for one in verify(hurt) for bad in one.damages] == ["points/000003.npy"]
    (hurt / "rays/000004.npy").unlink()
    with pytest.raises(InputError, match="000004"):
        ut.dataset.split(hurt, progress=False)
    (hurt / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        ut.dataset.split(hurt, progress=False)
