"""Datasets' layouts, each written here by its own documentation, read back as the same street.

Files are written by open3d, pyarrow, laspy, PyYAML and json, rotations are scipy's: nothing of the
readers is used to make what they read.
"""

import json

import numpy as np
import open3d as o3d
import pyarrow as pa
import pytest
import yaml
from pyarrow import feather
from scipy.spatial.transform import Rotation

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.readers.kitti import read_calibration
from urbantwin.fidelity.readers.labels import actor_class

rng = np.random.default_rng(7)
#: Objects in the sensor's frame: centre, length, width, height, yaw.
BOXES = np.array(
    [
        [12.0, 3.0, -4.1, 4.6, 1.9, 1.5, 0.4],
        [-8.0, 15.0, -3.9, 0.7, 0.6, 1.8, -2.9],
        [25.0, -9.0, -3.2, 11.0, 2.6, 3.2, 1.9],
    ]
)
CLASSES = ("car", "pedestrian", "bus")
WITH_VAN = ("van", "pedestrian", "bus")


def street():
    """Return points: 40 in each box (all but its outer tenth), then 300 of the ground below."""
    inside = rng.uniform(-0.45, 0.45, (len(BOXES), 40, 3)) * BOXES[:, None, 3:6]
    turned = [
        Rotation.from_euler("z", box[6]).apply(p) for p, box in zip(inside, BOXES, strict=True)
    ]
    ground = np.column_stack([rng.uniform(-40, 40, (300, 2)), np.full(300, -5.0)])
    return np.concatenate([*(t + b[:3] for t, b in zip(turned, BOXES, strict=True)), ground])


POINTS = street().astype(np.float32)
INTENSITY = rng.integers(1, 255, len(POINTS)).astype(np.float32)
#: Where the sensor is: level, as on a pole, so that boxes stand upright in both frames.
WORLD = (Rotation.from_euler("z", 2.2), np.array([400.0, -120.0, 30.0]))


def write_pcd(path, points=POINTS, **attributes):
    path.parent.mkdir(parents=True, exist_ok=True)
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(np.ascontiguousarray(points)))
    cloud.point["intensity"] = o3d.core.Tensor(INTENSITY[:, None].copy())
    for name, values in attributes.items():
        cloud.point[name] = o3d.core.Tensor(np.ascontiguousarray(values)[:, None])
    assert o3d.t.io.write_point_cloud(str(path), cloud)


def write_bin(path, *columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.column_stack([POINTS, INTENSITY, *columns]).astype("<f4").tofile(path)


def write_json(path, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def in_world(box):
    """Return centre and rotation of a box in the world."""
    turn, place = WORLD
    return turn.apply(box[:3]) + place, turn * Rotation.from_euler("z", box[6])


def check(frame, *, classes=CLASSES, world=True):
    np.testing.assert_allclose(frame.points, POINTS, atol=1e-5)
    np.testing.assert_array_equal(frame.intensity, INTENSITY)
    assert frame.boxes.class_names == classes
    np.testing.assert_allclose(frame.boxes.box[:, :6], BOXES[:, :6], atol=1e-4)
    apart = frame.boxes.box[:, 6] - BOXES[:, 6]
    np.testing.assert_allclose(np.sin(apart), 0, atol=1e-6)
    np.testing.assert_allclose(np.cos(apart), 1, atol=1e-6)
    assert frame.foreground().tolist() == [True] * 120 + [False] * 300
    if world:
        turn, place = WORLD
        expected = turn.apply(POINTS.astype(np.float64)) + place
        np.testing.assert_allclose(frame.world_SE3_frame.apply(frame.points), expected, atol=1e-4)


def write_kitti(root):
    # Axes of the camera are not quite those of the sensor, as in a real calibration.
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])
    rectify = Rotation.from_euler("xyz", [0.004, -0.006, 0.009]).as_matrix()
    turn = rectify.T @ axes  # so that upright stays upright in the rectified camera
    place = np.array([0.05, -0.08, -0.27])
    lines = ["DontCare -1 -1 -10 503 169 590 190 -1 -1 -1 -1000 -1000 -1000 -10"]
    for box, name in zip(BOXES, ("Van", "Person_sitting", "Bus"), strict=True):
        x, y, z = rectify @ (turn @ box[:3] + place)
        length, width, height, yaw = box[3:]
        lines.append(
            f"{name} 0.00 0 -0.2 1 2 3 4 {height} {width} {length} "
            f"{x} {y + height / 2} {z} {-yaw - np.pi / 2}"
        )
    numbers = {
        "P2": np.eye(3, 4),
        "R0_rect": rectify,
        "Tr_velo_to_cam": np.column_stack([turn, place]),
    }
    write_bin(root / "training/velodyne/000007.bin")
    for folder, text in (
        ("label_2", "\n".join(lines)),
        ("calib", "\n".join(f"{k}: {' '.join(map(str, v.ravel()))}" for k, v in numbers.items())),
    ):
        (root / "training" / folder).mkdir()
        (root / "training" / folder / "000007.txt").write_text(text + "\n")


