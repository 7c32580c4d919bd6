"""Detections in the forms of KITTI, OpenPCDet and nuScenes: the same boxes, and nothing is run."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy._core.multiarray import _reconstruct

import urbantwin as ut
from urbantwin.detections import Detections, joined, write_detections
from urbantwin.detections.forms import read_any_form
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording


def kitti_texts(kitti: Path, folder: Path, count: int) -> None:
    """The labels of KITTI themselves as results, all of them sure."""
    folder.mkdir(parents=True)
    for file in sorted((kitti / "label_2").glob("*.txt"))[:count]:
        lines = [f"{line} 0.9" for line in file.read_text().splitlines()]
        (folder / file.name).write_text("\n".join(lines) + "\n")


@pytest.mark.thorough
def test_kittis_labels_as_results_are_all_right(shared_data: Path, tmp_path: Path) -> None:
    kitti = shared_data / "recordings" / "kitti-training"
    kitti_texts(kitti, tmp_path / "found" / "data", 50)
    recording = open_recording(kitti)
    found, notes = read_any_form(tmp_path / "found", lambda: recording)
    assert len(found.frames) == 50
    for number, name in enumerate(found.frames):
        boxes = recording.read(recording.names.index(name)).boxes
        assert boxes is not None
        mine = found.of(number).box
        away = np.abs(boxes.box[:, None] - mine[None]).sum(axis=2)
        assert away.min(axis=0).max() < 1e-9
    assert all("left out" in one for one in notes)
    report = ut.model.evaluate(tmp_path / "found", kitti, tmp_path / "report", progress=False)
    assert report.figures["car"]["ap"]["iou_3d_0.7"]["ap"] == 1.0
    assert report.figures["large"]["ap"]["iou_3d_0.7"]["ap"] == 1.0  # trams, too


def boxes_in(draw: np.random.Generator, count: int) -> np.ndarray:
    place = draw.uniform(-30, 30, (count, 3))
    return np.hstack([place, draw.uniform(0.5, 5, (count, 3)), draw.uniform(-3, 3, (count, 1))])


def results(draw: np.random.Generator) -> list[dict[str, object]]:
    """What OpenPCDet writes of three frames, the second without a box."""
    return [
        {
            "frame_id": f"{number:06d}",
            "name": np.array(["Car", "Cyclist", "Pedestrian"][:count]),
            "score": draw.uniform(0, 1, count).astype(np.float32),
            "boxes_lidar": boxes_in(draw, count).astype(np.float32),
            "pred_labels": np.arange(count),
        }
        for number, count in enumerate((3, 0, 2))
    ]


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_openpcdets_pickle(tmp_path: Path, protocol: int) -> None:
    told = results(np.random.default_rng(protocol))
    content = pickle.dumps(told, protocol=protocol)
    if protocol == 2:  # as NumPy 1 names its core
        content = content.replace(b"numpy._core", b"numpy.core")
    (tmp_path / "result.pkl").write_bytes(content)
    found, _ = read_any_form(tmp_path, None)
    assert found.frames == ("000000", "000001", "000002")
    assert found.class_names == ("car", "bicycle", "pedestrian", "car", "bicycle")
    wanted = np.concatenate([one["boxes_lidar"] for one in told])
    assert np.allclose(found.box, wanted)


class Evil:
    """What a pickle may do."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[object, ...]:
        return os.system, (f"touch {self.file}",)


def test_a_pickle_that_runs_something_is_refused(tmp_path: Path) -> None:
    file, mark = tmp_path / "result.pkl", tmp_path / "mark"
    told = results(np.random.default_rng(1))
    told[0]["name"] = np.array([Evil(mark)] * 3, object)
    file.write_bytes(pickle.dumps(told))
    with pytest.raises(InputError, match=r"wants \w+\.system"):
        read_any_form(file, None)
    assert not mark.exists()


class Pointers:
    """Bytes that are to be taken for addresses of objects: a type without its flags."""

    def __reduce__(self) -> tuple[object, ...]:
        kind = Flagless()
        return _reconstruct, (np.ndarray, (0,), b"b"), (1, (1,), kind, False, b"A" * 8)


class Flagless:
    """NumPy's type of objects, told that it is none."""

    def __reduce__(self) -> tuple[object, ...]:
        return np.dtype, ("O", False, True), (3, "|", None, None, None, -1, -1, 0)


def test_a_pickle_makes_no_pointers(tmp_path: Path) -> None:
    told = results(np.random.default_rng(1))
    told[0]["name"] = Pointers()
    (tmp_path / "result.pkl").write_bytes(pickle.dumps(told))
    with pytest.raises(InputError, match="wants objects of bytes"):
        read_any_form(tmp_path, None)


def test_damaged_pickles_are_read_or_refused(tmp_path: Path) -> None:
    draw, file = np.random.default_rng(0), tmp_path / "result.pkl"
    good, refused = pickle.dumps(results(draw)), 0
    for _ in range(300):
        damaged = bytearray(good)
        damaged[draw.integers(len(good))] = draw.integers(256)
        file.write_bytes(damaged)
        try:
            read_any_form(file, None)
        except InputError:
            refused += 1
    assert refused > 100


