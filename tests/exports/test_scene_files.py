"""The scene as other programs read it: trimesh, Open3D, ufbx, USD."""

import functools
import json
import struct
from collections import defaultdict

import numpy as np
import open3d as o3d
import pytest
import trimesh
from pyproj import Transformer

from urbantwin.artefact import overwriting
from urbantwin.drawing.markings import markings
from urbantwin.errors import InputError, StageError
from urbantwin.exports import export_twin
from urbantwin.exports.mesh import Look, MeshObject, fbx, write_fbx
from urbantwin.exports.scene.cityjson import flat_faces
from urbantwin.io.cities.cityjson import read_cityjson
from urbantwin.io.fbx import read_fbx
from urbantwin.taxonomy import materials, semantic_classes, semantic_id

ENDINGS = {
    "glb": "glb",
    "obj": "obj",
    "ply": "ply",
    "usd": "usd",
    "fbx": "fbx",
    "cityjson": "city.json",
}


@pytest.fixture(scope="module")
def files(small_twin, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    return {
        name: export_twin(small_twin, name, folder / f"scene.{ending}").path
        for name, ending in ENDINGS.items()
    }


def gltf(path):
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length])


def expected_by_part(mesh):
    """Area of each part of the twin's own mesh."""
    areas = mesh.areas()
    return {int(part): areas[mesh.part == part].sum() for part in np.unique(mesh.part)}


def test_glb_has_a_node_per_object_with_its_class(files, small_twin):
    document = gltf(files["glb"])
    mesh = small_twin.mesh
    names = [node["name"] for node in document["nodes"]]
    assert len(names) == len(set(names)) == len(np.unique(mesh.part)) + 1
    assert names[-1] == "lane paint"
    assert {"road", "sidewalk", "terrain", "building 1", "pole 1"} <= set(names)
    wanted = expected_by_part(mesh)
    scene = trimesh.load(files["glb"])
    areas = defaultdict(float)
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        assert np.allclose(transform, np.eye(4))
        areas[scene.geometry[name].metadata.get("name", name)] += scene.geometry[name].area
    assert areas.pop("lane paint") > 50.0
    assert sum(areas.values()) == pytest.approx(sum(wanted.values()), rel=1e-4)
    for node in document["nodes"][:-1]:
        part = node["extras"]["part"]
        kind = node["extras"]["semantic"]
        assert node["extras"]["semantic_id"] == semantic_id(kind)
        assert semantic_id(kind) in mesh.semantic[mesh.part == part]
    low, high = scene.bounds
    assert np.allclose(
        low[[0, 2, 1]] * [1, 1, 1],
        [mesh.vertices[:, 0].min(), -mesh.vertices[:, 1].max(), mesh.vertices[:, 2].min()],
        atol=1e-3,
    )
    assert high[1] == pytest.approx(mesh.vertices[:, 2].max(), abs=1e-3)


def test_glb_materials_name_class_and_material(files, small_twin):
    document = gltf(files["glb"])
    mesh = small_twin.mesh
    classes = {one.id: one.name for one in semantic_classes().values()}
    stuff = {one.id: one.name for one in materials().values()}
    pairs = {
        f"{classes[int(s)]}/{stuff[int(m)]}"
        for s, m in zip(mesh.semantic, mesh.material, strict=True)
    }
    pairs.add("road/road-paint")
    assert {one["name"] for one in document["materials"]} == pairs
    for one in document["materials"]:
        assert f"{one['extras']['semantic']}/{one['extras']['material']}" == one["name"]
    place = document["scenes"][0]["extras"]["georeference"]
    assert place["latitude"] == small_twin.frame.latitude
    assert place["proj"] == small_twin.frame.proj


def test_obj_is_the_same_scene(files, small_twin):
    text = files["obj"].read_text()
    names = [line[2:] for line in text.splitlines() if line.startswith("o ")]
    assert {"building_1", "road", "pole_1"} <= set(names)
    mesh = trimesh.load(files["obj"], force="mesh", process=False, skip_materials=True)
    twin = small_twin
    paint = markings(twin.roads, twin.ground_mesh, twin.lane_model)
    assert len(mesh.faces) == len(twin.mesh.faces) + len(paint.faces)
    assert mesh.area == pytest.approx(twin.mesh.areas().sum() + paint.areas().sum(), rel=1e-3)
    used = {line[7:] for line in text.splitlines() if line.startswith("usemtl ")}
    library = files["obj"].with_suffix(".mtl").read_text()
    assert used == {line[7:] for line in library.splitlines() if line.startswith("newmtl ")}


