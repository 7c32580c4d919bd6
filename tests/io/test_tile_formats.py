"""i3dm, pnts, cmpt and implicit tilings, with coordinates that the test knows."""

import json
import math
import struct

import DracoPy
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from urbantwin.io.tiles3d.content import Context
from urbantwin.io.tiles3d.formats import read_content
from urbantwin.io.tiles3d.implicit import morton
from urbantwin.io.values import MalformedError

from .tile_bytes import Gltf, b3dm, cmpt, i3dm, pnts
from .tileset_site import east_north_up, names, on_site, read, tile, write

#: An arrow: its tip shows x, its fin shows y and its height shows z, once turned z up.
ARROW = np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 2]], float)
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
Z_UP_TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)


def arrow() -> bytes:
    gltf = Gltf()
    return gltf.scene({"mesh": gltf.mesh(ARROW @ Z_UP_TO_Y_UP.T, FACES)}).glb()


def content(data: bytes, transform=None, resolve=None):
    axis = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
    transform = np.eye(4) if transform is None else transform
    return read_content(
        data, Context(resolve or (lambda uri: b""), axis, transform, lambda n: None)
    )


def instances(data: bytes, **more) -> np.ndarray:
    """(N, 4, 3) corners of the arrow's instances, in the order of ARROW."""
    (mesh,) = content(data, **more).meshes
    return mesh.vertices.reshape(-1, 4, 3)


def posed(place, turn=None, size=(1, 1, 1)) -> np.ndarray:
    turn = np.eye(3) if turn is None else turn
    return (ARROW * size) @ np.asarray(turn).T + place


PLACES = np.array([[10, 20, 30], [-5, 0.5, 2], [7, 7, 7]], "<f4")


def test_instances_at_plain_places_with_both_scales():
    columns = {
        "POSITION": PLACES,
        "SCALE": np.array([1, 2, 3], "<f4"),
        "SCALE_NON_UNIFORM": np.array([[1, 1, 1], [1, 2, 3], [0.5, 1, 1]], "<f4"),
    }
    got = instances(i3dm(arrow(), {"INSTANCES_LENGTH": 3, "RTC_CENTER": [100, 0, 0]}, columns))
    sizes = columns["SCALE"][:, None] * columns["SCALE_NON_UNIFORM"]
    for k in range(3):
        np.testing.assert_allclose(got[k], posed(PLACES[k] + [100, 0, 0], size=sizes[k]), atol=1e-6)


def oct_encoded(vectors: np.ndarray) -> np.ndarray:
    """Encode unit vectors (Cigolle et al. 2014, listing 1)."""
    n = vectors / np.abs(vectors).sum(axis=1, keepdims=True)
    xy = n[:, :2].copy()
    below = n[:, 2] < 0
    sign = np.where(xy >= 0, 1.0, -1.0)
    xy[below] = (1 - np.abs(xy[below][:, ::-1])) * sign[below]
    return np.round((xy * 0.5 + 0.5) * 65535).astype("<u2")


@pytest.mark.parametrize("packed", [False, True])
def test_instances_turn_by_their_up_and_right(packed):
    turns = Rotation.from_euler("zyx", [[0.3, 0.2, 0.1], [2.0, -1.0, 3.0], [-2.5, 1.2, -0.7]])
    right, up = turns.apply([1, 0, 0]), turns.apply([0, 1, 0])
    columns = {"POSITION": PLACES}
    if packed:
        columns |= {"NORMAL_UP_OCT32P": oct_encoded(up), "NORMAL_RIGHT_OCT32P": oct_encoded(right)}
    else:
        columns |= {"NORMAL_UP": up.astype("<f4"), "NORMAL_RIGHT": right.astype("<f4")}
    got = instances(i3dm(arrow(), {"INSTANCES_LENGTH": 3}, columns))
    for k in range(3):
        expected = posed(PLACES[k], turns[k].as_matrix())
        np.testing.assert_allclose(got[k], expected, atol=1e-3 if packed else 1e-5)


