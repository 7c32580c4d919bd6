import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon, box

from urbantwin.geometry import SiteFrame
from urbantwin.scene.tree import tree_mesh
from urbantwin.scene.tree.planting import MOST_WOOD_TREES
from urbantwin.site.extract import OsmFeature
from urbantwin.site.extract_file import read_extract
from urbantwin.taxonomy import semantic_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -5, 100, 5)
TRUNK, LEAVES = semantic_id("trunk"), semantic_id("vegetation")


def tilted(xy):
    return 0.1 * xy[:, 0] + 3


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, road=ROAD, region=REGION, ground=tilted):
    return tree_mesh(features, region=region, ground_height=ground, carriageway=road)


@pytest.mark.parametrize("leaf_type", ["broadleaved", "needleleaved"])
def test_a_tree_has_its_mapped_dimensions(leaf_type):
    mesh, notes = build(
        feature(
            Point(20, 30),
            natural="tree",
            height="17 m",
            diameter_crown="9,5",
            circumference="1.57",
            leaf_type=leaf_type,
        )
    )
    assert notes["trees"] == 1
    ground = 5.0
    leaves = mesh.select(mesh.semantic == LEAVES).vertices
    assert leaves[:, 2].max() - ground == pytest.approx(17)
    assert np.ptp(leaves[:, :2], axis=0) == pytest.approx([9.5, 9.5])
    trunk = mesh.select(mesh.semantic == TRUNK).vertices
    foot = trunk[trunk[:, 2] < ground]
    assert len(foot) > 0
    assert np.ptp(foot[:, 0]) == pytest.approx(1.57 / np.pi, rel=0.1)
    assert leaves[:, 2].min() > ground
    assert trunk[:, 2].max() > leaves[:, 2].min()
    assert 300 <= len(mesh.faces) <= 1000


def test_a_crown_is_neither_a_ball_nor_see_through():
    """Level beams through the middle of the crown: some pass, and hits are spread in depth."""
    mesh, _ = build(feature(Point(0, 30), natural="tree", height="12", diameter_crown="8"))
    a, b, c = np.moveaxis(mesh.select(mesh.semantic == LEAVES).triangles()[..., [0, 2, 1]], 1, 0)
    rng = np.random.default_rng(1)
    depth = []
    for x, z in rng.uniform([-2.5, 3 + 6], [2.5, 3 + 10], (400, 2)):
        # In the x-z plane a beam along y is a point: it meets the triangles that contain it.
        sides = [
            (q[:, 0] - p[:, 0]) * (z - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        inside = np.all(np.array(sides) > 0, axis=0) | np.all(np.array(sides) < 0, axis=0)
        if inside.any():
            depth.append(((a + b + c)[inside, 2] / 3).min() - 26)
    passed = 1 - len(depth) / 400
    assert 0.02 < passed < 0.4
    assert np.quantile(depth, 0.9) - np.quantile(depth, 0.1) > 2.0


def test_the_same_map_gives_the_same_trees_and_two_trees_differ():
    trees = [feature(Point(0, 30), 7, natural="tree"), feature(Point(20, 30), 8, natural="tree")]
    first, _ = build(*trees)
    second, _ = build(*trees)
    alone, _ = build(trees[1])
    assert np.array_equal(first.vertices, second.vertices)
    shape = [first.select(first.part == k).vertices for k in (1, 2)]
    assert shape[0].shape != shape[1].shape or not np.allclose(
        shape[0] - shape[0][0], shape[1] - shape[1][0]
    )
    assert np.allclose(shape[1], alone.vertices)


def test_crowns_leave_the_carriageway_clear_and_trunks_stand_beside_it():
    mesh, notes = build(
        feature(Point(0, 4.8), natural="tree", height="8", diameter_crown="8"),
        feature(Point(40, 0), 2, natural="tree"),
        ground=lambda xy: np.zeros(len(xy)),
    )
    assert notes["trees moved off carriageways"] == 1
    assert notes["trees on carriageways, left out"] == 1
    over = np.abs(mesh.triangles()[..., 1]) < 5
    assert mesh.triangles()[..., 2][over].min() > 4.4
    assert over.any()


def test_a_row_has_a_tree_every_eight_metres_but_not_where_one_is_mapped():
    row = feature(LineString([(-40, 20), (40, 20)]), 5, natural="tree_row")
    mesh, notes = build(row)
    assert notes["trees of rows"] == 11
    assert len(set(mesh.part)) == 11
    _, notes = build(row, feature(Point(0, 21), 6, natural="tree"))
    assert notes["trees"] == 11
    assert notes["trees of rows"] == 10


def test_woods_are_drawn_from_the_road_inward_up_to_a_cap():
    mesh, notes = build(feature(box(-100, 10, 100, 100), natural="wood"))
    assert notes["trees of woods"] == MOST_WOOD_TREES
    assert notes["trees within woods, left out"] > 100
    trunks = mesh.select(mesh.semantic == TRUNK)
    assert trunks.vertices[:, 1].max() < 90


def test_nothing_grows_in_buildings_or_outside_the_region():
    house = feature(box(-20, 10, 20, 60), 2, building="yes")
    mesh, _ = build(feature(box(-60, 10, 150, 60), natural="scrub"), house)
    middle = mesh.vertices.reshape(-1, 42, 3).mean(axis=1)
    inside = shapely.contains_xy(house.geometry.buffer(-0.3), middle[:, 0], middle[:, 1])
    assert not inside.any()
    assert middle[:, 0].max() < 101
    assert (mesh.vertices[:, 2] - tilted(mesh.vertices)).max() < 4


def test_bushes_are_closed_and_stand_on_the_ground():
    mesh, notes = build(feature(Point(10, 20), natural="shrub", height="2"))
    assert notes["bushes"] == 1
    a, b, c = np.moveaxis(mesh.triangles() - mesh.vertices.mean(axis=0), 1, 0)
    assert (a * np.cross(b, c)).sum() / 6 > 1.0
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(ends, axis=0, return_counts=True)[1]) == {2}
    assert mesh.vertices[:, 2].min() < 4.0 < mesh.vertices[:, 2].max() < 6.5


def test_no_vegetation_gives_an_empty_mesh():
    mesh, notes = build(road=Polygon())
    assert len(mesh.faces) == 0
    assert notes == {}


def test_real_trees_are_as_high_as_mapped(shared_data):
    extract = read_extract(shared_data / "osm" / "neukolln.osm")
    signals = [i for i, t in extract.node_tags.items() if t.get("highway") == "traffic_signals"]
    longitude, latitude = np.median([extract.nodes[i] for i in signals], axis=0)
    region = shapely.Point(0, 0).buffer(200)
    features = extract.features(SiteFrame(float(latitude), float(longitude)), region)
    mesh, _ = build(*features, region=region, road=Polygon())
    tops, middles = [], []
    for part in set(mesh.part):
        own = mesh.select((mesh.part == part) & (mesh.semantic == LEAVES))
        if len(own.faces) > 300:
            tops.append(own.vertices[:, 2].max())
            middles.append((own.vertices.min(axis=0) + own.vertices.max(axis=0))[:2] / 2)
    checked = 0
    for f in features:
        if f.tags.get("natural") == "tree" and f.tags.get("height", "").isdigit():
            spot = shapely.get_coordinates(f.geometry)
            nearest = np.linalg.norm(np.array(middles) - spot, axis=1).argmin()
            assert tops[nearest] - tilted(spot)[0] == pytest.approx(float(f.tags["height"]))
            checked += 1
    assert checked >= 10
