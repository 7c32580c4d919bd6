"""Datasets as KITTI and SemanticKITTI: by their development kits' definitions and other readers."""

import hashlib
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from PIL import Image

import urbantwin as ut
from urbantwin.dataset import record
from urbantwin.errors import InputError
from urbantwin.exports.frames import FrameSource, export_dataset
from urbantwin.fidelity.labelled_view import view_of
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import place_rig
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_id

from ...dataset.conftest import _rig_spec

#: Boxes put into frame 5: class, x, y, yaw, points, occlusion, why ignored; z and sizes are alike.
PUT = {
    "ahead": ("bus", 30.0, 2.0, 3.1, 40, None, None),
    "sideways": ("motorcycle", 25.0, -4.0, -1.6, 9, 0.5, None),
    "partly behind": ("truck", 0.5, 3.0, 0.2, 7, 0.9, None),
    "behind": ("van", -20.0, 0.5, -3.14, 8, 0.1, None),
    "at the edge": ("tram", 20.0, 17.5, 0.0, 12, 0.21, None),
    "ignored": ("car", 28.0, 6.0, 1.0, 3, 0.0, "truncated"),
    "ignored behind": ("car", -28.0, 6.0, 1.0, 3, 0.0, "outside"),
    "without a point": ("car", 31.0, -3.0, 1.0, 0, 1.0, "unseen"),
}
SIZE = (6.0, 2.0, 2.5)


@pytest.fixture(scope="session")
def crowded(two_sensors, tmp_path_factory):
    """A dataset with boxes all around one frame, and a split with a gap and a part that tests."""
    folder = tmp_path_factory.mktemp("crowded") / "dataset"
    shutil.copytree(two_sensors, folder)
    table = pq.read_table(folder / "boxes.parquet")
    rows = table.to_pylist()
    pattern = next(row for row in rows if row["frame"] == "000005")
    for number, (name, x, y, yaw, points, occlusion, ignored) in enumerate(PUT.values()):
        box = dict(zip(("length", "width", "height"), SIZE, strict=True))
        row = {**pattern, **box, "track": 100 + number, "class": name, "x": x, "y": y, "z": -1.0}
        row |= {"yaw": yaw, "num_points": points, "occlusion": occlusion, "ignored": ignored}
        rows.append(row | {"truncation": 0.126})
    pq.write_table(pa.Table.from_pylist(rows, table.schema), folder / "boxes.parquet")
    for part, numbers in {"train": range(6), "val": (7, 8), "test": (9, 10, 11)}.items():
        text = "".join(f"{number:06d}\n" for number in numbers)
        (folder / "ImageSets" / f"{part}.txt").write_text(text)
    return folder


@pytest.fixture(scope="session")
def kitti(crowded, tmp_path_factory):
    return export_dataset(crowded, "kitti", tmp_path_factory.mktemp("kitti") / "kitti")[0]


def objects(file):
    """The lines of a label: its class, and 14 numbers."""
    lines = [line.split(" ") for line in file.read_text().splitlines()]
    assert all(len(words) == 15 for words in lines)
    return [(words[0], np.array(words[1:], float)) for words in lines]


def calibration(file):
    found = {}
    for line in file.read_text().splitlines():
        name, values = line.split(":")
        found[name] = np.array(values.split(), float)
    return {
        "P2": found["P2"].reshape(3, 4),
        "R0_rect": found["R0_rect"].reshape(3, 3),
        "Tr_velo_to_cam": found["Tr_velo_to_cam"].reshape(3, 4),
    }


def corners_in_camera(values):
    """The development kit's ``computeBox3D``: (3, 8), the rectified camera's frame."""
    height, width, length, *place, turn = values[7:]
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    x = np.array([1, 1, -1, -1, 1, 1, -1, -1]) * length / 2
    y = np.array([0, 0, 0, 0, -1, -1, -1, -1]) * height
    z = np.array([1, -1, -1, 1, 1, -1, -1, 1]) * width / 2
    return rotation @ [x, y, z] + np.array(place)[:, None]


