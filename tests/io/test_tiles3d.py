"""3D Tiles: real samples, and tilesets whose coordinates the test knows."""

import gzip
import json
import math
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame

from .tile_bytes import Gltf, b3dm, same_triangles
from .tileset_site import FRAME, REGION, names, on_site, read, tile, write

GEODETIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


def cube(x: float, y: float, size: float = 4.0, name: str = "cube") -> bytes:
    """A GLB of a cube that stands at x east, y north once it is turned z up; by trimesh."""
    box = trimesh.creation.box([size] * 3)
    box.apply_translation([x, size / 2, -y])
    scene = trimesh.Scene()
    scene.add_geometry(box, node_name=name)
    return scene.export(file_type="glb")


# --- real samples -----------------------------------------------------------------------------


def test_city_blocks_land_where_their_batch_tables_say(shared_data):
    """Every building's footprint is centred on the longitude and latitude of its batch table."""
    folder = shared_data / "tiles3d" / "1.0" / "TilesetWithRequestVolume"
    frame = SiteFrame(math.degrees(0.698874), math.degrees(-1.31968))
    model = read(folder / "tileset.json", shapely.box(-300, -300, 300, 300), frame)
    assert model.crs.to_epsg() == 4978
    assert model.problems == ("building.b3dm: not found", "points.pnts: not found")
    assert set(model.files) == {
        "tileset.json",
        "city/tileset.json",
        *(f"city/{part}.b3dm" for part in ("ll", "lr", "ul", "ur")),
    }
    lon, lat, height = GEODETIC.transform(*model.mesh.vertices.T)
    assert abs(height.min()) < 0.01
    for part in ("ll", "lr", "ul", "ur"):
        data = (folder / "city" / f"{part}.b3dm").read_bytes()
        batch = json.loads(data[data.index(b'{"id"') : data.index(b"glTF")])
        for number in range(10):
            index = model.mesh.names.index(f"city/{part}.b3dm / rootNode / id {number}")
            used = np.unique(model.mesh.faces[model.mesh.object == index])
            assert len(used) == 24
            east, north = (np.radians(v[used]).mean() for v in (lon, lat))
            # The first of a block is where it says; the sample's writer put the others around it
            # by a rule of thumb for metres per degree.
            within = 0.002 if number == 0 else 0.5
            assert abs(east - batch["Longitude"][number]) * 4.9e6 < within
            assert abs(north - batch["Latitude"][number]) * 6.37e6 < within
            assert np.ptp(height[used]) == pytest.approx(batch["Height"][number], abs=0.01)


def test_only_tiles_that_meet_the_region_are_read(shared_data):
    folder = shared_data / "tiles3d" / "1.0" / "TilesetWithRequestVolume"
    frame = SiteFrame(math.degrees(0.698874), math.degrees(-1.31968))
    model = read(folder / "tileset.json", shapely.box(20, 20, 120, 120), frame)
    assert names(model) == {"city/ur.b3dm"}
    with pytest.raises(InputError, match="no tile of it meets the region"):
        read(folder / "tileset.json", REGION, SiteFrame(52.0, 4.4))


def test_trees_stand_upright_at_their_places(shared_data):
    folder = shared_data / "tiles3d" / "1.0" / "TilesetWithTreeBillboards"
    frame = SiteFrame(math.degrees(0.698874), math.degrees(-1.31968))
    model = read(folder / "tileset.json", shapely.box(-300, -300, 300, 300), frame)
    data = (folder / "tree.i3dm").read_bytes()
    header = int.from_bytes(data[12:16], "little")
    places = np.frombuffer(data, "<f4", 75, 32 + header).reshape(25, 3).astype(float)
    assert not model.problems  # the coarser billboard, which is missing, is not asked for
    ground = GEODETIC.transform(*places.T)[2]
    for number, place in enumerate(places):
        mine = [k for k, n in enumerate(model.mesh.names) if f"instance {number} " in n]
        used = np.unique(model.mesh.faces[np.isin(model.mesh.object, mine)])
        points = model.mesh.vertices[used]
        height = GEODETIC.transform(*points.T)[2] - ground[number]
        # The model's own bounds: from -0.0004 to 16.573 m above its foot.
        assert height.min() == pytest.approx(0.0, abs=0.01)
        assert height.max() == pytest.approx(16.573, abs=0.01)
        assert np.linalg.norm(points.mean(axis=0) - place) < 17
    assert len(model.mesh.faces) == 25 * (3552 + 2676) // 3