def test_kitti(tmp_path):
    write_kitti(tmp_path)
    recording = open_recording(tmp_path)  # the folder above is enough
    assert (recording.layout, recording.names) == ("kitti", ("000007",))
    frame = recording.read(0)
    check(frame, classes=WITH_VAN, world=False)
    assert frame.boxes.source_names == ("Van", "Person_sitting", "Bus")
    told = ut.info(tmp_path, progress=False)
    assert (told["kind"], told["layout"], told["frames"]) == ("recording", "KITTI", 1)
    assert told["first"]["points"] == len(frame.points)
    assert sum(told["first"]["boxes"].values()) == 3
    label = tmp_path / "training/label_2/000007.txt"
    label.write_text("Car 0 0\n")
    with pytest.raises(InputError, match=r"000007\.txt: line 1"):
        recording.read(0)


def test_kitti_tracking(tmp_path):
    """The same objects in a sequence: frame and track before each label, no colons."""
    write_kitti(tmp_path)
    training = tmp_path / "training"
    objects = (training / "label_2/000007.txt").read_text().splitlines()
    tracks = [-1, 4, 5, 6]
    rows = [f"0 9 {objects[1]}", *(f"2 {t} {o}" for t, o in zip(tracks, objects, strict=True))]
    (training / "label_02").mkdir()
    (training / "label_02/0011.txt").write_text("\n".join(rows) + "\n")
    text = (training / "calib/000007.txt").read_text()
    for ours, theirs in (("R0_rect:", "R_rect"), ("Tr_velo_to_cam:", "Tr_velo_cam")):
        text = text.replace(ours, theirs)
    (training / "calib/0011.txt").write_text(text)
    for name in ("000000", "000002"):  # the cloud of frame 1 is missing
        write_bin(training / f"velodyne/0011/{name}.bin")
    (training / "velodyne/000007.bin").unlink()
    recording = open_recording(tmp_path / "training")
    assert (recording.layout, recording.names) == ("kitti-tracking", ("000000", "000002"))
    first, frame = recording
    assert first.boxes.source_names == ("Van",)
    check(frame, classes=WITH_VAN, world=False)
    assert len({*frame.boxes.track.tolist(), *first.boxes.track.tolist()}) == 4
    (training / "label_02/0011.txt").write_text("0 1 Car 0 0\n")
    with pytest.raises(InputError, match=r"0011\.txt: line 1"):
        open_recording(training)
    write_bin(training / "velodyne/0012/000000.bin")
    (training / "calib/0012.txt").write_text(text)
    with pytest.raises(InputError, match=r"holds 2 recordings.*velodyne/0011, velodyne/0012"):
        open_recording(training)