def test_boxes_are_where_kittis_development_kit_draws_them(crowded, kitti):
    source = FrameSource(crowded)
    theirs = {
        "car": "Car", "van": "Van", "bus": "Truck", "truck": "Truck", "tram": "Tram",
        "motorcycle": "Cyclist", "pedestrian": "Pedestrian",
    }  # fmt: skip
    seen = 0
    for frame in source:
        part = "testing" if int(frame.name) >= 9 else "training"
        matrices = calibration(kitti / part / "calib" / f"{frame.name}.txt")
        camera = matrices["R0_rect"] @ matrices["Tr_velo_to_cam"]
        boxes = frame.objects
        rows = np.flatnonzero((boxes.num_points > 0) & (boxes.ignored == ""))
        found = objects(kitti / part / "label_all" / f"{frame.name}.txt")
        assert [name for name, _ in found] == [theirs[str(boxes.class_name[k])] for k in rows]
        for row, (_, values) in zip(rows, found, strict=True):
            x, y, z, length, width, height, yaw = boxes.box[row]
            c, s = np.cos(yaw), np.sin(yaw)
            ours = np.array([
                [x + a * c * length / 2 - b * s * width / 2,
                 y + a * s * length / 2 + b * c * width / 2, z + d * height / 2, 1]
                for a in (-1, 1) for b in (-1, 1) for d in (-1, 1)
            ]) @ camera.T  # fmt: skip
            drawn = corners_in_camera(values)
            apart = np.linalg.norm(ours[:, :, None] - drawn[None], axis=1)
            assert apart.min(axis=0).max() < 4e-4
            # The nose is where the heading says: readers turn a box's length by rotation_y.
            nose = camera[:, :3] @ [c, s, 0]
            assert nose == pytest.approx([np.cos(values[13]), 0, -np.sin(values[13])], abs=1e-4)
            alpha = values[13] - np.arctan2(values[10], values[12])
            assert np.sin((values[2] - alpha) / 2) == pytest.approx(0, abs=1e-4)
            assert values[0] == pytest.approx(boxes.truncation[row], abs=0.005)
            share = boxes.occlusion[row]
            level = 3 if np.isnan(share) else 0 if share <= 0.2 else 1 if share <= 0.6 else 2
            assert values[1] == level
            if drawn[2].min() > 0.2:
                image = matrices["P2"] @ np.vstack([drawn, np.ones(8)])
                u, v = image[:2] / image[2]
                held = [u.min().clip(0, 1241), v.min().clip(0, 374),
                        u.max().clip(0, 1241), v.max().clip(0, 374)]  # fmt: skip
                if held[2] - held[0] > 0.02 and held[3] - held[1] > 0.02:
                    assert values[3:7] == pytest.approx(held, abs=0.1)
                    seen += 1
                else:
                    assert values[3:7].tolist() == [0, 0, 0, 0]
            elif drawn[2].max() < 0:
                assert values[3:7].tolist() == [0, 0, 0, 0]
    assert seen >= 5


def test_what_the_camera_does_not_see_is_not_in_label_2(kitti):
    everywhere = objects(kitti / "training" / "label_all" / "000005.txt")
    found = objects(kitti / "training" / "label_2" / "000005.txt")
    named = [name for name, _ in found]
    regions = [values for name, values in found if name == "DontCare"]
    # OpenPCDet takes the first boxes of a text for those that are no DontCare.
    assert named[-1:] == ["DontCare"]
    assert len(regions) == 1  # of two that do not count, one is ahead
    left, top, right, bottom = regions[0][3:7]
    assert 0 <= left < right <= 1241
    assert 0 <= top < bottom <= 374
    assert regions[0][:3].tolist() == [-1, -1, -10]
    assert regions[0][7:].tolist() == [-1, -1, -1, -1000, -1000, -1000, -10]
    seen = [values for name, values in found if name != "DontCare"]
    assert all(values[5] > values[3] and values[6] > values[4] for values in seen)
    assert {"Truck", "Cyclist", "Tram"} <= set(named)
    # The truck that stands beside the camera reaches into the image; the van behind does not.
    assert "Van" not in named
    assert sum(name == "Truck" for name in named) == 2
    assert sum(name == "Van" for name, _ in everywhere) == 1
    # No line of a car without a point: the only cars are those that points are on.
    assert 31.0 not in [round(values[12]) for name, values in everywhere if name == "Car"]


