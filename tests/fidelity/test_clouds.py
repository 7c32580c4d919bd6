"""Readers of clouds, against files that other programs or their format's definition made."""

import struct
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.fidelity import cloud_files, read_cloud
from urbantwin.fidelity.readers import open_recording

from ..real_files import FOREGROUND

POINTS = np.random.default_rng(1).uniform(-50, 50, (400, 4)).astype(np.float32)


def open3d_cloud():
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(POINTS[:, :3].copy()))
    cloud.point["intensity"] = o3d.core.Tensor(POINTS[:, 3:].copy())
    return cloud


@pytest.mark.parametrize(
    ("suffix", "ascii_", "compressed"),
    [
        ("pcd", True, False),
        ("pcd", False, False),
        ("pcd", False, True),
        ("ply", True, False),
        ("ply", False, False),
    ],
)
def test_reads_what_open3d_writes(tmp_path, suffix, ascii_, compressed):
    path = tmp_path / f"a.{suffix}"
    assert o3d.t.io.write_point_cloud(
        str(path), open3d_cloud(), write_ascii=ascii_, compressed=compressed
    )
    cloud = read_cloud(path)
    # Six significant digits is what its ascii files have.
    np.testing.assert_allclose(cloud.points, POINTS[:, :3], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(cloud.intensity, POINTS[:, 3], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("turned", [False, True], ids=["row by row", "column by column"])
@pytest.mark.parametrize("suffix", ["pcd", "npy"])
def test_an_image_of_points_has_rings_and_columns(tmp_path, suffix, turned):
    ring, column = np.divmod(np.arange(80 * 1800), 1800)
    table = np.column_stack([column, ring, np.ones_like(ring)]).astype(np.float32)
    image = table.reshape(80, 1800, 3)
    image = image.transpose(1, 0, 2) if turned else image
    path = tmp_path / f"a.{suffix}"
    if suffix == "npy":
        np.save(path, image)
    else:
        cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(image.reshape(-1, 3).copy()))
        assert o3d.t.io.write_point_cloud(str(path), cloud, write_ascii=False)
        height, width = image.shape[:2]
        data = path.read_bytes().replace(b"WIDTH 144000", b"WIDTH %d" % width)
        path.write_bytes(data.replace(b"HEIGHT 1\n", b"HEIGHT %d\n" % height))
    frame = open_recording(path).read(0)
    # Every point says by its place which ring and column it is.
    np.testing.assert_array_equal(frame.column, frame.points[:, 0])
    np.testing.assert_array_equal(frame.ring, frame.points[:, 1])


def test_a_pcd_whose_header_puts_the_ring_elsewhere_is_refused(tmp_path):
    """x, y, z, intensity as float32 and a ring as uint16, as PCL writes them."""
    rows = np.zeros(50, [("xyzi", "<f4", 4), ("ring", "<u2")])
    rows["xyzi"] = POINTS[:50]
    rows["ring"] = np.arange(50) % 16
    for sizes, types, fourth, match in (
        ("4 4 4 4 2", "F F F F U", "intensity", None),
        ("4 4 4 2 2", "F F F U U", "intensity", "18 bytes for each of its 50 points"),
        ("4 4 2 4 4", "F F U F U", "intensity", "has intensities up to 1e"),
        ("4 4 2 4 4", "F F U F U", "other", "has ring"),
    ):
        header = f"VERSION 0.7\nFIELDS x y z {fourth} ring\nSIZE {sizes}\nTYPE {types}\n"
        header += "COUNT 1 1 1 1 1\nWIDTH 50\nHEIGHT 1\nPOINTS 50\nDATA binary\n"
        path = tmp_path / "a.pcd"
        path.write_bytes(header.encode() + rows.tobytes())
        recording = open_recording(path)
        if match is None:
            np.testing.assert_array_equal(recording.read(0).ring, rows["ring"])
            continue
        with pytest.raises(InputError, match=match):
            recording.read(0)


def test_a_pcd_whose_sizes_add_up_and_whose_fields_begin_elsewhere_is_refused(tmp_path):
    """Five fields of four bytes each: no order of them has another size."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4")]
    rows = np.zeros(50, kinds)
    rows["x"], rows["y"], rows["z"], rows["intensity"] = POINTS[:50].T
    rows["t"] = np.arange(50) * 20_000
    for names, match in (
        ("x y z intensity t", None),
        ("x y z t intensity", "has intensities up to 1.4e-39"),
        ("x y t z intensity", "has intensities up to 1.4e-39"),
        ("x y t intensity z", "has z of less than 1e-30 m"),
    ):
        kind = " ".join("U" if name == "t" else "F" for name in names.split())
        header = f"VERSION 0.7\nFIELDS {names}\nSIZE 4 4 4 4 4\nTYPE {kind}\nCOUNT 1 1 1 1 1\n"
        path = tmp_path / "a.pcd"
        path.write_bytes(f"{header}WIDTH 50\nHEIGHT 1\nDATA binary\n".encode() + rows.tobytes())
        if match is None:
            np.testing.assert_allclose(open_recording(path).read(0).points, POINTS[:50, :3])
            continue
        for read in (
            lambda path=path: open_recording(path).read(0),
            lambda path=path: read_cloud(path),
        ):
            with pytest.raises(InputError, match=match):
                read()


@pytest.mark.parametrize("by", ["obj_info", "camera", "comment"])
def test_an_organised_ply_keeps_its_rings_and_columns(tmp_path, by):
    """As scanners say it (Stanford's range images), and as PCL does."""
    ring, column = np.divmod(np.arange(64 * 2048), 2048)
    rows = np.column_stack([column, ring, np.ones_like(ring)]).astype("<f4")
    said, view, after = "", "", b""
    if by == "obj_info":
        said = "obj_info num_cols 2048\nobj_info num_rows 64\n"
    elif by == "comment":
        said = "comment width 2048\ncomment height 64\n"
    else:
        view = "element camera 1\nproperty float view_px\nproperty int viewportx\n"
        view += "property int viewporty\n"
        after = struct.pack("<fii", 0.0, 2048, 64)
    path = tmp_path / "a.ply"
    header = f"ply\nformat binary_little_endian 1.0\n{said}element vertex {len(rows)}\n"
    header += f"property float x\nproperty float y\nproperty float z\n{view}end_header\n"
    path.write_bytes(header.encode() + rows.tobytes() + after)
    frame = open_recording(path).read(0)
    np.testing.assert_array_equal(frame.column, frame.points[:, 0])
    np.testing.assert_array_equal(frame.ring, frame.points[:, 1])
    # A count that is not the vertices': they are no image.
    wrong = header.replace("2048", "2047").encode() + rows.tobytes()
    path.write_bytes(wrong + after.replace(struct.pack("<i", 2048), struct.pack("<i", 2047)))
    assert open_recording(path).read(0).ring is None


def test_an_organised_pcd_with_rings_has_columns_where_a_row_is_a_ring(tmp_path):
    ring, column = np.divmod(np.arange(80 * 1800), 1800)
    away = np.random.default_rng(0).uniform(2.0, 60.0, ring.shape)
    turn = 2 * np.pi * column / 1800
    table = np.column_stack([away * np.cos(turn), away * np.sin(turn), ring, 79 - ring])
    path = tmp_path / "a.pcd"

    def written(rings):
        table[:, 3] = rings
        head = "VERSION 0.7\nFIELDS x y z ring\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        head += "WIDTH 1800\nHEIGHT 80\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 144000\nDATA binary\n"
        path.write_bytes(head.encode() + table.astype("<f4").tobytes())
        return open_recording(path).read(0)

    frame = written(79 - ring)  # counted from below: the writer's numbers stay
    np.testing.assert_array_equal(frame.ring, 79 - ring)
    np.testing.assert_array_equal(frame.column, column)
    assert ut.info(path)["column"] == [0, 1799]
    assert written(ring // 2).column is None  # two rows of one ring are no image by rings
    with pytest.raises(InputError, match="ring"):  # bits of something else
        written(1e-40 * ring)


@pytest.mark.parametrize("count", [1, 4, 400])
def test_a_compressed_pcd_whose_block_is_stored_as_it_is(tmp_path, count):
    """So writes pypcd4 what LZF makes no smaller: both sizes are equal."""
    points = np.random.default_rng(count).normal(0, 30, (count, 3)).astype("<f4")
    head = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\n"
        f"HEIGHT 1\nPOINTS {count}\nDATA binary_compressed\n"
    )
    body = points.T.tobytes()
    sizes = np.array([len(body)] * 2, "<u4").tobytes()
    path = tmp_path / "a.pcd"
    path.write_bytes(head.encode() + sizes + body)
    np.testing.assert_array_equal(read_cloud(path).points.astype("<f4"), points)


def test_compressed_pcd_of_repeating_values(tmp_path):
    # Long copies, some overlapping what they write: the codes that random values never give.
    table = np.repeat(np.arange(20, dtype=np.float32), 60).reshape(-1, 3) + 1
    path = tmp_path / "a.pcd"
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(table))
    assert o3d.t.io.write_point_cloud(str(path), cloud, write_ascii=False, compressed=True)
    assert path.stat().st_size < table.nbytes / 4
    np.testing.assert_array_equal(read_cloud(path).points, table)


@pytest.mark.parametrize(("order", "name"), [("<", "little"), (">", "big")])
def test_binary_ply_of_either_byte_order(tmp_path, order, name):
    header = (
        f"ply\nformat binary_{name}_endian 1.0\ncomment made by hand\n"
        "element sensor 1\nproperty double height\n"
        "element vertex 2\nproperty uchar ring\nproperty double x\nproperty float y\n"
        "property float z\nproperty ushort intensity\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = struct.pack(order + "d", 5.5)
    body += struct.pack(order + "BdffH", 7, 1.5, -2.25, 3.0, 300)
    body += struct.pack(order + "BdffH", 8, -10.5, 20.0, 0.5, 65535)
    body += struct.pack(order + "Biii", 3, 0, 1, 0)
    path = tmp_path / "a.ply"
    path.write_bytes(header.encode() + body)
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.points, [[1.5, -2.25, 3.0], [-10.5, 20.0, 0.5]])
    np.testing.assert_array_equal(cloud.intensity, [300, 65535])


def test_bin_columns(tmp_path):
    five = np.column_stack([POINTS[:7], np.zeros(7, np.float32)])
    five.tofile(tmp_path / "five.bin")  # 140 bytes: neither 16 nor 12 divides it
    POINTS[:7, :3].tofile(tmp_path / "three.bin")
    POINTS.tofile(tmp_path / "four.bin")
    np.testing.assert_array_equal(read_cloud(tmp_path / "five.bin", 5).points, POINTS[:7, :3])
    np.testing.assert_array_equal(read_cloud(tmp_path / "three.bin").points, POINTS[:7, :3])
    assert read_cloud(tmp_path / "three.bin").intensity is None
    np.testing.assert_array_equal(read_cloud(tmp_path / "four.bin").intensity, POINTS[:, 3])
    with pytest.raises(InputError, match=r"five\.bin.*140 bytes"):
        read_cloud(tmp_path / "five.bin")


def test_nan_and_no_return_are_dropped_and_counted(tmp_path):
    table = POINTS.copy()
    table[3, 1], table[5, 3], table[9, :3] = np.nan, np.inf, 0
    np.save(tmp_path / "a.npy", table)
    cloud = read_cloud(tmp_path / "a.npy")
    assert (len(cloud.points), cloud.not_finite, cloud.no_return) == (397, 2, 1)


def test_real_files(shared_data, tmp_path):
    # Counts of points as the data's own README and the files' sizes state them.
    kitti = read_cloud(shared_data / "lidar/kitti/000008.bin")
    assert len(kitti.points) == 17238
    assert kitti.intensity is not None
    assert 0 <= kitti.intensity.min() <= kitti.intensity.max() <= 1
    for name in FOREGROUND:
        (tmp_path / Path(name).name).symlink_to(shared_data / "lidar/newbrunswick-roadside" / name)
    files = cloud_files(tmp_path)
    assert [int(f.stem.split("_")[-1]) for f in files] == [200, 400, 600, 800, 1000]
    for file in files:
        expected = np.asarray(o3d.io.read_point_cloud(str(file)).points)
        cloud = read_cloud(file)
        assert len(cloud.points) + cloud.no_return + cloud.not_finite == len(expected)
        np.testing.assert_allclose(
            cloud.points.sum(axis=0), expected.sum(axis=0), rtol=1e-9, atol=1e-6
        )


def write(tmp_path, suffix):
    path = tmp_path / f"whole.{suffix}"
    if suffix == "npy":
        np.save(path, POINTS)
    elif suffix == "bin":
        POINTS.tofile(path)
    else:
        kind = suffix.split(".")[0]
        path = tmp_path / f"whole.{kind}"
        o3d.t.io.write_point_cloud(
            str(path),
            open3d_cloud(),
            write_ascii=suffix.endswith("ascii"),
            compressed=suffix.endswith("packed"),
        )
    return path


@pytest.mark.parametrize(
    "suffix", ["npy", "bin", "pcd.binary", "pcd.packed", "pcd.ascii", "ply.binary", "ply.ascii"]
)
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.99])
def test_truncated_files_name_themselves(tmp_path, suffix, kept):
    path = write(tmp_path, suffix)
    data = path.read_bytes()
    cut = int(len(data) * kept)
    if suffix == "bin":
        cut += cut % 4 == 0  # a cut between two values leaves whole rows or a multiple of four
    path.write_bytes(data[:cut])
    with pytest.raises(InputError, match="whole"):
        read_cloud(path)


