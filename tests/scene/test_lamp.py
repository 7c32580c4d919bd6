"""Street lamps: heads over the carriageway, arms on medians, walls, seeds; plates of signs."""

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon, box

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.pole import pole_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -5, 100, 5)
SIGN = semantic_id("traffic-sign")


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    tags = {key.replace("__", ":"): value for key, value in tags.items()}
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, road=ROAD, **more):
    return pole_mesh(features, region=REGION, ground_height=flat, carriageway=road, **more)


@pytest.mark.parametrize("away", [0.6, 1.5, 2.5])
def test_the_head_of_a_lamp_is_above_the_carriageway(away):
    mesh, _ = build(feature(Point(0, 5 + away), highway="street_lamp", height="8"))
    edge = DownwardProbe(mesh).height_below([[0, y, 20.0] for y in (4.5, 4.2)])
    assert np.isfinite(edge).any()
    assert np.nanmax(edge) == pytest.approx(8, abs=0.1)
    over = mesh.vertices[np.abs(mesh.vertices[:, 1]) < 5]
    assert over[:, 2].min() > 7


def test_a_lamp_on_a_median_has_an_arm_to_each_side():
    road = shapely.union(box(-100, -9, 100, -1), box(-100, 1, 100, 9))
    mesh, _ = build(feature(Point(0, 0), highway="street_lamp"), road=road)
    top = mesh.vertices[mesh.vertices[:, 2] > 7.7]
    assert top[:, 1].max() > 1.5
    assert top[:, 1].min() < -1.5


def test_masts_are_straight_or_bent_as_mapped():
    straight, _ = build(feature(Point(0, 6), highway="street_lamp", lamp_mount="straight_mast"))
    assert np.abs(straight.vertices[:, 1] - 6).max() < 0.3
    bent, _ = build(feature(Point(0, 6), highway="street_lamp", lamp_mount="bent_mast", height="8"))
    assert bent.vertices[:, 2].max() == pytest.approx(8, abs=0.1)
    assert bent.vertices[:, 1].min() < 5
    two, _ = build(feature(Point(0, 6), highway="street_lamp", light__count="2"))
    assert np.ptp(two.vertices[two.vertices[:, 2] > 7.5][:, 1]) > 3


def test_a_lamp_on_a_wall_reaches_out_of_it():
    house = feature(box(-10, 8, 10, 20), 2, building="yes")
    mesh, notes = build(feature(Point(0, 7.5), highway="street_lamp", lamp_mount="wall"), house)
    assert notes["lamps on walls"] == 1
    assert mesh.vertices[:, 1].min() < 7.1
    assert mesh.vertices[:, 1].max() == pytest.approx(8.1, abs=0.05)  # held in the wall
    assert mesh.vertices[:, 2].min() > 4


def test_lamps_are_seeded_along_lit_streets_without_any():
    street = LineString([(-100, 0), (100, 0)])
    mesh, notes = build(feature(street, 1, highway="residential", lit="yes"))
    count = notes["street lamps seeded where lit=yes"]
    assert count == 7  # 200 m at 28 m
    feet = mesh.vertices[mesh.vertices[:, 2] < 1]
    assert np.abs(feet[:, 1]).min() > 5.4
    assert {-1.0, 1.0} == set(np.sign(feet[:, 1]))
    again, _ = build(feature(street, 1, highway="residential", lit="yes"))
    assert np.array_equal(mesh.vertices, again.vertices)


@pytest.mark.parametrize("tags", [{"lit": "no"}, {}, {"lit": "yes", "tunnel": "yes"}])
def test_no_lamps_are_seeded_where_the_map_does_not_say_lit(tags):
    street = LineString([(-100, 0), (100, 0)])
    assert build(feature(street, 1, highway="residential", **tags))[1] == {}


def test_no_lamps_are_seeded_beside_mapped_ones_in_houses_or_under_decks():
    street = feature(LineString([(-100, 0), (100, 0)]), 1, highway="residential", lit="yes")
    lamps = [feature(Point(x, 6), 9 + k, highway="street_lamp") for k, x in enumerate((-90, -50))]
    _, notes = build(street, *lamps)
    assert notes["street lamps seeded where lit=yes"] == 4
    house = feature(box(-100, 5.2, 100, 30), 5, building="yes")
    mesh, _ = build(street, house)
    assert mesh.vertices[mesh.vertices[:, 2] < 1][:, 1].max() < 0
    _, notes = build(street, decks=box(-100, -20, 100, 20))
    assert notes == {}


def test_a_lamp_of_a_bridge_stands_on_its_deck():
    mesh, _ = build(
        feature(Point(0, 0), highway="street_lamp"),
        road=Polygon(),
        decks=box(-10, -10, 10, 10),
        deck_height=lambda xy: np.full(len(xy), 6.0),
    )
    assert mesh.vertices[:, 2].min() == pytest.approx(5.7)


def test_plates_have_their_shapes_and_hang_below_each_other():
    mesh, _ = build(
        feature(Point(0, 8), traffic_sign="DE:206", traffic_sign__2="DE:1001", direction="W")
    )
    plates = mesh.select(mesh.semantic == SIGN).vertices
    upper, lower = plates[plates[:, 2] > 2.4], plates[plates[:, 2] < 2.4]
    assert len(np.unique(np.round(upper[:, 1:], 3), axis=0)) == 8  # an octagon
    assert np.ptp(lower[:, 1]) == pytest.approx(0.6)
    assert lower[:, 2].min() == pytest.approx(2.03)  # people pass below
    assert plates[:, 0].max() < 0  # it looks west
    yield_sign, _ = build(feature(Point(0, 8), traffic_sign="give_way", direction="W"))
    corners = yield_sign.select(yield_sign.semantic == SIGN).vertices
    assert (corners[:, 2] > corners[:, 2].mean()).mean() == pytest.approx(2 / 3)


def test_signs_on_a_lamp_are_on_its_mast():
    mesh, notes = build(feature(Point(0, 6), highway="street_lamp", traffic_sign="FI:372"))
    assert notes["signs on other poles"] == 1
    assert set(mesh.part) == {1}
    assert (mesh.semantic == SIGN).any()
