"""Street furniture: sizes, what it faces, that it is closed, stands and keeps off the road."""

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon, box

from urbantwin.scene.catalogue import street_objects
from urbantwin.scene.furniture import furniture_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -5, 100, 5)


def tilted(xy):
    return 0.05 * xy[:, 0]


def feature(geometry, number=1, **tags):
    tags = {key.replace("__", ":"): value for key, value in tags.items()}
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, road=ROAD, ground=tilted):
    return furniture_mesh(features, region=REGION, ground_height=ground, carriageway=road)


def closed(mesh):
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


def volumes(mesh):
    """Signed volume per part: positive where normals look outward."""
    a, b, c = np.moveaxis(mesh.triangles() - mesh.vertices.mean(axis=0), 1, 0)
    return np.bincount(mesh.part, (a * np.cross(b, c)).sum(axis=1) / 6)[np.unique(mesh.part)]


EXTRA = [
    {"amenity": "shelter"},
    {"amenity": "bicycle_parking", "capacity": "8"},
    {"amenity": "fountain"},
    {"highway": "bus_stop", "shelter": "yes"},
    {"historic": "memorial", "memorial": "statue", "height": "5"},
    {"historic": "memorial", "memorial": "bust"},
    {"historic": "memorial", "memorial": "obelisk"},
    {"tourism": "artwork", "artwork_type": "sculpture"},
    {"historic": "boundary_stone"},
    {"man_made": "gantry"},
    {"tourism": "information", "information": "guidepost"},
    {"tourism": "information", "information": "board"},
    {"amenity": "vending_machine", "vending": "cigarettes"},
    {"amenity": "vending_machine", "vending": "excrement_bags"},
]
KINDS = [
    {key: (values[0] or "").replace("*", "") for key, values in one.tags.wanted.items()}
    for one in street_objects()
    if one.tags is not None and one.parts and one.placed == "furniture"
]


@pytest.mark.parametrize("tags", KINDS + EXTRA, ids=lambda tags: "-".join(tags.values()))
def test_every_piece_is_closed_faces_outward_and_stands_in_the_ground(tags):
    mesh, notes = build(feature(Point(20, 30), **tags))
    assert sum(notes.values()) == 1
    assert closed(mesh)
    assert mesh.areas().min() > 1e-7
    assert (volumes(mesh) > 0).all()
    above = mesh.vertices[:, 2] - tilted(mesh.vertices)
    assert above.min() < -0.1
    assert above.max() > 0.4


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({"amenity": "post_box"}, 1.3),
        ({"amenity": "waste_basket"}, 0.9),
        ({"advertising": "column"}, 3.6),
        ({"advertising": "column", "height": "4.2"}, 4.2),
        ({"historic": "memorial", "memorial": "statue", "height": "5 m"}, 5.0),
        ({"emergency": "fire_hydrant"}, 0.87),
        ({"amenity": "bicycle_parking"}, 0.825),
        ({"shop": "kiosk"}, 2.8),
        ({"amenity": "parcel_locker"}, 2.1),
        ({"amenity": "shelter", "height": "3"}, 3.0),
    ],
)
def test_sizes_are_as_mapped_or_usual(tags, height):
    mesh, _ = build(feature(Point(0, 30), **tags), ground=lambda xy: np.zeros(len(xy)))
    assert mesh.vertices[:, 2].max() == pytest.approx(height, abs=0.01)


def test_a_kiosk_in_a_house_is_a_shop_of_it():
    house = feature(box(20, 20, 40, 40), 9, building="yes")
    for spot, built in ((Point(30, 30), 0), (Point(19.5, 30), 0), (Point(10, 30), 1)):
        mesh, notes = build(house, feature(spot, shop="kiosk"))
        assert notes.get("kiosks", 0) == built
        if built:
            assert mesh.vertices[:, :2].mean(axis=0) == pytest.approx([10, 30], abs=0.1)


def test_what_lies_below_ground_indoors_or_has_no_shape_is_left_out():
    mesh, notes = build(
        feature(Point(0, 30), 1, emergency="fire_hydrant", fire_hydrant__type="underground"),
        feature(Point(5, 30), 2, amenity="vending_machine", indoor="yes"),
        feature(Point(9, 30), 3, amenity="bench", layer="-1"),
        feature(Point(9, 40), 4, historic="memorial", memorial="stolperstein"),
        feature(Point(12, 40), 5, amenity="restaurant"),
    )
    assert len(mesh.faces) == 0
    assert notes == {"memorials and artworks of unknown shape, not drawn": 1}


def test_a_bench_faces_the_road_or_as_mapped():
    """Its backrest is on the side away from where it faces."""
    for tags, side in (({}, 1), ({"direction": "N"}, -1)):
        mesh, _ = build(
            feature(Point(0, 8), amenity="bench", **tags), ground=lambda xy: np.zeros(len(xy))
        )
        back = mesh.vertices[mesh.vertices[:, 2] > 0.7]
        assert np.sign(back[:, 1] - 8).tolist() == [side] * len(back)


