"""Bad files of geometry: meshes, clouds, city models, tiles, and what stands beside them."""

import gzip
import json
import struct
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import DracoPy
import laspy
import meshopt
import numpy as np
import pye57
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.io import read_model
from urbantwin.reconstruct import Surroundings
from urbantwin.reconstruct.build import reconstruct
from urbantwin.reconstruct.georeference.control_points import fit, read_control_points
from urbantwin.site.geometry import GeometrySource, GeometrySpec, SimilaritySpec
from urbantwin.site.yaml_document import Document

from ..io.city_gml import block, city, house
from ..io.tile_bytes import Gltf, b3dm, cmpt, i3dm, pnts
from ..reconstruct.model_files import BOX, BOX_QUADS
from .harness import NUMBERS
from .reader import SHARED_DATA, Reader
from .test_site_readers import files, inspected, made

TILES = SHARED_DATA / "tiles3d"
PLACES = np.array([[0, 0, 0], [10, 0, 5], [0, -20, 1]], "<f4")
FRAME = SiteFrame(52.0113, 4.3664)
REGION = shapely.box(-60, -60, 60, 60)


def read_around(path: Path) -> None:
    """What `inspect` and `build` do with a source."""
    inspected(path)
    source = GeometrySource(
        GeometrySpec(file=path.name), Document(path.parent / "site.yaml", {}), 0
    )
    read_model(source, FRAME, REGION)


def of_folder(path: Path) -> None:
    folder = path.parent
    while not folder.name.startswith("fuzz-"):
        folder = folder.parent
    inspected(folder)


def of_tileset(path: Path) -> None:
    folder = path.parent
    while not (folder / "tileset.json").is_file():
        folder = folder.parent
    inspected(folder / "tileset.json")


def _obj() -> list[bytes]:
    rows = [b"mtllib a.mtl\no box\nusemtl red"]
    rows += [b"v %g %g %g" % tuple(row) for row in BOX]
    rows += [b"vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1"]
    rows += [b"f " + b" ".join(b"%d/%d" % (v + 1, t + 1) for t, v in enumerate(quad))
             for quad in BOX_QUADS]  # fmt: skip
    plain = (
        b"v 0 0 0 1 0 0\nv 4 0 0 1 0 0\nv 4 4 0 0 1 0\nv 2 1 0 0 0 1\nv 0 4 0 0 0 1\nf 1 2 3 4 5\n"
    )
    return [b"\n".join(rows) + b"\n", plain + b"g more\nf -1 -2 -3\n"]


def _mtl() -> list[bytes]:
    return [b"newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 picture.png\n\nnewmtl blue\nKd 0 0 1\nd 0.5\n"]


@cache
def _png() -> bytes:
    from PIL import Image

    pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5
    return made("a.png", lambda path: Image.fromarray(pixels).save(path))


def _ply_ascii() -> bytes:
    head = b"ply\nformat ascii 1.0\nelement vertex 8\n"
    head += b"".join(b"property float %s\n" % name for name in (b"x", b"y", b"z"))
    head += b"element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [b"%g %g %g" % tuple(row) for row in BOX]
    rows += [b"4 %d %d %d %d" % tuple(quad) for quad in BOX_QUADS]
    return head + b"\n".join(rows) + b"\n"


def _ply_binary() -> bytes:
    head = b"ply\nformat binary_little_endian 1.0\ncomment made\nelement vertex 8\n"
    head += b"".join(b"property double %s\n" % name for name in (b"x", b"y", b"z"))
    head += b"property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += b"element face 6\nproperty list uchar int vertex_indices\n"
    head += b"property list uchar float texcoord\nend_header\n"
    body = b"".join(struct.pack("<3d3B", *row, 1, 2, 3) for row in BOX)
    body += b"".join(struct.pack("<B4iB2f", 4, *quad, 2, 0.5, 0.5) for quad in BOX_QUADS)
    return head + body


