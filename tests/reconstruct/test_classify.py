"""Classification of meshes, against scenes whose truth is known and a city model's own names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from urbantwin.geometry import DownwardProbe
from urbantwin.reconstruct import TriangleMesh
from urbantwin.reconstruct.classify import classified
from urbantwin.reconstruct.classify.colours import hsv
from urbantwin.reconstruct.classify.names import labels_of_names
from urbantwin.site.geometry import GeometrySpec
from urbantwin.taxonomy import material_id, semantic_id

SPEC = GeometrySpec(file="scan.glb")


def slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.05 * np.asarray(x, float)


def ground(half: float = 30.0, step: float = 0.5, colour=(110, 108, 105)) -> TriangleMesh:
    axis = np.arange(-half, half + 1e-9, step)
    x, y = np.meshgrid(axis, axis)
    n = len(axis)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    points = np.column_stack([x.ravel(), y.ravel(), slope(x, y).ravel()])
    return painted(points, faces, colour)


def painted(points, faces, colour) -> TriangleMesh:
    triangles = np.asarray(faces, np.int32)
    shade = np.tile(np.array(colour, np.uint8), (len(triangles), 1))
    return TriangleMesh.build(points, triangles, colour=shade)


def house(x, y, length, width, height, wall=(170, 90, 70), roof=(60, 60, 65)) -> TriangleMesh:
    """Walls in pieces of half a metre, as scans have them, and a gabled roof."""
    parts = []
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length / 2, width / 2] + [x, y]
    for k in range(4):
        start, end = corner[k], corner[(k + 1) % 4]
        n, m = max(2, int(np.hypot(*(end - start)) / 0.5)), int(height / 0.5)
        u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1))
        plan = start + u.ravel()[:, None] * (end - start)
        low = slope(plan[:, 0], plan[:, 1]) - 0.2
        points = np.column_stack([plan, low + v.ravel() * (height + slope(x, y) - low)])
        g = np.arange(u.size).reshape(u.shape)
        a, b, c, d = (part.ravel() for part in (g[:-1, :-1], g[:-1, 1:], g[1:, 1:], g[1:, :-1]))
        faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        parts.append(painted(points, faces, wall))
    eaves = np.column_stack([corner, np.full(4, height + float(slope(x, y)))])
    ridge = np.array([[x - length / 2, y, eaves[0, 2] + 2], [x + length / 2, y, eaves[0, 2] + 2]])
    points = np.vstack([eaves, ridge])
    tiles = [[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4]]
    return TriangleMesh.concatenate([*parts, painted(points, tiles, roof)])


def tree(x: float, y: float, seed: int) -> TriangleMesh:
    """A trunk, and a crown as photogrammetry has it: a lumpy ball."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    bumps = np.random.default_rng(seed).normal(0, 0.12, len(ball.vertices))
    points = ball.vertices * (1 + bumps[:, None]) + [x, y, float(slope(x, y)) + 4.5]
    stem = trimesh.creation.cylinder(0.15, 3.0, sections=8)
    trunk = painted(stem.vertices + [x, y, float(slope(x, y)) + 1.45], stem.faces, (90, 70, 50))
    return TriangleMesh.concatenate([trunk, painted(points, ball.faces, (60, 110, 50))])


def post(x: float, y: float) -> TriangleMesh:
    import trimesh

    stem = trimesh.creation.cylinder(0.08, 7.0, sections=12)
    return painted(stem.vertices + [x, y, float(slope(x, y)) + 3.45], stem.faces, (150, 150, 150))


HOUSES = [(-15.0, 12.0, 14.0, 8.0, 6.0), (14.0, 13.0, 10.0, 10.0, 9.0)]
TREES = [(-10.0, -10.0), (3.0, -12.0), (16.0, -9.0)]
POSTS = [(-4.0, 0.0), (8.0, 1.0)]


@pytest.fixture(scope="module")
def scene() -> TriangleMesh:
    parts = [ground()]
    parts += [house(*one) for one in HOUSES]
    parts += [tree(*at, seed) for seed, at in enumerate(TREES)]
    parts += [post(*at) for at in POSTS]
    return TriangleMesh.concatenate(parts)