def test_a_frame_without_anybody_has_a_region_of_no_area(kitti):
    ((name, values),) = objects(kitti / "training" / "label_2" / "000000.txt")
    assert name == "DontCare"
    assert values[3:7].tolist() == [0, 0, 0, 0]
    assert (kitti / "training" / "label_all" / "000000.txt").read_text() == ""


def test_frames_are_where_kittis_programs_look(crowded, kitti):
    lists = {one.stem: one.read_text().split() for one in (kitti / "ImageSets").iterdir()}
    assert lists["train"] == [f"{n:06d}" for n in range(6)]
    assert lists["val"] == ["000007", "000008"]
    assert lists["test"] == ["000009", "000010", "000011"]
    assert lists["trainval"] == [*lists["train"], *lists["val"]]
    for part, numbers in {"training": range(9), "testing": range(9, 12)}.items():
        for folder in ("velodyne", "calib", "image_2", "label_2"):
            names = sorted(one.stem for one in (kitti / part / folder).iterdir())
            assert names == [f"{n:06d}" for n in numbers]
    with Image.open(kitti / "training" / "image_2" / "000003.png") as image:
        assert (image.size, image.mode) == ((1242, 375), "RGB")
    source = FrameSource(crowded)
    values = np.fromfile(kitti / "training" / "velodyne" / "000003.bin", "<f4").reshape(-1, 4)
    assert (values[:, :3] == source[3].xyz).all()
    assert (values[:, 3] == source[3].intensity).all()


@pytest.fixture(scope="session")
def tilted(twin, motion, tmp_path_factory):
    """Frames of a tilted sensor, in its own frame: boxes are upright there."""
    out = tmp_path_factory.mktemp("tilted") / "dataset"
    rig = place_rig(_rig_spec(frame="sensor"), twin.mesh)
    record(twin, motion, rig, out, workers=1, seed=5, start_s=0.4, stop_s=0.9)
    return out


@pytest.fixture(scope="session")
def in_site(twin, motion, tmp_path_factory):
    """Frames in the frame of the site: the camera is not in its origin."""
    out = tmp_path_factory.mktemp("in-site") / "dataset"
    rig = place_rig(_rig_spec(frame="site"), twin.mesh)
    record(twin, motion, rig, out, workers=1, seed=5, start_s=0.4, stop_s=0.9)
    return out


@pytest.mark.parametrize("name", ["two_sensors", "riding", "tilted", "in_site"])
def test_kitti_comes_back(name, request, tmp_path):
    dataset = request.getfixturevalue(name)
    out, _ = export_dataset(dataset, "kitti", tmp_path / "out")
    source = FrameSource(dataset)
    parts = [open_recording(out / part) for part in ("training", "testing")]
    assert {one.layout for one in parts} == {"kitti"}
    assert parts[1].names == source.splits["test"]
    back = {found.name: found for one in parts for found in one}
    assert sorted(back) == list(source.names)
    middles = {0: 0.0, 1: 0.4, 2: 0.8}
    boxes_seen = 0
    for wanted in source:
        found = back[wanted.name]
        assert (found.points == wanted.xyz).all()
        assert (found.intensity == wanted.intensity).all()
        boxes = wanted.objects
        rows = np.flatnonzero((boxes.num_points > 0) & (boxes.ignored == ""))
        assert len(found.boxes) == len(rows)
        boxes_seen += len(rows)
        if len(rows):
            assert found.boxes.box[:, :6] == pytest.approx(boxes.box[rows, :6], abs=1e-4)
            turn = found.boxes.box[:, 6] - boxes.box[rows, 6]
            assert np.abs(np.sin(turn / 2)).max() < 1e-4
            share = boxes.occlusion[rows]
            levels = np.where(share <= 0.2, 0, np.where(share <= 0.6, 1, 2))
            assert found.boxes.occlusion.tolist() == [middles[k] for k in levels.tolist()]
    assert boxes_seen >= 4
    # The camera stands where the first sensor stands.
    camera = calibration(out / "training" / "calib" / f"{source.names[3]}.txt")["Tr_velo_to_cam"]
    frame = source[3]
    at = frame.site_SE3_sensors[source.sensors[0]["name"]].translation
    in_frame = frame.site_SE3_dataset.rotation.T @ (at - frame.site_SE3_dataset.translation)
    assert camera @ [*in_frame, 1] == pytest.approx(np.zeros(3), abs=1e-9)
    # What is on all sides is labelled: nothing is left out where it stands.
    frame = next(iter(parts[0]))
    around = np.array([[-20.0, 3, 0, 4, 2, 2, 0], [20.0, 0, 0, 4, 2, 2, 0]])
    assert view_of(parts[0]).covers(frame, around).all()
    shutil.rmtree(out / "training" / "label_all")
    seen = view_of(open_recording(out / "training")).covers(frame, around)
    assert seen.tolist() == [False, True]


