import numpy as np
import pytest
import trimesh
from PIL import Image

from urbantwin.errors import InputError

from ..reconstruct.model_files import BOX, BOX_QUADS, area, read, volume


def written(path, lines):
    path.write_text("\n".join(lines) + "\n")
    return path


def box_lines(corner="{0}", first=0):
    quads = [
        "f " + " ".join(corner.format(k + 1 - first, n + 1) for n, k in enumerate(quad))
        for quad in BOX_QUADS
    ]
    return [f"v {x} {y} {z}" for x, y, z in BOX] + quads


@pytest.mark.parametrize("corner", ["{0}", "{0}/{1}", "{0}//{1}", "{0}/{1}/{1}"])
def test_every_way_to_write_a_corner(tmp_path, corner):
    lines = ["vt 0 0"] * 4 + ["vn 0 0 1"] * 4 + box_lines(corner)
    mesh = read(written(tmp_path / "box.obj", lines)).mesh
    assert len(mesh.faces) == 12
    assert area(mesh) == pytest.approx(2 * (6 + 8 + 12))
    assert volume(mesh) == pytest.approx(24.0)


def test_negative_numbers_count_from_the_last_vertex(tmp_path):
    lines = box_lines(first=9)  # 1 becomes -8
    assert "f -8 -7 -5 -6" in lines
    twice = lines + [line.replace("v 0", "v 5").replace("v 2", "v 7") for line in lines]
    mesh = read(written(tmp_path / "box.obj", twice)).mesh
    assert volume(mesh) == pytest.approx(48.0)


def test_concave_faces_and_continued_lines(tmp_path):
    corners = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
    lines = [f"v {x} {y} 1e0" for x, y in corners] + ["f 1 2 3 \\", " 4 5 6"]
    assert area(read(written(tmp_path / "l.obj", lines)).mesh) == pytest.approx(7.0)


def test_names_materials_and_pictures(tmp_path):
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:, :32], picture[:, 32:] = (200, 10, 20), (30, 40, 250)
    Image.fromarray(picture).save(tmp_path / "skin.png")
    (tmp_path / "m.mtl").write_text(
        "newmtl wall\nKd 0.2 0.4 0.6\nnewmtl front\nKd 1 1 1\nmap_Kd -s 1 1 1 C:\\me\\skin.png\n"
    )
    lines = ["mtllib m.mtl", *(f"v {x} {y} {z}" for x, y, z in BOX)]
    lines += ["vt 0.1 0.1", "vt 0.4 0.1", "vt 0.4 0.9", "vt 1.6 0.5", "vt 1.9 0.5", "vt 1.9 0.9"]
    lines += ["o house 12", "usemtl wall", "f 1 2 4"]
    lines += ["usemtl front", "f 1/1 2/2 4/3", "g porch", "f 1/4 2/5 4/6", "o shed", "f 1 2 4"]
    model = read(written(tmp_path / "m.obj", lines))
    names = model.mesh.names
    assert [names[k] for k in model.mesh.object] == [
        "house 12 / wall",
        "house 12 / front",
        "house 12 / porch / front",
        "shed / front",
    ]
    assert model.mesh.colour.tolist() == [
        [51, 102, 153],
        [200, 10, 20],
        [30, 40, 250],  # beyond 1 the picture repeats
        [255, 255, 255],
    ]
    assert model.up is None
    assert model.unit_m is None
    assert not model.problems


def test_a_picture_outside_the_folder_is_not_opened(tmp_path):
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "secret.png")
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "m.mtl").write_text("newmtl a\nKd 0 0 1\nmap_Kd ../secret.png\n")
    lines = ["mtllib m.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0", "vt 0 0", "usemtl a", "f 1/1 2/1 3/1"]
    model = read(written(folder / "m.obj", lines))
    assert model.mesh.colour.tolist() == [[0, 0, 255]]
    assert "secret.png" in model.problems[0]


def test_the_reference_of_delft_is_as_another_reader_has_it(shared_data):
    path = shared_data / "airborne" / "delft-ahn3" / "reference" / "testarea.obj"
    model = read(path)
    other = trimesh.load(path, force="mesh", process=False, skip_materials=True)
    assert len(model.mesh.faces) == len(other.faces)
    assert area(model.mesh) == pytest.approx(other.area, rel=1e-12)
    assert "3dfier.mtl" in model.problems[0]


def test_comments_after_numbers(tmp_path):
    lines = ["v 0 0 0 # a", "v 1 0 0", "v 0 1 0", "o house #12", "f 1 2 3 # b"]
    mesh = read(written(tmp_path / "c.obj", lines)).mesh
    assert area(mesh) == pytest.approx(0.5)
    assert mesh.names == ("house #12",)


def test_vertices_alone_are_a_cloud(tmp_path):
    cloud = read(written(tmp_path / "p.obj", ["v 1 2 3 1 0 0", "v 4 5 6 0 0 1"])).cloud
    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.colour.tolist() == [[255, 0, 0], [0, 0, 255]]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["v 0 0 0", "v 1 0", "v 0 1 0", "f 1 2 3"], "line 2"),
        (["v 0 0 0", "v 1 nan 0", "v 0 1 0", "f 1 2 3"], "vertex 2 of 3"),
        (["v 0 0 0", "v 1 x 0", "v 0 1 0", "f 1 2 3"], "line 2"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 4"], "vertex 4 of 3"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2"], "line 4"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 0 1 2"], "line 4"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 -4"], "vertex"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 a 3"], "line 4"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 1 3"], "no triangle"),
        (["v 0 0 0", "v 1 0 0", "v 0 1 0", "vt ", "f 1 2 3"], "line 4"),
        (["hello"], "no face and no vertex"),
        (["\0\0"], "not text"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(tmp_path, lines, said):
    with pytest.raises(InputError) as caught:
        read(written(tmp_path / "bad.obj", lines))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
