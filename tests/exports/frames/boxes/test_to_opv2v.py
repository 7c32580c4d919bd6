"""Datasets as OPV2V: read by OpenCOOD's rules, written here anew, by Open3D, and by our reader.

OpenCOOD is not on PyPI. What is done here is what its ``basedataset.py`` (which agents there are,
which is ego), ``transformation_utils.x_to_world``, ``box_utils.create_bbx`` and
``project_world_objects``, and ``pcd_utils.pcd_to_np`` do, by matrices of scipy.
"""

import json
import shutil

import numpy as np
import open3d as o3d
import pytest
import yaml
from scipy.spatial.transform import Rotation

from urbantwin.dataset import record
from urbantwin.errors import InputError
from urbantwin.exports.frames import DATASET_FORMATS, export_dataset
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import place_rig
from urbantwin.taxonomy import classes_in

from .conftest import two_sensors_spec

MIRROR = np.diag([1.0, -1.0, 1.0])
PART = {"train": "train", "val": "validate", "test": "test", None: "unused"}


def exported(dataset, tmp_path):
    said = []
    out, notes = export_dataset(dataset, "opv2v", tmp_path / "out", tell=said.append)
    return out, said, notes


def x_to_world(pose):
    """CARLA's matrix of x, y, z, roll, yaw, pitch in degrees: left-handed, pitch lifts the nose."""
    x, y, z, roll, yaw, pitch = pose
    matrix = np.eye(4)
    turn = Rotation.from_euler("ZYX", [yaw, -pitch, -roll], degrees=True)
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = x, y, z
    return matrix


