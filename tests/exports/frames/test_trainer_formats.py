"""Datasets as OpenPCDet and MMDetection3D train on them: by their rules and readers."""

import ast
import hashlib
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.exports.frames import FrameSource, export_dataset
from urbantwin.exports.frames.plain_pickle import write_plain_pickle
from urbantwin.fidelity.readers import open_recording

#: All frames train, as ten examples are asked for; the last two judge.
SPLIT = {"train": range(12), "val": (10, 11)}


@pytest.fixture(scope="session")
def trained_on(two_sensors, tmp_path_factory):
    """A dataset with enough examples, and boxes that do not count among them."""
    folder = tmp_path_factory.mktemp("trained-on") / "dataset"
    shutil.copytree(two_sensors, folder)
    for part, numbers in SPLIT.items():
        text = "".join(f"{number:06d}\n" for number in numbers)
        (folder / "ImageSets" / f"{part}.txt").write_text(text)
    table = pq.read_table(folder / "boxes.parquet")
    rows = table.to_pylist()
    cut = next(row for row in rows if row["num_points"])
    cut = {**cut, "track": 77, "class": "truck", "x": 20.0, "num_points": 3}
    rows.append({**cut, "ignored": "truncated", "difficulty": None})
    # Alone in its frame: KITTI's name for it is longer than its own.
    rows.append({**cut, "frame": "000001", "track": 78, "class": "bus"})
    pq.write_table(pa.Table.from_pylist(rows, table.schema), folder / "boxes.parquet")
    return folder


@pytest.fixture(scope="session")
def written(trained_on, tmp_path_factory):
    base, known = tmp_path_factory.mktemp("trainers"), {}

    def write(to):
        if to not in known:
            known[to] = export_dataset(trained_on, to, base / to)
        return known[to]

    return write


def counted(folder: Path, part: str) -> dict[str, int]:
    """How many boxes of each class a trainer should read, from the table alone."""
    names = {f"{number:06d}" for number in SPLIT[part]}
    found: dict[str, int] = {}
    for row in pq.read_table(folder / "boxes.parquet").to_pylist():
        if row["frame"] in names and row["num_points"] and not row["ignored"]:
            found[row["class"]] = found.get(row["class"], 0) + 1
    return found


def test_openpcdet_reads_what_its_rules_make(trained_on, written, judge):
    folder, told = written("openpcdet")
    config = yaml.safe_load((folder / "pointpillar.yaml").read_text())
    job = {
        "map": config["DATA_CONFIG"]["MAP_CLASS_TO_KITTI"],
        "classes": config["CLASS_NAMES"],
        "fewest": 5,
    }
    found = judge("openpcdet_rules", folder, job=job)
    assert found["wrong"] == []
    assert found["numpy"].startswith("1." if sys.version_info < (3, 13) else "2.")
    for part in SPLIT:
        learned = {name: len(rows) for name, rows in found["learned"][part].items()}
        assert learned == counted(trained_on, part) != {}
    # One box that has points and does not count is marked; those without a point are nowhere.
    assert found["objects"] == {**counted(trained_on, "train"), "DontCare": 1}
    assert set(found["trained"]) == {"car", "pedestrian"}
    assert min(found["trained"].values()) >= 10
    rows = pq.read_table(trained_on / "boxes.parquet").to_pylist()
    empty = sum(not row["num_points"] for row in rows)
    assert empty
    assert any(f"{empty} boxes without a point are left out" in line for line in told)
    assert any("1 boxes that have points and do not count are DontCare" in line for line in told)