def test_kitti_raw(tmp_path):
    """A drive: tracklets stand in the LiDAR's frame, poses come from GPS and IMU."""
    drive = tmp_path / "2011_09_26/2011_09_26_drive_0001_sync"
    for name in ("0000000000", "0000000001"):
        write_bin(drive / f"velodyne_points/data/{name}.bin")
    items = "".join(
        f"<item><objectType>{name}</objectType><h>{b[5]}</h><w>{b[4]}</w><l>{b[3]}</l>"
        f"<first_frame>1</first_frame><poses><count>1</count><item><tx>{b[0]}</tx><ty>{b[1]}</ty>"
        f"<tz>{b[2] - b[5] / 2}</tz><rx>0</rx><ry>0</ry><rz>{b[6]}</rz><occlusion>1</occlusion>"
        "</item></poses></item>"
        for b, name in zip(BOXES, ("Van", "Person_sitting", "Bus"), strict=True)
    )
    xml = (
        f"<boost_serialization><tracklets><count>3</count>{items}</tracklets></boost_serialization>"
    )
    (drive / "tracklet_labels.xml").write_text(xml)
    lever = np.array([-0.81, 0.32, -0.8])  # the LiDAR's frame has the vehicle's axes here
    (drive.parent / "calib_imu_to_velo.txt").write_text(as_text({"R": np.eye(3), "T": -lever}, ":"))
    (drive / "oxts/data").mkdir(parents=True)
    # 0.0001 degrees of longitude at 49 degrees of latitude are 7.303 m; it turns to the north.
    for name, east, yaw in (("0000000000", 8.0, 0.0), ("0000000001", 8.0001, np.pi / 2)):
        (drive / f"oxts/data/{name}.txt").write_text(f"49.0 {east} 115 0 0 {yaw}" + " 0" * 24)
    recording = open_recording(drive)
    assert recording.layout == "kitti-raw"
    first, frame = recording
    assert len(first.boxes) == 0
    check(frame, classes=WITH_VAN, world=False)
    assert len(set(frame.boxes.track.tolist())) == 3
    np.testing.assert_allclose(frame.boxes.occlusion, 0.4)
    np.testing.assert_allclose(first.world_SE3_frame.translation, lever, atol=1e-9)
    turned = [-lever[1], lever[0], lever[2]]
    east = 6_378_137 * np.cos(np.radians(49)) * np.radians(1e-4)
    np.testing.assert_allclose(
        frame.world_SE3_frame.translation, turned + np.array([east, 0, 0]), atol=1e-6
    )
    (drive / "tracklet_labels.xml").write_text(xml.replace("<tx>", "<tx>no"))
    with pytest.raises(InputError, match=r"tracklet_labels\.xml"):
        open_recording(drive)


def as_text(rows, colon):
    return "".join(f"{k}{colon} {' '.join(map(str, np.ravel(v)))}\n" for k, v in rows.items())


@pytest.mark.parametrize("colon", [":", "", " :"])
@pytest.mark.parametrize(
    "names",
    [
        {"rectify": "R0_rect", "place": "Tr_velo_to_cam", "seen": "P2"},  # objects
        {"rectify": "R_rect", "place": "Tr_velo_cam", "seen": "P2"},  # tracking
        {"rectify": None, "place": "Tr", "seen": "P2"},  # odometry
        "raw velo",
        "raw cam",
    ],
)
def test_calibrations_of_all_of_kittis_benchmarks(tmp_path, names, colon):
    turn = Rotation.from_euler("zyx", [-1.57, 0.01, -1.56]).as_matrix()
    rectify = Rotation.from_euler("xyz", [0.004, -0.006, 0.009]).as_matrix()
    place, seen = np.array([0.05, -0.08, -0.27]), np.arange(12.0).reshape(3, 4)
    moved = np.column_stack([turn, place])
    if isinstance(names, str):
        date = "calib_time: 15-Mar-2012 11:37:16\n"
        velo, cam = tmp_path / "calib_velo_to_cam.txt", tmp_path / "calib_cam_to_cam.txt"
        velo.write_text(date + as_text({"R": turn, "T": place, "delta_f": [0, 0]}, colon))
        cam.write_text(
            date + as_text({"R_00": np.eye(3), "T_00": [0, 0, 0], "R_rect_00": rectify,
                            "P_rect_00": seen + 1, "P_rect_02": seen}, colon)
        )  # fmt: skip
        file = velo if names == "raw velo" else cam
    else:
        rows = {"P0": seen + 1, names["seen"]: seen, names["place"]: moved}
        if names["rectify"]:
            rows[names["rectify"]] = rectify
        file = tmp_path / "000000.txt"
        file.write_text(as_text({**rows, "Tr_imu_velo": np.eye(3, 4)}, colon))
    found = read_calibration(file)
    turned = np.eye(3) if isinstance(names, dict) and not names["rectify"] else rectify
    np.testing.assert_allclose(found.camera_SE3_lidar.rotation, turned @ turn, atol=1e-9)
    np.testing.assert_allclose(found.camera_SE3_lidar.translation, turned @ place, atol=1e-9)
    np.testing.assert_array_equal(found.projection, seen)