def test_instances_at_quantised_places_of_a_model_beside_the_tile():
    steps = np.array([[0, 0, 0], [65535, 65535, 65535], [13107, 26214, 39321]], "<u2")
    features = {
        "INSTANCES_LENGTH": 3,
        "QUANTIZED_VOLUME_OFFSET": [-10, 5, 0],
        "QUANTIZED_VOLUME_SCALE": [20, 10, 100],
    }
    data = i3dm(b"tree model.glb  ", features, {"POSITION_QUANTIZED": steps}, embedded=False)
    asked = []

    def resolve(uri):
        asked.append(uri)
        return arrow()

    got = instances(data, resolve=resolve)
    places = [[-10, 5, 0], [10, 15, 100], [-6, 9, 60]]
    for k in range(3):
        np.testing.assert_allclose(got[k], posed(places[k]), atol=1e-6)
    assert asked == ["tree model.glb"]


@pytest.mark.parametrize("local", [False, True])
def test_instances_face_east_north_up(local):
    """With Earth-centred positions, and with local ones that the tile's transform moves there."""
    frame = east_north_up()
    offsets = np.array([[0, 0, 0], [1000, 2000, 10]], float)
    features = {"INSTANCES_LENGTH": 2, "EAST_NORTH_UP": True}
    if local:
        transform = frame
        data = i3dm(arrow(), features, {"POSITION": offsets.astype("<f4")})
    else:
        transform = np.eye(4)
        features["RTC_CENTER"] = frame[:3, 3].tolist()
        data = i3dm(arrow(), features, {"POSITION": (offsets @ frame[:3, :3].T).astype("<f4")})
    got = instances(data, transform=transform) @ transform[:3, :3].T + transform[:3, 3]
    for k in range(2):
        axes = (got[k, 1:] - got[k, 0]) / [[3], [1], [2]]
        # East, north and up as the place's longitude and the ellipsoid's normal have them.
        x, y, z = got[k, 0]
        a2, b2 = 6378137.0**2, 6356752.3142**2
        up = np.array([x / a2, y / a2, z / b2]) / np.linalg.norm([x / a2, y / a2, z / b2])
        east = np.array([-y, x, 0]) / math.hypot(x, y)
        np.testing.assert_allclose(axes, [east, np.cross(up, east), up], atol=2e-6)


def test_instances_are_objects_with_names():
    columns = {"POSITION": PLACES, "BATCH_ID": np.array([1, 0, 1], "<u2")}
    data = i3dm(arrow(), {"INSTANCES_LENGTH": 3}, columns, {"name": ["oak", "lime"]})
    (mesh,) = content(data).meshes
    assert mesh.names == ("lime / node 0", "oak / node 0", "lime / node 0")
    np.testing.assert_array_equal(mesh.object, np.repeat([0, 1, 2], 4))


def test_points_with_every_kind_of_colour():
    points = np.array([[1, 2, 3], [4, 5, 6]], "<f4")
    head = {"POINTS_LENGTH": 2, "RTC_CENTER": [1000, 0, 0]}
    kinds = {
        "RGB": (np.array([[255, 0, 0], [1, 2, 3]], "u1"), [[255, 0, 0], [1, 2, 3]]),
        "RGBA": (np.array([[255, 0, 0, 9], [1, 2, 3, 9]], "u1"), [[255, 0, 0], [1, 2, 3]]),
        "RGB565": (np.array([0xF800, 0x07FF], "<u2"), [[255, 0, 0], [0, 255, 255]]),
    }
    for key, (column, colours) in kinds.items():
        (cloud,) = content(pnts(head, {"POSITION": points, key: column})).clouds
        np.testing.assert_array_equal(cloud.points, points + [1000, 0, 0])
        np.testing.assert_array_equal(cloud.colour, colours)
    (cloud,) = content(pnts({**head, "CONSTANT_RGBA": [9, 8, 7, 6]}, {"POSITION": points})).clouds
    np.testing.assert_array_equal(cloud.colour, [[9, 8, 7]] * 2)
    (cloud,) = content(pnts(head, {"POSITION": points})).clouds
    assert cloud.colour is None