def test_openpcdet_config_of_centers_has_the_same_data(written):
    folder, _ = written("openpcdet")
    pillar, centre = (
        yaml.safe_load((folder / f"{name}.yaml").read_text())
        for name in ("pointpillar", "centerpoint")
    )
    assert pillar["DATA_CONFIG"] == centre["DATA_CONFIG"]
    assert centre["MODEL"]["DENSE_HEAD"]["CLASS_NAMES_EACH_HEAD"] == [centre["CLASS_NAMES"]]
    low, high = np.split(np.array(centre["DATA_CONFIG"]["POINT_CLOUD_RANGE"]), 2)
    limits = centre["MODEL"]["DENSE_HEAD"]["POST_PROCESSING"]["POST_CENTER_LIMIT_RANGE"]
    assert (np.array(limits[:3]) < low).all()
    assert (np.array(limits[3:]) > high).all()
    # No file of an artefact names a place on this machine.
    assert not Path(pillar["DATA_CONFIG"]["DATA_PATH"]).is_absolute()


@pytest.mark.parametrize("to", ["openpcdet", "mmdet3d"])
def test_what_trainers_read_comes_back(to, trained_on, written):
    folder, _ = written(to)
    back, source = open_recording(folder), FrameSource(trained_on)
    assert len(back) == len(source) == 12
    for found, wanted in zip(back, source, strict=True):
        assert found.name == wanted.name
        assert (found.points == wanted.xyz).all()
        assert (found.intensity == wanted.intensity).all()
        boxes = wanted.objects
        read = (boxes.num_points > 0) & (boxes.ignored == "")
        counts = np.array(found.boxes.source_names, object) != "DontCare"
        assert found.boxes.box[counts] == pytest.approx(boxes.box[read], abs=5.1e-5)
        assert [n for n in found.boxes.source_names if n != "DontCare"] == list(
            boxes.class_name[read]
        )


def test_liguard_reads_openpcdets_labels(written, judge):
    folder, _ = written("openpcdet")
    job = {
        "folder": str(folder), "count": 100, "clouds": "points", "ending": ".npy",
        "labels": "labels", "kind": "openpcdet",
    }  # fmt: skip
    found = judge("liguard_reads", job=job)
    assert len(found) == 12
    for frame, wanted in zip(found, open_recording(folder), strict=True):
        assert frame["shape"] == [len(wanted.points), 4]
        values = np.load(folder / "points" / f"{wanted.name}.npy")
        assert frame["sha256"] == hashlib.sha256(values.tobytes()).hexdigest()
        assert [one["class"] for one in frame["labels"]] == list(wanted.boxes.source_names)
        read = [[*one["centre"], *one["extent"], one["turn"]] for one in frame["labels"]]
        assert np.array(read).reshape(-1, 7) == pytest.approx(wanted.boxes.box, abs=1e-4)


