"""Datasets as OpenLABEL beside clouds: ASAM's schema and VCD, Open3D, and our reader."""

import json

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial.transform import Rotation

from urbantwin.exports.frames import DATASET_FORMATS, export_dataset
from urbantwin.exports.frames.losses import FIELDS
from urbantwin.fidelity.readers import open_recording
from urbantwin.taxonomy import classes_in


def exported(dataset, tmp_path):
    said = []
    out, _ = export_dataset(dataset, "openlabel", tmp_path / "out", tell=said.append)
    (clouds,) = (out / "point_clouds").iterdir()
    return out, out / "labels_point_clouds" / clouds.name, clouds, said


def matrix(values):
    return np.array(values["matrix4x4"]).reshape(4, 4)


def test_vcd_reads_every_box_after_the_schema(any_dataset, held, judge, tmp_path):
    _, labels, clouds, said = exported(any_dataset, tmp_path)
    assert said == []  # nothing is lost
    told = judge("openlabel_says", job=[str(path) for path in sorted(labels.iterdir())])
    theirs = classes_in("openlabel")
    manifest = json.loads((any_dataset / "dataset.json").read_text())
    for number, frame in enumerate(held(any_dataset)):
        one = told[frame.name]
        assert (one["number"], one["time_s"]) == (number, frame.time_s)
        assert (clouds / one["cloud"]).is_file()
        assert list(one["objects"]) == [str(row["track"]) for row in frame.boxes]
        ((_, moved),) = one["transforms"].items()
        site_SE3_points = matrix(moved["transform_src_to_dst"])
        np.testing.assert_allclose(site_SE3_points, np.linalg.inv(frame.frame_SE3_site), atol=1e-9)
        systems = one["systems"]
        root = moved["dst"]
        assert systems[root]["parent"] == ""
        assert set(systems[root]["children"]) == set(systems) - {root}
        np.testing.assert_allclose(
            matrix(systems[moved["src"]]["pose_wrt_parent"]), site_SE3_points, atol=1e-12
        )
        for sensor in manifest["rig"]["sensors"]:
            if manifest["rig"]["ride"] is None and sensor["name"] in systems:
                place = matrix(systems[sensor["name"]]["pose_wrt_parent"])
                np.testing.assert_allclose(place, sensor["site_SE3_sensor"], atol=1e-9)
        for row, box in zip(frame.boxes, one["objects"].values(), strict=True):
            assert box["class"] == theirs[row["class"]]
            assert box["system"] == moved["src"]
            names = ("x", "y", "z")
            np.testing.assert_allclose(box["val"][:3], [row[name] for name in names])
            sizes = ("length", "width", "height")
            np.testing.assert_allclose(box["val"][7:], [row[name] for name in sizes])
            turn = Rotation.from_quat(box["val"][3:7]) * Rotation.from_euler("z", -row["yaw"])
            assert turn.magnitude() < 1e-9
            known = box["attributes"]
            assert known["velocity"] == [row["vx"], row["vy"], row["vz"]]
            for name in ("num_points", "num_points_alone", "truncation", "observed_s", "parked"):
                assert known[name] == row[name]
            for name in ("occlusion", "ignored", "difficulty", "towed_by"):
                assert known.get(name) == row[name]
            assert ("occlusion_level" in known) == (row["occlusion"] is not None)


def test_open3d_reads_every_field_of_the_clouds(two_sensors, held, tmp_path):
    _, _, clouds, _ = exported(two_sensors, tmp_path)
    assert clouds.name == "fused"
    for frame in held(two_sensors):
        cloud = o3d.t.io.read_point_cloud(str(clouds / f"{frame.name}.pcd")).point
        np.testing.assert_array_equal(cloud["positions"].numpy(), frame.points.astype(np.float32))
        values = {"intensity": frame.intensity, "semantic": frame.semantic}
        values |= {"instance": frame.instance}
        values |= {name: frame.rays[name] for name in frame.rays.dtype.names}
        for name, wanted in values.items():
            np.testing.assert_array_equal(cloud[name].numpy()[:, 0], wanted, err_msg=name)