@pytest.mark.parametrize("name", ["calib_imu_to_velo.txt", "calib_cam_to_cam.txt", "000000.txt"])
def test_a_calibration_without_the_sensors_place_is_named_as_what_it_is(tmp_path, name):
    rows = {"R": np.eye(3), "T": [0, 0, 0]}
    rows = rows if "imu" in name else {"R_rect_00": np.eye(3), "P_rect_02": np.eye(3, 4)}
    (tmp_path / name).write_text(as_text(rows, ":"))
    with pytest.raises(InputError, match=f"{name}: has no place of the sensor, but R"):
        read_calibration(tmp_path / name)


@pytest.mark.parametrize("line", ["Tr: {}\n", "Tr {}\n", "P0: 1 2 3\nTr: {}\nTr_x: 1\n"])
def test_poses_of_odometry_need_no_colon(tmp_path, line):
    sequence = tmp_path / "sequences" / "08"
    write_bin(sequence / "velodyne/000000.bin")
    matrix = " ".join(map(str, np.eye(3, 4).ravel()))
    (sequence / "calib.txt").write_text(line.format(matrix))
    (sequence / "poses.txt").write_text(matrix + "\n")
    frame = open_recording(sequence).read(0)
    np.testing.assert_allclose(frame.world_SE3_frame.translation, 0, atol=1e-12)