def test_ply_faces_carry_class_material_and_part(files, small_twin):
    mesh = trimesh.load(files["ply"], process=False)
    rows = mesh.metadata["_ply_raw"]["face"]["data"]
    own = small_twin.mesh
    assert np.array_equal(mesh.vertices, own.vertices)
    assert np.array_equal(mesh.faces, own.faces)
    for name in ("semantic", "material", "part"):
        assert np.array_equal(np.asarray(rows[name]).ravel(), getattr(own, name))


def test_usd_is_a_sound_stage_with_names_and_classes(files, small_twin):
    usd = pytest.importorskip("pxr.Usd")
    geometry = pytest.importorskip("pxr.UsdGeom")
    shade = pytest.importorskip("pxr.UsdShade")
    stage = usd.Stage.Open(str(files["usd"]))
    assert geometry.GetStageUpAxis(stage) == "Z"
    assert geometry.GetStageMetersPerUnit(stage) == 1.0
    wanted = expected_by_part(small_twin.mesh)
    found = {}
    for prim in stage.Traverse():
        if not prim.IsA(geometry.Mesh):
            continue
        data = prim.GetCustomData()["urbantwin"]
        points = np.array(geometry.Mesh(prim).GetPointsAttr().Get(), float)
        faces = np.array(geometry.Mesh(prim).GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        found[data.get("part", "lane paint")] = trimesh.Trimesh(points, faces, process=False).area
        subsets = geometry.Subset.GetAllGeomSubsets(geometry.Imageable(prim))
        assert sum(len(s.GetIndicesAttr().Get()) for s in subsets) in (0, len(faces))
        bound = [shade.MaterialBindingAPI(s.GetPrim()).GetDirectBinding() for s in subsets]
        bound = bound or [shade.MaterialBindingAPI(prim).GetDirectBinding()]
        assert all(one.GetMaterial() for one in bound)
    assert found.pop("lane paint") > 50.0
    assert found == pytest.approx(wanted, rel=1e-3)
    assert stage.GetPrimAtPath("/World/building_1").GetDisplayName() == "building 1"


def test_cityjson_holds_every_wall_and_roof_where_it_stands(files, small_twin):
    document = json.loads(files["cityjson"].read_text())
    assert (document["type"], document["version"]) == ("CityJSON", "2.0")
    code = document["metadata"]["referenceSystem"].rsplit("/", 1)[1]
    scale, shift = document["transform"]["scale"], document["transform"]["translate"]
    vertices = np.array(document["vertices"]) * scale + shift
    frame = small_twin.frame
    back = Transformer.from_crs(f"EPSG:{code}", "EPSG:4326", always_xy=True)
    site = frame.site_from_lonlat(np.column_stack(back.transform(vertices[:, 0], vertices[:, 1])))
    anchor = small_twin.manifest["notes"]["ground"]["anchor_height_m"]
    site = np.column_stack([site, vertices[:, 2] - anchor])
    mesh, sills = small_twin.mesh, 0
    for one in document["CityObjects"].values():
        own = mesh.select(mesh.part == one["attributes"]["part"])
        (geometry,) = one["geometry"]
        assert geometry["type"] == "MultiSurface"
        values = geometry["semantics"]["values"]
        assert len(values) == len(geometry["boundaries"])
        kinds = [geometry["semantics"]["surfaces"][k]["type"] for k in values]
        assert {"RoofSurface", "WallSurface"} <= set(kinds)
        area = 0.0
        for kind, rings in zip(kinds, geometry["boundaries"], strict=True):
            turned = np.zeros(3)
            for ring in rings:
                p = site[ring] - site[rings[0][0]]
                turned += np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0) / 2
            area += np.linalg.norm(turned)
            rise = turned[2] / np.linalg.norm(turned)
            edges = [np.linalg.norm(site[r] - site[np.roll(r, -1)], axis=1).sum() for r in rings]
            if abs(rise) > 0.99 and 2 * np.linalg.norm(turned) / sum(edges) < 0.2:
                # The sill or the head of a window, what a door stands on, a narrow roof.
                level = "RoofSurface" if rise > 0 else "GroundSurface"
                assert kind in ("WallSurface", level)
                sills += kind == "WallSurface"
            else:
                assert (rise > 0.25) == (kind == "RoofSurface")
                assert (rise < -0.25) == (kind in ("GroundSurface", "OuterCeilingSurface"))
            normal = turned / np.linalg.norm(turned)
            for ring in rings:
                assert np.abs((site[ring] - site[rings[0][0]]) @ normal).max() < 0.02
        assert area == pytest.approx(own.areas().sum(), rel=2e-3)
        corners = site[[k for rings in geometry["boundaries"] for ring in rings for k in ring]]
        assert np.abs(corners.min(axis=0) - own.vertices.min(axis=0)).max() < 0.002
        assert np.abs(corners.max(axis=0) - own.vertices.max(axis=0)).max() < 0.002
    assert sills > 10
    model = read_cityjson(files["cityjson"])
    assert not model.problems
    assert model.mesh.names[0].startswith("Building building-1")


