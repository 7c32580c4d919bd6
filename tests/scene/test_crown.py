"""Crowns cast by Embree, proportions by genus, trees of surveys."""

import numpy as np
import pytest
from numpy.random import Generator, Philox
from shapely import LineString, Point, Polygon, box

from urbantwin.reconstruct import SurveyedTree
from urbantwin.scene.tree import surveyed_tree_mesh, tree_mesh
from urbantwin.scene.tree.crown import crown_clumps
from urbantwin.scene.tree.genus import genus_of
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

from ..thin_rays import cast_static

REGION = box(-100, -100, 100, 100)
LEAVES, TRUNK = semantic_id("vegetation"), semantic_id("trunk")


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, road=None, **more):
    return tree_mesh(
        features, region=REGION, ground_height=flat, carriageway=road or Polygon(), **more
    )


def passed(clumps, diameter, low, high, seed=3, count=3000):
    """Share of level beams through the middle half of a crown that pass it."""
    from urbantwin.geometry import LabelledMesh

    mesh = LabelledMesh.build(
        clumps.reshape(-1, 3), np.arange(3 * len(clumps)).reshape(-1, 3), LEAVES, 10
    )
    rng = np.random.default_rng(seed)
    spots = np.column_stack(
        [
            rng.uniform(-diameter / 4, diameter / 4, count),
            np.zeros(count),
            low + (high - low) * rng.uniform(0.25, 0.75, count),
        ]
    )
    origin = np.array([0.0, -600.0, (low + high) / 2])
    way = spots - origin
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return float((cast_static(mesh, origin, way).face < 0).mean())


@pytest.mark.parametrize("count", [60, 480, 900])
@pytest.mark.parametrize(
    ("form", "diameter", "low", "high"),
    [
        ("round", 8.0, 3.0, 12.0),
        ("round", 3.0, 2.0, 5.0),
        ("ovoid", 7.0, 3.0, 14.0),
        ("spreading", 10.0, 3.0, 12.0),
        ("column", 3.0, 0.5, 14.0),
        ("cone", 5.0, 1.0, 16.0),
    ],
)
def test_a_few_percent_of_level_beams_pass_a_crown(form, diameter, low, high, count):
    shares = [
        passed(
            crown_clumps(form, diameter, low, high, Generator(Philox(key=seed)), count),
            diameter,
            low,
            high,
        )
        for seed in range(6)
    ]
    assert 0.02 < np.mean(shares) < 0.26


@pytest.mark.parametrize("form", ["round", "ovoid", "spreading", "column", "cone", "palm"])
def test_a_crown_fills_its_bounds(form):
    clumps = crown_clumps(form, 6.0, 3.0, 11.0, Generator(Philox(key=5)))
    corners = clumps.reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx([-3, -3, 3])
    assert corners.max(axis=0) == pytest.approx([3, 3, 11])


@pytest.mark.parametrize(
    ("tags", "name"),
    [
        ({"genus": "Tilia"}, "Tilia"),
        ({"species": "Quercus robur"}, "Quercus"),
        ({"species": "tilia cordata"}, "Tilia"),
        ({"taxon": "Platanus × hispanica"}, "Platanus"),
        ({"genus:de": "Ahorn"}, "Acer"),
        ({"species:en": "London plane"}, "Platanus"),
        ({"genus": "Unheardof"}, ""),
        ({"leaf_type": "needleleaved"}, "needleleaved"),
    ],
)
def test_the_genus_is_read_from_what_mappers_write(tags, name):
    assert genus_of(tags).name == name


def test_trees_of_one_height_differ_by_genus():
    def widths(genus):
        mesh, _ = build(feature(Point(0, 30), natural="tree", genus=genus, height="15"))
        leaves = mesh.select(mesh.semantic == LEAVES).vertices
        return np.ptp(leaves[:, 0]), leaves[:, 2].min(), leaves[:, 2].max()

    cypress, oak, spruce, palm = map(widths, ("Cupressus", "Quercus", "Picea", "Washingtonia"))
    assert cypress[0] < spruce[0] < oak[0]
    assert palm[1] > 10 > oak[1] > spruce[1]
    assert {round(tree[2], 6) for tree in (cypress, oak, spruce, palm)} == {15.0}


def test_conifers_have_needles():
    mesh, _ = build(feature(Point(0, 30), natural="tree", genus="Picea"))
    leaves = mesh.select(mesh.semantic == LEAVES)
    assert set(leaves.material) == {material_id("foliage-needle")}


def test_surveyed_trees_have_their_measured_sizes():
    trees = [
        SurveyedTree(0, 30, 14.0, 8.0, 4.0),
        SurveyedTree(20, 30, 20.0, 5.0, 1.5),
        SurveyedTree(40, 30, float("nan"), 5.0, 1.5),
        SurveyedTree(400, 30, 10.0, 5.0, 1.5),
    ]
    mesh, notes = surveyed_tree_mesh(trees, lambda xy: np.full(len(xy), 2.0), region=REGION)
    assert notes == {
        "surveyed trees": 2,
        "surveyed trees outside the region, left out": 1,
        "surveyed trees without a size, left out": 1,
    }
    for part, tree in enumerate(trees[:2], 1):
        own = mesh.select(mesh.part == part)
        leaves = own.select(own.semantic == LEAVES).vertices
        assert leaves[:, 2].max() - 2 == pytest.approx(tree.height_m)
        assert leaves[:, 2].min() - 2 == pytest.approx(tree.crown_base_m)
        assert np.ptp(leaves[:, 0]) == pytest.approx(tree.crown_m)
        trunk = own.select(own.semantic == TRUNK).vertices
        assert trunk[:, 2].min() == pytest.approx(2 - 0.3)


def test_no_trees_are_no_mesh():
    mesh, notes = surveyed_tree_mesh([], flat)
    assert len(mesh.faces) == 0
    assert notes == {}


def test_imported_geometry_takes_the_place_of_the_maps_trees():
    row = feature(LineString([(-60, 20), (60, 20)]), 5, natural="tree_row")
    tree = feature(Point(0, 40), 6, natural="tree")
    _, notes = build(row, tree)
    _, less = build(row, tree, without=box(-100, 0, 0.5, 100))
    assert less["trees"] < notes["trees"] / 2 + 1
    assert "trees" not in build(row, tree, without=REGION)[1]


def test_an_orchard_is_planted_and_woods_are_mixed_where_mapped():
    mesh, notes = build(feature(box(0, 10, 60, 60), 3, landuse="orchard"))
    assert notes["trees of woods"] > 80
    assert mesh.vertices[:, 2].max() < 8
    mesh, _ = build(feature(box(0, 10, 60, 60), 3, natural="wood", leaf_type="mixed"))
    kinds = set(mesh.select(mesh.semantic == LEAVES).material)
    assert kinds == {material_id("foliage"), material_id("foliage-needle")}


def test_nothing_is_seeded_on_ways_tracks_and_water():
    wood = feature(box(-60, 10, 60, 80), 3, natural="wood")
    path = feature(LineString([(-60, 40), (60, 40)]), 4, highway="footway")
    pond = feature(box(-60, 60, 0, 80), 5, natural="water")
    mesh, _ = build(wood, path, pond)
    trunks = mesh.select(mesh.semantic == TRUNK)
    middle = np.array(
        [
            trunks.vertices[trunks.faces[trunks.part == part]].mean(axis=(0, 1))
            for part in np.unique(trunks.part)
        ]
    )
    assert (np.abs(middle[:, 1] - 40) > 1.5).all()
    assert not ((middle[:, 0] < -0.3) & (middle[:, 1] > 60.3)).any()