def test_semantic_kitti(tmp_path):
    sequence = tmp_path / "sequences" / "08"
    semantic = np.repeat([10, 254, 259, 40], [40, 40, 40, 300]).astype("<u4")
    instance = np.repeat([1, 2, 700, 0], [40, 40, 40, 300]).astype("<u4")
    for name in ("000000", "000001"):
        write_bin(sequence / "velodyne" / f"{name}.bin")
    (sequence / "labels").mkdir()
    (semantic | instance << 16).tofile(sequence / "labels" / "000001.label")
    camera = np.column_stack([[[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0.1, 0.2, 0.3]])
    (sequence / "calib.txt").write_text(
        f"P0: {' '.join(['0'] * 12)}\nTr: {' '.join(map(str, camera.ravel()))}\n"
    )
    # Straight ahead by 2 m is along z of the camera.
    (sequence / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 2\n")
    recording = open_recording(sequence)
    assert recording.layout == "semantic-kitti"
    bare, frame = recording
    assert bare.semantic is None
    assert bare.foreground() is None
    assert np.unique(frame.semantic).tolist() == [10, 18, 30, 40]  # moving ones as those at rest
    assert frame.instance.max() == 700
    assert frame.foreground().sum() == 120
    np.testing.assert_allclose(frame.world_SE3_frame.translation, [2, 0, 0], atol=1e-12)


def write_nuscenes(root):
    turn, place = WORLD
    vehicle = Rotation.from_euler("zyx", [0.7, 0.1, 0.02])
    sensor = vehicle.inv() * turn  # world = vehicle then sensor
    offset = np.array([5.0, 6.0, 7.0])
    tables = {
        "sample_data": [
            {
                "token": name,
                "sample_token": "s",
                "ego_pose_token": "e",
                "calibrated_sensor_token": "c",
                "timestamp": time,
                "is_key_frame": key,
                "filename": f"{folder}/LIDAR_TOP/n008__LIDAR_TOP__{time}.pcd.bin",
            }
            for name, time, key, folder in (
                ("b", 1531883530449377, True, "samples"),
                ("a", 1531883530399000, False, "sweeps"),
                ("missing", 1531883530499000, False, "sweeps"),
            )
        ]
        + [{"filename": "samples/CAM_FRONT/n008__CAM_FRONT__1531883530.jpg", "timestamp": 1}],
        # The sensor is then at `place`.
        "ego_pose": [_placed("e", vehicle, place - vehicle.apply(offset))],
        "calibrated_sensor": [_placed("c", sensor, offset)],
        "category": [
            {"token": f"k{k}", "name": name}
            for k, name in enumerate(
                ["vehicle.car", "human.pedestrian.construction_worker", "vehicle.bus.bendy"]
            )
        ],
        "instance": [{"token": f"i{k}", "category_token": f"k{k}"} for k in range(3)],
        "sample_annotation": [
            _placed(f"n{k}", in_world(box)[1], in_world(box)[0])
            | {
                "sample_token": "s",
                "instance_token": f"i{k}",
                "size": [box[4], box[3], box[5]],
            }
            for k, box in enumerate(BOXES)
        ],
    }
    for name, rows in tables.items():
        write_json(root / "v1.0-mini" / f"{name}.json", rows)
    for row in tables["sample_data"][:2]:
        write_bin(root / row["filename"], np.arange(len(POINTS)) % 32)


def _placed(token, turn, place):
    x, y, z, w = turn.as_quat()
    return {"token": token, "rotation": [w, x, y, z], "translation": list(place)}


def test_nuscenes(tmp_path):
    write_nuscenes(tmp_path)
    recording = open_recording(tmp_path)
    assert recording.layout == "nuscenes"
    assert [name[-4:] for name in recording.names] == ["9000", "9377"]
    assert any("1 of 3" in note for note in recording.notes)
    sweep, key = recording
    assert sweep.boxes is None
    check(key)
    assert key.ring.tolist() == [k % 32 for k in range(len(POINTS))]
    rows = json.loads((tmp_path / "v1.0-mini/sample_data.json").read_text())
    nameless = [{key: row[key] for key in row if key != "token"} for row in rows]
    listed = [{**row, "token": []} for row in rows]
    for bad, told in ((listed, "a token is"), (nameless, "lacks 'token'")):
        write_json(tmp_path / "v1.0-mini/sample_data.json", bad)
        with pytest.raises(InputError, match=told):
            open_recording(tmp_path).read(0)
    write_json(tmp_path / "v1.0-mini/sample_data.json", rows)
    (tmp_path / "v1.0-mini/instance.json").write_text('[{"token": "i0"}]')
    with pytest.raises(InputError, match=r"instance\.json.*category_token"):
        open_recording(tmp_path)


def test_classes_of_pandaset():
    """As the names of its cuboids stand in the devkit's documentation of annotations."""
    named = {
        "Pickup Truck": "car",
        "Medium-sized Truck": "truck",
        "Semi-truck": "truck",
        "Motorized Scooter": "motorcycle",
        "Pedestrian with Object": "pedestrian",
        "Tram / Subway": "tram",
        "Temporary Construction Barriers": "other",
    }
    assert {name: actor_class(name) for name in named} == named


def test_argoverse(tmp_path):
    log = tmp_path / "log"
    (log / "sensors/lidar").mkdir(parents=True)
    (log / "calibration").mkdir()
    time_ns = 315966265259836000

    def write(name, columns):
        feather.write_feather(pa.table(columns), str(log / name))

    write(
        f"sensors/lidar/{time_ns}.feather",
        {
            **dict(zip("xyz", POINTS.T, strict=True)),
            "intensity": INTENSITY.astype(np.uint8),
            "laser_number": (np.arange(len(POINTS)) % 64).astype(np.uint8),
            "offset_ns": np.arange(len(POINTS), dtype=np.int32) * 1000,
        },
    )

    def poses(turns, places):
        x, y, z, w = np.array([turn.as_quat() for turn in turns]).T
        return {
            **dict(zip(("qw", "qx", "qy", "qz"), (w, x, y, z), strict=True)),
            **dict(zip(("tx_m", "ty_m", "tz_m"), np.array(places).T, strict=True)),
        }

    # A tenth of a second later the vehicle has turned, and the car has gone on at 10 m/s.
    later_ns, speed = time_ns + 100_000_000, np.array([6.0, -8.0, 0.0])
    later = (Rotation.from_euler("z", 2.3), WORLD[1] + [0.8, 0.4, 0.0])
    gone = WORLD[0].apply(BOXES[0, :3]) + WORLD[1] + 0.1 * speed
    write(
        "city_SE3_egovehicle.feather",
        {"timestamp_ns": [time_ns, later_ns], **poses(*zip(WORLD, later, strict=True))},
    )
    write(
        "calibration/egovehicle_SE3_sensor.feather",
        {
            "sensor_name": ["down_lidar", "up_lidar"],
            **poses([Rotation.identity()] * 2, [[1.3, 0, 1.5], [1.3, 0, 1.6]]),
        },
    )
    write(
        "annotations.feather",
        {
            "timestamp_ns": [time_ns] * 3 + [later_ns],
            "track_uuid": ["u0", "u1", "u2", "u0"],
            "category": ["REGULAR_VEHICLE", "OFFICIAL_SIGNALER", "ARTICULATED_BUS", "DOG"],
            **dict(
                zip(("length_m", "width_m", "height_m"), BOXES[[0, 1, 2, 0], 3:6].T, strict=True)
            ),
            **poses(
                [Rotation.from_euler("z", yaw) for yaw in BOXES[[0, 1, 2, 0], 6]],
                [*BOXES[:3, :3], later[0].inv().apply(gone - later[1])],
            ),
        },
    )
    frame = open_recording(tmp_path).read(0)
    check(frame)
    assert frame.sensor_places.tolist() == [[1.3, 0, 1.6], [1.3, 0, 1.5]]  # the upper is 0
    assert frame.sensor[:64].tolist() == [0] * 32 + [1] * 32
    assert frame.time_s[:3] == pytest.approx([0, 1e-6, 2e-6])
    assert len(set(frame.boxes.track)) == 3
    assert frame.boxes.velocity[0] == pytest.approx(WORLD[0].inv().apply(speed))
    assert np.isnan(frame.boxes.velocity[1:]).all()


def openlabel(cuboid_of):
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0"},
            "frames": {
                "17": {
                    "frame_properties": {"timestamp": 1646667310.05},
                    "objects": {
                        f"uuid-{k}": {
                            "object_data": {
                                "name": f"{name}_{k}",
                                "type": name,
                                "cuboid": cuboid_of(box),
                            }
                        }
                        for k, (name, box) in enumerate(
                            zip(("VAN", "PEDESTRIAN", "BUS"), BOXES, strict=True)
                        )
                    },
                }
            },
        }
    }


