"""Recordings found by what is in a folder: real files, other programs' files, and bad ones."""

import json
import pickle
import warnings

import laspy
import numpy as np
import open3d as o3d
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import LAYOUTS, open_recording
from urbantwin.geometry import points_in_box

from ..box_tables import write_table
from ..real_files import AHN3, FOREGROUND, argoverse_log

POINTS = np.random.default_rng(3).uniform(-50, 50, (60, 4)).astype(np.float32)


def test_argoverse_sweeps(shared_data):
    recording = open_recording(argoverse_log(shared_data))
    assert (recording.layout, len(recording)) == ("argoverse2", 2)
    first, second = recording
    assert (len(first.points), len(second.points)) == (99_229, 99_466)
    # What stands still comes together in the city's frame, and not without the poses.
    from scipy.spatial import cKDTree

    walls = [frame.only(frame.points[:, 2] > 2.0) for frame in (first, second)]
    apart, unmoved = (
        np.median(cKDTree(a).query(b)[0])
        for a, b in (
            [frame.world_SE3_frame.apply(frame.points) for frame in walls],
            [frame.points for frame in walls],
        )
    )
    assert apart < 0.1
    assert unmoved > 2 * apart
    # The annotators' own count of points in each cuboid: the same, to the point.
    from pyarrow import feather

    table = feather.read_table(next(recording.path.rglob("annotations.feather"))).to_pydict()
    of_first = [k for k, t in enumerate(table["timestamp_ns"]) if str(t) == first.name]
    expected = [table["num_interior_pts"][k] for k in of_first]
    assert [points_in_box(first.points, box).sum() for box in first.boxes.box] == expected
    # Where cuboids overlap, a point is one object's.
    assert 0.95 * sum(expected) < first.foreground().sum() < sum(expected)
    assert first.boxes.class_names.count("car") == [table["category"][k] for k in of_first].count(
        "REGULAR_VEHICLE"
    )


def test_kitti_frame_with_its_labels(shared_data, tmp_path):
    """The labels of 000008 in KITTI's text, from the converter's table, which counts points."""
    folder = shared_data / "lidar/kitti"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the numpy that it was written with
        info = pickle.loads((folder / "000008.pkl").read_bytes())["data_list"][0]
    for name in ("velodyne", "label_2", "calib"):
        (tmp_path / name).mkdir()
    (tmp_path / "velodyne/000008.bin").write_bytes((folder / "000008.bin").read_bytes())
    lidar2cam = np.array(info["images"]["CAM2"]["lidar2cam"])
    (tmp_path / "calib/000008.txt").write_text(
        f"R0_rect: {' '.join(map(str, np.eye(3).ravel()))}\n"
        f"Tr_velo_to_cam: {' '.join(map(str, lidar2cam[:3].ravel()))}\n"
    )
    lines, counts = [], []
    for one in info["instances"]:
        if one["num_lidar_pts"] < 0:
            continue  # of regions that nobody labelled
        x, y, z, length, height, width, turn = one["bbox_3d"]
        lines.append(f"Car 0 0 0 0 0 0 0 {height} {width} {length} {x} {y} {z} {turn}")
        counts.append(one["num_lidar_pts"])
    (tmp_path / "label_2/000008.txt").write_text("\n".join(lines))
    frame = open_recording(tmp_path).read(0)
    owner = frame.boxes.points_of(frame.points)
    found = np.bincount(owner[owner >= 0], minlength=len(counts))
    assert sum(counts) > 1000
    # Theirs stand upright on the road and not in the camera, which a near car's edges feel; 6 cm
    # to the side would take 38 % of the first.
    np.testing.assert_allclose(found, counts, rtol=0.09)