def test_a_shelter_has_glass_walls_and_is_open_to_the_road():
    mesh, _ = build(feature(Point(0, 8), amenity="shelter"), ground=lambda xy: np.zeros(len(xy)))
    glass = mesh.select(mesh.material == material_id("glass")).vertices
    assert glass[:, 1].min() > 7.3
    assert np.ptp(glass[:, 0]) == pytest.approx(4.0, abs=0.1)


def test_cycle_stands_fill_their_area():
    mesh, _ = build(
        feature(box(0, 20, 12, 22), amenity="bicycle_parking", bicycle_parking="stands"),
        ground=lambda xy: np.zeros(len(xy)),
    )
    top = mesh.vertices[mesh.vertices[:, 2] > 0.78]
    assert np.ptp(top[:, 0]) == pytest.approx(12 * (1 - 1 / 13), abs=0.1)
    assert len(mesh.faces) / 3 / (2 * 6 + 2 * 4) == 13  # 12 m at 0.9 m: 13 hoops of three bars


def test_cycle_stands_of_an_area_stay_within_it_off_the_road_and_out_of_houses():
    """An area over a road and a house, larger than the stands that it is given."""
    area = Polygon([(-30, -12), (30, -12), (30, 40), (0, 40)])
    house = box(12, 8, 40, 30)
    mesh, notes = build(
        feature(area, 1, amenity="bicycle_parking"), feature(house, 2, building="yes"),
        ground=lambda xy: np.zeros(len(xy)),
    )  # fmt: skip
    assert notes == {"cycle parking": 1}
    bars = np.unique(mesh.vertices[:, :2], axis=0)
    assert len(bars) > 100
    distance = shapely.distance(shapely.points(bars), area.buffer(0.03))
    assert distance.max() == 0
    for taken in (ROAD, house):
        assert shapely.distance(shapely.points(bars), taken).min() > 0.2
    boxed, _ = build(feature(area, 1, amenity="bicycle_parking", covered="yes"))
    assert semantic_id("other-structure") not in boxed.semantic


def test_nothing_stands_on_the_carriageway():
    mesh, notes = build(
        feature(Point(0, 4), 1, amenity="waste_basket"),
        feature(Point(20, 0), 2, amenity="bench"),
        feature(Point(40, 5.2), 3, amenity="shelter"),
    )
    assert notes["pieces on carriageways, left out"] == 1
    assert np.abs(mesh.vertices[:, 1]).min() > 5.0


def test_a_fountain_of_an_area_holds_level_water_within_a_rim():
    mesh, notes = build(feature(Point(0, 30).buffer(4), amenity="fountain"))
    assert notes == {"fountains": 1}
    water = mesh.select(mesh.material == material_id("water")).vertices[:, 2]
    assert mesh.vertices[:, 2].max() - water.max() == pytest.approx(0.12)
    assert closed(mesh)


def test_a_gantry_spans_the_road_clear_of_traffic():
    road = feature(LineString([(-100, 0), (100, 0)]), 1, highway="motorway")
    mesh, notes = build(
        road, feature(Point(10, 1), 2, man_made="gantry"), ground=lambda xy: np.zeros(len(xy))
    )
    assert notes == {"gantries": 1}
    over = np.abs(mesh.vertices[:, 1]) < 5
    assert mesh.vertices[over, 2].min() == pytest.approx(5.5, abs=0.01)
    posts = mesh.vertices[mesh.vertices[:, 2] < 1]
    assert np.abs(posts[:, 1]).min() > 5.2
    assert (mesh.semantic == semantic_id("traffic-sign")).any()


def test_steps_climb_the_ground_between_their_ends():
    """On ground that rises by 5 %: 20 m are 1 m, in as many steps as are mapped."""
    up = feature(LineString([(10, 20), (30, 20)]), highway="steps", step_count="8", width="3")
    mesh, notes = build(up)
    assert notes == {"flights of steps": 1}
    assert closed(mesh)
    assert mesh.areas().min() > 1e-7
    assert set(mesh.semantic) == {semantic_id("sidewalk")}
    level = mesh.normals()[:, 2] > 0.99
    heights = np.unique(mesh.triangles()[level][..., 2].round(6))
    assert heights == pytest.approx(0.5 + np.arange(1, 9) / 8)
    assert mesh.areas()[level].sum() == pytest.approx(20 * 3)


@pytest.mark.parametrize("tags", [{"layer": "-1"}, {"tunnel": "yes"}, {"indoor": "yes"}])
def test_steps_below_ground_are_not_drawn(tags):
    assert not build(feature(LineString([(10, 20), (30, 20)]), highway="steps", **tags))[1]


def test_steps_on_level_ground_are_told_and_not_drawn():
    mesh, notes = build(feature(LineString([(10, 20), (10, 30)]), highway="steps"))
    assert not len(mesh.faces)
    assert list(notes.values()) == [1]