def test_an_implicit_quadtree_shows_the_cells_that_its_files_are_named_after(shared_data):
    folder = shared_data / "tiles3d" / "1.1" / "SparseImplicitQuadtree"
    model = read(folder / "tileset.json")
    assert model.crs is None
    assert model.up == "z"
    cells = set()
    for path in (folder / "content").glob("*.glb"):
        level, x, y = (
            int(v) for v in path.stem.removeprefix("content_").replace("__", "_").split("_")
        )
        cells.add((level, x, y))
    squares = {
        tuple(np.floor(corner.min(axis=0)[:2] * 32 + 1e-6).astype(int))
        for corner in model.mesh.vertices[model.mesh.faces]
    }
    assert squares == {(x, y) for level, x, y in cells}
    a, b, c = np.moveaxis(model.mesh.triangles(), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(len(cells) / 32**2)


# --- refinement -------------------------------------------------------------------------------


def quarters(refine: str, folder: Path, missing: str = "") -> Path:
    """A coarse slab of 80 x 80 m, refined by four cubes, one of which has a finer one."""
    slab = trimesh.creation.box([80, 1, 80]).subdivide().subdivide().subdivide()
    slab.apply_translation([0, 0.5, 0])
    children = [
        tile(0, -40, -40, 0, 0, content={"uri": "sw.glb"}),
        tile(0, 0, -40, 40, 0, content={"uri": "se.glb"}),
        tile(0, -40, 0, 0, 40, content={"uri": "nw.glb"}),
        tile(
            2,
            0,
            0,
            40,
            40,
            content={"uri": "ne.glb"},
            children=[tile(0, 0, 0, 40, 40, content={"uri": "finer.glb"})],
        ),
    ]
    root = tile(20, -40, -40, 40, 40, refine=refine, content={"uri": "slab.glb"}, children=children)
    files = {
        "slab.glb": slab.export(file_type="glb"),
        "sw.glb": cube(-20, -20),
        "se.glb": cube(20, -20),
        "nw.glb": cube(-20, 20),
        "ne.glb": cube(20, 20),
        "finer.glb": cube(20, 20, 5.0),
    }
    files.pop(missing, None)
    return write(folder, root, files)


@pytest.mark.parametrize(
    ("refine", "error", "expected"),
    [
        ("REPLACE", 50.0, {"slab"}),
        ("REPLACE", 20.0, {"slab"}),
        ("REPLACE", 5.0, {"sw", "se", "nw", "ne"}),
        ("REPLACE", 0.5, {"sw", "se", "nw", "finer"}),
        ("ADD", 5.0, {"slab", "sw", "se", "nw", "ne"}),
        ("ADD", 0.5, {"slab", "sw", "se", "nw", "ne", "finer"}),
    ],
)
def test_refinement_stops_at_the_geometric_error(tmp_path, refine, error, expected):
    model = read(quarters(refine, tmp_path), geometric_error_m=error)
    assert names(model) == {f"{name}.glb" for name in expected}
    assert not model.problems


def test_cubes_land_where_they_were_put(tmp_path):
    model = read(quarters("REPLACE", tmp_path))
    vertices = on_site(model.mesh.vertices)
    expected = []
    for size, x, y in [(4, -20, -20), (4, 20, -20), (4, -20, 20), (5, 20, 20)]:
        box = trimesh.creation.box([size] * 3)
        box.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
        box.apply_translation([x, y, size / 2])
        expected.append(box)
    mesh = trimesh.Trimesh(vertices, model.mesh.faces, process=False)
    assert same_triangles(mesh, trimesh.util.concatenate(expected), within=1e-5)


def test_a_missing_child_leaves_its_siblings_and_its_parents_part(tmp_path):
    model = read(quarters("REPLACE", tmp_path, missing="se.glb"))
    assert model.problems == ("se.glb: not found",)
    assert names(model) == {"sw.glb", "nw.glb", "finer.glb", "slab.glb"}
    vertices = on_site(model.mesh.vertices)
    slab = [k for k, name in enumerate(model.mesh.names) if name.startswith("slab")]
    middles = vertices[model.mesh.faces[np.isin(model.mesh.object, slab)]].mean(axis=1)
    assert (middles[:, 0] > -0.1).all()
    assert (middles[:, 1] < 0.1).all()
    # Its top and bottom cover the quarter once each.
    a, b, c = np.moveaxis(vertices[model.mesh.faces[np.isin(model.mesh.object, slab)]], 1, 0)
    flat = np.cross(b - a, c - a)[:, 2] / 2
    assert flat[flat > 0].sum() == pytest.approx(40 * 40, rel=0.02)


def test_a_missing_tile_that_is_good_enough_is_refined_instead(tmp_path, shared_data):
    model = read(quarters("REPLACE", tmp_path, missing="slab.glb"), geometric_error_m=50.0)
    assert names(model) == {"sw.glb", "se.glb", "nw.glb", "ne.glb"}
    assert model.problems == ("slab.glb: not found",)
    # The real trees' billboard is not there either; the trees themselves are.
    folder = shared_data / "tiles3d" / "1.0" / "TilesetWithTreeBillboards"
    frame = SiteFrame(math.degrees(0.698874), math.degrees(-1.31968))
    region = shapely.box(-300, -300, 300, 300)
    model = read(folder / "tileset.json", region, frame, geometric_error_m=20.0)
    assert names(model) == {"tree.i3dm"}
    assert model.problems == ("tree_billboard.i3dm: not found",)


def test_a_missing_only_child_leaves_its_parent(tmp_path):
    model = read(quarters("REPLACE", tmp_path, missing="finer.glb"))
    assert names(model) == {"sw.glb", "se.glb", "nw.glb", "ne.glb"}
    assert len(model.mesh.faces) == 4 * 12
    assert model.notes["failed tiles filled from coarser ones"] == 1


def test_regions_boxes_and_spheres_are_tested_conservatively(tmp_path):
    """40 small tiles around the region: each that touches it is read, those far off are not."""
    draw = np.random.default_rng(3)
    region = shapely.Polygon([(-30, -10), (35, -40), (10, 45)])
    children, files, touching, far = [], {}, set(), set()
    for number in range(40):
        x, y = draw.uniform(-150, 150, 2)
        name = f"{number}.glb"
        files[name] = cube(x, y)
        square = shapely.box(x - 2, y - 2, x + 2, y + 2)
        (touching if square.intersects(region) else far).add(name)
        if number % 3 == 0:
            turn = draw.uniform(0, np.pi)
            c, s = 3 * math.cos(turn), 3 * math.sin(turn)
            volume = {"box": [x, y, 2, c, s, 0, -s, c, 0, 0, 0, 2]}
        elif number % 3 == 1:
            volume = {"sphere": [x, y, 2, 3.5]}
        else:
            west, south = np.radians(FRAME.lonlat_from_site([x - 2, y - 2])[0])
            east, north = np.radians(FRAME.lonlat_from_site([x + 2, y + 2])[0])
            volume = {"region": [west, south, east, north, -10, 50]}
        children.append({"boundingVolume": volume, "geometricError": 0, "content": {"uri": name}})
    model = read(write(tmp_path, tile(9, -200, -200, 200, 200, children=children), files), region)
    assert touching
    assert touching <= names(model)
    distances = {
        name: shapely.distance(
            region,
            shapely.Point(
                on_site(model.mesh.vertices)[model.mesh.faces[model.mesh.object == k][0, 0]][:2]
            ),
        )
        for k, name in enumerate(n.split(" / ")[0] for n in model.mesh.names)
        if (model.mesh.object == k).any()
    }
    assert max(distances.values()) < 15
    assert len(far - names(model)) > 20


# --- external tilesets, transforms, formats ---------------------------------------------------


def test_external_tilesets_cascade_their_transforms(tmp_path):
    inner = {
        "asset": {"version": "1.0", "gltfUpAxis": "Z"},
        "geometricError": 1,
        "root": tile(
            0, -5, -5, 5, 5, content={"url": "deep/cube.b3dm"}, transform=list(np.eye(4).ravel())
        ),
    }
    inner["root"]["transform"][12:15] = [1, 2, 3]
    box = trimesh.creation.box([4, 4, 4])
    outer = tile(
        9,
        -40,
        -40,
        40,
        40,
        children=[
            tile(
                5,
                -5,
                -5,
                5,
                5,
                content={"uri": "sub%20set/inner.json"},
                # 90 degrees about up, twice as large, 10 m east.
                transform=[0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1],
            )
        ],
    )
    model_bytes = b3dm(box.export(file_type="glb"), {"BATCH_LENGTH": 0, "RTC_CENTER": [0, 0, 7]})
    path = write(
        tmp_path,
        outer,
        {
            "sub set/inner.json": json.dumps(inner).encode(),
            "sub set/deep/cube.b3dm": gzip.compress(model_bytes),
        },
    )
    model = read(path)
    vertices = on_site(model.mesh.vertices)
    np.testing.assert_allclose(vertices.min(axis=0), [10 - 4 - 4, 2 - 4, 20 - 4], atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), [10 + 4 - 4, 2 + 4, 20 + 4], atol=1e-6)
    assert names(model) == {"sub set/deep/cube.b3dm"}


