"""A made-up survey, classified or not: its ground, houses and trees are found where they stand."""

import numpy as np
import open3d as o3d
import pytest
import shapely
import trimesh

from urbantwin.errors import InputError
from urbantwin.reconstruct import PointCloud
from urbantwin.reconstruct.airborne import from_airborne
from urbantwin.taxonomy import material_id, semantic_id

REGION = shapely.box(-60, -60, 60, 60)
HOUSE = shapely.box(-30, -12, -14, 0)  # gabled along x, eaves 6 m, ridge 9 m above 1.0
HALL = shapely.box(10, 10, 50, 40)  # flat, 8 m
TREES = [(-30.0, 25.0, 12.0, 3.5), (-12.0, 30.0, 9.0, 2.5), (20.0, -30.0, 15.0, 4.5)]
POLE, CAR, WIRE_Z = (0.0, -40.0), (5.0, -45.0), 9.0


def terrain(x, y):
    return 0.03 * x + 1.5 * np.sin(y / 25.0)


def survey(seed=0, density=8.0):
    """Points, ASPRS classes and last returns of the scene."""
    random = np.random.default_rng(seed)

    def spread(count, low, high):
        return random.uniform(low, high, (count, 2))

    xy = spread(int(140 * 140 * density), -70, 70)
    z = terrain(*xy.T)
    code = np.full(len(xy), 2)
    house = shapely.contains_xy(HOUSE, xy)
    z[house] = 1.0 + 9 - 0.5 * np.abs(xy[house, 1] + 6)
    hall = shapely.contains_xy(HALL, xy)
    z[hall] = 9.0
    code[house | hall] = 6
    points, last = [np.column_stack([xy, z])], [np.ones(len(xy), bool)]
    codes = [code]

    def add(more, number, is_last):
        points.append(more)
        codes.append(np.full(len(more), number))
        last.append(np.broadcast_to(is_last, len(more)))

    for x, y, height, radius in TREES:
        # A crown as an ellipsoid: first returns on its upper side, later ones within.
        way = random.normal(size=(int(60 * radius**2), 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        depth = random.uniform(0.4, 1.0, (len(way), 1)) ** (1 / 3)
        crown = way * depth * [radius, radius, 0.35 * height]
        crown += [x, y, terrain(x, y) + 0.65 * height]
        add(crown, 5, random.random(len(crown)) < 0.5)
    # A lamp post, a car and a wire: high or rough, and no trees.
    add(np.column_stack([random.normal(POLE, 0.08, (60, 2)),
                         terrain(*POLE) + random.uniform(0, 9, 60)]), 1, True)  # fmt: skip
    car = random.uniform([-2.2, -0.9, 0.3], [2.2, 0.9, 1.5], (250, 3))
    add(car + [*CAR, terrain(*CAR)], 1, True)
    wire = np.column_stack([np.linspace(-60, 60, 400), np.full(400, -55.0), np.full(400, WIRE_Z)])
    add(wire, 1, random.random(400) < 0.5)
    add(np.array([[0.0, 0, 80.0], [30, -10, -25.0]]), 1, True)  # a bird, a reflection
    cloud = np.concatenate(points)
    cloud += random.normal(0, 0.03, cloud.shape)
    return PointCloud(cloud, None, np.concatenate(codes).astype(np.uint8), np.concatenate(last))


@pytest.fixture(scope="module", params=["classified", "unclassified", "without footprints"])
def model(request):
    cloud = survey()
    if request.param != "classified":
        cloud = PointCloud(cloud.points, None, None, cloud.last)
    footprints = [] if request.param == "without footprints" else [HOUSE, HALL]
    return from_airborne(cloud, footprints=footprints, region=REGION, name="made up")


def test_the_ground_is_the_terrain(model):
    patch = model.ground
    rows, columns = patch.heights.shape
    x, y = np.meshgrid(
        patch.west + patch.step * np.arange(columns), patch.south + patch.step * np.arange(rows)
    )
    inside = shapely.contains_xy(REGION, x, y)
    built = shapely.contains_xy(shapely.union_all([HOUSE, HALL]).buffer(1), x, y)
    error = patch.heights - terrain(x, y)
    assert np.isfinite(error[inside]).all()
    assert np.sqrt(np.mean(error[inside & ~built] ** 2)) < 0.05
    assert np.abs(error[inside & ~built]).max() < 0.4
    # Under the hall the ground is bridged from side to side: 30 m of it.
    assert np.abs(error[inside & built]).max() < 0.5
    assert patch.detail_m == pytest.approx(1 / np.sqrt(8), rel=0.2)


def test_the_buildings_are_closed_and_where_they_stand(model):
    assert len(model.outlines) == 2
    mesh = model.buildings
    assert set(mesh.semantic.tolist()) == {semantic_id("building")}
    assert set(mesh.material.tolist()) == {material_id("brick"), material_id("roofing")}
    for number, outline in enumerate(model.outlines, start=1):
        truth = HOUSE if outline.centroid.x < 0 else HALL
        assert outline.intersection(truth).area / outline.union(truth).area > 0.93
        part = mesh.select(mesh.part == number)
        body = trimesh.Trimesh(part.vertices, part.faces, process=False)
        assert body.is_watertight
        assert body.volume > 0
        assert body.area_faces.min() > 1e-7
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    down = np.array([[-20, -6, 50, 0, 0, -1], [-20, -9, 50, 0, 0, -1], [30, 25, 50, 0, 0, -1]])
    top = 50 - scene.cast_rays(o3d.core.Tensor(down.astype(np.float32)))["t_hit"].numpy()
    assert top == pytest.approx([10.0, 8.5, 9.0], abs=0.1)


def test_the_trees_are_the_trees(model):
    found = np.array([[t.x, t.y, t.height_m, t.crown_m / 2] for t in model.trees])
    assert len(found) == len(TREES)
    for x, y, height, radius in TREES:
        tree = found[np.argmin(np.hypot(found[:, 0] - x, found[:, 1] - y))]
        assert np.hypot(tree[0] - x, tree[1] - y) < 1.0
        assert tree[2] == pytest.approx(height, abs=0.6)
        assert tree[3] == pytest.approx(radius, rel=0.3)
    for tree in model.trees:
        assert 0 < tree.crown_base_m < tree.height_m


def test_a_survey_of_elsewhere_is_refused():
    cloud = PointCloud(np.random.default_rng(0).uniform(5e5, 5.001e5, (100, 3)))
    with pytest.raises(InputError, match="none of its 100 points lies in the region"):
        from_airborne(cloud, footprints=[], region=REGION, name="elsewhere")


@pytest.mark.thorough
def test_a_footprint_without_points_stays_the_maps():
    empty = shapely.box(-50, 40, -40, 50)
    model = from_airborne(survey(), footprints=[HOUSE, HALL, empty], region=REGION, name="made up")
    assert len(model.outlines) == 2
    assert not model.covers["buildings"].contains(empty.centroid)
    assert model.covers["buildings"].contains(HALL.centroid)