def seen(mesh, places: np.ndarray) -> np.ndarray:
    """The class of what a ray straight down meets, 0 for nothing."""
    face = DownwardProbe(mesh).face_below(np.column_stack([places, np.full(len(places), 40.0)]))
    return np.where(face >= 0, mesh.semantic[face], 0)


def footprint(x, y, length, width) -> shapely.Polygon:
    return shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2)


@pytest.mark.parametrize("coloured", [True, False])
def test_a_scan_without_names_is_told_apart(scene, coloured: bool) -> None:
    mesh = scene if coloured else replace(scene, colour=None)
    result = classified(mesh, SPEC, name="scan")
    generator = np.random.default_rng(1)
    places = generator.uniform(-29, 29, (20_000, 2))
    found = seen(result.mesh, places)
    points = shapely.points(places)
    homes = shapely.union_all([footprint(*one[:4]) for one in HOUSES])
    crowns = shapely.union_all([shapely.Point(at).buffer(1.7) for at in TREES])
    trees = shapely.union_all([shapely.Point(at).buffer(3.3) for at in TREES])
    open_air = ~shapely.intersects(points, homes.buffer(0.3).union(trees))
    near_post = np.min([np.hypot(*(places - at).T) for at in POSTS], axis=0) < 0.3
    assert (found[shapely.contains(homes, points)] == semantic_id("building")).mean() > 0.99
    assert (found[shapely.contains(crowns, points)] == semantic_id("vegetation")).mean() > 0.95
    assert (found[open_air & ~near_post] == 0).all()
    for at in POSTS:
        one = result.mesh.select(
            (np.abs(result.mesh.triangles().mean(axis=1)[:, :2] - at).max(axis=1)) < 0.3
        )
        assert (one.semantic == semantic_id("pole")).all()
    # Every wall, feet and all: what stands there is the building down to the ground.
    wall = result.mesh.select(result.mesh.semantic == semantic_id("building"))
    area = wall.areas()[np.abs(wall.normals()[:, 2]) < 0.1].sum()
    true = sum(2 * (one[2] + one[3]) * (one[4] + 0.2) for one in HOUSES)
    true += sum(one[3] * 2.0 for one in HOUSES)  # both gables
    assert area == pytest.approx(true, rel=0.06)


def test_the_ground_is_the_slope_and_open_under_houses(scene) -> None:
    patch = classified(scene, SPEC, name="scan").ground
    assert patch is not None
    assert patch.name == "scan"
    rows, columns = np.indices(patch.heights.shape)
    x, y = patch.west + columns * patch.step, patch.south + rows * patch.step
    known = np.isfinite(patch.heights)
    np.testing.assert_allclose(patch.heights[known], slope(x, y)[known], atol=1e-3)
    homes = shapely.union_all([footprint(*one[:4]) for one in HOUSES])
    under = shapely.contains_xy(homes.buffer(-0.3), x, y)
    assert not known[under].any()
    beside = ~shapely.contains_xy(homes.buffer(0.6), x, y) & (np.abs(x) < 29.5) & (np.abs(y) < 29.5)
    crowns = shapely.union_all([shapely.Point(at).buffer(2.5) for at in TREES])
    assert known[beside].mean() > 0.995
    assert known[shapely.contains_xy(crowns, x, y)].mean() > 0.9  # the ground goes on under trees


def test_materials_follow_colours(scene) -> None:
    mesh = classified(scene, SPEC).mesh
    building = mesh.semantic == semantic_id("building")
    upright = np.abs(mesh.normals()[:, 2]) < 0.3
    walls = mesh.material[building & upright]
    assert (walls == material_id("brick")).mean() > 0.9
    assert set(np.unique(mesh.material[building & ~upright])) == {material_id("roofing-felt")}
    plants = mesh.material[mesh.semantic == semantic_id("vegetation")]
    assert (plants == material_id("foliage")).mean() > 0.9


