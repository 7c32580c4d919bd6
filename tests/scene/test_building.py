import itertools
from collections import Counter

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box

from urbantwin.geometry import DownwardProbe, LabelledMesh, SiteFrame
from urbantwin.roads.building_ground import ROAD_CLEARANCE_M
from urbantwin.scene.building import building_mesh
from urbantwin.scene.building_height import building_rise
from urbantwin.site.extract import OsmFeature
from urbantwin.site.extract_file import read_extract
from urbantwin.taxonomy import material_id, semantic_id

from ..thorough import further

REGION = box(-200, -200, 200, 200)
NO_ROAD = Polygon()


def flat(xy):
    return np.zeros(len(xy))


def tilted(xy):
    return 0.05 * xy[:, 0]


def feature(geometry, number=1, kind="way", **tags):
    return OsmFeature(kind, number, {k.replace("__", ":"): v for k, v in tags.items()}, geometry)


def build(*features, ground=flat, road=NO_ROAD, region=REGION):
    return building_mesh(features, region=region, ground_height=ground, carriageway=road)[:2]


def volume(mesh: LabelledMesh) -> float:
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def uneven_edges(mesh: LabelledMesh) -> int:
    """Count edges whose two directions are not used equally often: 0 for closed surfaces."""
    ends = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    sign = np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0)
    return int(np.count_nonzero(np.bincount(edge.ravel(), weights=sign)))


def crossings(mesh: LabelledMesh, start, end) -> int:
    """Count the triangles that a segment passes through (Moller and Trumbore, 1997)."""
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    direction = np.subtract(end, start)
    p = np.cross(direction, c - a)
    det = ((b - a) * p).sum(axis=1)
    ok = np.abs(det) > 1e-12
    inverse = np.where(ok, 1 / np.where(ok, det, 1), 0)
    s = np.asarray(start) - a
    q = np.cross(s, b - a)
    u, v = (s * p).sum(axis=1) * inverse, (direction * q).sum(axis=1) * inverse
    t = ((c - a) * q).sum(axis=1) * inverse
    return int((ok & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1)).sum())


def roof_height(mesh, x, y):
    return float(DownwardProbe(mesh).height_below([[x, y, 500.0]])[0])


def test_a_building_has_its_mapped_height_over_its_lowest_ground():
    mesh, _ = build(feature(box(0, 0, 20, 10), building="yes", height="12 m"), ground=tilted)
    assert mesh.vertices[:, 2].max() == pytest.approx(12.0)
    assert mesh.vertices[:, 2].min() == pytest.approx(-0.5)
    assert volume(mesh) == pytest.approx(20 * 10 * 12.5)
    assert uneven_edges(mesh) == 0
    assert set(mesh.semantic) == {semantic_id("building")}
    assert set(mesh.part) == {1}


def test_a_courtyard_is_open():
    hollow = Polygon(box(0, 0, 20, 20).exterior, [box(5, 5, 15, 15).exterior.coords])
    mesh, _ = build(feature(hollow, kind="relation", building="yes", building__levels="3"))
    assert volume(mesh) == pytest.approx(300 * (3 * 3.2 + 0.5))
    assert np.isnan(roof_height(mesh, 10, 10))


def test_min_height_leaves_the_space_beneath_open():
    mesh, _ = build(feature(box(0, 0, 10, 10), building="yes", height="20", min_height="8"))
    assert volume(mesh) == pytest.approx(100 * 12)
    assert crossings(mesh, (-5, 5, 4), (15, 5, 4)) == 0
    assert crossings(mesh, (-5, 5.3, 14), (15, 5.3, 14)) == 2


