"""Recording: the files, the same bytes however it is run, and going on after an interruption."""

import json
import multiprocessing
import re
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from urbantwin.dataset import describe, record
from urbantwin.errors import InputError, StageError
from urbantwin.geometry import Pose, points_in_box
from urbantwin.lidar import place_rig
from urbantwin.taxonomy import ACTOR_SEMANTICS, semantic_id

from ..thorough import further

NAMES = [f"{index:06d}" for index in range(12)]
FOREGROUND = [semantic_id(name) for name in ACTOR_SEMANTICS.values()]


def read_as_openpcdet(path):
    """Boxes and names of a label file, read as OpenPCDet's custom dataset reads them."""
    boxes, names = [], []
    for line in path.read_text().splitlines():
        tokens = line.strip().split(" ")
        boxes.append(tokens[:-1])
        names.append(tokens[-1])
    return np.array(boxes, dtype=np.float32).reshape(-1, 7), np.array(names)


def left_beside(out):
    return sorted(path.name for path in out.parent.iterdir() if path != out)


def test_every_frame_has_its_files_and_nothing_else_is_there(dataset):
    files = {str(path.relative_to(dataset)) for path in dataset.rglob("*") if path.is_file()}
    expected = {
        "README.md",
        "SHA256SUMS",
        "dataset.json",
        "boxes.parquet",
        "sweeps.parquet",
        "ignore_regions.geojson",
        "tracks.parquet",
        "tracklets.parquet",
        "trajectories.parquet",
        "poses.parquet",
    }
    expected |= {f"ImageSets/{part}.txt" for part in ("train", "val", "test")}
    for name in NAMES:
        expected |= {f"points/{name}.npy", f"labels/{name}.txt"}
        expected |= {f"semantic/{name}.label", f"rays/{name}.npy"}
    assert files == expected
    assert left_beside(dataset) == []


def test_points_and_labels_of_a_frame_belong_together(dataset):
    for name in NAMES:
        points = np.load(dataset / f"points/{name}.npy")
        assert points.dtype == np.float32
        assert points.shape[1] == 4
        assert len(points) > 1000
        assert points[:, 3].min() >= 0
        assert points[:, 3].max() <= 1
        label = np.fromfile(dataset / f"semantic/{name}.label", np.uint32)
        rays = np.load(dataset / f"rays/{name}.npy")
        assert len(label) == len(rays) == len(points)
        assert rays.dtype.descr == [
            ("sensor", "|u1"),
            ("ring", "<u2"),
            ("column", "<u2"),
            ("time", "<f4"),
            ("echo", "|u1"),
        ]
        assert rays["ring"].max() < 16
        assert rays["column"].max() < 900
        moving = np.isin(label & 0xFFFF, FOREGROUND)
        assert np.array_equal(moving, label >> 16 > 0)


def test_rays_lead_back_to_the_points(dataset, rig):
    """The point of ring r, column k lies along that beam from the sensor (level frame).

    While lasers fire one after another, the head turns on: by 3.6 degrees in a millisecond.
    """
    points = np.load(dataset / "points/000006.npy")[:, :3].astype(float)
    rays = np.load(dataset / "rays/000006.npy")
    sensor = rig.sensors[0]
    local = points @ (rig.dataset_SE3_site.rotation @ sensor.site_SE3_sensor.rotation)
    range_m = np.linalg.norm(local, axis=1)
    elevation = np.degrees(np.arcsin(local[:, 2] / range_m))
    assert np.abs(elevation - sensor.sensor.elevation_deg[rays["ring"]]).max() < 1e-3
    azimuth = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    turned = rays["column"] * 0.4 + rays["ring"] * 2.304e-3 * 3.6
    miss = (azimuth + turned + 180) % 360 - 180
    assert np.abs(miss).max() < 1e-3


def test_rays_tell_when_they_fired(dataset):
    """VLP-16 at 10 Hz with 900 columns: laser n fires n x 2.304 us after its column begins."""
    for name in NAMES:
        rays = np.load(dataset / f"rays/{name}.npy")
        fired = rays["column"] / 9000 + rays["ring"] * 2.304e-6
        assert rays["time"] == pytest.approx(fired, abs=1e-8)
        assert not rays["echo"].any()


def test_labels_hold_the_box_and_the_class_and_nothing_else(dataset):
    for name in NAMES:
        text = (dataset / f"labels/{name}.txt").read_text()
        for line in text.splitlines():
            assert re.fullmatch(r"(-?\d+\.\d{4} ){7}[a-z]+", line)
        assert "-0.0000" not in text
        boxes, classes = read_as_openpcdet(dataset / f"labels/{name}.txt")
        assert classes.tolist() == (["car", "car", "pedestrian"] if int(name) >= 2 else [])
        assert ((boxes[:, 6] >= -np.pi - 1e-4) & (boxes[:, 6] <= np.pi + 1e-4)).all()