def test_triangles_of_a_plane_become_one_polygon_with_its_holes():
    """A square frame of 8 triangles, and a triangle that stands on its edge."""
    outer = [[0, 0], [4, 0], [4, 4], [0, 4]]
    inner = [[1, 1], [3, 1], [3, 3], [1, 3]]
    frame = [[k, (k + 1) % 4, 4 + k] for k in range(4)]
    frame += [[(k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    points = [[x, y, 0] for x, y in outer + inner] + [[2, 0, 3]]
    found = flat_faces(
        np.array(points, float), np.array([*frame, [0, 8, 1]]), np.zeros(9, np.int64)
    )
    assert sorted(sorted(len(r) for r in one.rings) for one in found) == [[3], [4, 4]]
    whole = next(one for one in found if len(one.rings) == 2)
    assert set(whole.rings[0]) == {0, 1, 2, 3}
    assert set(whole.rings[1]) == {4, 5, 6, 7}
    labels = np.array([0] * 4 + [1] * 4)
    assert len(flat_faces(np.array(points, float), np.array(frame), labels)) > 1


@pytest.mark.parametrize("name", ENDINGS)
def test_the_same_twin_gives_the_same_bytes(files, small_twin, tmp_path, name):
    again = export_twin(small_twin, name, tmp_path / files[name].name).path
    assert again.read_bytes() == files[name].read_bytes()
    assert str(tmp_path).encode() not in again.read_bytes()


def test_nothing_is_left_where_writing_fails(small_twin, tmp_path, monkeypatch):
    monkeypatch.setattr("urbantwin.exports.scene.write.write_glb", lambda *a: 1 / 0)
    (tmp_path / "s.glb").write_bytes(b"older")
    with overwriting(allowed=True), pytest.raises(ZeroDivisionError):
        export_twin(small_twin, "glb", tmp_path / "s.glb")
    assert (tmp_path / "s.glb").read_bytes() == b"older"
    assert len(list(tmp_path.iterdir())) == 1
    with pytest.raises(InputError, match="folder"):
        export_twin(small_twin, "ply", tmp_path)
    for name in ("glb", "usd", "fbx", "cityjson"):
        with pytest.raises(InputError, match="ends in"):
            export_twin(small_twin, name, tmp_path / "scene.gltf")


def test_fbx_has_the_glb_s_objects_in_centimetres(files, small_twin):
    model, mesh = read_fbx(files["fbx"]), small_twin.mesh
    assert model.notes["unit_in_file_m"] == 0.01
    # ufbx turns z up as the file's axes tell it to: it is up already.
    assert np.allclose(model.mesh.vertices.min(axis=0), mesh.vertices.min(axis=0), atol=1e-4)
    assert np.allclose(model.mesh.vertices.max(axis=0), mesh.vertices.max(axis=0), atol=1e-4)
    document = gltf(files["glb"])
    materials = [one["name"] for one in document["materials"]]
    wanted = {
        f"{entry['name']} / {materials[part['material']]}": trimesh_of(files["glb"], part).area
        for entry in document["meshes"]
        for part in entry["primitives"]
    }
    corners = model.mesh.vertices[model.mesh.faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    found = np.bincount(model.mesh.object, areas / 2, len(model.mesh.names))
    assert dict(zip(model.mesh.names, found, strict=True)) == pytest.approx(wanted, rel=1e-3)


@functools.cache
def read_once(path):
    """Return the bytes and the JSON of a file that has hundreds of primitives."""
    return path.read_bytes(), gltf(path)


def trimesh_of(path, primitive):
    """A primitive of a glTF, read by hand."""
    data, document = read_once(path)
    start = 28 + struct.unpack("<I", data[12:16])[0]

    def rows(number, kind, width):
        accessor = document["accessors"][number]
        at = start + document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        return np.frombuffer(data, kind, accessor["count"] * width, at).reshape(-1, width)

    faces = rows(primitive["indices"], "<u4", 1).reshape(-1, 3)
    return trimesh.Trimesh(
        rows(primitive["attributes"]["POSITION"], "<f4", 3), faces, process=False
    )


def test_fbx_faces_have_normals_and_texture_coordinates_in_metres(files):
    """As Open3D's own Assimp has them, which turns y up."""
    model = o3d.io.read_triangle_model(str(files["fbx"]))
    count = sum(len(one.mesh.triangles) for one in model.meshes)
    assert count == len(read_fbx(files["fbx"]).mesh.faces)
    for one in model.meshes:
        mesh = one.mesh
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sound = np.linalg.norm(cross, axis=1) > 1.0  # cm2: float32 tells which way it faces
        normal = np.asarray(mesh.vertex_normals)[np.asarray(mesh.triangles)]
        turn = (normal * cross[:, None]).sum(axis=2) / np.linalg.norm(cross, axis=1)[:, None]
        assert turn[sound].min(initial=1.0) > 0.99
        uv = np.asarray(mesh.triangle_uvs).reshape(-1, 3, 2)
        edge, on_map = corners[:, 1] - corners[:, 0], uv[:, 1] - uv[:, 0]
        # Seen from the nearest side: no longer than the edge, and nowhere all of it away.
        assert (np.linalg.norm(on_map, axis=1) <= np.linalg.norm(edge, axis=1) / 100 + 1e-3).all()
        area = np.abs(on_map[:, 0] * (uv[:, 2] - uv[:, 0])[:, 1]
                      - on_map[:, 1] * (uv[:, 2] - uv[:, 0])[:, 0])  # fmt: skip
        assert (area[sound] * 1e4 >= 0.56 * np.linalg.norm(cross, axis=1)[sound]).all()


def test_fbx_says_no_date(files):
    content = files["fbx"].read_bytes()
    date = [
        struct.unpack_from("<i", content, content.index(name + b"I") + len(name) + 1)[0]
        for name in (b"Year", b"Month", b"Day", b"Hour", b"Minute", b"Second", b"Millisecond")
    ]
    assert date == [1970, 1, 1, 0, 0, 0, 0]


def test_fbx_names_are_in_any_script_and_faces_have_their_own_material(tmp_path):
    names = ("信義路 3", "Straße: a/b", "one")
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 1.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    objects = [
        MeshObject(name, square + 10 * k, faces, np.array([0, 1], np.int32), ("a/b", "a/c"))
        for k, name in enumerate(names)
    ]
    looks = {"a/b": Look((0.1, 0.2, 0.3)), "a/c": Look((0.5, 0.5, 0.5), 0.5)}
    write_fbx(objects, tmp_path / "some.fbx", looks)
    mesh = read_fbx(tmp_path / "some.fbx").mesh
    wanted = {f"{name} / {material}" for name in names for material in ("a/b", "a/c")}
    assert set(mesh.names) == wanted
    assert np.bincount(mesh.object).tolist() == [1] * 6


def test_assimp_that_fails_is_told(tmp_path):
    (tmp_path / "broken.glb").write_bytes(b"glTF and nothing more")
    with pytest.raises(StageError, match="Assimp failed"):
        fbx._convert(tmp_path / "broken.glb", tmp_path / "out.fbx")
