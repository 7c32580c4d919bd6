"""What covers the ground beside roads: by the map's land use, by the buildings around it."""

import itertools

import pytest
import shapely
from shapely import box

from urbantwin.geometry import SiteFrame
from urbantwin.roads import RoadNetwork
from urbantwin.scene.building_outline import building_footprints
from urbantwin.scene.land_use import land_covers, mapped_cover
from urbantwin.scene.zones import ground_zones
from urbantwin.site import OsmFeature, read_extract
from urbantwin.taxonomy import semantic_id

GROUND = box(-100, -100, 100, 100)
PLACES = {
    "taipei": (25.052396, 121.522635, "TW"),
    "munich": (48.1860, 11.5510, "DE"),
    "london-borough": (51.5014, -0.0930, "GB"),
    "chennai": (13.0716773, 80.2744307, "IN"),
}


def area(number, shape, **tags):
    tags = {key.replace("__", ":"): value for key, value in tags.items()}
    return OsmFeature("way", number, tags, shape)


def cover_at(covers, x, y):
    """Return the material at a place: exactly one."""
    (found,) = [material for shape, (_, material) in covers if shape.covers(shapely.Point(x, y))]
    return found


def houses(size, gap, **tags):
    """Houses in rows all over the ground."""
    step = size + gap
    starts = range(-90, 90 - size, step)
    corners = itertools.product(starts, starts)
    return [
        area(k, box(x, y, x + size, y + size), building=tags.get("building", "yes"))
        for k, (x, y) in enumerate(corners, start=10)
    ]


def is_partition(covers, ground):
    shapes = [shape for shape, _ in covers]
    whole = shapely.union_all(shapes)
    assert sum(shape.area for shape in shapes) == pytest.approx(ground.area, rel=2e-3)
    return whole.symmetric_difference(ground).area < 2e-3 * ground.area


def test_gardens_have_grass_and_a_paved_strip_along_the_house():
    house = area(1, box(-5, -5, 5, 5), building="house")
    covers = land_covers([house, area(2, GROUND, landuse="residential")], GROUND, "DE")
    assert is_partition(covers, GROUND)
    assert cover_at(covers, 6.0, 0) == "paving"
    assert cover_at(covers, 9.0, 0) == cover_at(covers, 60.0, 0) == "grass"


def test_town_centres_are_paved_between_their_houses():
    covers = land_covers(houses(12, 4), GROUND, "DE")
    assert is_partition(covers, GROUND)
    assert cover_at(covers, -76, -76) == "paving"


def test_loose_houses_have_gardens_and_paved_yards_where_those_are_usual():
    loose = houses(10, 14)
    assert cover_at(land_covers(loose, GROUND, "DE"), -73, -85) == "grass"
    assert cover_at(land_covers(loose, GROUND, "JP"), -73, -85) == "concrete"


@pytest.mark.parametrize(
    ("tags", "near", "far"),
    [
        ({"landuse": "commercial"}, "paving", "asphalt"),
        ({"landuse": "industrial"}, "concrete", "asphalt"),
        ({"amenity": "school"}, "paving", "grass"),
        ({"place": "square"}, "paving", "paving"),
    ],
)
def test_land_use_says_what_lies_there(tags, near, far):
    hall = area(1, box(-10, -10, 10, 10), building="yes")
    covers = land_covers([hall, area(2, GROUND, **tags)], GROUND, "DE")
    assert cover_at(covers, 15, 0) == near
    assert cover_at(covers, 60, 0) == far


def test_the_smaller_of_two_areas_counts():
    works = area(1, box(0, -100, 100, 100), landuse="industrial")
    covers = land_covers([area(2, GROUND.buffer(900), landuse="residential"), works], GROUND, "DE")
    assert cover_at(covers, 50, 0) == "asphalt"
    assert cover_at(covers, -50, 0) == "grass"


def test_halls_without_land_use_say_it_themselves():
    covers = land_covers([area(1, box(-20, -20, 20, 20), building="warehouse")], GROUND, "DE")
    assert cover_at(covers, 25, 0) == "concrete"
    covers = land_covers([area(1, box(-20, -20, 20, 20), building="retail")], GROUND, "DE")
    assert cover_at(covers, 25, 0) == "paving"


def test_open_land_is_green_and_desert_is_not():
    assert cover_at(land_covers([], GROUND, "DE"), 0, 0) == "grass"
    assert cover_at(land_covers([], GROUND, "AE"), 0, 0) == "soil"


def test_what_a_mapper_says_of_the_surface_counts():
    assert mapped_cover({"leisure": "pitch"}) == ("terrain", "grass")
    assert mapped_cover({"leisure": "pitch", "surface": "asphalt"}) == ("other-ground", "asphalt")
    assert mapped_cover({"landuse": "residential"}) is None


def test_a_footway_through_a_building_is_paved_outside_and_through_its_passages():
    nothing = RoadNetwork("right", (), (), (), (), ())
    house = area(1, box(-10, -10, 10, 10), building="yes")
    way = shapely.LineString([(-50, 0), (50, 0)])

    def sidewalks(*others):
        zones = ground_zones(nothing, GROUND, [house, *others], country="DE")
        whole = shapely.union_all([zone.area for zone in zones])
        assert whole.covers(GROUND)
        found = [z.area for z in zones if z.semantic == semantic_id("sidewalk")]
        return shapely.union_all(found)

    inside = sidewalks(area(2, way, highway="footway"))
    assert inside.area == pytest.approx(2.0 * 80, rel=0.01)
    assert not inside.intersects(box(-9.9, -9.9, 9.9, 9.9))
    through = sidewalks(area(2, way, highway="footway", tunnel="building_passage"))
    assert through.area == pytest.approx(2.0 * 100, rel=0.01)


@pytest.mark.real
@pytest.mark.parametrize("name", PLACES)
def test_no_bare_soil_between_the_houses_of_real_places(name, shared_data):
    latitude, longitude, country = PLACES[name]
    region = shapely.Point(0, 0).buffer(150)
    extract = read_extract(shared_data / "osm" / f"{name}.osm")
    features = extract.features(SiteFrame(latitude, longitude), region)
    covers = land_covers(features, region, country)
    assert is_partition(covers, region)
    around = shapely.union_all(building_footprints(features)).buffer(10)
    assert around.area > 1000
    soil = [shape for shape, (_, material) in covers if material == "soil"]
    assert shapely.union_all(soil).intersection(around).area < 1.0
