"""ONCE, IPS300+, V2V4Real and the first A9 release, written as their own tools read them."""

import json

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

from .test_reader_datasets import (
    BOXES,
    CLASSES,
    POINTS,
    WORLD,
    carla_matrix,
    check,
    write_bin,
    write_json,
    write_pcd,
)

STAMPS = ("1616003433400", "1616003433900", "1616003434400")


def once_frames():
    turn, place = WORLD
    annos = {
        "names": ["Car", "Pedestrian", "Bus"],
        "boxes_3d": BOXES.tolist(),
        "boxes_2d": {"cam01": [[-1, -1, -1, -1]] * 3},
    }
    return [
        {"frame_id": STAMPS[0], "pose": [*turn.as_quat(), *place], "annos": annos},
        {"frame_id": STAMPS[1], "pose": [0] * 7},
        {"frame_id": STAMPS[2], "pose": [*turn.as_quat(), *place]},
    ]


def write_once(root, frames=None, stamps=STAMPS[:2]):
    sequence = root / "data" / "000027"
    for stamp in stamps:
        write_bin(sequence / "lidar_roof" / f"{stamp}.bin")
    camera = {"cam_to_velo": np.eye(4).tolist(), "cam_intrinsic": np.eye(3).tolist()}
    write_json(
        sequence / "000027.json",
        {
            "meta_info": {"weather": "sunny"},
            "calib": {"cam01": {**camera, "distortion": [0.0] * 5}},
            "frames": once_frames() if frames is None else frames,
        },
    )
    return sequence


def test_once(tmp_path):
    sequence = write_once(tmp_path)
    recording = open_recording(tmp_path)
    assert (recording.layout, recording.names) == ("once", STAMPS[:2])
    assert any("1 of 3 sweeps" in note for note in recording.notes)
    assert any("x to the left and y to the back" in note for note in recording.notes)
    labelled, bare = recording
    check(labelled)
    assert bare.boxes is None
    assert bare.world_SE3_frame is None
    told = ut.info(tmp_path, progress=False)
    assert (told["layout"], told["first"]["boxes"]) == ("ONCE", dict.fromkeys(CLASSES, 1))
    (sequence / "000027.json").rename(sequence / "another.json")
    check(open_recording(sequence).read(0))


def test_once_as_another_program_reads_it(tmp_path):
    """tri3d turns the sensor's frame so that x is ahead: a quarter turn, and nothing else."""
    tri3d = pytest.importorskip("tri3d.datasets")
    frames = once_frames()
    frames[1]["pose"] = frames[0]["pose"]
    write_once(tmp_path / "train", frames, STAMPS)
    theirs = tri3d.Once(tmp_path, "train")
    frame = open_recording(tmp_path / "train").read(0)
    turn = Rotation.from_euler("z", 90, degrees=True)
    points = theirs.points(0, 0, "lidar_roof")[:, :3]
    np.testing.assert_allclose(turn.apply(frame.points), points, atol=1e-5)
    boxes = theirs.boxes(0, 0, coords="lidar_roof")
    assert tuple(one.label for one in boxes) == frame.boxes.source_names
    box = frame.boxes.box
    np.testing.assert_allclose(turn.apply(box[:, :3]), [one.center for one in boxes], atol=1e-9)
    np.testing.assert_allclose(box[:, 3:6], [one.size for one in boxes])
    apart = box[:, 6] + np.pi / 2 - [one.heading for one in boxes]
    np.testing.assert_allclose(np.cos(apart), 1, atol=1e-9)
    pose = theirs.poses(0, sensor="ego")[0]
    there = frame.world_SE3_frame.apply(frame.points)
    np.testing.assert_allclose(pose.apply(turn.apply(frame.points)), there, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f[0].update(pose=[1.0, 2.0]), f"frame {STAMPS[0]}: "),
        (lambda f: f[0].update(pose=[0, 0, 0, 1, 0, 0]), f"frame {STAMPS[0]}: .*not a pose"),
        (lambda f: f[0]["annos"]["names"].pop(), f"frame {STAMPS[0]}: "),
        (lambda f: f[0]["annos"]["boxes_3d"][1].pop(), f"frame {STAMPS[0]}: "),
        (lambda f: f[0]["annos"].pop("boxes_3d"), f"frame {STAMPS[0]}: lacks 'boxes_3d'"),
        (lambda f: f[1].pop("frame_id"), r"frames\[1\]: lacks 'frame_id'"),
        (lambda f: f[1].update(frame_id=STAMPS[0]), rf"frames\[1\]: has frame {STAMPS[0]} twice"),
        (lambda f: f.insert(0, "a"), r"frames\[0\]: "),
    ],
)
def test_bad_once(tmp_path, change, said):
    frames = json.loads(json.dumps(once_frames()))
    change(frames)
    write_once(tmp_path, frames)
    with pytest.raises(InputError, match=rf"000027\.json: {said}"):
        open_recording(tmp_path).read(0)


