"""What is assumed beside streets: where it may stand, how often, and what silences it."""

import numpy as np
import pytest
import shapely

from urbantwin.scene.clutter import assumed_features
from urbantwin.scene.clutter.practice import boundaries, group_of, kerbside_kinds
from urbantwin.scene.furniture.shelter import bicycle, cycle_stands
from urbantwin.scene.land_use import use_of_building
from urbantwin.scene.zones import Zone
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

LENGTH = 400.0
REGION = shapely.box(-LENGTH / 2, -60, LENGTH / 2, 60)
CARRIAGEWAY = shapely.box(-LENGTH / 2, -4, LENGTH / 2, 4)
STREET = shapely.box(-LENGTH / 2, -9, LENGTH / 2, 9)
CROSSING = shapely.box(-3, -9, 3, 9)


def zone(kind, area, semantic):
    return Zone(kind, area, semantic_id(semantic), material_id("asphalt"))


ZONES = [
    zone("carriageway", CARRIAGEWAY, "road"),
    zone("footway", STREET.difference(CARRIAGEWAY), "sidewalk"),
    zone("terrain", REGION.difference(STREET), "terrain"),
]


def way(number, tags, geometry):
    return OsmFeature("way", number, tags, geometry)


def street(**more):
    line = shapely.LineString([(-LENGTH / 2, 0), (LENGTH / 2, 0)])
    return way(1, {"highway": "residential", **more}, line)


def houses(setback, kind="house"):
    """Houses 10 m square on both sides, one every 16 m."""
    found = []
    for k, x in enumerate(np.arange(-LENGTH / 2 + 8, LENGTH / 2, 16.0)):
        for side in (1, -1):
            y = side * (9 + setback + 5)
            box = shapely.box(x - 5, y - 5, x + 5, y + 5)
            found.append(way(100 + 2 * k + (side > 0), {"building": kind}, box))
    return found


def assumed(features, country="GB", sensors=(), crossing=CROSSING):
    return assumed_features(features, ZONES, crossing, REGION, country, sensors)


def new(features, result):
    old = {feature.id for feature in features}
    return [feature for feature in result.features if feature.id not in old]


@pytest.fixture(scope="module")
def suburb():
    features = [street(), *houses(5.0)]
    return features, assumed(features)


def test_nothing_stands_on_streets_crossings_or_in_houses(suburb):
    features, result = suburb
    found = new(features, result)
    assert len(found) > 50
    walls = shapely.union_all([f.geometry for f in features if "building" in f.tags])
    for one in found:
        assert not one.geometry.intersects(CARRIAGEWAY.buffer(0.4)), one
        assert not one.geometry.intersects(walls), one
        if one.geometry.geom_type == "Point":
            assert not one.geometry.intersects(CROSSING), one
        else:
            assert not one.geometry.intersects(STREET.buffer(0.3)), one


def test_walkers_keep_a_clear_width(suburb):
    features, result = suburb
    on_footway = [
        f for f in new(features, result) if f.geometry.within(STREET) and "natural" not in f.tags
    ]
    assert on_footway
    for one in on_footway:
        # Kerb at 4 m, edge of the footway at 9 m.
        assert 9.0 - abs(one.geometry.y) >= 1.5


@pytest.mark.thorough
def test_shares_of_boundaries_are_those_of_the_table():
    # 50 houses in each of many towns: every house draws with its own number.
    features = [street(), *houses(5.0)]
    long = 0.0
    towns = 8
    for town in range(towns):
        moved = [features[0]] + [way(f.id + 1000 * town, f.tags, f.geometry) for f in features[1:]]
        notes = assumed(moved).notes
        long += notes.get("hedge of plots, m", 0)
    share = next(b.share for b in boundaries("britain", "dwelling") if b.barrier == "hedge")
    # Each side is 400 m, less gates and drives: 1.2 or 3 m every 16 m, and ends below 1 m.
    whole = towns * 2 * LENGTH * (1 - (0.6 * 1.2 + 0.4 * 3.0) / 16)
    houses_drawn = towns * 50
    spread = np.sqrt(share * (1 - share) / houses_drawn)
    assert abs(long / whole - share) < 4 * spread + 0.02