def _ply_cloud() -> bytes:
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 20\n"
    head += b"property float x\nproperty float y\nproperty float z\nend_header\n"
    return head + np.random.default_rng(1).uniform(0, 9, (20, 3)).astype("<f4").tobytes()


def _stl() -> list[bytes]:
    quads = BOX[BOX_QUADS]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    binary = bytes(80) + struct.pack("<I", len(triangles))
    binary += b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in triangles)
    text = b"solid box\n"
    for triangle in triangles:
        text += b"facet normal 0 0 0\nouter loop\n"
        text += b"".join(b"vertex %g %g %g\n" % tuple(p) for p in triangle)
        text += b"endloop\nendfacet\n"
    return [binary, text + b"endsolid box\n"]


def _box(**more: object) -> Gltf:
    gltf = Gltf()
    triangles = np.concatenate([BOX_QUADS[:, [0, 1, 2]], BOX_QUADS[:, [0, 2, 3]]])
    uv = gltf.accessor(BOX[:, :2] / 4, "f4")
    image = {"bufferView": gltf.view(_png()), "mimeType": "image/png"}
    gltf.add("images", image)
    gltf.add("textures", {"source": 0})
    gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    mesh = gltf.mesh(BOX, triangles, attributes={"TEXCOORD_0": uv}, material=0)
    return gltf.scene({"mesh": mesh, "name": "box", "translation": [1, 2, 3]})