def test_points_quantised_and_by_draco():
    features = {
        "POINTS_LENGTH": 2,
        "QUANTIZED_VOLUME_OFFSET": [0, 0, -1],
        "QUANTIZED_VOLUME_SCALE": [65535, 10, 2],
    }
    steps = np.array([[7, 65535, 0], [65535, 0, 65535]], "<u2")
    (cloud,) = content(pnts(features, {"POSITION_QUANTIZED": steps})).clouds
    np.testing.assert_allclose(cloud.points, [[7, 10, -1], [65535, 0, 1]])
    points = np.random.default_rng(0).uniform(-50, 50, (500, 3)).astype("<f4")
    colours = np.random.default_rng(1).integers(0, 255, (500, 3)).astype("u1")
    packed = DracoPy.encode(points, quantization_bits=20, colors=colours)
    ids = {a["attribute_type"]: a["unique_id"] for a in DracoPy.decode(packed).attributes}
    extension = {
        "properties": {"POSITION": ids[0], "RGB": ids[2]},
        "byteOffset": 0,
        "byteLength": len(packed),
    }
    features = {
        "POINTS_LENGTH": 500,
        "extensions": {"3DTILES_draco_point_compression": extension},
        "POSITION": {"byteOffset": 0},
        "RGB": {"byteOffset": 0},
    }
    (cloud,) = content(pnts(features, {"body": np.frombuffer(packed, "u1")})).clouds
    ours = np.concatenate([cloud.points, cloud.colour / 10], axis=1)
    theirs = np.concatenate([points, colours / 10], axis=1)
    distance = np.abs(ours[:, None] - theirs[None]).sum(axis=2).min(axis=1)
    assert distance.max() < 1e-3


def test_a_composite_holds_tiles_of_every_kind_and_other_composites():
    cloud = pnts({"POINTS_LENGTH": 1}, {"POSITION": np.array([[1, 2, 3]], "<f4")})
    trees = i3dm(arrow(), {"INSTANCES_LENGTH": 3}, {"POSITION": PLACES})
    broken = b3dm(b"glTFnonsense")
    result = content(cmpt(b3dm(arrow()), cmpt(cloud, trees), broken))
    assert [len(mesh.faces) for mesh in result.meshes] == [4, 12]
    assert len(result.clouds[0].points) == 1
    assert len(result.problems) == 1
    assert result.problems[0].startswith("inner tile 2: ")
    nested = arrow()
    for _ in range(20):
        nested = cmpt(nested)
    with pytest.raises(MalformedError, match="beyond reason"):
        content(nested)


def test_b3dm_with_batch_ids():
    gltf = Gltf()
    points = np.concatenate([ARROW, ARROW + 10]) @ Z_UP_TO_Y_UP.T
    batch = gltf.accessor(np.repeat([1, 0], 4), "u2")
    faces = [*FACES, *(np.array(FACES) + 4).tolist()]
    model = gltf.scene(
        {"mesh": gltf.mesh(points, np.ravel(faces), attributes={"_BATCHID": batch})}
    ).glb()
    (mesh,) = content(b3dm(model, {"BATCH_LENGTH": 2}, {"gml_id": ["a", "b"]})).meshes
    assert mesh.names == ("node 0 / a", "node 0 / b")
    np.testing.assert_array_equal(mesh.object, [1] * 4 + [0] * 4)


# --- implicit tilings -------------------------------------------------------------------------


