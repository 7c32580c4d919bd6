"""Datasets as nuScenes, opened by its own devkit and by our reader."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.exports.frames import DATASET_FORMATS, FrameSource, export_dataset
from urbantwin.exports.frames.nuscenes_names import scene_names
from urbantwin.fidelity.readers import open_recording
from urbantwin.taxonomy import classes_in, semantic_classes, semantic_id

#: x to the right, y forward: where the axes of a frame with x forward, y left lie.
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def exported(dataset, tmp_path):
    said = []
    out, notes = export_dataset(dataset, "nuscenes", tmp_path / "out", tell=said.append)
    return out, said, notes


def is_the_same_box(row, box):
    centre = TURN @ [row["x"], row["y"], row["z"]]
    np.testing.assert_allclose(box["centre"], centre, atol=1e-9)
    np.testing.assert_allclose(box["wlh"], [row["width"], row["length"], row["height"]], atol=1e-12)
    ahead = TURN @ [np.cos(row["yaw"]), np.sin(row["yaw"]), 0]
    np.testing.assert_allclose(np.array(box["axes"])[:, 0], ahead, atol=1e-9)
    np.testing.assert_allclose(np.array(box["axes"])[:, 2], [0, 0, 1], atol=1e-9)
    assert box["points"] == row["num_points"]
    assert ("parked" in "".join(box["attribute"])) == (
        row["parked"] and box["class"].startswith("vehicle.")
        and box["class"] not in ("vehicle.bicycle", "vehicle.motorcycle")
    )  # fmt: skip
    low, high = map(int, box["visibility"][1:].split("-"))
    seen = 0.0 if row["occlusion"] is None else 100 * (1 - row["occlusion"])
    assert low - 1e-9 <= seen <= high + 1e-9


def are_the_same_labels(frame, labels, told):
    np.testing.assert_array_equal(labels["of_panoptic"], labels["lidarseg"])
    assert [told[str(index)] for index in labels["lidarseg"]] == categories(frame)
    numbered = labels["panoptic"] % 1000 > 0
    known = labels["lidarseg"] > 0  # who has no category has no number
    np.testing.assert_array_equal(numbered[known], (frame.instance > 0)[known])
    assert not numbered[~known].any()


def test_it_says_what_mean_a_perfect_detector_can_reach(any_dataset, tmp_path):
    """The devkit averages over ten classes, counts what is near the ego, and 0 for a class of none.

    Its rules, by the tables alone: an annotation with points, within the range of its class.
    """
    out, _, notes = exported(any_dataset, tmp_path)
    rows = {
        name: json.loads((out / "v1.0-trainval" / f"{name}.json").read_text())
        for name in ("category", "instance", "sample_data", "ego_pose", "sample_annotation")
    }
    by_token = {row["token"]: row for table in rows.values() for row in table}
    ego = {
        row["sample_token"]: by_token[row["ego_pose_token"]]["translation"]
        for row in rows["sample_data"]
    }
    reach = dict.fromkeys(("vehicle.car", "vehicle.truck", "vehicle.bus"), 50)
    reach |= dict.fromkeys(("human.pedestrian", "vehicle.motorcycle", "vehicle.bicycle"), 40)
    there = set()
    for row in rows["sample_annotation"]:
        category = by_token[by_token[row["instance_token"]]["category_token"]]["name"]
        kind = next((one for one in reach if category.startswith(one)), None)
        away = np.linalg.norm(np.subtract(row["translation"], ego[row["sample_token"]])[:2])
        if kind and row["num_lidar_pts"] and away <= reach[kind]:
            there.add(kind)
    (said,) = [note for note in notes if "mAP" in note]
    assert f"{len(there)} have an object" in said
    assert f"mAP {len(there) / 10:.1f}" in said


def test_its_devkit_reads_all_that_is_held(any_dataset, held, parts, judge, tmp_path):
    out, _, _ = exported(any_dataset, tmp_path)
    (tmp_path / "clouds").mkdir()
    told = judge("nuscenes_says", out, tmp_path / "clouds")
    assert len(told["tables"]) == 15  # the thirteen, lidarseg and panoptic
    assert len(told["categories"]) == 32
    objects = {}
    samples = {one["name"]: one for scene in told["scenes"] for one in scene["samples"]}
    scene_of = {one["name"]: scene["name"] for scene in told["scenes"] for one in scene["samples"]}
    frames = held(any_dataset)
    assert list(samples) == [frame.name for frame in frames]
    theirs = classes_in("nuscenes")
    for frame in frames:
        sample = samples[frame.name]
        assert sample["time_us"] == round(frame.time_s * 1e6)
        cloud = np.load(tmp_path / "clouds" / f"{frame.name}.npz")["points"]
        np.testing.assert_array_equal(cloud[:, :3], (frame.points @ TURN.T).astype(np.float32))
        np.testing.assert_allclose(cloud[:, 3] / 255, frame.intensity, atol=1e-7)
        labels = np.load(tmp_path / "clouds" / f"{frame.name}.npz")
        are_the_same_labels(frame, labels, told["categories"])
        for value, track in zip(labels["panoptic"].tolist(), frame.instance.tolist(), strict=True):
            objects.setdefault((scene_of[frame.name], value), set()).add(track)
        rows = [row for row in frame.boxes if theirs[row["class"]]]
        assert len(sample["boxes"]) == len(rows)
        for row, box in zip(rows, sample["boxes"], strict=True):
            assert box["class"] == theirs[row["class"]]
            is_the_same_box(row, box)
    assert all(len(tracks) == 1 for (_, value), tracks in objects.items() if value % 1000)
    # Tracks: one instance each within a scene; its last digits are the number.
    for scene in told["scenes"]:
        of_frame = {frame.name: frame for frame in frames}
        for sample in scene["samples"]:
            rows = [row for row in of_frame[sample["name"]].boxes if theirs[row["class"]]]
            tracks = [int(box["instance"][-8:], 16) for box in sample["boxes"]]
            assert tracks == [row["track"] for row in rows]
        instances = {box["instance"] for sample in scene["samples"] for box in sample["boxes"]}
        assert len(instances) == len({one[-8:] for one in instances})
    # The split: what the devkit counts to its own parts, and by splits.json.
    split = parts(any_dataset)
    of_part = {name: part for part, names in split.items() for name in names}
    for scene in told["scenes"]:
        assert {of_part.get(one["name"]) for one in scene["samples"]} == {
            scene["parts"][0] if scene["parts"] else None
        }
    judged = {name: one["samples"] for name, one in told["judged"].items()}
    assert judged == {f"urbantwin_{part}": len(names) for part, names in split.items()}
    assert all(one["judged"] <= one["loaded"] for one in told["judged"].values())
    # Where the sensors are, on the rig and with it in the site.
    manifest = json.loads((any_dataset / "dataset.json").read_text())
    sensors = {f"LIDAR_{one['name']}": one for one in manifest["rig"]["sensors"]}
    assert list(told["rig"]) == [*sensors, "LIDAR_TOP"]
    if manifest["rig"]["ride"] is None:
        site_SE3_ego = matrix(told["scenes"][0]["samples"][0]["ego"])
        assert site_SE3_ego[2, 2] == pytest.approx(1, abs=1e-12)  # upright
        for channel, one in sensors.items():
            (place,) = told["rig"][channel]
            pose = site_SE3_ego @ matrix(place)
            pose[:3, :3] = pose[:3, :3] @ TURN
            np.testing.assert_allclose(pose, one["site_SE3_sensor"], atol=2e-8)


def categories(frame):
    """What nuScenes calls each point: by the box of whom it is on, else by its own class."""
    of_point, of_box = classes_in("nuscenes", "point"), classes_in("nuscenes")
    own = {kind.id: of_point[name] or "noise" for name, kind in semantic_classes().items()}
    boxes = {row["track"]: of_box[row["class"]] or "noise" for row in frame.boxes}
    return [
        boxes.get(track, own[semantic])
        for semantic, track in zip(frame.semantic.tolist(), frame.instance.tolist(), strict=True)
    ]


def matrix(values):
    """Return the matrix of x, y, z and w, x, y, z."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([*values[4:], values[3]]).as_matrix()
    pose[:3, 3] = values[:3]
    return pose