def test_folders_of_real_clouds(shared_data, tmp_path):
    for place, names in (
        ("lidar/newbrunswick-roadside", FOREGROUND),
        ("airborne/delft-ahn3", AHN3),
        ("lidar/kitti", ("000008.bin",)),
    ):
        for name in names:
            file = tmp_path / place / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.symlink_to(shared_data / place / name)
    plain = open_recording(tmp_path / "lidar/newbrunswick-roadside")
    assert (plain.layout, len(plain)) == ("plain", 5)
    assert plain.names[0].endswith("frame_200.ply")
    assert len(plain.read(0).points) == 24_519
    with pytest.raises(InputError, match=r"holds 2 recordings.*kitti, newbrunswick-roadside"):
        open_recording(tmp_path / "lidar")
    airborne = open_recording(tmp_path / "airborne/delft-ahn3")
    assert [name.endswith(".laz") for name in airborne.names] == [True, True]


def test_las_is_what_laspy_wrote(tmp_path):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [100.0, 0, 0]
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS[:, :3].T.astype(np.float64)
    cloud.intensity = np.arange(60)
    cloud.gps_time = 3e5 + np.arange(60) * 1e-3
    for name in ("a.las", "b.laz"):
        cloud.write(str(tmp_path / name))
        frame = open_recording(tmp_path / name).read(0)
        np.testing.assert_allclose(frame.points, POINTS[:, :3], atol=6e-4)
        assert frame.intensity.tolist() == list(range(60))
        assert frame.time_s[-1] == pytest.approx(0.059)
    (tmp_path / "b.laz").write_bytes((tmp_path / "b.laz").read_bytes()[:300])
    with pytest.raises(InputError, match=r"b\.laz.*LAS"):
        open_recording(tmp_path).read(1)


@pytest.mark.parametrize(
    ("name", "unit"), [("t", 1e9), ("timestamp", 1.0), ("time", 1e6), ("time", 1e3)]
)
def test_times_of_drivers(tmp_path, name, unit):
    kind = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2"), (name, "f8")])
    table = np.zeros(60, kind)
    for axis, values in zip("xyz", POINTS.T, strict=False):
        table[axis] = values
    table["ring"] = np.arange(60)
    table[name] = (5000 + np.linspace(0, 0.1, 60)) * unit
    table["x"][7] = np.nan  # what is left out of the points is left out of all
    np.save(tmp_path / "a.npy", table)
    frame = open_recording(tmp_path).read(0)
    assert len(frame.points) == 59
    assert frame.not_finite == 1
    assert 7 not in frame.ring
    np.testing.assert_allclose(frame.time_s[[0, -1]], [0, 0.1], atol=1e-6)


def test_nuscenes_sweeps_without_tables(tmp_path):
    np.column_stack([POINTS, np.arange(60) % 32]).astype("<f4").tofile(tmp_path / "n.pcd.bin")
    frame = open_recording(tmp_path).read(0)
    np.testing.assert_array_equal(frame.points, POINTS[:, :3])
    assert frame.ring.tolist() == [k % 32 for k in range(60)]


def test_a_bad_file_leaves_the_others(tmp_path):
    np.save(tmp_path / "frame_2.npy", POINTS)
    POINTS.tofile(tmp_path / "frame_10.bin")
    (tmp_path / "frame_3.npy").write_bytes(b"\x93NUMPY")
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(POINTS[:, :3].copy()))
    assert o3d.t.io.write_point_cloud(str(tmp_path / "frame_4.pcd"), cloud)
    (tmp_path / "notes.txt").write_text("none of them")
    recording = open_recording(tmp_path)
    assert recording.names == ("frame_2.npy", "frame_3.npy", "frame_4.pcd", "frame_10.bin")
    assert recording.notes == ("Holds files of several formats: 1 bin and 2 npy and 1 pcd.",)
    with pytest.raises(InputError, match=r"frame_3\.npy"):
        recording.read(1)
    assert [len(recording.read(k).points) for k in (0, 2, 3)] == [60, 60, 60]
    with pytest.raises(IndexError):
        recording.read(-1)


