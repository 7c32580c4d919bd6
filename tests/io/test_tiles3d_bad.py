"""Tilesets that climb out, loop, burst or are broken: a line each, and the rest loads."""

import json
import os
import random
import time
import zipfile
import zlib

import numpy as np
import pytest

from urbantwin.errors import InputError

from .tile_bytes import Gltf, b3dm, cmpt, i3dm, pnts
from .tileset_site import names, read, tile, write


def square() -> bytes:
    gltf = Gltf()
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    return gltf.scene({"mesh": gltf.mesh(points, [0, 1, 2, 0, 2, 3])}).glb()


def children(*uris: str) -> dict:
    """A root whose children name these contents."""
    tiles = [tile(0, -9, -9, 9, 9, content={"uri": uri}) for uri in uris]
    return tile(9, -9, -9, 9, 9, refine="ADD", children=tiles)


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.glb",
        "..%2Fsecret.glb",
        "%2e%2e/secret.glb",
        "sub/../../secret.glb",
        "..\\secret.glb",
        "ABSOLUTE",
        "file://ABSOLUTE",
        "file:secret.glb",
        "http://127.0.0.1:9/secret.glb",
        "//127.0.0.1/secret.glb",
        "C:/secret.glb",
        "link.glb",
        "sub/link.glb?../",
    ],
)
def test_no_address_climbs_out_of_the_folder(tmp_path, uri):
    """The file outside is a good tile: were it reached, it would be read."""
    (tmp_path / "secret.glb").write_bytes(square())
    folder = tmp_path / "tiles"
    (folder / "sub").mkdir(parents=True)
    (folder / "link.glb").symlink_to(tmp_path / "secret.glb")
    (folder / "sub" / "link.glb").symlink_to("../../secret.glb")
    uri = uri.replace("ABSOLUTE", str(tmp_path / "secret.glb"))
    path = write(folder, children(uri, "good.glb"), {"good.glb": square()})
    model = read(path)
    assert names(model) == {"good.glb"}
    assert len(model.problems) == 1
    assert "is refused" in model.problems[0]


def test_textures_and_models_of_tiles_do_not_climb_out_either(tmp_path):
    (tmp_path / "secret.glb").write_bytes(square())
    outside = i3dm(
        b"../secret.glb",
        {"INSTANCES_LENGTH": 1},
        {"POSITION": np.zeros((1, 3), "<f4")},
        embedded=False,
    )
    gltf = Gltf()
    gltf.scene({"mesh": gltf.mesh(np.eye(3))})
    document = {**gltf.document, "buffers": [{"uri": "../secret.glb", "byteLength": 9}]}
    files = {
        "a.i3dm": outside,
        "b.gltf": json.dumps(document).encode(),
        "good.glb": square(),
    }
    model = read(write(tmp_path / "tiles", children(*files), files))
    assert names(model) == {"good.glb"}
    assert [problem.split(": it leads")[0] for problem in model.problems] == [
        "a.i3dm: ../secret.glb is refused",
        "b.gltf: mesh 0, primitive 0: ../secret.glb is refused",
    ]


def test_an_address_may_go_up_within_the_folder(tmp_path):
    inner = {
        "asset": {"version": "1.0"},
        "root": tile(0, -9, -9, 9, 9, content={"uri": "../a b.glb"}),
    }
    files = {"sub/inner.json": json.dumps(inner).encode(), "a b.glb": square()}
    model = read(write(tmp_path, children("sub/inner.json", "./sub/../a%20b.glb?v=1"), files))
    assert len(model.mesh.faces) == 4
    assert not model.problems


def test_tilesets_that_contain_themselves_are_told(tmp_path):
    def external(uri: str) -> bytes:
        root = tile(0, -9, -9, 9, 9, content={"uri": uri})
        return json.dumps({"asset": {"version": "1.0"}, "root": root}).encode()

    files = {
        "self.json": external("self.json"),
        "ping.json": external("pong.json"),
        "pong.json": external("ping.json"),
        "disguised": external("disguised"),
        "good.glb": square(),
        **{f"{k}.json": external(f"{k + 1}.json") for k in range(100)},
    }
    path = write(
        tmp_path, children("self.json", "ping.json", "disguised", "0.json", "good.glb"), files
    )
    model = read(path)
    assert names(model) == {"good.glb"}
    assert sorted(model.problems) == [
        "63.json: is nested in more than 64 tilesets",
        "disguised: contains itself",
        "ping.json: contains itself",
        "self.json: contains itself",
    ]