@pytest.mark.parametrize("standard", [False, True])
def test_tumtraf(tmp_path, standard):
    def cuboid(box):
        turn = [0, 0, box[6]] if standard else Rotation.from_euler("z", box[6]).as_quat()
        one = {"name": "shape3D", "val": [*box[:3], *turn, *box[3:6]]}
        return [one] if standard else one

    north, south = "s110_lidar_ouster_north", "s110_lidar_ouster_south"
    name = f"1646667310_053239541_{south}"
    write_pcd(tmp_path / "point_clouds" / south / f"{name}.pcd")
    write_json(tmp_path / "labels_point_clouds" / south / f"{name}.json", openlabel(cuboid))
    recording = open_recording(tmp_path)
    assert (recording.layout, recording.names) == ("tumtraf", (name,))
    check(recording.read(0), classes=WITH_VAN, world=False)
    track = recording.read(0).boxes.track
    write_pcd(tmp_path / "point_clouds" / north / "1.pcd")
    with pytest.raises(InputError, match=f"holds 2 sensors.*{north}, {south}"):
        open_recording(tmp_path)
    again = open_recording(tmp_path / "point_clouds" / south).read(0)
    check(again, classes=WITH_VAN, world=False)
    assert again.boxes.track.tolist() == track.tolist()
    assert open_recording(tmp_path / "point_clouds" / north).read(0).boxes is None