def bits(available: set[int], count: int) -> bytes:
    flags = np.zeros(-(-count // 8) * 8, bool)
    flags[list(available)] = True
    return np.packbits(flags, bitorder="little").tobytes()


def test_morton_order_is_that_of_the_standard():
    """3D Tiles 1.1, "Availability Bitstream Lengths" and the figures of the Morton order."""
    assert [morton((x, y)) for y in range(2) for x in range(2)] == [0, 1, 2, 3]
    assert morton((3, 5)) == 0b100111
    assert morton((1, 0, 0)) == 1
    assert morton((0, 1, 0)) == 2
    assert morton((0, 0, 1)) == 4


@pytest.mark.parametrize("form", ["json 1.1", "binary 1.0"])
def test_an_octree_of_two_subtrees_reads_what_is_available_near_the_region(tmp_path, form):
    """A cube of 160 m, four levels of two per subtree; contents on the finest level only."""
    cells = {(0, 0, 0), (4, 4, 0), (3, 4, 1), (7, 7, 7)}  # of 20 m each
    parents = {tuple(v // 4 for v in cell) for cell in cells}  # tops of subtrees, 80 m
    files = {}

    def subtree(name: str, tiles: set[int], contents: set[int], children: set[int]) -> None:
        parts = [bits(tiles, 9), bits(contents, 9), bits(children, 64)]
        views, body = [], b""
        for part in parts:
            views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(part)})
            body += part + b"\0" * (-len(part) % 8)
        key = "bitstream" if form == "json 1.1" else "bufferView"
        content = {key: 1} if contents else {"constant": 0}
        document = {
            "buffers": [{"byteLength": len(body)}],
            "bufferViews": views,
            "tileAvailability": {key: 0},
            "contentAvailability": [content] if form == "json 1.1" else content,
            "childSubtreeAvailability": {key: 2},
        }
        if form == "json 1.1":
            document["buffers"][0]["uri"] = name.rpartition("/")[2] + ".bin"
            files[name] = json.dumps(document).encode()
            files[name + ".bin"] = body
        else:
            text = json.dumps(document).encode()
            text += b" " * (-len(text) % 8)
            head = struct.pack("<4sIQQ", b"subt", 1, len(text), len(body))
            files[name] = head + text + body

    # Level 1 tiles (80 m) are the second level of the first subtree; its children are of 40 m.
    forties = {tuple(v // 2 for v in cell) for cell in cells}
    subtree(
        "s/0.0.0.0",
        {0} | {1 + morton(p) for p in parents},
        set(),
        {morton(f) for f in forties},
    )
    for forty in forties:
        inside = {c for c in cells if tuple(v // 2 for v in c) == forty}
        local = {1 + morton(tuple(v % 2 for v in c)) for c in inside}
        subtree("s/2.{}.{}.{}".format(*forty), {0} | local, local, set())
    for x, y, z in cells:
        box = trimesh.creation.box([2, 2, 2])
        box.apply_translation([-70 + 20 * x, 10 + 20 * z, 70 - 20 * y])
        files[f"c/3_{x}_{y}_{z}.glb"] = box.export(file_type="glb")
    implicit = {
        "subdivisionScheme": "OCTREE",
        "subtreeLevels": 2,
        "subtrees": {"uri": "s/{level}.{x}.{y}.{z}"},
    }
    root = {
        "boundingVolume": {"box": [0, 0, 80, 80, 0, 0, 0, 80, 0, 0, 0, 80]},
        "geometricError": 64,
        "refine": "REPLACE",
        "content": {"uri": "c/{level}_{x}_{y}_{z}.glb"},
    }
    if form == "json 1.1":
        root["implicitTiling"] = {**implicit, "availableLevels": 4}
    else:
        root["extensions"] = {"3DTILES_implicit_tiling": {**implicit, "maximumLevel": 3}}
    model = read(write(tmp_path, root, files), geometric_error_m=1.0)
    # (0, 0, 0) spans -80..-60 m: outside of the region of -50..50 m. (7, 7, 7) as well.
    assert names(model) == {"c/3_4_4_0.glb", "c/3_3_4_1.glb"}
    assert not model.problems
    middle = on_site(model.mesh.vertices).reshape(2, 8, 3).mean(axis=1)
    middle = middle[np.argsort(middle[:, 0])]
    np.testing.assert_allclose(middle, [[-10, 10, 30], [10, 10, 10]], atol=1e-5)


def test_a_subtree_that_is_too_short_is_told_and_the_rest_loads(tmp_path):
    gltf = Gltf()
    files = {
        "good.glb": gltf.scene({"mesh": gltf.mesh(ARROW, FACES)}).glb(),
        "0.subtree": json.dumps(
            {
                "buffers": [{"byteLength": 1, "uri": "data.bin"}],
                "bufferViews": [{"buffer": 0, "byteLength": 1}],
                "tileAvailability": {"bitstream": 0},
                "contentAvailability": [{"constant": 1}],
                "childSubtreeAvailability": {"constant": 0},
            }
        ).encode(),
        "data.bin": b"\xff",
    }
    implicit = {
        "subdivisionScheme": "QUADTREE",
        "subtreeLevels": 3,
        "availableLevels": 3,
        "subtrees": {"uri": "{x}.subtree"},
    }
    children = [
        tile(1, -9, -9, 9, 9, content={"uri": "{x}.glb"}, implicitTiling=implicit),
        tile(0, -9, -9, 9, 9, content={"uri": "good.glb"}),
    ]
    model = read(write(tmp_path, tile(9, -9, -9, 9, 9, children=children), files))
    assert names(model) == {"good.glb"}
    assert model.problems == ("0.subtree: has 8 bits for 21 tiles",)