def test_our_reader_has_all_of_it_back(any_dataset, held, parts, tmp_path):
    out, _, clouds, _ = exported(any_dataset, tmp_path)
    recording = open_recording(out)
    assert recording.layout == "tumtraf"
    assert frozenset(FIELDS) == DATASET_FORMATS["openlabel"].holds
    theirs = classes_in("openlabel")
    for index, frame in enumerate(held(any_dataset)):
        read = recording.read(index)
        assert read.name == frame.name
        np.testing.assert_array_equal(read.points, frame.points)
        np.testing.assert_array_equal(read.intensity, frame.intensity)
        for name, wanted in {
            "ring": frame.rays["ring"],
            "column": frame.rays["column"],
            "sensor": frame.rays["sensor"],
            "semantic": frame.semantic,
            "instance": frame.instance,
        }.items():
            np.testing.assert_array_equal(getattr(read, name), wanted, err_msg=name)
        time = frame.rays["time"].astype(float)
        np.testing.assert_allclose(read.time_s, time - time.min(), atol=1e-9)
        in_site = read.world_SE3_frame.apply(read.points)
        np.testing.assert_allclose(in_site, frame.in_site(frame.points), atol=1e-9)
        boxes = read.boxes
        assert boxes.source_names == tuple(theirs[row["class"]] for row in frame.boxes)
        assert boxes.track.tolist() == [row["track"] for row in frame.boxes]
        box = frame.column("x", "y", "z", "length", "width", "height", "yaw")
        np.testing.assert_allclose(boxes.box[:, :6], box[:, :6], atol=1e-12)
        np.testing.assert_allclose(np.exp(1j * boxes.box[:, 6]), np.exp(1j * box[:, 6]), atol=1e-9)
        if not frame.boxes:
            continue
        np.testing.assert_allclose(boxes.velocity, frame.column("vx", "vy", "vz"), atol=1e-12)
        np.testing.assert_allclose(boxes.occlusion, frame.column("occlusion")[:, 0], atol=1e-12)
        assert boxes.num_points.tolist() == [row["num_points"] for row in frame.boxes]
        marks = [row["ignored"] or "" for row in frame.boxes]
        assert list(boxes.ignored or [""] * len(marks)) == marks
    for part, names in parts(any_dataset).items():
        for kind, ending in (("point_clouds", "pcd"), ("labels_point_clouds", "json")):
            listed = out / "data_split" / part / kind / clouds.name / "file_names.txt"
            assert listed.read_text().split() == [f"{name}.{ending}" for name in names]
            assert all(
                (out / kind / clouds.name / one).is_file() for one in listed.read_text().split()
            )


def test_the_same_dataset_gives_the_same_bytes(riding, digests, tmp_path):
    first, *_ = exported(riding, tmp_path)
    again, _ = export_dataset(riding, "openlabel", tmp_path / "again")
    assert digests(first) == digests(again)


def test_a_sensor_of_any_name_is_told_apart_from_the_site(dataset, judge, tmp_path):
    """A sensor may be called what the frames are called."""
    import shutil

    odd = tmp_path / "odd"
    shutil.copytree(dataset, odd)
    text = (odd / "dataset.json").read_text().replace('"name": "pole"', '"name": "site"')
    (odd / "dataset.json").write_text(text)
    _, labels, _, _ = exported(odd, tmp_path)
    told = judge("openlabel_says", job=[str(sorted(labels.iterdir())[-1])])
    ((_, one),) = told.items()
    assert set(one["systems"]) == {"site_", "points", "site"}
    assert one["systems"]["site"]["parent"] == "site_"
    assert pytest.approx(3.0) == matrix(one["systems"]["site"]["pose_wrt_parent"])[2, 3]