def test_contents_of_a_tile_are_all_read_whatever_their_names(tmp_path):
    files = {"a": cube(0, 0), "b.bin": b3dm(cube(9, 0)), "c.json.glb": cube(0, 9)}
    contents = [{"uri": name} for name in files]
    contents[2]["boundingVolume"] = tile(0, 500, 500, 510, 510)["boundingVolume"]
    model = read(write(tmp_path, tile(0, -20, -20, 20, 20, contents=contents), files))
    # The third's own volume, which lies elsewhere, leaves it out.
    assert names(model) == {"a", "b.bin"}


def test_a_tileset_under_any_name_is_walked_into(tmp_path):
    inner = {
        "asset": {"version": "1.0"},
        "root": tile(0, -9, -9, 9, 9, content={"uri": "cube.glb"}),
    }
    files = {"inner": json.dumps(inner).encode(), "cube.glb": cube(0, 0)}
    model = read(write(tmp_path, tile(1, -9, -9, 9, 9, content={"uri": "inner"}), files))
    assert names(model) == {"cube.glb"}


def test_one_archive_is_a_folder(tmp_path):
    path = quarters("REPLACE", tmp_path / "folder")
    with zipfile.ZipFile(tmp_path / "city.3tz", "w", zipfile.ZIP_DEFLATED) as archive:
        for file in path.parent.iterdir():
            archive.write(file, file.name)
    folder, packed = read(path), read(tmp_path / "city.3tz")
    np.testing.assert_array_equal(folder.mesh.vertices, packed.mesh.vertices)
    assert folder.files == packed.files