def test_a_frame_without_objects_has_an_empty_label_file(dataset):
    assert (dataset / "labels/000000.txt").read_bytes() == b""
    label = np.fromfile(dataset / "semantic/000000.label", np.uint32)
    assert (label >> 16 == 0).all()


def pose_of_actor(track, time_s):
    """Where the motion's actors are at any time, in closed form."""
    place, yaw, pitch = {
        4: ((-8 + 10 * time_s, 8.0, 0.0), 0.0, 0.0),
        9: ((15.0, 24.0, 0.0), np.pi / 4, 0.0),
        12: ((6.0, -3.0, 0.0), 3.0 + time_s, 0.01),
    }[track]
    return Pose.from_ypr(place, yaw, pitch)


def when_in_its_box(points, times_s, track, box_s, dataset_SE3_site):
    """Points that were measured of an actor at times, moved with it to when its box stands."""
    to_box = dataset_SE3_site @ pose_of_actor(track, box_s)
    moved = [
        (to_box @ (dataset_SE3_site @ pose_of_actor(track, float(s))).inverse()).apply(point)
        for point, s in zip(points[:, None, :3].astype(float), times_s, strict=True)
    ]
    return np.concatenate(moved) if moved else np.zeros((0, 3))


def test_every_labelled_point_is_in_its_own_box_and_boxes_count_them(dataset, rig):
    table = pq.read_table(dataset / "boxes.parquet").to_pylist()
    checked = 0
    for name in NAMES:
        points = np.load(dataset / f"points/{name}.npy")
        track = np.fromfile(dataset / f"semantic/{name}.label", np.uint32) >> 16
        time_s = np.load(dataset / f"rays/{name}.npy")["time"] + int(name) / 10
        boxes, _ = read_as_openpcdet(dataset / f"labels/{name}.txt")
        rows = [row for row in table if row["frame"] == name]
        assert len(rows) == len(boxes)
        assert set(np.unique(track)) <= {0, *(row["track"] for row in rows)}
        for row, box in zip(rows, boxes, strict=True):
            full = [row[key] for key in ("x", "y", "z", "length", "width", "height", "yaw")]
            assert np.abs(np.array(full) - box).max() < 1e-3
            mine = track == row["track"]
            assert mine.sum() == row["num_points"] <= row["num_points_alone"]
            box_s = row["time_s"] + row["observed_s"]
            moved = when_in_its_box(
                points[mine], time_s[mine], row["track"], box_s, rig.dataset_SE3_site
            )
            assert points_in_box(moved, np.array(full), 0.02).all()
            checked += len(moved)
    assert checked > 200


def test_boxes_say_what_is_hidden_and_how_fast_it_goes(dataset, rig):
    table = pq.read_table(dataset / "boxes.parquet").to_pylist()
    passing = [row for row in table if row["track"] == 4]
    hidden = [row for row in table if row["track"] == 9]
    assert len(passing) == len(hidden) == 10
    # Of a beam that half passes it, what stands behind may return more: some of its edge is lost.
    assert all(row["num_points"] > 0 and row["occlusion"] < 0.1 for row in passing)
    assert all(row["num_points"] == 0 and row["num_points_alone"] > 0 for row in hidden)
    assert all(row["occlusion"] == 1 and row["visibility"] == 0 for row in hidden)
    for before, after in pairwise(passing):
        took_s = 0.1 + after["observed_s"] - before["observed_s"]
        moved = [(after[key] - before[key]) / took_s for key in "xyz"]
        assert moved == pytest.approx([before["vx"], before["vy"], before["vz"]], abs=1e-6)
        assert np.hypot(before["vx"], before["vy"]) == pytest.approx(10)


def test_the_manifest_holds_what_makes_it_again(dataset, twin, rig):
    manifest = json.loads((dataset / "dataset.json").read_text())
    assert manifest["kind"] == "dataset"
    assert manifest["seeds"] == {"record": 5, "traffic": 7}
    assert manifest["inputs"] == twin.manifest["inputs"]
    assert {"numpy", "embreex"} <= set(manifest["dependencies"])
    assert [frame["name"] for frame in manifest["frames"]] == NAMES
    assert manifest["frames"][3]["time_s"] == pytest.approx(0.3)
    sensor = manifest["rig"]["sensors"][0]
    pose = np.array(sensor["site_SE3_sensor"])
    assert pose[:3, :3] == pytest.approx(rig.sensors[0].site_SE3_sensor.rotation)
    assert pose[:3, 3] == pytest.approx([0, 0, 3])
    assert len(sensor["sensor"]["elevation_deg"]) == 16
    names = {one["id"]: one["name"] for one in manifest["semantic_classes"]}
    points = np.concatenate([np.load(dataset / f"points/{name}.npy") for name in NAMES])
    labels = np.concatenate(
        [np.fromfile(dataset / f"semantic/{name}.label", np.uint32) for name in NAMES]
    )
    numbers, counts = np.unique(labels & 0xFFFF, return_counts=True)
    assert manifest["counts"]["points_by_class"] == {
        names[number]: count for number, count in zip(numbers, counts, strict=True)
    }
    low, high = np.split(np.array(manifest["point_cloud_range"]), 2)
    assert (points[:, :3] >= low).all()
    assert (points[:, :3] <= high).all()
    assert (high - low < np.ptp(points[:, :3], axis=0) + 2).all()


