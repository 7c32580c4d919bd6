"""glTF that lies, loops or ends early: one line, never a traceback or a giant allocation."""

import json
import random
import resource
import struct
import zlib

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.io.gltf import read_gltf

from .tile_bytes import Gltf, glb

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TWO = [0, 1, 2, 0, 2, 3]


def square() -> Gltf:
    gltf = Gltf()
    return gltf.scene({"mesh": gltf.mesh(SQUARE, TWO)})


def read(data: bytes):
    def beside(uri: str) -> bytes:
        raise FileNotFoundError(uri)

    return read_gltf(data, beside, name="a.glb")


def told(data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        read(data)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("a.glb: ")
    return str(caught.value)


def edited(**changes) -> bytes:
    """The square with fields of its first accessor, view, ... changed."""
    gltf = square()
    for key, fields in changes.items():
        gltf.document[key][0] |= fields
    return gltf.glb()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not JSON"),
        (b"glTF", "ends within its header"),
        (b"\x89PNG\r\n\x1a\n", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"asset": {"version": "3.0"}}', "version 3.0"),
        (b'{"hello": 1}', "not glTF"),
        (square().glb()[:-30], "ends after"),
        (glb({"asset": {"version": "2.0"}}, b""), "no triangles"),
        (edited(accessors={"count": 2**31}), "claims 2147483648"),
        (edited(accessors={"count": 5}), "claims 5 elements"),
        (
            edited(accessors={"count": 10**400}),
            "10000000000000000000, which is not a finite number",
        ),
        (edited(accessors={"count": -1}), "count is -1"),
        (edited(accessors={"bufferView": 77}), "bufferViews 77"),
        (edited(accessors={"bufferView": None, "count": 2**26}), "claims 67108864"),
        (edited(accessors={"componentType": 9}), "components of type 9"),
        (edited(accessors={"type": "MAT4"}), "not of 3 numbers"),
        (edited(bufferViews={"byteLength": 2**33}), "runs to byte"),
        (edited(bufferViews={"byteOffset": "x"}), "not a whole number"),
        (edited(nodes={"mesh": 3}), "mesh 3 does not exist"),
        (edited(nodes={"matrix": [1] * 15}), "16 numbers"),
        (edited(nodes={"matrix": [float("nan")] * 16}), "NaN"),
        (edited(nodes={"rotation": [0, 0, 0, 0]}), "rotation that is zero"),
        (edited(nodes={"scale": [1e300, 1e300, 1e300]}), "without bounds"),
        (edited(scenes={"nodes": "all"}), "not a list"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(data, words):
    assert words in told(data)


def test_nodes_that_loop_or_are_not_there_leave_the_others():
    gltf = Gltf()
    mesh = gltf.mesh(SQUARE, TWO)
    gltf.scene(
        {"mesh": mesh, "children": [0, 1, 9]},
        {"mesh": mesh, "children": [2]},
        {"children": [1]},
        {"mesh": mesh, "scale": [1, 2]},
        {"mesh": mesh},
    )
    gltf.document["scenes"] = [{"nodes": [0, 3, 4]}]
    model = read(gltf.glb())
    assert len(model.mesh.faces) == 6
    assert model.problems == (
        "node 0 is reached twice: nodes are not a tree",
        "node 1 is reached twice: nodes are not a tree",
        "node 9 does not exist",
        "node 3 scale is not a list of 3 numbers",
    )


def test_an_index_beyond_the_vertices_leaves_the_other_mesh():
    gltf = Gltf()
    good, bad = gltf.mesh(SQUARE, TWO), gltf.mesh(SQUARE, [0, 1, 4])
    model = read(gltf.scene({"mesh": good}, {"mesh": bad}).glb())
    assert len(model.mesh.faces) == 2
    assert model.problems == ("mesh 1, primitive 0: has an index 4 beyond its 4 vertices",)


def test_vertices_that_are_not_numbers_lose_their_triangles():
    gltf = Gltf()
    points = np.array(SQUARE, float)
    points[3] = np.nan
    model = read(gltf.scene({"mesh": gltf.mesh(points, TWO)}).glb())
    assert len(model.mesh.faces) == 1
    assert np.isfinite(model.mesh.vertices).all()
    assert "1 of 4 vertices are not finite" in model.problems[0]
    gltf = Gltf()
    gltf.scene({"mesh": gltf.mesh(points * np.nan, TWO)})
    assert "not finite" in told(gltf.glb())


def test_a_buffer_that_is_missing_or_short_is_named():
    gltf = square()
    gltf.document["buffers"] = [{"byteLength": 9, "uri": "gone.bin"}]
    assert "gone.bin cannot be read" in told(json.dumps(gltf.document).encode())
    gltf.document["buffers"] = [{"byteLength": 10**6, "uri": "data:;base64,AAAA"}]
    assert "has 3 bytes" in told(json.dumps(gltf.document).encode())


def test_few_bytes_cannot_unfold_to_endless_triangles():
    """10,000 nodes of one mesh of 10,000 triangles: 700 kB that claim 100 million."""
    gltf = Gltf()
    mesh = gltf.mesh(SQUARE, TWO * 5000)
    data = gltf.scene(*[{"mesh": mesh}] * 10_000).glb()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert "unfolds to more than" in told(data)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2_000_000


def test_draco_that_claims_much_allocates_little():
    head = b"DRACO" + struct.pack("<4BH", 2, 2, 1, 0, 0)
    lie = head + b"\xff\xff\xff\xff\x0f" * 2 + bytes(20)
    gltf = Gltf()
    view = gltf.view(lie)
    gltf.add("accessors", {"componentType": 5126, "count": 3, "type": "VEC3"})
    packed = {"bufferView": view, "attributes": {"POSITION": 0}}
    gltf.add(
        "meshes",
        {
            "primitives": [
                {
                    "attributes": {"POSITION": 0},
                    "extensions": {"KHR_draco_mesh_compression": packed},
                }
            ]
        },
    )
    assert "cannot be read as Draco" in told(gltf.scene({"mesh": 0}).glb())


def test_an_image_that_is_broken_leaves_the_surface():
    gltf = Gltf()
    gltf.add("images", {"bufferView": gltf.view(b"not a picture")})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    uv = {"TEXCOORD_0": gltf.accessor([[0, 0]] * 4, "f4")}
    gltf.scene({"mesh": gltf.mesh(SQUARE, TWO, attributes=uv, material=0)})
    model = read(gltf.glb())
    assert len(model.mesh.faces) == 2
    assert model.problems == ("image 0: an image cannot be read; its material is of one colour",)


def test_any_byte_may_be_wrong(shared_data):
    """Whatever is changed, what comes back is a finite model or one line."""
    draw = random.Random(5)
    path = shared_data / "tiles3d" / "1.0" / "TilesetWithRequestVolume" / "city" / "ll.b3dm"
    sources = [square().glb(), path.read_bytes()[28 + 92 + 640 :]]
    lines: list[str] = []
    for turn in range(600):
        data = bytearray(sources[turn % 2])
        for _ in range(draw.randint(1, 4)):
            data[draw.randrange(len(data))] = draw.choice([0, 1, 127, 255, draw.randrange(256)])
        if turn % 5 == 0:
            del data[draw.randrange(len(data)) :]
        try:
            model = read(bytes(data))
        except InputError as error:
            lines.append(str(error))
        else:
            assert np.isfinite(model.mesh.vertices).all()
            assert model.mesh.faces.max(initial=0) < len(model.mesh.vertices)
    assert lines
    assert not any("\n" in line for line in lines)


def test_colours_and_features_that_are_broken_leave_the_surface():
    gltf = Gltf()
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 4}}})
    attributes = {"COLOR_0": 99, "_FEATURE_ID_0": 98}
    sets = {"EXT_mesh_features": {"featureIds": [{"featureCount": 1, "attribute": 0}]}}
    first = gltf.mesh(SQUARE, TWO, material=0)
    second = gltf.mesh(SQUARE, TWO, attributes=attributes, extensions=sets)
    third = gltf.mesh(SQUARE, TWO, material=7)
    model = read(gltf.scene({"mesh": first}, {"mesh": second}, {"mesh": third}).glb())
    assert len(model.mesh.faces) == 6
    assert len(model.problems) == 3


def test_an_image_that_claims_the_moon_is_not_unpacked():
    """A PNG header of 30,000 x 30,000 pixels: 3.6 GB if it were believed."""
    header = struct.pack(">2I5B", 30_000, 30_000, 8, 6, 0, 0, 0)
    chunk = b"IHDR" + header
    lie = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk
    lie += struct.pack(">I", zlib.crc32(chunk))
    data = zlib.compress(bytes(1000))
    lie += (
        struct.pack(">I", len(data))
        + b"IDAT"
        + data
        + struct.pack(">I", zlib.crc32(b"IDAT" + data))
    )
    gltf = Gltf()
    gltf.add("images", {"bufferView": gltf.view(lie)})
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    model = read(gltf.scene({"mesh": gltf.mesh(SQUARE, TWO, material=0)}).glb())
    assert "claims 30000 x 30000 pixels" in model.problems[0]