@pytest.mark.parametrize(
    ("tags", "low", "high"),
    [
        ({"building:levels": "4"}, 0, 12.8),
        ({"building:levels": "4", "roof:levels": "1"}, 0, 16.0),
        ({"height": "forty", "building:levels": "2"}, 0, 6.4),
        ({"height": "40'"}, 0, 12.192),
        ({"height": "15", "building:levels": "5", "building:min_level": "1"}, 3.0, 15),
        ({"building:levels": "4", "building:min_level": "1"}, 3.2, 12.8),
        ({"height": "9", "min_height": "11"}, 0, 9),
        ({"building": "garage", "building:levels": "0"}, 0, 2.8),
    ],
)
def test_tags_give_the_rise(tags, low, high):
    rise = building_rise(tags, {}, 100.0, Counter())
    assert (rise.low_m, rise.high_m) == pytest.approx((low, high))


def test_what_was_assumed_is_counted():
    _, notes = build(
        feature(box(0, 0, 10, 10), building="yes", height="tall"),
        feature(box(20, 0, 30, 10), 2, building="yes", building__levels="2"),
        feature(box(40, 0, 50, 10), 3, building="no"),
        feature(box(60, 0, 70, 10), 4, building="parking", layer="-1"),
        feature(box(80, 0, 90, 10), 5, building="yes", location="underground"),
    )
    assert notes["buildings"] == 2
    assert notes["height tag not understood"] == 1
    assert notes["height assumed from building type"] == 1
    assert notes["height from levels"] == 1
    assert notes["not drawn (underground or mapped as no building)"] == 3


def test_parts_replace_the_outline_where_they_stand():
    mesh, _ = build(
        feature(box(0, 0, 30, 10), building="yes", height="30"),
        feature(box(0, 0, 15, 10), 2, building__part="yes", height="10"),
        feature(box(15, 0, 25, 10), 3, building__part="yes", height="20"),
        feature(box(2, 2, 6, 6), 4, building__part="yes", height="14", min_height="10"),
        feature(box(25, 0, 30, 10), 5, building__part="no"),
    )
    expected = 150 * 10.5 + 100 * 20.5 + 16 * 4 + 50 * 30.5
    assert volume(mesh) == pytest.approx(expected)
    assert roof_height(mesh, 10, 5) == pytest.approx(10)
    assert roof_height(mesh, 4, 4) == pytest.approx(14)
    assert roof_height(mesh, 28, 5) == pytest.approx(30)
    assert uneven_edges(mesh) == 0
    assert set(mesh.part) == {1}


def test_the_height_of_a_tower_is_not_given_to_what_the_parts_leave_over():
    mesh, notes = build(
        feature(box(0, 0, 40, 20), building="church", height="50"),
        feature(box(0, 0, 30, 20), 2, building__part="yes", height="12"),
        feature(box(30, 0, 36, 6), 3, building__part="yes", height="50"),
    )
    assert notes["outlines built as high as most of their parts"] == 1
    assert roof_height(mesh, 33, 3) == pytest.approx(50)
    assert roof_height(mesh, 38, 15) == pytest.approx(12)


def test_a_building_mapped_as_relation_and_as_way_is_built_once():
    hollow = Polygon(box(0, 0, 20, 20).exterior, [box(5, 5, 15, 15).exterior.coords])
    mesh, notes = build(
        feature(box(0, 0, 20, 20), 1, building="yes"),
        feature(hollow, 2, "relation", building="yes"),
    )
    assert notes["buildings"] == 1
    assert np.isnan(roof_height(mesh, 10, 10))


def test_a_roof_on_posts_is_open_beneath():
    mesh, _ = build(feature(box(0, 0, 20, 10), building="roof", height="5"))
    assert roof_height(mesh, 10, 5) == pytest.approx(5)
    assert crossings(mesh, (-5, 3, 2), (25, 3, 2)) == 0
    assert mesh.vertices[:, 2].min() < 0
    assert uneven_edges(mesh) == 0