def test_what_is_no_recording(tmp_path):
    with pytest.raises(InputError, match="not found"):
        open_recording(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"holds no clouds.*LUMPI"):
        open_recording(tmp_path)
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(InputError, match="holds no clouds"):
        open_recording(tmp_path / "notes.txt")
    np.save(tmp_path / "a.npy", POINTS)
    with pytest.raises(InputError, match=r"lumpy is unknown.*lumpi"):
        open_recording(tmp_path, "lumpy")
    with pytest.raises(InputError, match="not laid out as LUMPI"):
        open_recording(tmp_path, "lumpi")
    assert open_recording(tmp_path, "plain").names == ("a.npy",)


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_every_layout_refuses_an_empty_folder(tmp_path, layout):
    with pytest.raises(InputError):
        open_recording(tmp_path, layout)


def write_own(root):
    """Write a dataset by docs/architecture.md: two sensors, one frame."""

    for name in ("points", "rays", "semantic"):
        (root / name).mkdir(parents=True)
    np.save(root / "points/000004.npy", POINTS)
    rays = np.zeros(
        60,
        [("sensor", "u1"), ("ring", "<u2"), ("column", "<u2"), ("time", "<f4"), ("echo", "u1")],
    )
    rays["sensor"][30:], rays["column"], rays["time"] = 1, 9, 0.05
    np.save(root / "rays/000004.npy", rays)
    (np.full(60, 10, "<u4") | (5 << 16)).tofile(root / "semantic/000004.label")
    site = np.eye(4)
    site[:3, 3] = [-20, -10, -6]
    (root / "dataset.json").write_text(
        json.dumps({"kind": "dataset", "dataset_SE3_site": site.tolist(), "frames": []})
    )
    box = dict(zip(("x", "y", "z", "length", "width", "height", "yaw"), range(7), strict=True))
    write_table(
        root / "boxes.parquet",
        [{"frame": "000004", "track": 5, "class": "car", **box}, {"frame": "000005"}],
    )
    write_table(
        root / "sweeps.parquet",
        [
            {"frame": "000004", "sensor": "ne", "true_x": 20.0, "true_y": 10.0, "true_z": 6.0},
            {"frame": "000004", "sensor": "ne", "true_x": 20.0, "true_y": 10.0, "true_z": 6.0},
            {"frame": "000004", "sensor": "a", "true_x": 0.0, "true_y": 0.0, "true_z": 5.0},
        ],
    )


def test_our_own_dataset(tmp_path):
    write_own(tmp_path)
    recording = open_recording(tmp_path)
    assert (recording.layout, recording.names) == ("own", ("000004",))
    frame = recording.read(0)
    assert frame.sensor_places.tolist() == [[0, 0, 0], [-20, -10, -1]]  # in the order of the rig
    assert frame.world_SE3_frame.translation.tolist() == [20, 10, 6]
    assert frame.boxes.box.tolist() == [[0, 1, 2, 3, 4, 5, 6]]
    assert frame.boxes.track.tolist() == [5]
    assert set(frame.instance) == {5}
    assert set(frame.semantic) == {10}
    assert frame.time_s == pytest.approx(np.full(60, 0.05))
    assert frame.sensor.sum() == 30
    np.zeros(59, "<u4").tofile(tmp_path / "semantic/000004.label")
    with pytest.raises(InputError, match="59 values of semantic for 60 points"):
        recording.read(0)
    (tmp_path / "dataset.json").write_text('{"kind": "datasets", "datasets": ["ne", "sw"]}')
    with pytest.raises(InputError, match=r"a dataset for each sensor.*ne, sw"):
        open_recording(tmp_path)


def test_a_damaged_laz_does_not_keep_us_busy(tmp_path):
    header = laspy.LasHeader(point_format=1, version="1.2")
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS[:, :3].T.astype(np.float64)
    path = tmp_path / "a.laz"
    cloud.write(str(path))
    whole = path.read_bytes()
    for at, what in ((100, "records"), (96, "where points begin"), (107, "points")):
        damaged = bytearray(whole)
        damaged[at : at + 4] = b"\xff\xff\xff\x7f"
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"a\.laz: "):
            open_recording(path).read(0)
            pytest.fail(what)


def test_a_file_of_our_manifests_name_is_not_enough(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    (tmp_path / "dataset.json").write_text('{"classes": ["car"]}')
    assert open_recording(tmp_path).layout == "plain"