def test_mmengine_reads_the_config_and_numpy_1_the_infos(trained_on, written, judge):
    folder, _ = written("mmdet3d")
    found = judge("mmengine_reads", folder)
    assert found["numpy"].startswith("1." if sys.version_info < (3, 13) else "2.")
    config = found["configs"]["pointpillars"]
    names = config["class_names"]
    assert names == ["car", "pedestrian"]
    source = FrameSource(trained_on)
    for part, numbers in SPLIT.items():
        told = found["infos"][part]
        assert sorted(told) == ["data_list", "metainfo"]  # as mmengine's BaseDataset asks
        categories = told["metainfo"]["categories"]
        assert [one["sample_idx"] for one in told["data_list"]] == [f"{n:06d}" for n in numbers]
        learned = []
        for number, info in zip(numbers, told["data_list"], strict=True):
            frame = source[number]
            lidar = info["lidar_points"]
            data = config["train_dataloader"]["dataset"]
            cloud = folder / data["data_prefix"]["pts"] / lidar["lidar_path"]
            values = np.fromfile(cloud, np.float32).reshape(-1, lidar["num_pts_feats"])
            assert (values[:, :3] == frame.xyz).all()
            assert (values[:, 3] == frame.intensity).all()
            assert info["timestamp"] == frame.time_s
            row_of = {int(track): row for row, track in enumerate(frame.objects.track)}
            for one in info["instances"]:
                row = row_of[one["track_id"]]
                assert one["bbox_3d"] == pytest.approx(frame.objects.box[row].tolist(), abs=5.1e-5)
                assert one["num_lidar_pts"] == frame.objects.num_points[row] > 0
                assert one["velocity"] == frame.objects.velocity[row, :2].tolist()
                counts = not frame.objects.ignored[row]
                wanted = categories[str(frame.objects.class_name[row])] if counts else -1
                assert one["bbox_label_3d"] == wanted
                learned += [str(frame.objects.class_name[row])] * counts
        assert {name: learned.count(name) for name in set(learned)} == counted(trained_on, part)

    # The objects: told from the middle of the floor, strictly inside (``points_in_rbbox``).
    objects = 0
    for name, infos in found["objects"].items():
        assert name in ("car", "pedestrian", "bus")
        for info in infos:
            own = np.fromfile(folder / info["path"], np.float32).reshape(-1, 4)
            assert len(own) == info["num_points_in_gt"]
            x, y, z, length, width, height, yaw = info["box3d_lidar"]
            frame = source[int(info["image_idx"])]
            away = frame.xyz.astype(float) - [x, y, z]
            along = away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw)
            across = away[:, 1] * np.cos(yaw) - away[:, 0] * np.sin(yaw)
            off = np.array([np.abs(along) - length / 2, np.abs(across) - width / 2,
                            np.abs(away[:, 2] - height / 2) - height / 2]).max(axis=0)  # fmt: skip
            assert (off < -1e-5).sum() <= len(own) <= (off < 1e-5).sum()
            assert (np.abs(own[:, :3]).max(axis=0, initial=0) <= [length, length, height]).all()
            objects += 1
    assert objects == sum(counted(trained_on, "train").values())


def test_mmdetection3ds_config_fits_the_dataset(written, judge):
    folder, _ = written("mmdet3d")
    configs = judge("mmengine_reads", folder)["configs"]
    config = configs["pointpillars"]
    model, names = config["model"], config["class_names"]
    reach = np.array(config["point_cloud_range"])
    edge = np.array(model["voxel_encoder"]["voxel_size"])
    cells = ((reach[3:] - reach[:3]) / edge).round(6)
    assert cells.tolist() == [*model["middle_encoder"]["output_shape"][::-1], 1]
    assert (cells[:2] % 8 == 0).all()  # three strides of 2
    head = model["bbox_head"]
    assert head["num_classes"] == len(names)
    generator = head["anchor_generator"]
    assert len(generator["sizes"]) == len(generator["ranges"]) == len(names)
    assert len(model["train_cfg"]["assigner"]) == len(names)
    pillar = yaml.safe_load((written("openpcdet")[0] / "pointpillar.yaml").read_text())
    anchors = pillar["MODEL"]["DENSE_HEAD"]["ANCHOR_GENERATOR_CONFIG"]
    assert [one["anchor_sizes"][0] for one in anchors] == generator["sizes"]
    assert [one["anchor_bottom_heights"][0] for one in anchors] == [
        one[2] for one in generator["ranges"]
    ]
    # The class that reads it: its classes are those of the infos, in the order of their numbers.
    (module,) = config["custom_imports"]["imports"]
    tree = ast.parse((folder / f"{module}.py").read_text())
    (reader,) = [one for one in tree.body if isinstance(one, ast.ClassDef)]
    assert reader.name == config["train_dataloader"]["dataset"]["type"]
    told = ast.literal_eval(reader.body[0].value)["classes"]
    # CenterPoint: a head for each class, a map of a quarter of the pillars that heads divide.
    centre = configs["centerpoint"]
    assert [one["class_names"] for one in centre["model"]["pts_bbox_head"]["tasks"]] == [
        [name] for name in names
    ]
    assert centre["model"]["pts_middle_encoder"] == model["middle_encoder"]
    grid = centre["model"]["train_cfg"]["pts"]["grid_size"]
    assert grid == cells.tolist()
    assert centre["train_dataloader"]["dataset"]["with_velocity"] is True
    pasted = [one["type"] for one in centre["train_dataloader"]["dataset"]["pipeline"]]
    assert "ObjectSample" not in pasted  # what is pasted in has no velocity
    infos = pickle.loads((folder / "custom_infos_train.pkl").read_bytes())
    assert dict(enumerate(told)) == {v: k for k, v in infos["metainfo"]["categories"].items()}