def nuscenes(folder: Path) -> Path:
    """A key frame seen from a tilted sensor on a vehicle somewhere, with two boxes."""
    turn = {"rotation": [0.9, 0.02, -0.05, 0.43], "translation": [400.0, 1100.0, 2.0]}
    seat = {"rotation": [0.7, 0.01, 0.02, -0.7], "translation": [0.9, 0.0, 1.8]}
    name = "samples/LIDAR_TOP/n008__LIDAR_TOP__1531883530449377.pcd.bin"
    tables = {
        "sample_data": [{"token": "b", "sample_token": "s", "ego_pose_token": "e",
                         "calibrated_sensor_token": "c", "timestamp": 1531883530449377,
                         "is_key_frame": True, "filename": name}],
        "ego_pose": [{"token": "e", **turn}],
        "calibrated_sensor": [{"token": "c", **seat}],
        "category": [{"token": "k", "name": "vehicle.car"}],
        "instance": [{"token": "i", "category_token": "k"}],
        "sample_annotation": [
            {"token": f"n{k}", "sample_token": "s", "instance_token": "i", "size": [1.9, 4.6, 1.5],
             "rotation": [0.8, 0.0, 0.0, 0.6 - k], "translation": [405.0 + 4 * k, 1090.0, 1.0]}
            for k in range(2)
        ],
    }  # fmt: skip
    for table, rows in tables.items():
        (folder / "v1.0-mini").mkdir(parents=True, exist_ok=True)
        (folder / "v1.0-mini" / f"{table}.json").write_text(json.dumps(rows))
    (folder / name).parent.mkdir(parents=True)
    points = np.random.default_rng(2).normal(0, 5, (50, 5))
    points[:, 4] = np.arange(50) % 32  # rings
    points.astype("<f4").tofile(folder / name)
    return folder


def test_nuscenes_annotations_as_results_are_the_labels(tmp_path: Path) -> None:
    data = nuscenes(tmp_path / "data")
    rows = json.loads((data / "v1.0-mini" / "sample_annotation.json").read_text())
    said = [
        {key: row[key] for key in ("size", "rotation", "translation")}
        | {"detection_name": name, "detection_score": 0.5, "sample_token": "s"}
        for row, name in zip([*rows, rows[0]], ["car", "car", "traffic_cone"], strict=True)
    ]
    file = tmp_path / "results_nusc.json"
    file.write_text(json.dumps({"meta": {}, "results": {"s": said}}))
    recording = open_recording(data)
    found, notes = read_any_form(file, lambda: recording)
    boxes = recording.read(0).boxes
    assert boxes is not None
    assert np.allclose(found.box, boxes.box)
    assert notes == ("1 boxes of class traffic_cone are left out.",)


def ours(folder: Path) -> Detections:
    box = boxes_in(np.random.default_rng(8), 2)
    nothing = (box[:0], [], box[0, :0])
    made = joined(["a", "b"], [(box, ["car", "bus"], np.array([0.3, 0.4])), nothing])
    write_detections(folder, made, {})
    return made


def test_ours_need_no_frames_and_what_is_none_is_refused(tmp_path: Path) -> None:
    made = ours(tmp_path / "ours")
    assert np.array_equal(read_any_form(tmp_path / "ours", None)[0].box, made.box)
    data = nuscenes(tmp_path / "data")

    def opens() -> object:
        return open_recording(data)

    (tmp_path / "empty").mkdir()
    texts = tmp_path / "texts"
    texts.mkdir()
    (texts / "000001.txt").write_text("Car 0 0 0 1 2 3 4 1.5 1.9 4.6 3 5 12 -1.2 0.9\n")
    pickled = pickle.dumps(results(np.random.default_rng(1)))
    for name, content, problem in (
        ("cut.pkl", pickled[:200], "cannot be read"),
        ("list.pkl", pickle.dumps([{"frame_id": "1"}]), "row 0"),
        (
            "flat.pkl",
            pickle.dumps(
                [{**results(np.random.default_rng(1))[0], "boxes_lidar": [[10**400] * 7] * 3}]
            ),
            "row 0",
        ),
        ("rows.json", b'{"results": {"s": null}}', "sample s: is no list"),
        ("none.json", b"{}", "has no results"),
        ("other.json", b'{"results": {"t": []}}', "sample t"),
        ("lacks.json", b'{"results": {"s": [{"size": [1, 2, 3]}]}}', "sample s, box 0"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=problem):
            read_any_form(tmp_path / name, opens)
    for path, problem in (
        (tmp_path / "empty", "holds no detections"),
        (tmp_path / "nowhere", "is not there"),
        (texts, "of which these frames say nothing"),
    ):
        with pytest.raises(InputError, match=problem):
            read_any_form(path, opens)
    with pytest.raises(InputError, match="is not in the frame of the points"):
        read_any_form(texts, None)


def test_a_line_of_kitti_with_a_value_too_few(shared_data: Path, tmp_path: Path) -> None:
    kitti = shared_data / "recordings" / "kitti-training"
    kitti_texts(kitti, tmp_path / "found", 1)
    file = next((tmp_path / "found").iterdir())
    file.write_text(file.read_text() + "Car 1 2 3\n")
    line = len(file.read_text().splitlines())
    with pytest.raises(InputError, match=f"line {line}"):
        read_any_form(tmp_path / "found", lambda: open_recording(kitti))