def test_what_unpacks_without_end_is_stopped(tmp_path):
    """260 MiB of zeros in 1 MB, as gzip and inside an archive."""
    zeros = bytes(1 << 20)
    machine = zlib.compressobj(1, wbits=31)
    bomb = b"".join(machine.compress(zeros) for _ in range(260)) + machine.flush()
    assert len(bomb) < 1.5e6
    path = write(tmp_path, children("bomb.b3dm", "good.glb"), {"good.glb": square()})
    (tmp_path / "bomb.b3dm").write_bytes(bomb)
    model = read(path)
    assert model.problems == ("bomb.b3dm: unpacks to more than 256 MiB",)
    assert names(model) == {"good.glb"}
    with zipfile.ZipFile(tmp_path / "a.3tz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.write(path, "tileset.json")
        archive.writestr("good.glb", square())
        with archive.open("bomb.b3dm", "w") as member:
            for _ in range(260):
                member.write(zeros)
    model = read(tmp_path / "a.3tz")
    assert model.problems == ("bomb.b3dm: is larger than 256 MiB",)
    assert names(model) == {"good.glb"}


def test_instances_without_end_are_stopped(tmp_path):
    many = np.zeros((100_000, 3), "<f4")
    gltf = Gltf()
    model = gltf.scene({"mesh": gltf.mesh(np.eye(3), [0, 1, 2] * 1000)}).glb()
    files = {
        "a.i3dm": i3dm(model, {"INSTANCES_LENGTH": 100_000}, {"POSITION": many}),
        "b": square(),
    }
    start = time.perf_counter()
    read_model = read(write(tmp_path, children("a.i3dm", "b"), files))
    assert read_model.problems == ("a.i3dm: unfolds to more than 20000000 triangles",)
    assert time.perf_counter() - start < 5


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("", "is not JSON"),
        ("[1]", "is not a JSON object"),
        ("{}", "has no root"),
        ('{"root": {"boundingVolume": {"box": [1]}}}', "12 numbers"),
        ('{"root": {"boundingVolume": {"region": [0, 9, 0, 9, 0, 0]}}}', "not on the ellipsoid"),
        ('{"root": {"transform": [NaN]}}', "NaN"),
        ('{"root": {"transform": [1e999]}}', "1e999, which is not a finite number"),
        ('{"root": {"children": 4}}', "not a list"),
        ('{"root": {"content": {}}}', "without a uri"),
        ('{"root": {"content": {"uri": 4}}}', "not text"),
        ('{"asset": {"gltfUpAxis": "W"}, "root": {}}', "gltfUpAxis"),
        ('{"root": ' + '{"children": [' * 30_000 + "]}" * 30_000 + "}", "is not JSON"),
        ('{"root": {"children": [{"children": []}]}}', "has a surface or points"),
        ('{"root": {"implicitTiling": {"subdivisionScheme": "HEX"}}}', "HEX"),
    ],
)
def test_a_tileset_that_cannot_be_understood_is_one_line(tmp_path, document, words):
    path = tmp_path / "tileset.json"
    path.write_text(document)
    with pytest.raises(InputError) as caught:
        read(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_what_is_not_there_is_one_line(tmp_path):
    with pytest.raises(InputError, match="not found"):
        read(tmp_path / "tileset.json")
    (tmp_path / "a.3tz").write_bytes(b"PK\x03\x04 and nothing more")
    with pytest.raises(InputError, match="not a ZIP file"):
        read(tmp_path / "a.3tz")


def test_any_byte_of_a_tile_may_be_wrong(tmp_path):
    """Whatever is changed in tiles of every kind, the good one loads and nothing else escapes."""
    draw = random.Random(11)
    places = np.array([[1, 2, 3], [4, 5, 6]], "<f4")
    trees = i3dm(square(), {"INSTANCES_LENGTH": 2}, {"POSITION": places}, {"name": ["a", "b"]})
    cloud = pnts({"POINTS_LENGTH": 2}, {"POSITION": places})
    originals = {
        "a.b3dm": b3dm(square(), {"BATCH_LENGTH": 1}, {"name": ["x"]}),
        "b.i3dm": trees,
        "c.pnts": cloud,
        "d.cmpt": cmpt(trees, cloud, b3dm(square())),
        "e.json": json.dumps({"root": tile(0, -9, -9, 9, 9, content={"uri": "good.glb"})}).encode(),
    }
    names_of_all = [*originals, "good.glb"]
    path = write(tmp_path, children(*names_of_all), {**originals, "good.glb": square()})
    assert not read(path).problems
    for _ in range(40):
        for name, data in originals.items():
            changed = bytearray(data)
            for _ in range(draw.randint(1, 3)):
                changed[draw.randrange(len(changed))] = draw.choice([0, 1, 127, 255, 34, 44])
            if draw.random() < 0.2:
                del changed[draw.randrange(len(changed)) :]
            (tmp_path / name).write_bytes(changed)
        model = read(path)
        assert "good.glb" in names(model)
        assert np.isfinite(model.mesh.vertices).all()
        assert not any("\n" in problem or os.sep * 2 in problem for problem in model.problems)
