"""Sidewalks against the footprints of the buildings beside them."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
STREET = {"highway": "residential", "lanes": "2", "width": "6", "sidewalk": "both"}
REAL = ["taipei", *further("higashimurayama", "london-borough")]


def built(path, frame, region, folder):
    side = driving_side(frame.latitude, frame.longitude)
    out = folder / "n.net.xml"
    extract = read_extract(path)
    return build_roads(extract, frame, region, Elevation.flat(), driving_side=side, out=out), out


@pytest.fixture
def street_with_house(write_osm, tmp_path):
    """Build a street along x with a house whose wall runs along y = ``wall``, x from -10 to 10."""

    def build(wall, tags=None, extra=None):
        corners = [(-10, wall), (10, wall), (10, wall + 12), (-10, wall + 12)]
        nodes = {1: (-100, 0, {}), 2: (100, 0, {})}
        nodes |= {10 + k: (x, y, {}) for k, (x, y) in enumerate(corners)}
        ways = {1: ([1, 2], STREET), 2: ([10, 11, 12, 13, 10], tags or {"building": "yes"})}
        if extra:
            nodes |= {20: (0, -5, {}), 21: (0, 40, {})}
            ways[3] = ([20, 21], extra)
        path = write_osm(nodes, ways)
        return built(path, HERE, shapely.box(-90, -60, 90, 60), tmp_path)

    return build


def cross_section(network, x, *, north=True):
    """Return where the footway of one side begins and ends across the street at x."""
    line = shapely.LineString([(x, 0), (x, 20 if north else -20)])
    y = np.abs(shapely.get_coordinates(network.footway(0).intersection(line))[:, 1])
    return (round(float(y.min()), 2), round(float(y.max()), 2)) if len(y) else None


def test_a_sidewalk_narrows_before_a_wall_and_is_whole_elsewhere(street_with_house):
    network = street_with_house(4.0)[0].network
    first, usual = cross_section(network, -60)
    assert first == pytest.approx(3.0, abs=0.02)
    assert usual > 4.4
    for x in np.linspace(-10, 10, 9):
        begins, ends = cross_section(network, x)
        assert begins == pytest.approx(first, abs=0.02)
        assert 3.85 < ends <= 4.0
    assert cross_section(network, 0, north=False) == pytest.approx((first, usual), abs=0.02)
    assert cross_section(network, 60) == pytest.approx((first, usual), abs=0.02)


def test_a_sidewalk_ends_at_a_wall_beside_the_carriageway(street_with_house):
    built_roads, _ = street_with_house(3.1)
    network = built_roads.network
    house = shapely.box(-10, 3.1, 10, 15.1)
    assert network.footway(0).intersection(house).area < 1e-3
    assert network.carriageway(0).intersection(house).area < 1e-3
    widths = [lane.widths for lane in network.lanes if lane.kind == "sidewalk"]
    assert min(w.min() for w in widths if len(w)) == 0.0


def test_a_carriageway_gives_way_to_a_wall(street_with_house):
    """The street is 6 m wide about y = 0: before a wall it lies to the south, and only there."""
    network = street_with_house(1.5)[0].network
    carriageway = network.carriageway(0)
    for x, north in ((-70, 3.0), (0, 1.45), (70, 3.0)):
        _, low, _, high = shapely.intersection(
            carriageway, shapely.LineString([(x, -20), (x, 20)])
        ).bounds
        assert high == pytest.approx(north, abs=0.05)
        assert high - low == pytest.approx(6.0, abs=0.05)
    assert carriageway.intersection(shapely.box(-10, 1.5, 10, 13.5)).area < 0.5


def test_what_is_thin_stops_no_street(write_osm, tmp_path):
    """A canopy's post wall of 1 m on the carriageway is no building that a street swerves for."""
    corners = [(-10, 1), (10, 1), (10, 2), (-10, 2)]
    nodes = {1: (-100, 0, {}), 2: (100, 0, {})}
    nodes |= {10 + k: (x, y, {}) for k, (x, y) in enumerate(corners)}
    ways = {1: ([1, 2], STREET), 2: ([10, 11, 12, 13, 10], {"building": "yes"})}
    path = write_osm(nodes, ways)
    network = built(path, HERE, shapely.box(-90, -60, 90, 60), tmp_path)[0].network
    assert network.carriageway(0).bounds[1::2] == pytest.approx((-3.0, 3.0), abs=0.02)