def test_liguard_reads_kitti(kitti, judge):
    job = {
        "folder": str(kitti / "training"), "count": 100, "clouds": "velodyne", "ending": ".bin",
        "labels": "label_2", "calibrations": "calib", "kind": "kitti",
    }  # fmt: skip
    found = judge("liguard_reads", job=job)
    assert len(found) == 9
    frames = list(open_recording(kitti / "training"))
    labelled = 0
    for told, frame in zip(found, frames, strict=True):
        assert told["shape"] == [len(frame.points), 4]
        data = (kitti / "training" / "velodyne" / f"{frame.name}.bin").read_bytes()
        assert told["sha256"] == hashlib.sha256(data).hexdigest()
        for one in told["labels"]:
            if one["class"] == "DontCare":
                continue
            # Its boxes are width, length, height, turned by -rotation_y.
            away = np.linalg.norm(frame.boxes.box[:, :3] - one["centre"], axis=1)
            box = frame.boxes.box[away.argmin()]
            assert away.min() < 2e-4
            width, length, height = one["extent"]
            assert [length, width, height] == pytest.approx(box[3:6].tolist(), abs=1e-4)
            assert np.cos(one["turn"] + np.pi / 2 - box[6]) ** 2 == pytest.approx(1, abs=1e-6)
            labelled += 1
    assert labelled >= 5


# SemanticKITTI


@pytest.fixture(scope="session")
def semantic(crowded, tmp_path_factory):
    return export_dataset(crowded, "semantickitti", tmp_path_factory.mktemp("semantic") / "out")[0]


def api_poses(sequence):
    """As ``generate_sequential.py`` of semantic-kitti-api has it: of the sensor, 4 x 4."""
    rows = {}
    for line in (sequence / "calib.txt").read_text().splitlines():
        name, content = line.strip().split(":")
        rows[name] = np.vstack([np.array(content.split(), float).reshape(3, 4), [0, 0, 0, 1]])
    found = []
    for line in (sequence / "poses.txt").read_text().splitlines():
        pose = np.vstack([np.array(line.split(), float).reshape(3, 4), [0, 0, 0, 1]])
        found.append(np.linalg.inv(rows["Tr"]) @ pose @ rows["Tr"])
    return found


def test_sequences_are_the_parts_of_the_split(semantic):
    config = yaml.safe_load((semantic / "semantic-kitti.yaml").read_text())
    # The frame between training and validation is in a sequence of no part.
    assert config["split"] == {"train": [0], "valid": [2], "test": [3]}
    counts = [len([*one.glob("velodyne/*.bin")])
              for one in sorted((semantic / "sequences").iterdir())]  # fmt: skip
    assert counts == [6, 1, 2, 3]
    for one in (semantic / "sequences").iterdir():
        names = sorted(file.stem for file in (one / "labels").iterdir())
        assert names == [f"{number:06d}" for number in range(len(names))]
        assert len(api_poses(one)) == len((one / "times.txt").read_text().split()) == len(names)


