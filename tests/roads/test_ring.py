"""Small roundabouts: one junction round a raised central island."""

import numpy as np
import pytest
import shapely
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.marking import painted
from urbantwin.scene.zones import ground_zones
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)
REGION = shapely.Point(0, 0).buffer(90)
STREET = {"highway": "residential", "lanes": "2", "sidewalk": "both"}
RING = {"highway": "residential", "junction": "roundabout", "lanes": "1"}
POINTS = 20
#: Half of the narrowest ring's lane, metres.
LANE_M = 1.4


@pytest.fixture
def build(write_osm, tmp_path):
    """Return a function: radius, side -> the roads, the extract, SUMO's network."""

    def run(radius, side="right"):
        turn = 1 if side == "right" else -1
        angles = turn * 2 * np.pi * np.arange(POINTS) / POINTS
        nodes = {k: (radius * np.cos(a), radius * np.sin(a), {}) for k, a in enumerate(angles, 1)}
        ways = {100: ([*nodes, 1], RING)}
        for number, arm in enumerate((0, 90, 180, 270)):
            a = np.radians(arm)
            near = 1 + round(turn * arm / 360 * POINTS) % POINTS
            nodes[200 + number] = (100 * np.cos(a), 100 * np.sin(a), {})
            ways[300 + number] = ([near, 200 + number], STREET)
        extract = read_extract(write_osm(nodes, ways))
        out = tmp_path / "n.net.xml"
        built = build_roads(extract, HERE, REGION, Elevation.flat(), driving_side=side, out=out)
        return built, extract, etree.parse(out).getroot()

    return run


def through(network):
    """The ways through the junction in the middle, of cars."""
    name = min(network.junctions, key=lambda j: j.polygon.distance(shapely.Point(0, 0))).id
    return [x for x in network.lanes if x.kind == "connection" and x.junction == name]


def turned(line):
    """How far a line turns about the origin, radians, counter-clockwise."""
    angle = np.unwrap(np.arctan2(line[:, 1], line[:, 0]))
    return angle[-1] - angle[0]


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("radius", [5.0, 6.3, 9.0])
def test_a_small_ring_has_an_island_that_all_traffic_goes_round(build, radius, side):
    built, extract, _ = build(radius, side)
    (island,) = [lane for lane in built.network.lanes if lane.kind == "island"]
    middle = island.polygon
    size = np.sqrt(middle.area / np.pi)
    # What the ring's lane leaves: it is at least as wide as a narrow lane, and no wider than two.
    assert radius - 2 * LANE_M - 0.5 < size <= radius - LANE_M
    assert middle.centroid.distance(shapely.Point(0, 0)) < 0.1
    ways = through(built.network)
    assert len(ways) == 12  # from each of four arms to the three others
    turn = 1 if side == "right" else -1
    for lane in ways:
        line = shapely.LineString(lane.centre[:, :2])
        assert line.distance(middle) > 0.9  # half a car
        ahead = turn * turned(lane.centre[:, :2])
        assert 0 < ahead < 2 * np.pi
    # Turns across the street lead three quarters round it, less what entry and exit cut off.
    assert sorted(turn * turned(lane.centre[:, :2]) for lane in ways)[-4] > np.pi
    zones = ground_zones(built.network, REGION, extract.features(HERE, REGION))
    raised = shapely.union_all([zone.area for zone in zones if zone.kind == "island"])
    assert raised.symmetric_difference(middle).area < 0.5
    assert built.network.carriageway(0).intersection(middle).area < 0.1
    (area,) = [one for one in built.model.areas if one.kind == "trafficIsland"]
    assert area.height > 0.1


@pytest.mark.parametrize("side", ["right", "left"])
def test_who_enters_gives_way_to_who_is_in_the_ring(build, side):
    """SUMO's own table: the link from the east yields to the one that passes before it."""
    built, _, net = build(6.3, side)
    junction = next(j for j in net.iterfind("junction") if len(j.findall("request")) > 8)
    vehicles = [
        row for row in net.iterfind("connection")
        if row.get("via") and not row.get("from").startswith(":") and row.get("dir") in "slrLR"
    ]  # fmt: skip
    requests = {int(r.get("index")): r.get("response")[::-1] for r in junction.iter("request")}
    names = junction.get("intLanes").split()
    number = {row.get("via"): names.index(row.get("via")) for row in vehicles}
    lanes = built.network.lane_by_id
    start = {row.get("via"): lanes[row.get("via")].centre[0, :2] for row in vehicles}
    end = {}
    for row in vehicles:
        last = lanes[f"{row.get('to')}_{row.get('toLane')}"]
        end[row.get("via")] = last.centre[0, :2]

    def way(*arms):
        """The link from the arm at one angle to that at another, degrees."""
        ends = [12.0 * np.array([np.cos(a), np.sin(a)]) for a in np.radians(arms)]
        return min(
            number,
            key=lambda via: np.linalg.norm(np.array([start[via], end[via]]) - ends, axis=1).sum(),
        )

    straight = way(0, 180)
    # Traffic keeps right: who comes from the south goes round to the north, past the east arm.
    before, after = (270, 90) if side == "right" else (90, 270)
    passing = way(before, after)
    assert requests[number[straight]][number[passing]] == "1"
    assert requests[number[passing]][number[straight]] == "0"


def test_a_wide_ring_keeps_its_own_junctions(build):
    built, _, _ = build(16.0)
    assert not [lane for lane in built.network.lanes if lane.kind == "island"]
    assert len({road.id for road in built.network.roads if 100 in road.ways}) >= 4


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mini_roundabout_at_a_node_has_a_painted_disc(write_osm, tmp_path, side):
    nodes = {1: (0, 0, {"highway": "mini_roundabout"})}
    nodes |= {2: (100, 0, {}), 3: (-100, 0, {}), 4: (0, 100, {}), 5: (0, -100, {})}
    ways = {10 + k: ([1, k], STREET) for k in (2, 3, 4, 5)}
    out = tmp_path / "n.net.xml"
    extract = read_extract(write_osm(nodes, ways))
    built = build_roads(extract, HERE, REGION, Elevation.flat(), driving_side=side, out=out)
    disc = shapely.union_all(
        [shapely.Polygon(quad[:3]) for quad in painted(built.network, built.model).of("disc")]
    )
    assert disc.centroid.distance(shapely.Point(0, 0)) < 0.1
    assert 1.0 < 2 * np.sqrt(disc.area / np.pi) <= 4.0  # TSRGD 2016, diagram 1003.4
    # It is driven over: no island stands there, and nothing of it is raised.
    assert built.network.carriageway(0).contains(disc.buffer(-0.1))
    assert not [lane for lane in built.network.lanes if lane.kind == "island"]
    junction = etree.parse(out).getroot().find("junction[@id='1']")
    assert junction.get("type") == "left_before_right"