@pytest.mark.parametrize("wall", [2.4, 3.1, 3.8])
def test_people_walk_a_shoulder_away_from_the_wall(street_with_house, wall):
    """SUMO walks its lane's line, and its width to both sides: none of it is in the house.

    Even where the house stands on the edge of the carriageway.
    """
    _, out = street_with_house(wall)
    house = shapely.box(-10, wall, 10, wall + 12)
    lanes = [
        lane
        for lane in ElementTree.parse(out).iter("lane")
        if "pedestrian" in lane.get("allow", "").split() and not lane.get("id").startswith(":")
    ]
    assert lanes
    for lane in lanes:
        points = [tuple(map(float, p.split(","))) for p in lane.get("shape").split()]
        band = shapely.LineString(points).buffer(float(lane.get("width")) / 2, cap_style="flat")
        assert band.intersection(house).area < 0.01
        turns = np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])))
        assert np.abs(turns).max(initial=0) < 2 * np.arctan(0.5) + 0.05


@pytest.mark.parametrize(
    "tags",
    [
        {"building": "roof"},
        {"building": "yes", "layer": "-1"},
        {"building": "yes", "min_height": "4"},
        {"building": "yes", "location": "underground"},
    ],
)
def test_what_does_not_stand_on_the_ground_takes_no_sidewalk(street_with_house, tags):
    network = street_with_house(3.5, tags)[0].network
    assert cross_section(network, 0) == cross_section(network, -60)


def test_an_arcade_is_walked_through(street_with_house):
    arcade = {"highway": "footway", "covered": "arcade", "width": "14"}
    network = street_with_house(3.0, extra=arcade)[0].network
    assert cross_section(network, 0) == pytest.approx(cross_section(network, -60), abs=0.02)
    assert cross_section(network, 9) is None


@pytest.mark.real
@pytest.mark.parametrize("name", REAL)
def test_no_real_sidewalk_runs_under_a_building(name, real_roads):
    """Footprints read from the map by another reader: its ways that are tagged as buildings."""
    place = real_roads(name)
    frame, network = place.frame, place.built.network
    root = ElementTree.parse(place.extract).getroot()
    place = {n.get("id"): (float(n.get("lon")), float(n.get("lat"))) for n in root.iter("node")}
    houses = []
    for way in root.iter("way"):
        tags = {tag.get("k"): tag.get("v") for tag in way.iter("tag")}
        refs = [nd.get("ref") for nd in way.iter("nd")]
        solid = tags.get("building", "no") not in ("no", "roof", "carport", "canopy")
        raised = {"layer", "min_height", "building:min_level", "location"} & tags.keys()
        if solid and not raised and refs[0] == refs[-1] and all(ref in place for ref in refs):
            points = frame.site_from_lonlat([place[ref] for ref in refs])
            houses.append(shapely.make_valid(shapely.Polygon(points)))
    passages = [
        shapely.LineString(frame.site_from_lonlat([place[nd.get("ref")] for nd in way.iter("nd")]))
        for way in root.iter("way")
        for tags in [{tag.get("k"): tag.get("v") for tag in way.iter("tag")}]
        if "highway" in tags and ("covered" in tags or tags.get("tunnel") == "building_passage")
        if all(nd.get("ref") in place for nd in way.iter("nd"))
    ]
    under = shapely.union_all(houses).difference(shapely.union_all(passages).buffer(6.0))
    footway = network.footway(0)
    assert footway.area > 2000
    assert footway.intersection(under).area < 0.001 * footway.area