@pytest.mark.parametrize("to", ["openpcdet", "mmdet3d", "kitti", "semantickitti"])
def test_the_same_dataset_gives_the_same_bytes_without_a_place(trained_on, written, tmp_path, to):
    first, _ = written(to)
    again, _ = export_dataset(trained_on, to, tmp_path / "again")
    files = sorted(one.relative_to(first) for one in first.rglob("*") if one.is_file())
    assert files == sorted(one.relative_to(again) for one in again.rglob("*") if one.is_file())
    place = str(trained_on.parents[1]).encode()
    for file in files:
        content = (first / file).read_bytes()
        assert content == (again / file).read_bytes(), file
        assert place not in content, file


@pytest.mark.parametrize("to", ["openpcdet", "mmdet3d", "kitti", "semantickitti"])
def test_a_frame_without_a_point_and_few_boxes_are_written(two_sensors, tmp_path, to):
    folder = tmp_path / "dataset"
    shutil.copytree(two_sensors, folder)
    for place in ("points", "rays"):
        file = folder / place / "000001.npy"
        np.save(file, np.load(file)[:0])
    (folder / "semantic" / "000001.label").write_bytes(b"")
    out, told = export_dataset(folder, to, tmp_path / "out")
    place = {"openpcdet": "points", "mmdet3d": "points", "kitti": "training/velodyne"}
    cloud = out / place.get(to, "sequences/00/velodyne") / "000001"
    if to == "openpcdet":
        assert np.load(cloud.with_suffix(".npy")).shape == (0, 4)
    else:
        assert cloud.with_suffix(".bin").stat().st_size == 0
    if to in ("openpcdet", "mmdet3d"):
        assert any("no config" in line for line in told)  # eight examples are too few
        assert not [*out.glob("*.yaml"), *out.glob("pointpillars.py")]


@pytest.mark.parametrize("to", ["openpcdet", "mmdet3d", "kitti", "semantickitti"])
def test_damaged_datasets_are_one_line_and_leave_nothing(two_sensors, tmp_path, to):
    folder = tmp_path / "dataset"
    shutil.copytree(two_sensors, folder)
    file = folder / "points" / "000007.npy"
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(InputError, match="truncated") as raised:
        export_dataset(folder, to, tmp_path / "out")
    assert raised.value.file == str(file)
    assert not (tmp_path / "out").exists()
    assert [one.name for one in tmp_path.iterdir()] == ["dataset"]


def test_pickles_are_of_plain_things(tmp_path):
    content = {"a": [np.arange(6, dtype="<f4").reshape(2, 3), np.array(["x", "yy"])], "b": 1.5}
    write_plain_pickle(tmp_path / "one.pkl", content)
    found = pickle.loads((tmp_path / "one.pkl").read_bytes())
    assert (found["a"][0] == content["a"][0]).all()
    assert found["a"][1].tolist() == ["x", "yy"]
    found["a"][0][0, 0] = 7  # evaluation writes over what it has read
    assert b"_core" not in (tmp_path / "one.pkl").read_bytes()
    with pytest.raises(TypeError):
        write_plain_pickle(tmp_path / "two.pkl", [np.float64(1.0)])


def test_what_is_lost_is_told_before_anything_is_written(
    two_sensors, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    made = ut.export(two_sensors, "openpcdet")
    told = capsys.readouterr().err.splitlines()
    lost = [line for line in told if "cannot hold" in line or "left out" in line]
    assert len(lost) == 2
    assert told[:2] == lost
    # Named after the dataset; a .yaml alone is asked for by its name.
    assert made.path == Path("dataset-openpcdet")
    assert (made.path / "custom_infos_train.pkl").is_file()
    assert ut.dataset.verify(made.path)