def test_a_mapped_passage_is_open_and_the_building_goes_on_above_it():
    mesh, notes = build(
        feature(box(0, 0, 30, 10), building="yes", height="15"),
        feature(LineString([(15, 0), (15, 10)]), 2, highway="service", tunnel="building_passage"),
    )
    assert notes["passages through buildings"] == 1
    for height in (0.1, 2.0, 4.4):
        assert crossings(mesh, (14.3, -5, height), (15.7, 15, height)) == 0
    assert crossings(mesh, (14.3, -5, 4.6), (15.7, 15, 4.6)) == 2
    assert crossings(mesh, (10, -5, 2), (10, 15, 2)) == 2
    assert volume(mesh) == pytest.approx(300 * 15.5 - 4 * 10 * (ROAD_CLEARANCE_M + 0.5))
    assert uneven_edges(mesh) == 0


def test_an_arcade_is_open_to_its_street_between_columns():
    mesh, _ = build(
        feature(box(0, 0, 30, 12), building="yes", height="15"),
        feature(LineString([(-1, 1.2), (31, 1.2)]), 2, highway="footway", covered="arcade"),
    )
    # Along it nothing; into it, some rays meet a column, most the wall behind.
    assert crossings(mesh, (-5, 1.3, 1.5), (35, 1.3, 1.5)) == 0
    hits = [crossings(mesh, (x, -5, 1.5), (x, 2.0, 1.5)) for x in np.arange(0.05, 30, 0.1)]
    assert set(hits) == {0, 2}
    assert 0.05 < np.mean(np.array(hits) == 2) < 0.25
    assert crossings(mesh, (14, -5, 4), (14, 2, 4)) == 1
    assert uneven_edges(mesh) == 0


def test_a_carriageway_is_cut_out_where_no_passage_is_mapped():
    road = box(-50, 8, 50, 14)
    mesh, notes = build(feature(box(0, 0, 30, 10), building="yes", height="15"), road=road)
    assert notes["carriageways cut out of buildings"] == 1
    assert mesh.vertices[:, 1].max() == pytest.approx(7.7)
    assert uneven_edges(mesh) == 0


def test_a_carriageway_passes_under_a_raised_part_and_under_a_roof():
    road = box(12, -50, 18, 50)
    mesh, _ = build(
        feature(box(0, 0, 10, 10), building="yes", height="15"),
        feature(box(10, 0, 20, 10), 2, building="yes", height="15", min_height="3.5"),
        feature(box(0, 20, 20, 30), 3, building="roof", height="4"),
        road=road,
    )
    for x in (12.1, 15.3, 17.9):
        assert crossings(mesh, (x, -40, 4.4), (x + 0.01, 40, 4.4)) == 0
    assert roof_height(mesh, 15, 5) == pytest.approx(15)
    assert roof_height(mesh, 15, 25) == pytest.approx(4.8)


def test_the_ceiling_of_a_passage_clears_the_highest_ground_in_it():
    mesh, _ = build(
        feature(box(0, 0, 40, 10), building="yes", height="20"),
        feature(LineString([(0, 5), (40, 5)]), 2, highway="service", covered="yes"),
        ground=tilted,
    )
    assert crossings(mesh, (-5, 5.2, 2 + 4.4), (45, 5, 2 + 4.4)) == 0


def test_buildings_are_kept_whole_at_the_border_and_left_out_beyond_it():
    mesh, notes = build(
        feature(box(190, 0, 230, 10), building="yes", height="5"),
        feature(box(240, 0, 250, 10), 2, building="yes", height="5"),
    )
    assert notes["buildings"] == 1
    assert volume(mesh) == pytest.approx(400 * 5.5)


def test_unknown_ground_is_left_out_of_the_lowest():
    def half_known(xy):
        return np.where(xy[:, 0] < 5, 3.0, np.nan)

    mesh, _ = build(feature(box(0, 0, 10, 10), building="yes", height="6"), ground=half_known)
    assert mesh.vertices[:, 2].max() == pytest.approx(9.0)


