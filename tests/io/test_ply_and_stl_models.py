import struct

import numpy as np
import open3d as o3d
import pytest
import trimesh
from PIL import Image

from urbantwin.errors import InputError

from ..real_files import FOREGROUND
from ..reconstruct.model_files import BOX, BOX_QUADS, area, read, volume


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(3, radius=5.0)
    mesh.vertices += [100, 200, 10]
    rng = np.random.default_rng(1)
    mesh.visual.vertex_colors = rng.integers(0, 255, (len(mesh.vertices), 4))
    return mesh


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_of_another_writer(tmp_path, ball, encoding):
    path = tmp_path / "ball.ply"
    path.write_bytes(ball.export(file_type="ply", encoding=encoding))
    mesh = read(path).mesh
    assert np.array_equal(mesh.faces, ball.faces)
    assert np.abs(mesh.vertices - ball.vertices).max() < 1e-4
    mean = np.asarray(ball.visual.vertex_colors)[ball.faces][:, :, :3].mean(axis=1)
    assert np.abs(mesh.colour - mean).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("ascii_text", [False, True])
def test_cloud_of_another_writer(tmp_path, ascii_text):
    points = np.random.default_rng(2).normal(size=(50, 3)) * 100
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.paint_uniform_color([1.0, 0.0, 0.0])
    o3d.io.write_point_cloud(str(tmp_path / "c.ply"), cloud, write_ascii=ascii_text)
    found = read(tmp_path / "c.ply").cloud
    assert np.abs(found.points - points).max() < 1e-3  # its text has six digits
    assert (found.colour == [255, 0, 0]).all()


@pytest.mark.parametrize("order", ["<", ">"])
def test_faces_of_different_length_with_more_lists(tmp_path, order):
    name = {"<": "little", ">": "big"}[order]
    header = (
        f"ply\nformat binary_{name}_endian 1.0\ncomment TextureFile skin.png\n"
        "element vertex 8\nproperty double x\nproperty double y\nproperty double z\n"
        "element face 7\nproperty uchar flag\nproperty list uchar int vertex_indices\n"
        "property list ushort float texcoord\nend_header\n"
    ).encode()
    rows = b""
    for quad in [
        *BOX_QUADS.tolist()[:5],
        BOX_QUADS[5][:3].tolist(),
        BOX_QUADS[5][[0, 2, 3]].tolist(),
    ]:
        rows += struct.pack(f"{order}BB{len(quad)}i", 7, len(quad), *quad)
        rows += struct.pack(f"{order}H{2 * len(quad)}f", 2 * len(quad), *([0.25] * 2 * len(quad)))
    (tmp_path / "box.ply").write_bytes(header + BOX.astype(f"{order}f8").tobytes() + rows)
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[4:, :4] = (9, 8, 7)  # v is up: 0.25, 0.25 is in the lower left
    Image.fromarray(picture).save(tmp_path / "skin.png")
    mesh = read(tmp_path / "box.ply").mesh
    assert volume(mesh) == pytest.approx(24.0)
    assert (mesh.colour == [9, 8, 7]).all()


def test_real_roadside_clouds(shared_data):
    path = shared_data / "lidar" / "newbrunswick-roadside" / FOREGROUND[0]
    expected = np.asarray(o3d.io.read_point_cloud(str(path)).points)
    assert np.array_equal(read(path).cloud.points, expected)


@pytest.mark.parametrize("ascii_text", [False, True])
def test_stl_of_another_writer(tmp_path, ball, ascii_text):
    text = ball.export(file_type="stl_ascii" if ascii_text else "stl")
    data = text.encode() if isinstance(text, str) else text
    (tmp_path / "ball.stl").write_bytes(data)
    mesh = read(tmp_path / "ball.stl").mesh
    assert len(mesh.vertices) == len(ball.vertices)
    assert volume(mesh) == pytest.approx(ball.volume, rel=1e-5)
    assert area(mesh) == pytest.approx(ball.area, rel=1e-5)


def test_binary_stl_that_begins_like_text(tmp_path, ball):
    data = bytearray(ball.export(file_type="stl"))
    data[:6] = b"solid "
    (tmp_path / "ball.stl").write_bytes(bytes(data))
    assert len(read(tmp_path / "ball.stl").mesh.faces) == len(ball.faces)


def ply(vertices=1, faces=0, body=b"", kind="ascii"):
    return (
        f"ply\nformat {kind} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {faces}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    ).encode() + body


BINARY = "binary_little_endian"
POINTS = np.eye(3, dtype="<f4").tobytes()


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.ply", b"ply\nformat ascii 1.0\n", "without an end"),
        ("a.ply", b"plx\n", "not a PLY"),
        ("a.ply", ply(10**12), "1,000,000,000,000"),
        ("a.ply", ply(-4), "-4"),
        ("a.ply", ply(3, 1, POINTS + b"\x03" + bytes(4), BINARY), "0 of 1 rows of face"),
        ("a.ply", ply(3, 1, POINTS[:20], BINARY), "1 of 3 rows of vertex"),
        ("a.ply", ply(3, 1, POINTS + b"\x03" + struct.pack("<3i", 0, 1, 9), BINARY), "vertex 10"),
        ("a.ply", ply(3, 1, b"0 0 0\n1 0 0\n0 1 0\n3 0 1 x\n"), "rows of face"),
        ("a.ply", ply(3, 1, b"0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n"), "vertex 2 of 3"),
        ("a.ply", ply(0, 0), "no vertex"),
        ("a.ply", ply().replace(b"float x", b"quad x"), "line 4"),
        ("a.stl", b"", "empty"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 10**9), "1,000,000,000"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 1) + bytes(20), "104 bytes"),
        ("a.stl", b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0\nendsolid a\n", "line 5"),
        ("a.stl", b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "ends before"),
        (
            "a.stl",
            b"x" * 80 + struct.pack("<I", 1) + struct.pack("<12fH", *[np.nan] * 12, 0),
            "nan",
        ),
    ],
)
def test_what_is_wrong_is_told_in_a_line(tmp_path, name, data, said):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as caught:
        read(tmp_path / name)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