def carla_matrix(x, y, z, roll, yaw, pitch):
    """The matrix of CARLA's transform as its documentation of `carla.Transform` gives it."""
    cy, sy = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    cr, sr = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    cp, sp = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    return np.array(
        [
            [cp * cy, cy * sp * sr - sy * cr, -cy * sp * cr - sy * sr, x],
            [cp * sy, sy * sp * sr + cy * cr, -sy * sp * cr + cy * sr, y],
            [sp, -cp * sr, cp * cr, z],
            [0, 0, 0, 1],
        ]
    )


def write_agent(folder, side, **named):
    """Write what an agent sees. ``side``: -1 where y grows to the right, as in CARLA."""
    flip = np.array([1, side, 1])
    lidar = [120.0, -30.0, 6.0, 0.0, 50.0, 0.0]  # x, y, z, roll, yaw, pitch
    matrix = carla_matrix(*lidar)
    vehicles = {}
    for number, box in enumerate(BOXES):
        centre = matrix @ [*(box[:3] * flip), 1]
        vehicles[100 + number] = {
            # The place is on the ground, the centre above it.
            "location": [float(v) for v in centre[:3] - [0, 0, box[5] / 2]],
            "center": [0.0, 0.0, float(box[5] / 2)],
            "angle": [0.0, float(50 + np.degrees(box[6] * side)), 0.0],
            "extent": [float(v) for v in box[3:6] / 2],
            "speed": 1.0,
            **{key: values[number] for key, values in named.items()},
        }
    folder.mkdir(parents=True)
    (folder / "000068.yaml").write_text(yaml.safe_dump({"lidar_pose": lidar, "vehicles": vehicles}))
    return POINTS * flip.astype(np.float32), matrix


def test_v2x_real(tmp_path):
    agent = tmp_path / "2023-03-17-15-53-02_1_0" / "-1"
    _, matrix = write_agent(agent, 1, obj_type=["Car", "Child", "Bus"])
    write_bin(agent / "000068.bin")
    recording = open_recording(agent.parent)
    assert recording.layout == "opencood"
    frame = recording.read(0)
    check(frame, world=False)
    assert frame.boxes.track.tolist() == [100, 101, 102]
    np.testing.assert_allclose(frame.world_SE3_frame.translation, matrix[:3, 3])
    np.testing.assert_allclose(frame.world_SE3_frame.rotation, matrix[:3, :3], atol=1e-12)


def test_opv2v_is_turned_the_right_way_round(tmp_path):
    agent = tmp_path / "scenario" / "641"
    points, matrix = write_agent(agent, -1)
    # Its clouds keep intensity as the red of a colour.
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    grey = np.round(INTENSITY)[:, None] / 255
    cloud.colors = o3d.utility.Vector3dVector(np.repeat(grey, 3, axis=1))
    assert o3d.io.write_point_cloud(str(agent / "000068.pcd"), cloud)
    frame = open_recording(agent).read(0)
    np.testing.assert_allclose(frame.points, POINTS, atol=1e-5)
    np.testing.assert_allclose(frame.intensity * 255, INTENSITY, atol=1e-4)
    np.testing.assert_allclose(frame.boxes.box[:, :6], BOXES[:, :6], atol=1e-4)
    assert frame.foreground()[:120].all()
    # Its world is CARLA's with y turned round as well.
    in_carla = (matrix @ np.column_stack([points, np.ones(len(points))]).T).T[:, :3]
    np.testing.assert_allclose(
        frame.world_SE3_frame.apply(frame.points), in_carla * [1, -1, 1], atol=1e-3
    )
    other = agent.parent / "-2"
    write_agent(other, -1)
    write_pcd(other / "000068.pcd")
    with pytest.raises(InputError, match=r"holds 2 agents.*-2, 641"):
        open_recording(agent.parent)