def test_no_file_says_where_or_when_it_was_made(dataset, tmp_path_factory):
    text = (dataset / "dataset.json").read_text()
    assert str(tmp_path_factory.getbasetemp()) not in text
    assert not re.search(r"20\d\d-\d\d-\d\d", text)


@pytest.mark.thorough
def test_two_workers_give_the_same_bytes(dataset, twin, motion, rig, tmp_path, digests):
    record(twin, motion, rig, tmp_path / "two", workers=2, seed=5)
    assert digests(tmp_path / "two") == digests(dataset)


def test_another_seed_gives_other_points(dataset, twin, motion, rig, tmp_path):
    record(twin, motion, rig, tmp_path / "other", workers=1, seed=6, stop_s=0.0)
    ours = (tmp_path / "other/points/000000.npy").read_bytes()
    assert ours != (dataset / "points/000000.npy").read_bytes()


def test_a_frame_is_the_same_whatever_else_is_recorded(
    dataset, twin, motion, rig, tmp_path, digests
):
    record(twin, motion, rig, tmp_path / "part", workers=1, seed=5, start_s=0.35, stop_s=0.61)
    part, whole = digests(tmp_path / "part"), digests(dataset)
    frames = {name for name in part if re.search(r"\d{6}", name)}
    assert {name.split("/")[1][:6] for name in frames} == {"000004", "000005", "000006"}
    assert all(part[name] == whole[name] for name in frames)


class StoppedError(Exception):
    pass


def stop_at(frame, told=None):
    def progress(fraction, doing):
        if told is not None:
            told.append(doing)
        if doing.startswith(f"frame {frame} "):
            raise StoppedError

    return progress


@pytest.mark.parametrize("workers", [1, *further(2)])
def test_an_interrupted_run_goes_on_where_it_stopped(
    dataset, twin, motion, rig, tmp_path, digests, workers
):
    out = tmp_path / "dataset"
    with pytest.raises(StoppedError):
        record(twin, motion, rig, out, workers=workers, seed=5, progress=stop_at(5))
    assert not out.exists()
    (partial,) = left_beside(out)
    # A frame that was cut off while it was written: its files are there, its mark is not.
    done = sorted(path.stem for path in (tmp_path / partial / "done").glob("*.json"))
    assert len(done) >= 5
    (tmp_path / partial / f"done/{done[0]}.json").unlink()
    (tmp_path / partial / f"points/{done[0]}.npy").write_bytes(b"cut")

    told = []
    record(
        twin, motion, rig, out, workers=1, seed=5, progress=lambda share, doing: told.append(doing)
    )
    recorded = [doing for doing in told if doing.startswith("frame")]
    assert recorded[0] == f"frame {len(done)} of 12"
    assert len(recorded) == 12 - len(done) + 1
    assert digests(out) == digests(dataset)
    assert left_beside(out) == []


def test_what_another_run_left_is_not_used(dataset, twin, motion, rig, tmp_path, digests):
    out = tmp_path / "dataset"
    with pytest.raises(StoppedError):
        record(twin, motion, rig, out, workers=1, seed=6, progress=stop_at(3))
    told = []
    record(
        twin, motion, rig, out, workers=1, seed=5, progress=lambda share, doing: told.append(doing)
    )
    assert "frame 1 of 12" in told
    assert digests(out) == digests(dataset)
    assert left_beside(out) == []


def test_an_older_dataset_stays_until_the_new_one_is_whole(
    dataset, twin, motion, rig, tmp_path, digests
):
    out = tmp_path / "dataset"
    record(twin, motion, rig, out, workers=1, seed=5)
    with pytest.raises(StoppedError):
        record(twin, motion, rig, out, workers=1, seed=6, progress=stop_at(3))
    assert digests(out) == digests(dataset)


def test_a_killed_worker_is_said_and_what_is_finished_is_kept(twin, motion, rig, tmp_path):
    def kill(_fraction, doing):
        if doing.startswith("frame 1 "):
            for child in multiprocessing.active_children():
                child.kill()

    out = tmp_path / "dataset"
    with pytest.raises(StageError, match="same command again"):
        record(twin, motion, rig, out, workers=2, seed=5, progress=kill)
    assert not out.exists()
    assert len(left_beside(out)) == 1