def test_what_is_not_provided_is_left_out_and_covers_say_where(scene) -> None:
    only = classified(scene, GeometrySpec(file="a", provides=["buildings"]))
    assert set(np.unique(only.mesh.semantic)) == {semantic_id("building")}
    assert set(only.covers) == {"buildings"}
    # A model of the whole place says where no building is, too.
    assert only.covers["buildings"].area == pytest.approx(60 * 60, rel=0.05)
    alone = classified(house(*HOUSES[0]), SPEC)
    assert alone.ground is None
    expected = footprint(*HOUSES[0][:4])
    overlap = alone.covers["buildings"].intersection(expected).area
    assert overlap > 0.93 * expected.area
    assert alone.covers["buildings"].area < 1.2 * expected.area
    assert set(np.unique(alone.mesh.semantic)) == {semantic_id("building")}


def test_the_person_has_the_last_word(scene) -> None:
    spec = GeometrySpec(file="a", semantic="fence", material="wood")
    mesh = classified(house(*HOUSES[0]), spec).mesh
    assert set(np.unique(mesh.semantic)) == {semantic_id("fence")}
    assert set(np.unique(mesh.material)) == {material_id("wood")}


@pytest.mark.parametrize(
    ("name", "semantic", "material"),
    [
        ("house 12 / Brick_Red", "building", "brick"),
        ("BuildingWall", "building", "plaster"),
        ("Window_F / Glass", None, "glass"),
        ("rootNode / feature 3", None, None),
        ("Straße / asphalt", "road", "asphalt"),
        ("Baum_07 / Laub", "vegetation", "foliage"),
        ("street_light_03 / chrome", "pole", "metal-painted"),
        ("pavement / asphalt_light", "road", "asphalt"),
        ("lamp post", "pole", "metal-painted"),
        ("GroundSurface", "terrain", None),
    ],
)
def test_names_say_what_things_are(name: str, semantic: str | None, material: str | None) -> None:
    found, made_of = labels_of_names((name,))
    assert found[0] == (semantic_id(semantic) if semantic else 0)
    assert made_of[0] == (material_id(material) if material else 0)


def test_hue_saturation_value_are_pythons() -> None:
    import colorsys

    colours = np.random.default_rng(0).integers(0, 256, (50, 3)).astype(np.uint8)
    expected = [colorsys.rgb_to_hsv(*(c / 255)) for c in colours]
    np.testing.assert_allclose(hsv(colours), np.array(expected) * [360, 1, 1], atol=1e-9)


@pytest.mark.thorough
def test_shape_agrees_with_the_names_of_a_city_model(shared_data) -> None:
    """The model of Delft that another program made names its parts; without the names we agree."""
    path = shared_data / "airborne" / "delft-ahn3" / "reference" / "testarea.obj"
    points, faces, objects, names, name = [], [], [], {}, ""
    for line in path.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            points.append([float(v) for v in rest])
        elif word == "usemtl":
            name = rest[0]
        elif word == "f":
            faces.append([int(v.split("/")[0]) - 1 for v in rest])
            objects.append(names.setdefault(name, len(names)))
    mesh = TriangleMesh(
        np.array(points) - [84940, 447530, 0],
        np.array(faces, np.int32),
        None,
        np.array(objects, np.int32),
        tuple(names),
    )
    named = classified(mesh, SPEC)
    nameless = classified(replace(mesh, names=("",) * len(names)), SPEC)
    places = np.random.default_rng(0).uniform([-125, -100], [125, 105], (30_000, 2))
    truth, ours = seen(named.mesh, places), seen(nameless.mesh, places)
    building = semantic_id("building")
    both = ((truth == building) & (ours == building)).sum()
    assert both / (truth == building).sum() > 0.93
    assert both / (ours == building).sum() > 0.97
    assert named.ground is not None
    assert nameless.ground is not None
    off = np.abs(named.ground.heights - nameless.ground.heights)
    assert np.nanpercentile(off, 99) < 0.05