@pytest.mark.parametrize(
    ("array", "problem"),
    [
        (np.zeros((5, 2)), r"shape \(5, 2\)"),
        (np.zeros(12), r"shape \(12,\)"),
        (np.zeros((0, 4)), "is empty"),
        (np.full((5, 4), np.nan), "none of its 5 points"),
        (np.array([["a", "b", "c"]]), "array of"),
        (np.full((5, 4), 1e30), "1e"),
    ],
)
def test_arrays_that_are_no_clouds(tmp_path, array, problem):
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError, match=rf"a\.npy.*{problem}"):
        read_cloud(tmp_path / "a.npy")


def test_ply_with_faces_before_and_after_its_vertices(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement strip 2\nproperty list uchar int row\n"
        "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 9\nproperty list uchar int vertex_indices\nend_header\n"
        "3 0 1 1\n1 0\n1 2 3\n4 5 6\n3 0 1 1\n"
    )
    assert read_cloud(tmp_path / "a.ply").points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_ply_without_z(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "end_header\n1 2\n"
    )
    with pytest.raises(InputError, match=r"a\.ply.*no field z"):
        read_cloud(tmp_path / "a.ply")


def test_folders(tmp_path):
    with pytest.raises(InputError, match="not found"):
        cloud_files(tmp_path / "nowhere")
    with pytest.raises(InputError, match="holds no clouds"):
        cloud_files(tmp_path)
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(InputError, match="is a file"):
        cloud_files(tmp_path / "notes.txt")
    (tmp_path / "set" / "points").mkdir(parents=True)
    (tmp_path / "set" / "dataset.json").write_text("{}")
    np.save(tmp_path / "set" / "points" / "000000.npy", POINTS)
    assert [f.name for f in cloud_files(tmp_path / "set")] == ["000000.npy"]
