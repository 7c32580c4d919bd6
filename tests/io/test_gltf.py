"""glTF as it is read: against trimesh, and against coordinates that the test knows."""

import io
import json
import struct

import DracoPy
import meshopt
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.io.gltf import read_gltf

from ..real_files import MODELS
from .tile_bytes import Gltf, glb, same_triangles

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TWO = [0, 1, 2, 0, 2, 3]


def nothing_beside(uri: str) -> bytes:
    raise FileNotFoundError(uri)


def read(gltf: Gltf | bytes):
    data = gltf if isinstance(gltf, bytes) else gltf.glb()
    return read_gltf(data, nothing_beside, name="a.glb")


def test_real_models_are_what_trimesh_reads(shared_data):
    for file in (shared_data / "meshes" / name for name in MODELS):
        ours = read_gltf(
            file.read_bytes(), lambda uri, f=file: (f.parent / uri).read_bytes(), name=""
        )
        assert ours.up == "y"
        assert ours.unit_m == 1.0
        assert not ours.problems
        theirs = trimesh.load(file, force="mesh", process=False)
        assert same_triangles(ours.mesh, theirs)
        assert ours.files[""] != ours.files.get("colormap.png")


def test_what_trimesh_writes_comes_back(tmp_path):
    scene = trimesh.Scene()
    boxes = []
    for number in range(3):
        place = trimesh.transformations.rotation_matrix(0.3 + number, [1, 2, 3], [4, 5, 6])
        box = trimesh.creation.box([1, 2, 3 + number])
        scene.add_geometry(box, node_name=f"box {number}", transform=place)
        boxes.append(box.copy().apply_transform(place))
    model = read(scene.export(file_type="glb"))
    theirs = trimesh.util.concatenate(boxes)
    assert same_triangles(model.mesh, theirs)
    assert sorted(name.split(" / ")[0] for name in model.mesh.names) == [
        "box 0",
        "box 1",
        "box 2",
    ]


def test_strips_fans_and_lists_give_the_same_polygon():
    ring = [[np.cos(a), np.sin(a), 0] for a in np.arange(6) * np.pi / 3]
    zigzag = [0, 1, 5, 2, 4, 3]
    for mode, indices in ((6, None), (5, zigzag), (4, [0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5])):
        gltf = Gltf()
        gltf.scene({"mesh": gltf.mesh(ring, indices, mode=mode)})
        mesh = read(gltf).mesh
        a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
        normals = np.cross(b - a, c - a) / 2
        assert len(mesh.faces) == 4
        np.testing.assert_allclose(normals.sum(axis=0), [0, 0, 1.5 * np.sqrt(3)], atol=1e-6)
        assert (normals[:, 2] > 0).all()


def test_transforms_cascade_in_double_precision():
    """A parent 6,000 km away: float32 would be off by 0.25 m."""
    gltf = Gltf()
    mesh = gltf.mesh(SQUARE, TWO)
    far = [1215011.9317263428, -4736309.3434217675, 4081602.0044800863]
    turn = Rotation.from_euler("zyx", [0.4, -0.2, 1.1])
    gltf.scene(
        {"translation": far, "children": [1]},
        {"rotation": turn.as_quat().tolist(), "scale": [2, 3, -1], "mesh": mesh},
    )
    gltf.document["scenes"] = [{"nodes": [0]}]
    model = read(gltf)
    expected = far + turn.apply(np.array(SQUARE) * [2, 3, -1])
    got = {tuple(v) for v in np.round(model.mesh.vertices, 6)}
    assert got == {tuple(v) for v in np.round(expected, 6)}
    # The scale mirrors: triangles keep their outside.
    a, b, c = model.mesh.triangles()[0]
    outside = np.cross(b - a, c - a) @ turn.apply([0, 0, 1.0])
    assert outside < 0


def test_a_matrix_is_stored_column_by_column():
    gltf = Gltf()
    gltf.scene(
        {
            "mesh": gltf.mesh(SQUARE, TWO),
            "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1],
        }
    )
    assert {tuple(v) for v in read(gltf).mesh.vertices} == {
        (7, 8, 9),
        (7, 9, 9),
        (6, 9, 9),
        (6, 8, 9),
    }