def test_x_to_world_is_opencoods():
    """By its own terms: a quarter of roll takes y to -z, as c_r and s_r stand in its matrix."""
    np.testing.assert_allclose(
        x_to_world([0, 0, 0, 90, 0, 0])[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12
    )
    np.testing.assert_allclose(
        x_to_world([0, 0, 0, 0, 0, 90])[:3, :3], [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-12
    )
    np.testing.assert_allclose(
        x_to_world([0, 0, 0, 0, 90, 0])[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12
    )


def pcd_to_np(file):
    cloud = o3d.io.read_point_cloud(str(file))
    return np.column_stack([np.asarray(cloud.points), np.asarray(cloud.colors)[:, 0]])


def agents_of(scenario):
    """The agents of a scenario in OpenCOOD's order: the first is ego."""
    names = sorted(one.name for one in scenario.iterdir() if one.is_dir())
    return [*names[1:], names[0]] if int(names[0]) < 0 else names


def corners(objects, lidar_pose):
    """The corners of each object in the frame of a LiDAR, (8, 3), by its number."""
    world_to_lidar = np.linalg.inv(x_to_world(lidar_pose))
    found = {}
    for number, one in objects.items():
        middle = np.add(one["location"], one["center"])
        matrix = world_to_lidar @ x_to_world([*middle, *one["angle"]])
        signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
        found[number] = signs * one["extent"] @ matrix[:3, :3].T + matrix[:3, 3]
    return found


def truth(frame, row, pose):
    """The same of a box of the dataset, by way of the site."""
    signs = np.array([[a, b, c] for a in (1, -1) for b in (1, -1) for c in (1, -1)])
    half = np.array([row["length"], row["width"], row["height"]]) / 2
    turned = Rotation.from_euler("z", row["yaw"]).apply(signs * half)
    site = frame.in_site(turned + [row["x"], row["y"], row["z"]])
    back = np.linalg.inv(x_to_world(pose))
    return site @ MIRROR @ back[:3, :3].T + back[:3, 3]


def frames_in(out, name):
    """The yaml of each agent of a frame."""
    return {file.parent.name: file for file in sorted(out.glob(f"*/*/*/{name}.yaml"))}


def test_its_config_has_a_range_that_holds_every_vehicle(any_dataset, tmp_path):
    """OpenCOOD keeps what has all its corners in the range: with its own, a pole's has few."""
    out, _, notes = exported(any_dataset, tmp_path)
    every = [yaml.load(f.read_text(), yaml.Loader) for f in out.glob("*/*/*/[0-9]*.yaml")]
    if not any(told["vehicles"] for told in every):
        assert "no config: no sensor sees a vehicle" in notes
        return
    config = yaml.load((out / "point_pillar_late_fusion.yaml").read_text(), yaml.Loader)
    bounds = config["preprocess"]["cav_lidar_range"]
    assert bounds == config["postprocess"]["anchor_args"]["cav_lidar_range"]
    assert bounds == config["model"]["args"]["lidar_range"]
    voxel = config["preprocess"]["args"]["voxel_size"]
    cells = np.subtract(bounds[3:], bounds[:3]) / voxel
    assert cells == pytest.approx(cells.round(), abs=1e-6)
    assert cells[2].round() == 1
    assert not (cells[:2].round() % 8).any()
    kept = {"ours": 0, "stock": 0, "all": 0}
    stock = [-70.4, -40, -3, 70.4, 40, 1]
    sizes = []
    for name in {file.stem for file in out.glob("*/*/*/[0-9]*.yaml")}:
        read = {
            agent: yaml.load(file.read_text(), yaml.Loader)
            for agent, file in frames_in(out, name).items()
        }
        seen = {k: v for told in read.values() for k, v in told["vehicles"].items()}
        for told in read.values():
            for found in corners(seen, told["lidar_pose"]).values():
                kept["all"] += 1
                for key, limits in (("ours", bounds), ("stock", stock)):
                    kept[key] += ((found >= limits[:3]) & (found <= limits[3:])).all()
            sizes += [2 * np.array(one["extent"]) for one in seen.values()]
    assert kept["ours"] == kept["all"] > 0
    anchor = config["postprocess"]["anchor_args"]
    np.testing.assert_allclose(
        [anchor["l"], anchor["w"], anchor["h"]], np.median(sizes, axis=0), atol=0.006
    )
    (said,) = [note for note in notes if "range z" in note]
    assert f"{kept['stock']} of {kept['all']} boxes remain" in said
    assert f"GT_RANGE = {bounds}" in said  # what inference filters by
    assert f"GT_RANGE = {bounds}" in (out / "point_pillar_late_fusion.yaml").read_text()


def test_opencoods_rules_give_boxes_and_points(any_dataset, held, parts, tmp_path):
    out, said, _ = exported(any_dataset, tmp_path)
    theirs = classes_in("opv2v")
    manifest = json.loads((any_dataset / "dataset.json").read_text())
    of_part = {name: part for part, names in parts(any_dataset).items() for name in names}
    left_out = 0
    for frame in held(any_dataset):
        files = frames_in(out, frame.name)
        assert {file.parts[-4] for file in files.values()} == {PART[of_part.get(frame.name)]}
        merged, count = {}, 0
        for agent, file in files.items():
            told = yaml.load(file.read_text(), yaml.Loader)
            assert {"lidar_pose", "true_ego_pos", "ego_speed", "vehicles"} <= set(told)
            assert told["lidar_pose"][3] == told["lidar_pose"][5] == 0  # upright
            cloud = pcd_to_np(file.with_suffix(".pcd"))
            count += len(cloud)
            mine = np.ones(len(frame.points), bool)
            if len(manifest["rig"]["sensors"]) > 1:
                mine = frame.rays["sensor"] == -1 - int(agent)
            world = x_to_world(told["lidar_pose"])
            site = (cloud[:, :3] @ world[:3, :3].T + world[:3, 3]) @ MIRROR
            np.testing.assert_allclose(site, frame.in_site(frame.points[mine]), atol=2e-5)
            np.testing.assert_allclose(cloud[:, 3], frame.intensity[mine], atol=0.5 / 255 + 1e-6)
            objects = {**told["vehicles"], **told["pedestrians"]}
            seen = set(np.unique(frame.instance[mine]).tolist())
            rows = {row["track"]: row for row in frame.boxes}
            assert set(objects) == {
                track for track, row in rows.items() if track in seen and theirs[row["class"]]
            }
            assert all(rows[one]["class"] == "pedestrian" for one in told["pedestrians"])
            assert all(rows[one]["class"] != "pedestrian" for one in told["vehicles"])
            for number, found in corners(objects, told["lidar_pose"]).items():
                expected = truth(frame, rows[number], told["lidar_pose"])
                # Its y mirrored, a box's left is its right: the same corners in another order.
                apart = np.linalg.norm(found[:, None] - expected[None], axis=2).min(axis=1)
                assert apart.max() < 1e-6
                speed = np.linalg.norm([rows[number][name] for name in ("vx", "vy", "vz")])
                assert objects[number]["speed"] == pytest.approx(3.6 * speed)
                assert objects[number]["class"] == theirs[rows[number]["class"]]
            merged |= objects
        assert count == len(frame.points)
        left_out += sum(
            row["num_points"] == 0 and theirs[row["class"]] is not None for row in frame.boxes
        )
    text = "\n".join(said)
    assert (f"{left_out} on which no sensor has a point are left out" in text) == (left_out > 0)


def test_agents_of_rigs_that_stand_and_ride(two_sensors, riding, held, tmp_path):
    out, _, notes = exported(two_sensors, tmp_path)
    assert "agents: -1 first, -2 swift" in notes
    for scenario in out.glob("*/*"):
        if scenario.is_dir():
            assert agents_of(scenario) == ["-2", "-1"]
            told = yaml.safe_load((scenario / "data_protocol.yaml").read_text())
            assert told["agents"] == {-1: "first", -2: "swift"}
            for agent in agents_of(scenario):
                names = {file.stem for file in (scenario / agent).glob("*.yaml")}
                assert names == set(told["times_s"])
            times = {frame.name: frame.time_s for frame in held(two_sensors)}
            assert told["times_s"].items() <= times.items()
    out, _ = export_dataset(riding, "opv2v", tmp_path / "riding")
    speeds, places = [], []
    for frame in held(riding):
        ((agent, file),) = frames_in(out, frame.name).items()
        told = yaml.safe_load(file.read_text())
        assert agent == "4"  # the track that carries it
        assert 4 not in told["vehicles"]
        speeds.append(told["ego_speed"])
        places.append(told["true_ego_pos"][0])
    np.testing.assert_allclose(speeds, 36.0, atol=0.2)
    assert np.all(np.diff(places) > 0.8)


def test_a_dataset_for_each_sensor_is_an_agent_for_each(twin, motion, held, tmp_path):
    """What is recorded apart has the same points as what is recorded together."""
    for name, more in (("apart", {"fused": False}), ("together", {})):
        rig = place_rig(two_sensors_spec(**more), twin.mesh)
        record(twin, motion, rig, tmp_path / name, workers=1, seed=5, start_s=0.3, stop_s=0.5)
        export_dataset(tmp_path / name, "opv2v", tmp_path / f"{name}-opv2v")
    with pytest.raises(InputError, match="one of them: first, swift"):
        export_dataset(tmp_path / "apart", "nuscenes", tmp_path / "nuscenes")
    files = sorted((tmp_path / "together-opv2v").glob("*/*/*/*.yaml"))
    assert len({file.parent.name for file in files}) == 2
    for file in files:
        other = tmp_path / "apart-opv2v" / file.relative_to(tmp_path / "together-opv2v")
        told, apart = yaml.safe_load(file.read_text()), yaml.safe_load(other.read_text())
        np.testing.assert_allclose(told["lidar_pose"], apart["lidar_pose"], atol=1e-9)
        assert set(told["vehicles"]) == set(apart["vehicles"])
        one, two = pcd_to_np(file.with_suffix(".pcd")), pcd_to_np(other.with_suffix(".pcd"))
        np.testing.assert_allclose(one, two, atol=2e-5)
    # Other frames than the first sensor's, and a vehicle with two clouds.
    manifest = tmp_path / "apart" / "swift" / "dataset.json"
    told = json.loads(manifest.read_text())
    told["frames"] = told["frames"][1:]
    manifest.write_text(json.dumps(told))
    with pytest.raises(InputError, match="other frames than the first sensor"):
        export_dataset(tmp_path / "apart", "opv2v", tmp_path / "again")


def test_our_reader_has_it_back(any_dataset, held, tmp_path):
    out, _, _ = exported(any_dataset, tmp_path)
    theirs = classes_in("opv2v")
    frames = {frame.name: frame for frame in held(any_dataset)}
    found = dict.fromkeys(frames, 0)
    for folder in sorted(out.glob("*/*/*")):
        if not folder.is_dir():
            continue
        recording = open_recording(folder)
        assert recording.layout == "opencood"
        for index, name in enumerate(recording.names):
            frame = frames[name]
            if b"\nPOINTS 0\n" in (folder / f"{name}.pcd").read_bytes()[:400]:
                continue  # the sensor lost its turn
            read = recording.read(index)
            found[name] += len(read.points)
            mine = np.ones(len(frame.points), bool)
            if len(read.points) < len(mine):
                mine = frame.rays["sensor"] == -1 - int(folder.name)
            np.testing.assert_allclose(
                read.world_SE3_frame.apply(read.points),
                frame.in_site(frame.points[mine]), atol=2e-5,
            )  # fmt: skip
            np.testing.assert_array_equal(read.intensity, frame.intensity[mine].astype(float))
            rows = {row["track"]: row for row in frame.boxes}
            for track, box, kind in zip(
                read.boxes.track.tolist(), read.boxes.box, read.boxes.source_names, strict=True
            ):
                row = rows[track]
                assert kind == theirs[row["class"]]
                site = read.world_SE3_frame.apply(box[None, :3])[0]
                expected = frame.in_site(np.array([[row["x"], row["y"], row["z"]]]))[0]
                np.testing.assert_allclose(site, expected, atol=1e-6)
                np.testing.assert_allclose(
                    box[3:6], [row["length"], row["width"], row["height"]], atol=1e-9
                )
            for name_ in ("ring", "column", "time_s", "semantic", "instance"):
                assert getattr(read, name_) is None
            assert read.boxes.velocity is None
            assert read.boxes.num_points is None
    assert found == {name: len(frame.points) for name, frame in frames.items()}


def test_it_says_before_what_is_lost(motley, tmp_path):
    _, said, _ = exported(motley, tmp_path)
    text = "\n".join(said)
    assert "no class for boxes of animal, obstacle: they are left out" in text
    assert "which OpenCOOD does not read" in text
    assert "of velocity only the speed" in text
    assert not DATASET_FORMATS["opv2v"].holds & {"ring", "time", "num_points", "velocity"}


def test_boxes_of_none_and_a_sensor_without_points(dataset, held, tmp_path):
    """Frames without boxes have no vehicles; a frame without a point is a cloud of none."""
    empty = tmp_path / "empty"
    shutil.copytree(dataset, empty)
    name = "000003"
    np.save(empty / "points" / f"{name}.npy", np.zeros((0, 4), "<f4"))
    rays = np.load(empty / "rays" / f"{name}.npy")
    np.save(empty / "rays" / f"{name}.npy", rays[:0])
    (empty / "semantic" / f"{name}.label").write_bytes(b"")
    for to in ("opv2v", "nuscenes", "openlabel", "lumpi"):
        export_dataset(empty, to, tmp_path / to)
    ((_, file),) = frames_in(tmp_path / "opv2v", name).items()
    assert yaml.safe_load(file.read_text())["vehicles"] == {}
    assert len(pcd_to_np(file.with_suffix(".pcd"))) == 0
    ((_, file),) = frames_in(tmp_path / "opv2v", "000000").items()
    assert yaml.safe_load(file.read_text())["vehicles"] == {}
