import zipfile

import numpy as np
import pytest
import trimesh

from urbantwin.errors import InputError

from ..reconstruct.model_files import area, read


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(2, radius=3.0)


@pytest.mark.parametrize("ending", ["obj", "ply", "stl", "glb"])
def test_the_first_bytes_tell_what_a_file_is(tmp_path, ball, ending):
    path = tmp_path / f"ball.{ending}"
    path.write_bytes(
        data.encode() if isinstance(data := ball.export(file_type=ending), str) else data
    )
    model = read(path)
    assert area(model.mesh) == pytest.approx(ball.area, rel=1e-5)
    assert set(model.files) == {path.name}
    if ending in ("ply", "glb"):
        wrong = tmp_path / "ball.obj"
        path.rename(wrong)
        assert area(read(wrong).mesh) == pytest.approx(ball.area, rel=1e-5)


def test_a_mesh_may_be_taken_as_a_cloud_but_not_the_other_way(tmp_path, ball):
    path = tmp_path / "ball.ply"
    path.write_bytes(ball.export(file_type="ply"))
    assert len(read(path, kind="cloud").cloud.points) == len(ball.vertices)
    (tmp_path / "p.xyz").write_text("1 2 3\n4 5 6\n")
    with pytest.raises(InputError, match="point cloud"):
        read(tmp_path / "p.xyz", kind="mesh")


def test_a_gltf_with_its_files(shared_data):
    folder = shared_data / "meshes" / "openmaterial" / "examples" / "vehicle_example"
    model = read(folder)
    assert set(model.files) >= {"vehicle_example.gltf", "vehicle_example.bin"}
    assert (model.up, model.unit_m) == ("y", 1.0)
    size = np.ptp(model.mesh.vertices, axis=0)
    assert np.allclose(np.sort(size), [1.30, 1.62, 3.85], atol=0.35)  # with its mirrors


@pytest.mark.parametrize(
    ("text", "points", "colour"),
    [
        ("1 2 3\n4 5 6\n", [[1, 2, 3], [4, 5, 6]], None),
        ("2\n1 2 3 -100 9 8 7\n4 5 6 20 6 5 4\n", [[1, 2, 3], [4, 5, 6]], [[9, 8, 7], [6, 5, 4]]),
        ("//X,Y,Z,R,G,B\n1,2,3,9,8,7\n", [[1, 2, 3]], [[9, 8, 7]]),
        ("x;y;z\n1;2;3e0\n", [[1, 2, 3]], None),
    ],
)
def test_points_as_text(tmp_path, text, points, colour):
    (tmp_path / "p.pts").write_text(text)
    cloud = read(tmp_path / "p.pts").cloud
    assert cloud.points.tolist() == points
    assert (None if cloud.colour is None else cloud.colour.tolist()) == colour


def archive(path):
    with zipfile.ZipFile(path, "w") as stream:
        stream.writestr("m.obj", "v 0 0 0\n")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("m.obj", b"", "is empty"),
        ("m.glb", b"", "is empty"),
        ("m.rcp", b"<ReCap/>", "PTS"),
        ("m.e57", b"ASTM-E57", "E57"),
        ("m.png", b"\x89PNG", "holds nothing known"),
        ("m.json", b"[1, 2]", "holds nothing known"),
        ("m.json", b'{"a": 1}', "another kind"),
        ("m.json", b'{"a": ', "not JSON"),
        ("m.json", b'{"a":' * 100_000, "not JSON"),
        ("m.b3dm", b"b3dm\x01\x00", "m.b3dm"),
        ("m.pts", b"1 2 3\n1 2\n", "line 2"),
        ("m.pts", b"1 2 nan\n", "not a place"),
        ("m.pts", b"hello\n", "no point"),
        ("m.las", b"LASF" + bytes(50), "cannot be read as LAS"),
        ("m.las", b"LASF" + b"\xff" * 400, "cannot be read as LAS"),
        ("m.fbx", b"Kaydara FBX Binary  \x00\x1a\x00" + b"\xff" * 200, "cannot be read as FBX"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(tmp_path / name)
    assert said in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_archive_under_any_name_is_told(tmp_path):
    archive(tmp_path / "m.obj")
    with pytest.raises(InputError, match="unpack"):
        read(tmp_path / "m.obj")


def test_folders_without_a_model(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="holds no model"):
        read(tmp_path / "a")
    (tmp_path / "a" / "scan.rcs").write_bytes(b"x")
    with pytest.raises(InputError, match="export it as PTS"):
        read(tmp_path / "a")
    with pytest.raises(InputError, match="not found"):
        read(tmp_path / "none.obj")


def test_a_gltf_that_names_a_file_outside_its_folder(tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(100))
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "m.gltf").write_text(
        '{"asset":{"version":"2.0"},"buffers":[{"uri":"../secret.bin","byteLength":100}],'
        '"bufferViews":[{"buffer":0,"byteLength":36}],'
        '"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],'
        '"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],'
        '"scenes":[{"nodes":[0]}]}'
    )
    with pytest.raises(InputError) as caught:
        read(tmp_path / "m" / "m.gltf")
    assert "\n" not in str(caught.value)