def test_stride_offset_sparse_and_normalised_integers():
    gltf = Gltf()
    # Interleaved: 3 unsigned shorts of position, 2 bytes of padding; two leading rows to skip.
    rows = np.zeros(6, [("p", "<u2", 3), ("pad", "<u2")])
    rows["p"][2:] = np.array(SQUARE) * 65535
    view = gltf.view(rows.tobytes(), byteStride=8)
    position = gltf.add(
        "accessors",
        {
            "bufferView": view,
            "byteOffset": 16,
            "componentType": 5123,
            "normalized": True,
            "count": 4,
            "type": "VEC3",
            "sparse": {
                "count": 1,
                "indices": {
                    "bufferView": gltf.view(struct.pack("<B", 2)),
                    "componentType": 5121,
                },
                "values": {"bufferView": gltf.view(struct.pack("<3H", 65535, 65535, 13107))},
            },
        },
    )
    indices = gltf.accessor(TWO, "u1")
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]})
    gltf.scene({"mesh": 0, "scale": [10, 10, 10]})
    assert sorted(map(tuple, read(gltf).mesh.vertices.round(6))) == [
        (0, 0, 0),
        (0, 10, 0),
        (10, 0, 0),
        (10, 10, 2),
    ]


def test_signed_bytes_are_fractions_of_127():
    gltf = Gltf()
    position = gltf.accessor([[-128, 0, 0], [127, 0, 0], [0, 127, 0]], "i1", normalized=True)
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]})
    vertices = read(gltf.scene({"mesh": 0})).mesh.vertices
    np.testing.assert_allclose(vertices, [[-1, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_draco_as_dracopy_packs_it():
    ball = trimesh.creation.icosphere(3, 10.0)
    packed = DracoPy.encode(ball.vertices, ball.faces, quantization_bits=20)
    gltf = Gltf()
    view = gltf.view(packed)
    count = {"componentType": 5126, "count": len(ball.vertices), "type": "VEC3"}
    position = gltf.add("accessors", count)
    identity = next(
        a["unique_id"] for a in DracoPy.decode(packed).attributes if not a["attribute_type"]
    )
    gltf.add(
        "meshes",
        {
            "primitives": [
                {
                    "attributes": {"POSITION": position},
                    "extensions": {
                        "KHR_draco_mesh_compression": {
                            "bufferView": view,
                            "attributes": {"POSITION": identity},
                        }
                    },
                }
            ]
        },
    )
    mesh = read(gltf.scene({"mesh": 0})).mesh
    assert len(mesh.faces) == len(ball.faces)
    volume = trimesh.Trimesh(mesh.vertices, mesh.faces).volume
    assert volume == pytest.approx(ball.volume, rel=1e-4)


def test_meshopt_as_meshoptimizer_packs_it():
    ball = trimesh.creation.icosphere(2, 5.0)
    points = ball.vertices.astype("<f4")
    gltf = Gltf()
    for rows, mode, stride in (
        (points, "ATTRIBUTES", 12),
        (ball.faces.astype("<u4").reshape(-1), "TRIANGLES", 4),
    ):
        packed = bytes(meshopt.encode_gltf_buffer(rows, mode))
        where = gltf.view(packed)
        spec = gltf.document["bufferViews"][where]
        spec["extensions"] = {
            "EXT_meshopt_compression": {
                **{key: spec[key] for key in ("buffer", "byteOffset", "byteLength")},
                "byteStride": stride,
                "count": len(rows),
                "mode": mode,
            }
        }
    gltf.add(
        "accessors",
        {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
    )
    gltf.add(
        "accessors",
        {"bufferView": 1, "componentType": 5125, "count": ball.faces.size, "type": "SCALAR"},
    )
    gltf.add("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
    assert same_triangles(read(gltf.scene({"mesh": 0})).mesh, ball)


def test_instances_stand_where_their_attributes_say():
    gltf = Gltf()
    mesh = gltf.mesh(SQUARE, TWO)
    places = np.array([[10, 0, 0], [20, 0, 5]], float)
    turns = Rotation.from_rotvec([[0, 0, 0], [0, 0.5, 0]])
    sizes = np.array([[1, 1, 1], [2, 2, 2]], float)
    attributes = {
        "TRANSLATION": gltf.accessor(places, "f4"),
        "ROTATION": gltf.accessor(turns.as_quat(), "f4"),
        "SCALE": gltf.accessor(sizes, "f4"),
    }
    gltf.scene(
        {
            "mesh": mesh,
            "translation": [0, 100, 0],
            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}},
        }
    )
    mesh = read(gltf).mesh
    for number in range(2):
        corners = np.unique(mesh.vertices[mesh.faces[mesh.object == number]].reshape(-1, 3), axis=0)
        expected = turns[number].apply(np.array(SQUARE) * sizes[number]) + places[number]
        expected = expected + [0, 100, 0]
        assert np.abs(corners[:, None] - expected).sum(axis=2).min(axis=1).max() < 1e-5
    assert mesh.names == ("node 0 #0", "node 0 #1")


def picture(rows: list[list[tuple[int, int, int]]]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(np.array(rows, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def textured(corner: tuple[float, float], extension: dict | None = None, **material) -> Gltf:
    """A small square laid on a picture of 2 x 2: red, green above blue, white."""
    gltf = Gltf()
    image = gltf.view(picture([[RED, GREEN], [BLUE, WHITE]]))
    gltf.add("images", {"bufferView": image, "mimeType": "image/png"})
    gltf.add("textures", {"source": 0})
    info = {"index": 0, **({"extensions": extension} if extension else {})}
    gltf.add(
        "materials",
        {"name": "wall", "pbrMetallicRoughness": {"baseColorTexture": info, **material}},
    )
    uv = np.array(corner) + 0.1 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    attributes = {"TEXCOORD_0": gltf.accessor(uv, "f4")}
    gltf.scene({"name": "house", "mesh": gltf.mesh(SQUARE, TWO, attributes=attributes, material=0)})
    return gltf


@pytest.mark.parametrize(
    ("corner", "extension", "colour"),
    [
        ((0.2, 0.2), None, RED),
        ((0.7, 0.2), None, GREEN),
        ((0.2, 0.7), None, BLUE),
        ((1.7, -0.3), None, WHITE),  # repeated
        ((0.2, 0.2), {"KHR_texture_transform": {"offset": [0.5, 0.0]}}, GREEN),
        ((0.3, 0.3), {"KHR_texture_transform": {"scale": [2, 2]}}, WHITE),
        # Turned by 90 degrees: (u, v) -> (v, -u), so (0.2..0.3, 0.7..0.8) -> (0.75, -0.25).
        ((0.2, 0.7), {"KHR_texture_transform": {"rotation": np.pi / 2}}, WHITE),
    ],
)
def test_colour_is_what_the_picture_shows_there(corner, extension, colour):
    mesh = read(textured(corner, extension)).mesh
    assert (mesh.colour == colour).all()
    assert mesh.names == ("house / wall",)


def test_a_mean_is_taken_in_light_and_multiplied_by_the_factor():
    """Half white, half black is 188 in sRGB (IEC 61966-2-1), not 128."""
    gltf = Gltf()
    image = gltf.view(picture([[WHITE, (0, 0, 0)]]))
    gltf.add("images", {"bufferView": image})
    gltf.add("textures", {"source": 0})
    gltf.add(
        "materials",
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": 0},
                "baseColorFactor": [1.0, 0.5, 0.0, 1.0],
            }
        },
    )
    attributes = {"TEXCOORD_0": gltf.accessor([[0, 0], [64, 0], [64, 64], [0, 64]], "f4")}
    gltf.scene({"mesh": gltf.mesh(SQUARE, TWO, attributes=attributes, material=0)})
    red, green, blue = read(gltf).mesh.colour[0].astype(int)
    assert abs(red - 188) <= 3
    assert abs(green - 137) <= 3
    assert blue == 0


def test_vertex_colours_of_bytes_and_points():
    gltf = Gltf()
    colour = gltf.accessor([[255, 0, 0, 255]] * 4, "u1", normalized=True)
    gltf.scene(
        {"mesh": gltf.mesh(SQUARE, TWO, attributes={"COLOR_0": colour})},
        {"mesh": gltf.mesh(SQUARE, mode=0, attributes={"COLOR_0": colour})},
        {"mesh": gltf.mesh(SQUARE, mode=1)},
    )
    model = read(gltf)
    assert (model.mesh.colour == RED).all()
    assert (model.cloud.colour == RED).all()
    np.testing.assert_array_equal(model.cloud.points, SQUARE)
    assert model.notes == {"primitives of lines left out": 1}


def test_features_keep_buildings_apart_and_have_their_names():
    gltf = Gltf()
    points = np.concatenate([np.array(SQUARE) + [5 * k, 0, 0] for k in range(3)])
    faces = np.concatenate([np.array(TWO) + 4 * k for k in range(3)])
    attributes = {"_FEATURE_ID_0": gltf.accessor(np.repeat([2, 0, 7], 4), "u1")}
    names = [b"church", b"", b"town hall"]
    strings = gltf.view(b"".join(names))
    offsets = gltf.view(np.cumsum([0, *map(len, names)]).astype("<u4").tobytes())
    sets = {
        "featureIds": [{"featureCount": 3, "attribute": 0, "nullFeatureId": 7, "propertyTable": 0}]
    }
    gltf.document["extensions"] = {
        "EXT_structural_metadata": {
            "schema": {"classes": {"b": {"properties": {"Name": {"type": "STRING"}}}}},
            "propertyTables": [
                {
                    "class": "b",
                    "count": 3,
                    "properties": {"Name": {"values": strings, "stringOffsets": offsets}},
                }
            ],
        }
    }
    mesh = gltf.mesh(points, faces, attributes=attributes, extensions={"EXT_mesh_features": sets})
    mesh = read(gltf.scene({"name": "n", "mesh": mesh})).mesh
    by_x = {
        int(mesh.vertices[f, 0].min()): mesh.names[o]
        for f, o in zip(mesh.faces, mesh.object, strict=True)
    }
    assert by_x == {0: "n / town hall", 5: "n / church", 10: "n"}


def test_a_centre_of_the_document_is_added_after_the_turn():
    gltf = Gltf()
    centre = [1215011.5, -4736309.25, 4081602.125]
    gltf.document["extensions"] = {"CESIUM_RTC": {"center": centre}}
    gltf.scene({"mesh": gltf.mesh([[0, 1, 0], [1, 1, 0], [0, 1, 1]])})
    model = read(gltf)
    assert model.crs.to_epsg() == 4978
    assert model.up == "z"
    # y up (0, 1, 0) is z up (0, 0, 1).
    np.testing.assert_allclose(model.mesh.vertices[0], np.array(centre) + [0, 0, 1])


@pytest.mark.parametrize(
    "data",
    [
        b'{"asset": {"version": "1.0"}, "meshes": {}}',
        struct.pack("<4s4I", b"glTF", 1, 22, 2, 0) + b"{}",
    ],
)
def test_version_1_is_refused_by_its_name(data):
    with pytest.raises(InputError, match="is glTF of version 1"):
        read(data)


def test_json_with_its_buffer_beside_it():
    gltf = Gltf()
    gltf.scene({"mesh": gltf.mesh(SQUARE, TWO)})
    gltf.document["buffers"] = [{"byteLength": len(gltf.binary), "uri": "a b.bin"}]
    asked = []

    def resolve(uri):
        asked.append(uri)
        return gltf.binary

    model = read_gltf(json.dumps(gltf.document).encode(), resolve, name="a.gltf")
    assert len(model.mesh.faces) == 2
    assert asked == ["a b.bin"]
    assert set(model.files) == {"a.gltf", "a b.bin"}
    assert glb(gltf.document, b"")[:4] == b"glTF"