RUN = """
import multiprocessing, sys, time
from pathlib import Path
from urbantwin.dataset import record
from urbantwin.lidar import place_rig
from urbantwin.site import load_rig_spec
from urbantwin.traffic import Motion
from urbantwin.twin import load_twin

def progress(_, doing):
    if doing.startswith("frame"):
        print(*(child.pid for child in multiprocessing.active_children()), flush=True)
        time.sleep(600)

if __name__ == "__main__":
    here = Path(sys.argv[1])
    twin, motion = load_twin(Path(sys.argv[2])), Motion.load(here / "motion")
    rig = place_rig(load_rig_spec(here / "rig.yaml"), twin.mesh)
    record(twin, motion, rig, here / "dataset", workers=3, seed=5, progress=progress)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_workers_end_with_a_run_that_is_killed(twin, motion, rig_spec, tmp_path):
    (tmp_path / "run.py").write_text(RUN)
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig_spec().written()))
    replace(motion, manifest={**motion.manifest, "kind": "motion", "version": 1}).save(
        tmp_path / "motion"
    )
    command = [sys.executable, tmp_path / "run.py", tmp_path, twin.folder]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        helpers = [int(number) for number in run.stdout.readline().split()]
        run.kill()
    assert len(helpers) == 2  # and the run itself
    deadline = time.monotonic() + 20
    while any(runs(number) for number in helpers):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def runs(process):
    """Whether a process is there and not just waiting to be forgotten."""
    try:
        state = (
            Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
        )
    except FileNotFoundError:
        return False
    return state not in "ZX"


def test_two_sensors_and_the_site_frame(twin, motion, tmp_path, rig_spec):
    first = rig_spec().sensors[0].model_dump()
    second = {**first, "name": "far", "east_m": 30.0, "north_m": -10.0, "yaw_deg": -90.0}
    both = place_rig(rig_spec(sensors=[first, second], frame="site", rate_hz=5.0), twin.mesh)
    out = tmp_path / "dataset"
    record(twin, motion, both, out, workers=1, start_s=0.4, stop_s=0.6)
    assert (out / "ImageSets/train.txt").read_text() == "000002\n"
    assert (out / "ImageSets/val.txt").read_text() == "000003\n"
    points = np.load(out / "points/000002.npy")
    rays = np.load(out / "rays/000002.npy")
    assert set(rays["sensor"]) == {0, 1}
    road = np.fromfile(out / "semantic/000002.label", np.uint32) == semantic_id("road")
    assert abs(np.median(points[road, 2])) < 0.05
    boxes, names = read_as_openpcdet(out / "labels/000002.txt")
    car = boxes[names == "car"][0]
    row = pq.read_table(out / "boxes.parquet").to_pylist()[0]
    assert 0 < row["observed_s"] < 0.2
    assert car[0] == pytest.approx(-8 + 10 * (0.4 + row["observed_s"]), abs=1e-3)
    assert car[2] == pytest.approx(car[5] / 2, abs=0.02)


def test_description(dataset):
    told = describe(dataset)
    assert told["frames"] == 12
    assert told["boxes"]["car"] == 20
    assert told["boxes_with_points"]["car"] == 10
    assert told["sensors"] == [{"name": "pole", "model": "VLP-16", "columns": 900}]
    json.dumps(told)


def test_description_of_something_else(tmp_path):
    with pytest.raises(InputError, match="not found"):
        describe(tmp_path)
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(InputError, match="is not a dataset's"):
        describe(tmp_path)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"workers": 0}, "workers"),
        ({"seed": -1}, "seed"),
        ({"start_s": -1.0}, "start_s"),
        ({"stop_s": 99.0}, "stop_s"),
        ({"start_s": 0.5, "stop_s": 0.4}, "no frame"),
        ({"start_s": 0.11, "stop_s": 0.19}, "no frame"),
        ({"start_s": float("nan")}, "start_s"),
    ],
)
def test_a_wrong_number_is_refused_and_nothing_is_written(twin, motion, rig, tmp_path, given, told):
    with pytest.raises(InputError, match=told):
        record(twin, motion, rig, tmp_path / "out/dataset", **given)
    assert list(tmp_path.iterdir()) == []


def test_a_motion_of_another_twin_is_refused(twin, motion, rig, tmp_path):
    motion.manifest["twin_sha256"], kept = "00" * 32, motion.manifest["twin_sha256"]
    try:
        with pytest.raises(InputError, match="another twin"):
            record(twin, motion, rig, tmp_path / "dataset")
    finally:
        motion.manifest["twin_sha256"] = kept
    assert list(tmp_path.iterdir()) == []


def test_somebody_elses_folder_is_left_alone(twin, motion, rig, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        record(twin, motion, rig, tmp_path, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