def test_dair(tmp_path):
    side = tmp_path / "single-infrastructure-side"
    write_pcd(side / "velodyne/000123.pcd")
    labels = [
        {
            "type": name,
            "occluded_state": 0,
            "3d_dimensions": {"h": str(box[5]), "w": str(box[4]), "l": str(box[3])},
            "3d_location": {"x": str(box[0]), "y": str(box[1]), "z": str(box[2])},
            "rotation": str(box[6]),
        }
        for name, box in zip(("Car", "Pedestrian", "Bus"), BOXES, strict=True)
    ]
    write_json(side / "label/virtuallidar/000123.json", labels)
    turn, place = WORLD
    write_json(
        side / "calib/virtuallidar_to_world/000123.json",
        {"rotation": turn.as_matrix().tolist(), "translation": [[v] for v in place]},
    )
    recording = open_recording(side)
    assert recording.layout == "dair-v2x"
    check(recording.read(0))
    write_json(side / "label/virtuallidar/000123.json", labels[:1] + [{"type": "Car"}])
    with pytest.raises(InputError, match=r"000123\.json.*3d_location"):
        recording.read(0)


def lumpi_lines(kinds):
    lines = []
    for frame in (2, 3):
        for number, (box, kind) in enumerate(zip(BOXES, kinds, strict=True)):
            moved = box + [5 * (3 - frame), 0, 0, 0, 0, 0, 0]
            head = [frame / 10, 50 + number, 1, 2, 3, 4, 4, kind, 40]
            lines.append(",".join(map(str, [*head, *moved])) + ",")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("kinds", "names"),
    [((1, 0, 4), ("car", "person", "bus")), ((6, 0, 4), ("unknown", "person", "bus"))],
)
def test_lumpi(tmp_path, kinds, names):
    measurement = tmp_path / "Measurement4"
    for frame in (2, 3):
        write_pcd(
            measurement / "lidar" / f"{frame:06d}.ply",
            id=np.repeat([21, 17], 210).astype(np.int32),
            ray=(np.arange(420) % 64).astype(np.int32),
            time=np.arange(420, dtype=np.int32) * 200 + frame * 100_000,
        )
    (measurement / "Label.csv").write_text(lumpi_lines(kinds))
    recording = open_recording(tmp_path)
    assert (recording.layout, len(recording)) == ("lumpi", 2)
    assert recording.read(0).boxes.box[0, 0] == 17
    frame = recording.read(1)
    classes = tuple({"person": "pedestrian", "unknown": "other"}.get(n, n) for n in names)
    check(frame, classes=classes, world=False)
    assert frame.boxes.source_names == names
    assert frame.boxes.track.tolist() == [50, 51, 52]
    assert frame.sensor.tolist() == [1] * 210 + [0] * 210
    assert frame.ring.max() == 63
    assert frame.time_s.max() == pytest.approx(419 * 200e-6)


def test_lumpi_of_each_sensor(tmp_path):
    for name in ("hesai", "velodyne"):
        write_pcd(tmp_path / "lidar" / name / "000003.ply")
    (tmp_path / "Label.csv").write_text("time,id,and so on\n" + lumpi_lines((6, 0, 7)))
    with pytest.raises(InputError, match=r"2 sensors.*hesai, velodyne"):
        open_recording(tmp_path)
    frame = open_recording(tmp_path / "lidar" / "hesai").read(0)
    # With a class 7, 6 is a van.
    check(frame, classes=("van", "pedestrian", "other"), world=False)
    (tmp_path / "Label.csv").write_text(lumpi_lines((1, 1, 1)) + "0.3,5,1\n")
    with pytest.raises(InputError, match=r"Label\.csv: line 7"):
        open_recording(tmp_path / "lidar" / "hesai")


def test_openpcdet_labels_without_our_tables(tmp_path):
    (tmp_path / "points").mkdir()
    np.save(tmp_path / "points/000000.npy", np.column_stack([POINTS, INTENSITY]))
    lines = [
        " ".join([*map(str, b), c]) for b, c in zip(BOXES, ("Car", "person", "bus"), strict=True)
    ]
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels/000000.txt").write_text("\n".join(lines))
    recording = open_recording(tmp_path)
    assert recording.layout == "own"
    check(recording.read(0), world=False)