def test_velocities_sweeps_and_labels_are_those_of_the_motion(dataset, held, judge, tmp_path):
    out, _, _ = exported(dataset, tmp_path)
    (tmp_path / "clouds").mkdir()
    told = judge("nuscenes_says", out, tmp_path / "clouds")
    frames = {frame.name: frame for frame in held(dataset)}
    speeds = []
    for scene in told["scenes"]:
        for at, sample in enumerate(scene["samples"]):
            frame = frames[sample["name"]]
            cloud = np.load(tmp_path / "clouds" / f"{frame.name}.npz")
            # The rig stands: three sweeps are three clouds in one place, each with its age.
            assert sorted(set(np.round(cloud["lag"], 6))) == pytest.approx(
                [0.1 * k for k in range(min(at, 2) + 1)]
            )
            assert len(cloud["swept"]) <= sum(
                len(frames[one["name"]].points) for one in scene["samples"][max(at - 2, 0) : at + 1]
            )
            turn = np.linalg.inv(frame.frame_SE3_site)[:3, :3]
            for row, box in zip(frame.boxes, sample["boxes"], strict=True):
                if box["velocity"] is not None and row["track"] == 4:
                    truth = turn @ [row["vx"], row["vy"], row["vz"]]
                    # Boxes stand where the beams met them, some hundredths of a second apart.
                    np.testing.assert_allclose(box["velocity"], truth, atol=0.3)
                    speeds.append(np.linalg.norm(truth))
                    assert box["attribute"] == ["vehicle.moving"]
                if row["track"] == 9:
                    assert box["attribute"] == ["vehicle.stopped"]
    assert len(speeds) >= 8
    assert speeds == pytest.approx([10.0] * len(speeds), abs=0.01)
    assert all(one["loaded"] > one["judged"] > 0 for one in told["judged"].values())