def test_materials_follow_the_tags():
    mesh, _ = build(
        feature(box(0, 0, 9, 9), building="yes", building__material="brick", roof__material="metal")
    )
    up = mesh.normals()[:, 2] > 0.5
    assert set(mesh.material[up]) == {material_id("metal-painted")}
    assert set(mesh.material[~up]) == {material_id("brick")}


def test_no_features_give_no_buildings():
    mesh, notes = build()
    assert len(mesh.faces) == 0
    assert notes["buildings"] == 0


def real_features(folder, name, radius):
    extract = read_extract(folder / "osm" / f"{name}.osm")
    signals = [i for i, t in extract.node_tags.items() if t.get("highway") == "traffic_signals"]
    longitude, latitude = np.median([extract.nodes[i] for i in signals], axis=0)
    region = shapely.Point(0, 0).buffer(radius)
    return extract.features(SiteFrame(float(latitude), float(longitude)), region), region


def test_real_passages_are_open(shared_data):
    features, region = real_features(shared_data, "neukolln", 300)
    mesh, notes = build(*features, region=region)
    passages = [f for f in features if f.tags.get("tunnel") == "building_passage"]
    assert notes["passages through buildings"] >= len(passages) >= 10
    for passage in passages:
        corners = shapely.get_coordinates(passage.geometry)
        for start, end in itertools.pairwise(corners):
            assert crossings(mesh, (*start, 2.0), (*end, 2.0)) == 0, passage.id


@pytest.mark.parametrize(
    ("name", "radius", "fewest"),
    [("taipei", 150, 15), ("neukolln", 150, 20), *further(("munich", 300, 40))],
)
def test_real_buildings_are_closed_and_as_high_as_mapped(shared_data, name, radius, fewest):
    features, region = real_features(shared_data, name, radius)
    mesh, notes = build(*features, region=region, ground=tilted)
    assert notes["buildings"] > 50
    assert uneven_edges(mesh) == 0
    for part in np.unique(mesh.part):
        assert volume(mesh.select(mesh.part == part)) > 0
    # Away from every other footprint, the roof's top is where the outline's own tags put it.
    mapped = [f for f in features if "building" in f.tags or "building:part" in f.tags]
    tree = shapely.STRtree([f.geometry for f in mapped])
    probe = DownwardProbe(mesh)
    checked = 0
    for f in mapped:
        levels = [f.tags.get("building:levels", "?"), f.tags.get("roof:levels", "0")]
        if f.tags.get("height", "x").replace(".", "").isdigit():
            expected = float(f.tags["height"])
        elif all(n.isdigit() for n in levels):
            if f.tags.get("roof:shape", "flat") != "flat":
                continue
            expected = 3.2 * sum(map(int, levels))
        else:
            continue
        near = [mapped[k] for k in tree.query(f.geometry)]
        others = shapely.union_all([o.geometry for o in near if o is not f])
        inner = f.geometry.difference(others).buffer(-1.5)
        if "building" not in f.tags or inner.is_empty or expected == 0:
            continue
        spot = inner.representative_point()
        ground = tilted(shapely.get_coordinates(f.geometry)).min()
        if "roof:shape" in f.tags or "roof:levels" in f.tags:
            if f.geometry.intersection(others).area > 1:
                continue
            face = probe.face_below([[spot.x, spot.y, 900.0]])[0]
            own = mesh.select(mesh.part == mesh.part[face])
            top = own.vertices[:, 2].max() - ground
        else:
            top = probe.height_below([[spot.x, spot.y, 900.0]])[0] - ground
        assert top == pytest.approx(expected, abs=0.01), f.id
        checked += 1
    assert checked >= fewest


def test_mapped_balconies_are_no_part_of_their_house():
    house = feature(box(0, 0, 12, 10), building="yes", height="12")
    balcony = feature(box(4, -1.5, 8, 0), 2, building__part="balcony", building__levels="4")
    mesh, notes = build(house, balcony)
    assert notes["balconies, not drawn"] == 1
    assert volume(mesh) == pytest.approx(volume(build(house)[0]))