def test_a_model_in_another_system_is_chosen_by_its_crs(tmp_path):
    """The tiles lie in EPSG:28992; only the one at the region is read."""
    frame = SiteFrame(52.0, 4.37)
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:28992", always_xy=True).transform(4.37, 52.0)
    children, files = [], {}
    for k in range(5):
        gltf = Gltf()
        ring = np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1]]) + [0, 0.0, 0]
        gltf.scene({"mesh": gltf.mesh(ring), "translation": [x + 100 * k, 0, -y]})
        files[f"{k}.glb"] = gltf.glb()
        box = [x + 100 * k, y, 0, 5, 0, 0, 0, 5, 0, 0, 0, 5]
        children.append(
            {"boundingVolume": {"box": box}, "geometricError": 0, "content": {"uri": f"{k}.glb"}}
        )
    root = {
        "boundingVolume": {"sphere": [x, y, 0, 1000]},
        "geometricError": 9,
        "children": children,
    }
    path = tmp_path / "tileset.json"
    path.write_text(json.dumps({"asset": {"version": "1.1"}, "root": root}))
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    assert names(read(path, REGION, frame, crs="EPSG:28992")) == {"0.glb"}
    everything = read(path, REGION, frame)
    assert everything.crs is None
    assert len(names(everything)) == 5
    np.testing.assert_allclose(everything.mesh.vertices[0], [x, y, 0])


def test_a_thousand_tiles_load_quickly(tmp_path):
    """A grid of 32 x 32 tiles of 320 triangles in two levels of external tilesets."""
    patch = trimesh.creation.icosphere(2, 1.0)
    data = b3dm(patch.export(file_type="glb"))
    rows, files = [], {}
    for k in range(32):
        children = []
        for j in range(32):
            files[f"{k}/{j}.b3dm"] = data
            child = tile(0, 3 * j - 49, 3 * k - 49, 3 * j - 47, 3 * k - 47)
            child["content"] = {"uri": f"{j}.b3dm"}
            children.append(child)
        external = {"asset": {"version": "1.0"}, "root": tile(2, -50, 3 * k - 50, 50, 3 * k - 46)}
        external["root"]["children"] = children
        files[f"{k}/tileset.json"] = json.dumps(external).encode()
        row = tile(4, -50, 3 * k - 50, 50, 3 * k - 46, content={"uri": f"{k}/tileset.json"})
        rows.append(row)
    path = write(tmp_path, tile(9, -50, -50, 50, 50, children=rows), files)
    start = time.perf_counter()
    model = read(path)
    assert len(model.mesh.faces) == 1024 * len(patch.faces)
    assert time.perf_counter() - start < 15