def test_our_reader_has_it_back(any_dataset, held, tmp_path):
    out, _, _ = exported(any_dataset, tmp_path)
    recording = open_recording(out)
    assert recording.layout == "nuscenes"
    theirs = classes_in("nuscenes")
    tracks = {}
    for index, frame in enumerate(held(any_dataset)):
        read = recording.read(index)
        np.testing.assert_allclose(
            read.world_SE3_frame.apply(read.points), frame.in_site(frame.points), atol=1e-6
        )
        np.testing.assert_allclose(read.intensity / 255, frame.intensity, atol=1e-7)
        np.testing.assert_array_equal(read.ring, frame.rays["ring"])
        rows = [row for row in frame.boxes if theirs[row["class"]]]
        assert read.boxes.source_names == tuple(theirs[row["class"]] for row in rows)
        points = [row["num_points"] for row in rows]
        assert (read.boxes.num_points is None) == (not rows)
        if rows:
            assert read.boxes.num_points.tolist() == points
        for row, track in zip(rows, read.boxes.track.tolist(), strict=True):
            tracks.setdefault(track, set()).add(row["track"])
        of_point = classes_in("nuscenes", "point")
        first = {theirs: ours for ours, theirs in reversed(of_point.items())}
        first |= {"animal": "other-object", "vehicle.trailer": "truck"}
        first |= {"movable_object.debris": "unlabelled"}  # no class of points is an obstacle's
        wanted = [semantic_id(first[name]) for name in categories(frame)]
        np.testing.assert_array_equal(read.semantic, wanted)
        known = np.array(wanted) > 0
        np.testing.assert_array_equal((read.instance > 0)[known], (frame.instance > 0)[known])
        for name in ("column", "time_s", "sensor"):
            assert getattr(read, name) is None
    assert all(len(numbers) == 1 for numbers in tracks.values())


def test_it_says_before_what_is_lost(motley, tmp_path):
    out, said, notes = exported(motley, tmp_path)
    assert notes[: len(said)] == said
    text = "\n".join(said)
    assert "of points: column, time, echo, sensor;" in text
    assert "car and van are merged: boxes are vehicle.car in nuscenes" in text
    assert "no class for boxes of tram: they are left out" in text
    assert "four levels of visibility" in text
    assert "within a scene" in text
    held = DATASET_FORMATS["nuscenes"].holds
    assert "parked" in held
    assert not held & {"column", "velocity", "occlusion", "towed"}
    with Image.open(next((out / "maps").glob("*.png"))) as mask:
        assert mask.getextrema() == (0, 0)


def test_objects_beyond_those_that_a_category_can_number(dataset, monkeypatch, tmp_path):
    """With room for none, no point has the number of an object, which is said before."""
    monkeypatch.setattr("urbantwin.exports.frames.nuscenes._MOST_OBJECTS", 0)
    out, said, _ = exported(dataset, tmp_path)
    part = FrameSource(dataset).part_of
    tracks = {(row["track"], part(row["frame"]))
              for row in pq.read_table(dataset / "boxes.parquet").to_pylist()
              if row["num_points"]}  # fmt: skip
    assert f"of points: {len(tracks)} instances, beyond 999 of a category in a scene" in said
    for file in (out / "panoptic" / "v1.0-trainval").iterdir():
        assert not (np.load(file)["data"] % 1000).any()


def test_the_same_dataset_gives_the_same_bytes(two_sensors, digests, tmp_path):
    first, _, _ = exported(two_sensors, tmp_path)
    again, _ = export_dataset(two_sensors, "nuscenes", tmp_path / "again")
    assert digests(first) == digests(again)


def test_more_scenes_than_the_devkit_has_names_for():
    names = scene_names(["val"] * 200 + [None, "train", "other"])
    assert len(set(names)) == 203
    assert names[0] == "scene-0092"
    assert names[-3:] == [names[-3], "scene-0041", names[-1]]
    assert all("urbantwin" in name for name in (names[199], names[-3], names[-1]))


def test_an_earlier_export_stays_when_the_dataset_is_damaged(dataset, digests, tmp_path):
    out, _, _ = exported(dataset, tmp_path)
    before = digests(out)
    broken = tmp_path / "broken"
    shutil.copytree(dataset, broken)
    victim = sorted((broken / "points").iterdir())[3]
    victim.write_bytes(victim.read_bytes()[:-5])
    with pytest.raises(InputError, match=victim.name):
        export_dataset(broken, "nuscenes", out)
    assert digests(out) == before