def test_a_truncated_sweep_of_once(tmp_path):
    sequence = write_once(tmp_path)
    file = sequence / "lidar_roof" / f"{STAMPS[0]}.bin"
    file.write_bytes(file.read_bytes()[:-3])
    recording = open_recording(sequence)
    with pytest.raises(InputError, match=rf"{STAMPS[0]}\.bin: .*6717 bytes; expected a multiple"):
        recording.read(0)
    assert len(recording.read(1).points) == len(POINTS)


IPS_NAMES = ("Minibus", "pedestrian", "Bus")


def ips_objects():
    return [
        {
            "label": name,
            "center": dict(zip("xyz", box[:3].tolist(), strict=True)),
            "dimensions": dict(zip(("length", "width", "height"), box[3:6].tolist(), strict=True)),
            "rotation": {"x": 0, "y": 0, "z": float(box[6])},
            "box2d": {"camera1": {"x": 1, "y": 2, "width": 3, "height": 4}},
        }
        for name, box in zip(IPS_NAMES, BOXES, strict=True)
    ]


def ips_line(name, box):
    x, y, z, length, width, height, yaw = box
    numbers = [0.0, 0, 0.0, *range(8), height, width, length, x, y, z, yaw]
    return " ".join([name, *map(str, numbers)])


def write_ips(root, number, objects=None, lines=None):
    write_pcd(root / "data" / "PCD_COM_ROI" / f"{number:06d}_COM_ROI.pcd")
    if objects is not None:
        write_json(root / "label" / "json" / f"{number:06d}_LABEL.json", {"objects": objects})
    if lines is not None:
        file = root / "label" / "txt" / f"{number:06d}_LABEL.txt"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(lines) + "\n")


def test_ips300(tmp_path):
    root = tmp_path / "IPS300+_detection"
    lines = [ips_line(*pair) for pair in zip(IPS_NAMES, BOXES, strict=True)]
    write_ips(root, 0, objects=ips_objects(), lines=["not looked at"])
    write_ips(root, 1, lines=["DontCare -1", *lines])
    write_ips(root, 2)
    # As the kit itself makes a KITTI label of the JSON: floor of the box, turn about y.
    one = ips_objects()[0]
    camera = [-one["center"]["y"], -(one["center"]["z"] - one["dimensions"]["height"] / 2)]
    assert camera == pytest.approx([-BOXES[0, 1], -BOXES[0, 2] + BOXES[0, 5] / 2])
    for path in (tmp_path, root, root / "data", root / "data" / "PCD_COM_ROI"):
        recording = open_recording(path)
        assert recording.layout == "ips300"
        assert recording.names == tuple(f"00000{k}_COM_ROI" for k in range(3))
        of_json, of_text, bare = recording
        for frame in (of_json, of_text):
            check(frame, world=False)
            assert frame.boxes.source_names == IPS_NAMES
        assert bare.boxes is None
    write_pcd(root / "data" / "IPU1" / "IPU1_pcd" / "000000_IPU1_LIDAR.pcd")
    alone = open_recording(root / "data" / "IPU1" / "IPU1_pcd")
    check(alone.read(0), world=False)
    assert (len(alone.notes), len(recording.notes)) == (1, 2)
    assert len(open_recording(root)) == 3  # the joint clouds stand for the set