@pytest.mark.thorough
def test_pieces_come_as_often_as_the_table_says():
    found = 0
    for number in range(2, 14):
        features = [way(number, {"highway": "residential"}, street().geometry), *houses(5.0)]
        found += assumed(features, "DE", crossing=shapely.Polygon()).notes.get("signs", 0)
    rate = next(k.dwellings for k in kerbside_kinds("europe") if k.kind == "signs")
    expected = rate * 12 * LENGTH / 1000
    assert abs(found - expected) < 3 * np.sqrt(expected) + 0.1 * expected


def test_what_is_mapped_is_not_assumed_again():
    features = [street(), *houses(5.0)]
    spots = [(x, y) for x in range(-200, 201, 50) for y in (-8.5, 8.5)]
    signs = [OsmFeature("node", 5000 + k, {"traffic_sign": "GB:616"}, shapely.Point(p))
             for k, p in enumerate(spots)]  # fmt: skip
    wall = [way(6000 + k, {"barrier": "wall"}, shapely.LineString([(-200, y), (200, y)]))
            for k, y in enumerate((-10.0, 10.0))]  # fmt: skip
    notes = assumed([*features, *signs, *wall]).notes
    assert "signs" not in notes
    assert not any("of plots" in name for name in notes)
    assert "street cabinets" in notes


def test_parks_and_open_land_have_no_plots():
    park = way(2, {"leisure": "park"}, shapely.box(-LENGTH / 2, 9, LENGTH / 2, 60))
    notes = assumed([street(), park]).notes
    assert not any("of plots" in name for name in notes)
    # What encloses the park stands within it, if anything does.
    assert {name for name in notes if name.startswith("barriers")} <= {"barriers of parks, m"}


def test_houses_at_the_footway_have_no_boundary():
    features = [street(), *houses(0.5)]
    lines = [f for f in new(features, assumed(features)) if f.geometry.geom_type != "Point"]
    walls = shapely.union_all([f.geometry for f in features if "building" in f.tags])
    # What there is closes the gaps between houses.
    assert all(not line.geometry.buffer(0.1).intersects(walls) for line in lines)


def test_sensors_are_kept_free():
    features = [street(), *houses(5.0)]
    sensor = (40.0, 9.36)
    poles = shapely.Point(sensor).buffer(1.4)
    assert not any(
        f.geometry.intersects(poles) for f in new(features, assumed(features, sensors=[sensor]))
    )


def test_a_house_keeps_its_front_when_another_one_comes():
    features = [street(), *houses(5.0)]
    before = {f.geometry.wkb for f in new(features, assumed(features)) if "barrier" in f.tags}
    fewer = [f for f in features if f.id != 100]
    after = {f.geometry.wkb for f in new(fewer, assumed(fewer)) if "barrier" in f.tags}
    assert len(before - after) <= 5


def test_without_a_map_there_is_nothing():
    assert assumed([]) == ([], {})


def test_countries_differ():
    features = [street(), *houses(5.0)]
    assert group_of("JP") == "japan"
    assert group_of("") == "europe"
    assert "utility poles" in assumed(features, "JP").notes
    assert "utility poles" not in assumed(features, "GB").notes
    assert "hydrants" in assumed(features, "US").notes


def test_bicycles_stand_at_stands():
    empty = cycle_stands({"capacity": "10"}, None, None)
    full = cycle_stands({"capacity": "10", "parked": "1"}, None, None)
    half = cycle_stands({"capacity": "10", "parked": "0.5"}, None, None)
    a_bicycle = (len(full) - len(empty)) / 10
    assert (len(half) - len(empty)) / a_bicycle == pytest.approx(5, abs=1)
    # 1.7 to 1.9 m is the length of a city bicycle.
    alone = np.concatenate([p.solid.vertices for p in bicycle(0.0, 0.0, 1)])
    assert 1.6 < np.ptp(alone[:, 0]) < 1.95
    assert alone[:, 2].min() > -0.01
    assert 0.95 < alone[:, 2].max() < 1.15


def test_use_of_a_building_is_that_of_the_ground_around_it():
    assert use_of_building(way(1, {"building": "house"}, shapely.box(0, 0, 10, 10))) == "dwellings"
    assert use_of_building(way(1, {"building": "yes"}, shapely.box(0, 0, 40, 40))) == "business"