def _glb() -> list[bytes]:
    packed = Gltf()
    triangles = np.concatenate([BOX_QUADS[:, [0, 1, 2]], BOX_QUADS[:, [0, 2, 3]]])
    draco = DracoPy.encode(BOX.astype(np.float32), triangles)
    extension = {"bufferView": packed.view(draco), "attributes": {"POSITION": 0}}
    place = {"componentType": 5126, "count": 8, "type": "VEC3"}
    index = {"componentType": 5125, "count": triangles.size, "type": "SCALAR"}
    primitive = {
        "attributes": {"POSITION": packed.add("accessors", place)},
        "indices": packed.add("accessors", index),
        "extensions": {"KHR_draco_mesh_compression": extension},
    }
    packed.document["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    packed.scene({"mesh": packed.add("meshes", {"primitives": [primitive]})})
    return [_box().glb(), packed.glb(), _meshopt()]


def _meshopt() -> bytes:
    gltf = Gltf()
    rows = np.zeros((8, 4), "<f4")
    rows[:, :3] = BOX
    data = bytes(meshopt.encode_gltf_buffer(rows, "ATTRIBUTES"))
    view = gltf.view(data)
    extension = {"buffer": 0, "byteOffset": gltf.document["bufferViews"][view]["byteOffset"]}
    extension |= {"byteLength": len(data), "byteStride": 16, "count": 8, "mode": "ATTRIBUTES"}
    gltf.document["bufferViews"].append(
        {"buffer": 0, "byteLength": 128, "extensions": {"EXT_meshopt_compression": extension}}
    )
    place = {"bufferView": view + 1, "componentType": 5126, "count": 8, "type": "VEC3"}
    primitive = {"attributes": {"POSITION": gltf.add("accessors", place)}}
    triangles = np.concatenate([BOX_QUADS[:, [0, 1, 2]], BOX_QUADS[:, [0, 2, 3]]])
    primitive["indices"] = gltf.accessor(triangles.ravel(), "u4")
    return gltf.scene({"mesh": gltf.add("meshes", {"primitives": [primitive]})}).glb()


def _gltf() -> list[bytes]:
    gltf = _box()
    gltf.glb()
    gltf.document["buffers"] = [{"byteLength": len(gltf.binary), "uri": "a.bin"}]
    gltf.document["images"][0] = {"uri": "picture.png"}
    return [json.dumps(gltf.document).encode()]


def _survey(ending: str) -> list[bytes]:
    def write(path: Path, point_format: int, version: str) -> None:
        header = laspy.LasHeader(point_format=point_format, version=version)
        header.scales, header.offsets = [0.001] * 3, [84000, 447000, -5]
        from pyproj import CRS

        header.add_crs(CRS.from_user_input("EPSG:7415"))
        rng = np.random.default_rng(5)
        las = laspy.LasData(header)
        las.x, las.y = (m + rng.uniform(-150, 150, 300) for m in (84952.0, 447550.0))
        las.z = rng.uniform(-2, 9, 300)
        las.classification = rng.choice([1, 2, 6], 300).astype(np.uint8)
        las.write(path)

    return [
        made(f"a.{ending}", lambda path, kind=kind: write(path, *kind))
        for kind in ((7, "1.4"), (1, "1.2"), (6, "1.4"))
    ]


def _city() -> list[bytes]:
    shell = [[quad.tolist()] for quad in BOX_QUADS]
    values = {"surfaces": [{"type": "WallSurface"}, {"type": "RoofSurface"}]}
    solid = {"type": "Solid", "lod": "2.2", "boundaries": [shell]}
    solid["semantics"] = {**values, "values": [[0, 0, 0, 0, None, 1]]}
    plain = {"type": "MultiSurface", "lod": "1", "boundaries": shell}
    house = {"type": "Building", "geometry": [solid, plain], "attributes": {"h": 3.5}}
    place = {"scale": [0.001] * 3, "translate": [84952.0, 447550.0, 0.0]}
    vertices = (BOX * 1000).astype(int).tolist()
    template = {"type": "MultiSurface", "lod": "1", "boundaries": shell}
    tree = {
        "type": "SolitaryVegetationObject",
        "geometry": [{
            "type": "GeometryInstance", "template": 0, "boundaries": [0],
            "transformationMatrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        }],
    }  # fmt: skip
    city = {
        "type": "CityJSON", "version": "2.0", "transform": place, "vertices": vertices,
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
        "CityObjects": {"house": house, "tree": tree},
        "geometry-templates": {"templates": [template], "vertices-templates": BOX.tolist()},
    }  # fmt: skip
    head = {**city, "vertices": [], "CityObjects": {}}
    feature = {"type": "CityJSONFeature", "id": "house", "CityObjects": {"house": house}}
    lines = [json.dumps(head), json.dumps({**feature, "vertices": vertices})]
    return [json.dumps(city).encode(), "\n".join(lines).encode()]


def _points3d() -> bytes:
    row = struct.pack("<Q3d3Bd", 1, 1.0, 2.0, 3.0, 9, 8, 7, 0.1) + struct.pack("<Q2i", 1, 0, 0)
    return struct.pack("<Q", 5) + row * 5


def _images() -> bytes:
    row = struct.pack("<I7dI", 1, 1, 0, 0, 0, 1, 2, 3, 1) + b"a.jpg\0" + struct.pack("<Q", 0)
    return struct.pack("<Q", 3) + row * 3


POINTS_TXT = b"# 3D\n1 0.5 1.5 2.5 10 20 30 0.1 1 0\n2 1.5 1.5 2.5 10 20 30 0.1 1 0\n"
IMAGES_TXT = b"# images\n1 1 0 0 0 1 2 3 1 a.jpg\n1 2 -1\n2 1 0 0 0 1 2 4 1 b.jpg\n\n"


def _geotagged() -> bytes:
    from PIL import Image

    def write(path: Path) -> None:
        exif = Image.Exif()
        exif[0x8825] = {
            1: "N",
            2: (52.0, 0.0, 36.5),
            3: "E",
            4: (4.0, 21.0, 36.0),
            5: b"\0",
            6: 12.5,
        }
        Image.new("RGB", (8, 8)).save(path, exif=exif)

    return made("a.jpg", write)


def _tile() -> bytes:
    return _box().glb()


def _tiles(kind: str) -> list[bytes]:
    trees = i3dm(_tile(), {"INSTANCES_LENGTH": 3}, {"POSITION": PLACES}, {"name": ["a", "b", "c"]})
    turned = {
        "POSITION": PLACES,
        "NORMAL_UP": PLACES * 0 + [0, 0, 1],
        "NORMAL_RIGHT": PLACES * 0 + 1,
    }
    turned = {key: np.asarray(rows, "<f4") for key, rows in turned.items()}
    cloud = {"POSITION": PLACES, "RGB": np.array([[1, 2, 3]] * 3, "u1")}
    draco = DracoPy.encode(np.random.default_rng(0).uniform(-9, 9, (50, 3)).astype("<f4"))
    extension = {"properties": {"POSITION": 0}, "byteOffset": 0, "byteLength": len(draco)}
    packed = {
        "POINTS_LENGTH": 50,
        "extensions": {"3DTILES_draco_point_compression": extension},
        "POSITION": {"byteOffset": 0},
    }
    every = {
        "b3dm": [b3dm(_tile(), {"BATCH_LENGTH": 1, "RTC_CENTER": [1, 2, 3]}, {"name": ["house"]})],
        "i3dm": [trees, i3dm(_tile(), {"INSTANCES_LENGTH": 3, "EAST_NORTH_UP": True}, turned)],
        "pnts": [
            pnts({"POINTS_LENGTH": 3, "RTC_CENTER": [9, 9, 9]}, cloud),
            pnts(packed, {"body": np.frombuffer(draco, "u1")}),
        ],
    }
    every["cmpt"] = [cmpt(every["b3dm"][0], trees, cmpt(every["pnts"][0]))]
    every["glb"] = [_tile()]
    return every[kind]


def _tileset(content: str = "content.b3dm") -> dict[str, object]:
    box = {"box": [0, 0, 10, 50, 0, 0, 0, 50, 0, 0, 0, 10]}
    inner = {"boundingVolume": box, "geometricError": 0, "content": {"uri": content}}
    root = {"boundingVolume": box, "geometricError": 20, "refine": "ADD", "children": [inner]}
    root["transform"] = np.eye(4).ravel().tolist()
    return {"asset": {"version": "1.1"}, "geometricError": 500, "root": root}


def _tilesets() -> list[bytes]:
    sphere = _tileset()
    sphere["root"]["boundingVolume"] = {"sphere": [0, 0, 0, 90]}
    region = _tileset()
    region["root"]["boundingVolume"] = {"region": [0.0761, 0.9077, 0.0762, 0.9078, 0, 50]}
    return [json.dumps(value).encode() for value in (_tileset(), sphere, region)]


def _archive() -> list[bytes]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("tileset.json", json.dumps(_tileset()))
            archive.writestr("content.b3dm", _tiles("b3dm")[0])

    return [made("a.3tz", write)]


def _quadtree() -> dict[str, bytes]:
    folder = TILES / "1.1" / "SparseImplicitQuadtree"
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _points_csv() -> list[bytes]:
    site = b"name,model_x,model_y,model_z,x,y,z\na,0,0,0,10,20,0.5\n"
    site += b"b,5,0,0,15,20,0.5\nc,0,5,1,10,25,1.5\n"
    earth = b"model_x;model_y;model_z;latitude;longitude;height_m\n0;0;0;52.01;4.36;0\n"
    earth += b"5;0;0;52.0101;4.36;0\n5;5;0;52.0101;4.3601;1.5\n"
    return [site, earth]


def control_points(path: Path) -> None:
    spec = GeometrySpec(file="a.obj", control_points=path.name)
    source = GeometrySource(spec, Document(path.parent / "site.yaml", {"geometry": [{}]}), 0)
    fit(read_control_points(source, FRAME, None), None)


def _fbx() -> list[bytes]:
    """The smallest ASCII FBX that holds a mesh."""
    points = ",".join(f"{v:g}" for v in BOX.ravel())
    quads = ",".join(f"{a},{b},{c},{-d - 1}" for a, b, c, d in BOX_QUADS.tolist())
    text = f"""; FBX 7.4.0 project file
FBXHeaderExtension:  {{
\tFBXHeaderVersion: 1003
\tFBXVersion: 7400
}}
Objects:  {{
\tGeometry: 1, "Geometry::box", "Mesh" {{
\t\tVertices: *24 {{
\t\t\ta: {points}
\t\t}}
\t\tPolygonVertexIndex: *24 {{
\t\t\ta: {quads}
\t\t}}
\t}}
\tModel: 2, "Model::box", "Mesh" {{
\t\tVersion: 232
\t}}
}}
Connections:  {{
\tC: "OO",1,2
\tC: "OO",2,0
}}
"""
    return [text.encode()]


def _citygml() -> list[bytes]:
    """A house by reference and a block, of two versions."""
    return [
        city(version, house(version), block(version, "b", (20, 0, 0), (22, 3, 4)), srs=srs).encode()
        for version, srs in (("2.0", "urn:ogc:def:crs:EPSG::7415"), ("3.0", ""))
    ]


def _e57() -> list[bytes]:
    rng = np.random.default_rng(1)
    data = {f"cartesian{axis}": rng.uniform(-9, 9, 40) for axis in "XYZ"}
    data |= {f"color{name}": np.arange(40, dtype=np.uint8) for name in ("Red", "Green", "Blue")}
    data["cartesianInvalidState"] = (np.arange(40) % 2).astype(np.int8)

    def write(path: Path) -> None:
        with pye57.E57(str(path), mode="w") as file:
            for number in range(2):
                file.write_scan_raw(data, translation=np.array([number, 0.0, 0.0]))

    return [made("a.e57", write)]


XYZ = b"// x y z r g b\n1.5 2.5 3.5 10 20 30\n4 5 6 1 2 3\n7 8 9 1 2 3\n"
PTS = b"3\n1.5 2.5 3.5 -5 10 20 30\n4 5 6 1 1 2 3\n7 8 9 1 1 2 3\n"
METADATA = (
    b'<?xml version="1.0"?>\n<ModelMetadata version="1"><SRS>EPSG:25832</SRS>\n'
    b"<SRSOrigin>513000,5394000,300</SRSOrigin></ModelMetadata>\n"
)
OFFSET = b"513000 5394000 300\n"


def obj_beside(path: Path) -> None:
    """The OBJ that another file stands beside."""
    source = GeometrySource(GeometrySpec(file="a.obj"), Document(path.parent / "site.yaml", {}), 0)
    read_model(source, FRAME, REGION)


def built(path: Path) -> None:
    """What `build` does with a source that is placed by hand."""
    spec = GeometrySpec(file=path.name, similarity=SimilaritySpec(), up="z", unit="m")
    source = GeometrySource(spec, Document(path.parent / "site.yaml", {"geometry": [{}]}), 0)
    region = shapely.box(-10, -10, 10, 10)
    road = shapely.box(-10, -3, 10, 3)
    reconstruct([source], FRAME, Surroundings(region, road, (), np.zeros((0, 3))))


def _street() -> list[bytes]:
    """A square of ground, drawn as quads, with a house on it."""
    rows = [b"o street"]
    line = range(-15, 16, 5)
    rows += [b"v %d %d %.2f" % (x, y, 0.01 * x) for x in line for y in line]
    n = len(line)
    for i in range(n - 1):
        rows += [
            b"f %d %d %d %d" % (k + 1, k + n + 1, k + n + 2, k + 2)
            for k in range(i * n, i * n + n - 1)
        ]
    rows += [b"o house"]
    rows += [b"v %g %g %g" % tuple(corner * [4, 3, 2] + [2, 5, -1]) for corner in BOX]
    rows += [b"f " + b" ".join(b"%d" % (v - 8) for v in quad) for quad in BOX_QUADS]
    return [b"\n".join(rows) + b"\n"]


READERS = [
    Reader("obj built", built, "a.obj", _street),
    Reader("obj", read_around, "a.obj", _obj, {"a.mtl": _mtl()[0], "picture.png": b""}),
    Reader("mtl", obj_beside, "a.mtl", _mtl, lambda: {"a.obj": _obj()[0], "picture.png": _png()}),
    Reader("texture", obj_beside, "picture.png", lambda: [_png()],
           lambda: {"a.obj": _obj()[0], "a.mtl": _mtl()[0]}),
    Reader("metadata.xml", obj_beside, "metadata.xml", lambda: [METADATA],
           lambda: {"a.obj": _obj()[0]}),
    Reader("offset", obj_beside, "a_offset.xyz", lambda: [OFFSET], lambda: {"a.obj": _obj()[0]}),
    Reader("ply", read_around, "a.ply", lambda: [_ply_binary(), _ply_ascii(), _ply_cloud()]),
    Reader("stl", read_around, "a.stl", _stl),
    Reader("glb", read_around, "a.glb", _glb),
    Reader("glb of a car", read_around, "a.glb",
           files(SHARED_DATA / "meshes/kenney/models/vehicle-truck-purple.glb"),
           lambda: {"Textures/colormap.png": _png()}, real=True),
    Reader("gltf", read_around, "a.gltf", _gltf,
           lambda: {"a.bin": _box().binary, "picture.png": _png()}),
    Reader("las", read_around, "a.las", lambda: _survey("las")),
    Reader("laz", read_around, "a.laz", lambda: _survey("laz")),
    Reader("xyz", read_around, "a.xyz", lambda: [XYZ, PTS]),
    Reader("cityjson", read_around, "a.city.json", lambda: _city()[:1]),
    Reader("cityjson lines", read_around, "a.city.jsonl", lambda: _city()[1:]),
    Reader("colmap points", of_folder, "sparse/points3D.bin", lambda: [_points3d()],
           lambda: {"sparse/images.bin": _images()}),
    Reader("colmap images", of_folder, "sparse/images.bin", lambda: [_images()],
           lambda: {"sparse/points3D.bin": _points3d(), "images/a.jpg": _geotagged()}),
    Reader("colmap points text", of_folder, "sparse/points3D.txt", lambda: [POINTS_TXT],
           lambda: {"sparse/images.txt": IMAGES_TXT}),
    Reader("colmap images text", of_folder, "sparse/images.txt", lambda: [IMAGES_TXT],
           lambda: {"sparse/points3D.txt": POINTS_TXT, "images/a.jpg": _geotagged()}),
    Reader("geotagged image", of_folder, "images/a.jpg", lambda: [_geotagged()],
           lambda: {"sparse/points3D.txt": POINTS_TXT, "sparse/images.txt": IMAGES_TXT,
                    "images/b.jpg": _geotagged()}),
    *(
        Reader(kind, of_tileset, f"content.{kind}", lambda kind=kind: _tiles(kind),
               lambda kind=kind: {"tileset.json": json.dumps(_tileset(f"content.{kind}")).encode()})
        for kind in ("b3dm", "i3dm", "pnts", "cmpt")
    ),
    Reader("tileset", read_around, "tileset.json", _tilesets,
           lambda: {"content.b3dm": _tiles("b3dm")[0]}),
    Reader("3tz", read_around, "a.3tz", _archive),
    Reader("subtree", of_tileset, "subtrees/0.0.0.subtree",
           files(TILES / "1.1/SparseImplicitQuadtree/subtrees/0.0.0.subtree"), _quadtree,
           real=True),
    Reader("implicit tileset", read_around, "tileset.json",
           files(TILES / "1.1/SparseImplicitQuadtree/tileset.json"), _quadtree, real=True),
    Reader("real b3dm", of_tileset, "content.b3dm",
           files(TILES / "1.0/TilesetWithRequestVolume/city/ll.b3dm"),
           lambda: {"tileset.json": json.dumps(_tileset()).encode()}, real=True),
    Reader("control points", control_points, "points.csv", _points_csv),
    Reader("fbx", read_around, "a.fbx", _fbx),
    Reader("citygml", read_around, "a.gml", _citygml),
    Reader("citygml.gz", read_around, "a.gml.gz",
           lambda: [gzip.compress(one, mtime=0) for one in _citygml()]),
    Reader("e57", read_around, "a.e57", _e57),
]  # fmt: skip


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)