def test_the_apis_configuration_knows_every_label_that_is_written(semantic):
    config = yaml.safe_load((semantic / "semantic-kitti.yaml").read_text())
    labels = [np.fromfile(one, "<u4") & 0xFFFF for one in semantic.rglob("*.label")]
    numbers, counts = np.unique(np.concatenate(labels), return_counts=True)
    for name in ("labels", "color_map", "content", "learning_map"):
        assert set(numbers.tolist()) <= set(config[name])
    shares = counts / counts.sum()
    assert [config["content"][n] for n in numbers.tolist()] == pytest.approx(shares.tolist())
    # ``remap_semantic_labels.py`` there and back: 20 classes, each to a label that is learned so.
    assert sorted(config["learning_map_inv"]) == list(range(20))
    assert sorted(config["learning_ignore"]) == list(range(20))
    for learned, label in config["learning_map_inv"].items():
        assert config["learning_map"][label] == learned
        assert "moving" not in config["labels"][label]
    for number, name in config["labels"].items():
        if name.startswith("moving-"):
            still = next(k for k, one in config["labels"].items() if f"moving-{one}" == name)
            assert config["learning_map"][number] == config["learning_map"][still]


@pytest.mark.parametrize("name", ["two_sensors", "riding"])
def test_semantickitti_comes_back(name, two_sensors, riding, tmp_path):
    dataset = {"two_sensors": two_sensors, "riding": riding}[name]
    out, _ = export_dataset(dataset, "semantickitti", tmp_path / "out")
    source, at, moved = FrameSource(dataset), 0, set()
    moving = {"car": 252, "pedestrian": 254}
    for sequence in sorted((out / "sequences").iterdir()):
        back = open_recording(sequence)
        assert back.layout == "semantic-kitti"
        poses, times = api_poses(sequence), (sequence / "times.txt").read_text().split()
        for number, found in enumerate(back):
            wanted = source[at]
            at += 1
            assert (found.points == wanted.xyz).all()
            assert (found.intensity == wanted.intensity).all()
            assert (found.semantic == wanted.semantic).all()
            assert (found.instance == wanted.instance).all()
            assert float(times[number]) == pytest.approx(wanted.time_s, abs=1e-9)
            place = wanted.site_SE3_dataset
            assert poses[number][:3, :3] == pytest.approx(place.rotation, abs=1e-10)
            assert poses[number][:3, 3] == pytest.approx(place.translation, abs=1e-9)
            assert found.world_SE3_frame.translation == pytest.approx(place.translation, abs=1e-9)
            label = np.fromfile(sequence / "labels" / f"{number:06d}.label", "<u4")
            for track in np.unique(wanted.instance[wanted.instance > 0]):
                row = int(np.flatnonzero(wanted.objects.track == track)[0])
                speed = float(np.linalg.norm(wanted.objects.velocity[row, :2]))
                kind = str(wanted.objects.class_name[row])
                still = semantic_id(BOX_SEMANTICS[kind])
                numbers = set((label[label >> 16 == track] & 0xFFFF).tolist())
                assert numbers == {moving[kind] if speed > 0.25 else still}
                moved.add((kind, speed > 0.25))
    assert at == len(source)
    assert ({"two_sensors": "car", "riding": "pedestrian"}[name], name == "two_sensors") in moved


def test_who_stands_does_not_move(two_sensors, tmp_path):
    folder = tmp_path / "dataset"
    shutil.copytree(two_sensors, folder)
    table = pq.read_table(folder / "boxes.parquet")
    rows = [{**row, "vx": 0.1, "vy": 0.1, "vz": 0.0} for row in table.to_pylist()]
    pq.write_table(pa.Table.from_pylist(rows, table.schema), folder / "boxes.parquet")
    out, _ = export_dataset(folder, "semantickitti", tmp_path / "out")
    labels = [np.fromfile(one, "<u4") & 0xFFFF for one in out.rglob("*.label")]
    found = set(np.concatenate(labels).tolist())
    assert found >= {10, 30, 40}
    assert not found & set(range(250, 260))


def test_a_rig_that_is_not_fused_is_refused_with_its_parts(two_sensors, tmp_path):
    parts = tmp_path / "dataset"
    for name in ("mast", "pole"):
        shutil.copytree(two_sensors, parts / name)
    (parts / "dataset.json").write_text('{"kind": "datasets", "datasets": ["mast", "pole"]}')
    for to in ("openpcdet", "mmdet3d", "kitti", "semantickitti"):
        with pytest.raises(InputError, match="holds a dataset for each sensor") as raised:
            ut.export(parts, to, tmp_path / to, progress=False)
        assert "mast" in str(raised.value)
        assert not (tmp_path / to).exists()