@pytest.mark.parametrize(
    ("objects", "lines", "said"),
    [
        ([{"label": "Bus"}], None, r"000000_LABEL\.json: objects\[0\]: lacks 'center'"),
        ([*ips_objects(), 3], None, r"000000_LABEL\.json: objects\[3\]: "),
        ({}, None, r"000000_LABEL\.json: is not laid out right"),
        (None, ["Bus 1 2"], r"000000_LABEL\.txt: line 1: is no label \(3 values\)"),
        (None, [ips_line("Bus", BOXES[0]), ips_line("Bus", BOXES[0]).replace("4.6", "four")],
         r"000000_LABEL\.txt: line 2: is no label \('four' is not a number\)"),
    ],
)  # fmt: skip
def test_bad_ips300(tmp_path, objects, lines, said):
    write_ips(tmp_path, 0, objects, lines)
    with pytest.raises(InputError, match=said):
        open_recording(tmp_path).read(0)


def write_v2v4real(root, agent="0", flat=False, **more):
    turn, place = WORLD
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), place
    objects = {
        k: {
            "location": [*(box[:2] - 0.1), box[2] - 0.5],
            "center": [0.1, 0.1, 0.5],
            "extent": (box[3:6] / 2).tolist(),
            "angle": [0.0, float(np.degrees(box[6])), 0.0],
            "obj_type": name,
            "ass_id": ass,
        }
        for k, (box, name, ass) in enumerate(
            zip(BOXES, ("Car", "Pedestrian", "Bus"), (-1, 3, -1), strict=True)
        )
    }
    for one, box in zip(objects.values(), BOXES, strict=True):
        assert carla_matrix(*box[:3], *one["angle"])[0, 0] == pytest.approx(np.cos(box[6]))
        one["location"] = [float(value) for value in one["location"]]
    told = {"lidar_pose": matrix.ravel().tolist() if flat else matrix.tolist(), "vehicles": objects}
    write_pcd(root / agent / "000000.pcd")
    (root / agent / "000000.yaml").write_text(yaml.safe_dump({**told, **more}))


@pytest.mark.parametrize("flat", [False, True])
def test_v2v4real(tmp_path, flat):
    scenario = tmp_path / "testoutput_CAV_data_2022-03-15-09-54-40_0"
    write_v2v4real(scenario, flat=flat)
    write_v2v4real(scenario, "1", flat=flat)
    frame = open_recording(scenario / "0").read(0)
    check(frame)  # right-handed: nothing is turned round, boxes are where the points are
    assert frame.boxes.track.tolist() == [0, 3, 2]
    other = open_recording(scenario / "1").read(0)
    assert other.boxes.track.tolist() == [100, 3, 102]
    write_v2v4real(scenario, "1", lidar_pose=np.zeros((4, 4)).tolist())
    with pytest.raises(InputError, match=r"000000\.yaml: .*not a rotation"):
        open_recording(scenario / "1").read(0)
    write_v2v4real(scenario, "1", lidar_pose=[[1.0] * 4] * 3)
    with pytest.raises(InputError, match=r"000000\.yaml: is not laid out right"):
        open_recording(scenario / "1").read(0)


@pytest.mark.parametrize(
    ("clouds", "sensor"), [("_points", ""), ("_points_clouds", "s110_lidar_ouster_south")]
)
def test_first_releases_of_a9(tmp_path, clouds, sensor):
    name = "1607434794_159253522_s040_lidar_ouster_south"
    labels = [
        {
            "id": k,
            "category": category,
            "box3d": {
                "dimension": dict(zip(("length", "width", "height"), box[3:6], strict=True)),
                "location": dict(zip("xyz", box[:3], strict=True)),
                "orientation": {"rotationYaw": box[6], "rotationPitch": 0, "rotationRoll": 0},
            },
        }
        for k, (category, box) in enumerate(
            zip(("CAR", "PEDESTRIAN", "BUS"), BOXES.tolist(), strict=True)
        )
    ]
    write_pcd(tmp_path / "a9_dataset_r00_s03" / clouds / sensor / f"{name}.pcd")
    file = tmp_path / "a9_dataset_r00_s03" / "_labels" / sensor / f"{name}.json"
    write_json(file, {"index": 0, "labels": labels})
    recording = open_recording(tmp_path)
    assert (recording.layout, recording.names) == ("tumtraf", (name,))
    check(recording.read(0), world=False)
    assert len(set(recording.read(0).boxes.track)) == 3
    labels[1]["box3d"].pop("location")
    write_json(file, {"labels": labels})
    with pytest.raises(InputError, match=rf"{name}\.json: labels\[1\]: lacks 'location'"):
        recording.read(0)
