"""Crossings against the map that they were made from; SUMO's own network is the witness."""

import numpy as np
import pytest
import shapely
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.roads.marking import painted
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
STREET = {"highway": "secondary", "lanes": "2", "sidewalk": "both"}
BARE = {"highway": "secondary", "lanes": "2", "sidewalk": "no"}
ZEBRA = {"highway": "crossing", "crossing": "uncontrolled", "crossing:markings": "zebra"}
LIT = {"highway": "crossing", "crossing": "traffic_signals"}
UNMARKED = {"highway": "crossing", "crossing": "unmarked"}
FOOTWAY = {"highway": "footway"}
CROSSING_WAY = {"highway": "footway", "footway": "crossing"}


@pytest.fixture
def build(write_osm, tmp_path):
    def run(nodes, ways, side="right"):
        out = tmp_path / "n.net.xml"
        built = build_roads(
            read_extract(write_osm(nodes, ways)),
            HERE,
            shapely.box(-140, -140, 140, 140),
            Elevation.flat(),
            driving_side=side,
            out=out,
        )
        return built, etree.parse(out).getroot()

    return run


def crossings(built):
    return [lane for lane in built.network.lanes if lane.kind == "crossing"]


def line_of(lane):
    return shapely.LineString(lane.centre[:, :2])


def walked_from(net, crossing):
    """Edges that people come from and go on to over the walking areas of a crossing."""
    edge = crossing.rsplit("_", 1)[0]
    rows = [(c.get("from"), c.get("to")) for c in net.iterfind("connection")]
    areas = {a for a, b in rows if b == edge} | {b for a, b in rows if a == edge}
    return [{x for row in rows if area in row for x in row} - {area, edge} for area in areas]


def test_nobody_guesses_a_crossing(build):
    nodes = {1: (-130, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (130, 0, {})}
    nodes |= {4: (0, -130, {}), 5: (0, 130, {})}
    built, _ = build(nodes, {10: ([1, 2, 3], STREET), 11: ([4, 2, 5], STREET)})
    assert crossings(built) == []


def test_a_crossing_told_of_the_one_node_of_a_junction_is_on_every_arm(build):
    """Not in the junction's middle, where nobody walks; where streets only go on, over the node."""
    told = {"highway": "traffic_signals", "crossing": "traffic_signals"}
    nodes = {1: (-130, 0, {}), 2: (0, 0, told), 3: (130, 0, {}), 4: (0, 130, {})}
    built, _ = build(nodes, {10: ([1, 2, 3], STREET), 11: ([4, 2], STREET)})
    middles = sorted(tuple(lane.centre[:, :2].mean(axis=0)) for lane in crossings(built))
    arms = [(-1.0, 0.0), (0.0, 1.0), (1.0, 0.0)]
    assert len(middles) == 3
    for middle, arm in zip(middles, arms, strict=True):
        assert 6.0 < np.hypot(*middle) < 20.0
        assert np.dot(middle, arm) == pytest.approx(np.hypot(*middle), abs=0.3)
    nodes.pop(4)
    built, _ = build(nodes, {10: ([1, 2, 3], STREET)})
    (lane,) = crossings(built)
    assert lane.centre[:, 0] == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("side", ["right", *further("left")])
@pytest.mark.parametrize("distance", [8, 12, 60])
def test_a_crossing_lies_where_it_is_mapped_and_leads_from_kerb_to_kerb(build, side, distance):
    """At a junction and between junctions: square over both lanes of 3.25 m, 5 cm off the kerbs."""
    nodes = {1: (-130, 0, {}), 2: (0, 0, {}), 3: (130, 0, {}), 4: (0, -130, {}), 5: (0, 130, {})}
    nodes[6] = (-distance, 0, ZEBRA)
    built, net = build(nodes, {10: ([1, 6, 2, 3], STREET), 11: ([4, 2, 5], STREET)}, side)
    (lane,) = crossings(built)
    x, y = lane.centre[:, :2].T
    assert x == pytest.approx(-distance, abs=0.3)
    assert sorted(y[[0, -1]]) == pytest.approx([-3.5, 3.5], abs=0.4)
    assert lane.marking == "zebra"
    found = walked_from(net, lane.id)
    assert len(found) == 2
    assert all(found)
    # Traffic stops before it: no road runs over it.
    streets = [x for x in built.network.lanes if x.road and x.kind == "driving"]
    assert not any(x.polygon.intersects(lane.polygon.buffer(-0.3)) for x in streets)


def test_crossings_look_as_they_are_mapped(build):
    """Stripes, two broken lines at signals in Germany, nothing; and by its own word, two lines."""
    kinds = [ZEBRA, LIT, UNMARKED, {**ZEBRA, "crossing:markings": "lines"}]
    nodes = {1: (-135, 0, {}), 9: (135, 0, {})}
    nodes |= {2 + k: (-90 + 60 * k, 0, kind) for k, kind in enumerate(kinds)}
    built, _ = build(nodes, {10: ([1, 2, 3, 4, 5, 9], STREET)})
    lanes = sorted(crossings(built), key=lambda lane: lane.centre[0, 0])
    assert [lane.marking for lane in lanes] == ["zebra", "dashes", "none", "lines"]
    paint = painted(built.network, built.model)
    quads = shapely.polygons(paint.of("zebra", "crossing"))
    areas = [float(shapely.intersection(quads, lane.polygon.buffer(0.1)).area.sum())
             if hasattr(shapely.intersection(quads, lane.polygon.buffer(0.1)), "area") else
             float(shapely.area(shapely.intersection(quads, lane.polygon.buffer(0.1))).sum())
             for lane in lanes]  # fmt: skip
    length = line_of(lanes[0]).length
    assert areas[0] == pytest.approx(4.0 * length / 2, rel=0.1)
    assert areas[1] == pytest.approx(2 * 0.12 * length * 5 / 7, rel=0.1)
    assert areas[2] == 0.0
    assert areas[3] == pytest.approx(2 * 0.3 * length, rel=0.1)
    assert {program.id for program in built.network.programs} != set()


def test_a_crossing_mapped_as_node_and_as_way_is_one(build):
    nodes = {1: (-130, 0, {}), 2: (0, 0, ZEBRA), 3: (130, 0, {}), 4: (-1, -8, {}), 5: (1, 8, {})}
    ways = {10: ([1, 2, 3], STREET), 11: ([4, 2, 5], CROSSING_WAY)}
    built, _ = build(nodes, ways)
    (lane,) = crossings(built)
    # It runs as its way does.
    chord = np.abs(lane.centre[-1, :2] - lane.centre[0, :2])
    assert chord[0] / chord[1] == pytest.approx(1 / 8, abs=0.02)


def test_a_crossings_way_without_a_node_of_the_street_counts(build):
    nodes = {1: (-130, 0, {}), 3: (130, 0, {}), 4: (20, -8, {}), 5: (20, 8, {})}
    ways = {10: ([1, 3], STREET), 11: ([4, 5], {**CROSSING_WAY, "crossing": "unmarked"})}
    built, _ = build(nodes, ways)
    (lane,) = crossings(built)
    assert lane.centre[:, 0] == pytest.approx(20, abs=0.1)


def test_each_carriageway_is_crossed_by_itself_and_footways_are_walked_on(build):
    """A road of two carriageways without sidewalks; a path crosses both, with room between."""
    nodes = {1: (-130, -8, {}), 2: (0, -8, LIT), 3: (130, -8, {})}
    nodes |= {4: (130, 8, {}), 5: (0, 8, LIT), 6: (-130, 8, {})}
    nodes |= {7: (0, -60, {}), 8: (0, 60, {}), 9: (50, 60, {})}
    one_way = {"highway": "trunk", "oneway": "yes", "lanes": "2", "sidewalk": "no"}
    # Both ends of the road are joined, so that it is one network.
    link = {"highway": "secondary", "sidewalk": "no"}
    ways = {10: ([1, 2, 3], one_way), 11: ([4, 5, 6], one_way), 12: ([3, 4], link)}
    ways |= {13: ([6, 1], link), 14: ([7, 2, 5, 8, 9], FOOTWAY)}
    built, net = build(nodes, ways)
    found = crossings(built)
    assert sorted(round(float(lane.centre[:, 1].mean())) for lane in found) == [-8, 8]
    sides = [edges for lane in found for edges in walked_from(net, lane.id)]
    assert all(any(name.startswith("footway14") for name in edges) for edges in sides)
    path = shapely.LineString([(0, -60), (0, 60), (50, 60)])
    lanes = [lane for lane in built.network.lanes if lane.road.startswith("footway14")]
    assert sum(line_of(lane).length for lane in lanes) > 0.7 * path.length
    assert all(line_of(lane).distance(path) < 1.0 for lane in lanes)


def test_who_crosses_a_bare_road_has_a_place_to_stand(build):
    nodes = {1: (-130, 0, {}), 2: (0, 0, ZEBRA), 3: (130, 0, {})}
    built, net = build(nodes, {10: ([1, 2, 3], BARE)})
    (lane,) = crossings(built)
    assert len(walked_from(net, lane.id)) == 2


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "least"),
    [("manchester-kingsway", 15), *further(("taipei", 15), ("london-borough", 10), ("munich", 8))],
)
def test_mapped_crossings_of_real_places_are_there_and_no_others(name, least, real_roads):
    """Of the map's nodes on streets, parsed here: nearly all within 3 m, and none without."""
    place = real_roads(name)
    frame, region, built = place.frame, place.region, place.built
    root = etree.parse(place.extract).getroot()
    driven = built.network.carriageway(0).buffer(3.0)
    lines = [line_of(lane) for lane in crossings(built)]
    mapped, walked = [], []
    on_streets = {
        nd.get("ref")
        for way in root.iterfind("way")
        if any(tag.get("k") == "highway" and tag.get("v") in NETWORK_CLASSES
               for tag in way.iterfind("tag"))
        for nd in way.iterfind("nd")
    }  # fmt: skip
    place_of = {node.get("id"): (float(node.get("lon")), float(node.get("lat")))
                for node in root.iterfind("node")}  # fmt: skip
    for node in root.iterfind("node"):
        tags = {tag.get("k"): tag.get("v") for tag in node.iterfind("tag")}
        point = shapely.Point(frame.site_from_lonlat([place_of[node.get("id")]])[0])
        if tags.get("highway") == "crossing" and tags.get("crossing") != "no":
            walked.append(point)
            inside = region.buffer(-2).contains(point) and driven.contains(point)
            if inside and node.get("id") in on_streets:
                mapped.append(point)
    for way in root.iterfind("way"):
        tags = {tag.get("k"): tag.get("v") for tag in way.iterfind("tag")}
        nodes = [nd.get("ref") for nd in way.iterfind("nd") if nd.get("ref") in place_of]
        if "crossing" in (tags.get("footway"), tags.get("cycleway"), tags.get("path")):
            walked.append(shapely.LineString(frame.site_from_lonlat([place_of[n] for n in nodes])))
    there = [min(line.distance(point) for line in lines) < 3.0 for point in mapped]
    assert len(mapped) >= least
    assert np.mean(there) >= 0.95
    for line in lines:
        assert min(line.distance(item) for item in walked) < 8.0


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("lanes", [("4", "1"), ("1", "4"), ("2", "2")])
def test_a_crossing_leads_over_both_directions_of_a_street_of_unequal_ones(build, lanes, side):
    """The line that a street is mapped as may lie far from where its directions meet."""
    forward, backward = lanes
    street = {
        **STREET,
        "lanes": str(int(forward) + int(backward)),
        "lanes:forward": forward,
        "lanes:backward": backward,
        "placement:forward": "left_of:1",
    }
    nodes = {1: (-100, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (100, 0, {})}
    nodes |= {4: (0, 100, {}), 5: (0, -100, {}), 6: (-12, 0, LIT), 7: (-12, 20, {})}
    nodes |= {8: (-12, -20, {})}
    ring = {**CROSSING_WAY, "crossing": "traffic_signals", "crossing:markings": "lines"}
    ways = {10: ([1, 6, 2], street), 11: ([2, 3], STREET), 12: ([4, 2, 5], STREET)}
    ways |= {13: ([7, 6, 8], ring)}
    built, _ = build(nodes, ways, side=side)
    (found,) = crossings(built)
    kerbs = int(forward) + int(backward)
    assert line_of(found).length > 3.0 * kerbs


def test_a_ring_of_footways_round_signals_has_all_its_crossings(shared_data, tmp_path):
    """Seven carriageways of four arms, each with a node and the ring that leads over it."""
    frame = SiteFrame(33.4219352, -111.9400089)
    built = build_roads(
        read_extract(shared_data / "osm" / "tempe_split.osm"),
        frame,
        shapely.Point(0, 0).buffer(100),
        Elevation.flat(),
        driving_side="right",
        out=tmp_path / "n.net.xml",
    )
    found = crossings(built)
    # Six of one direction each, and the western arm, which is mapped as one line, whole.
    assert len(found) == 7
    assert max(line_of(lane).length for lane in found) > 20
    for angle in range(0, 360, 90):
        way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        assert any(lane.centre[:, :2].mean(axis=0) @ way > 10 for lane in found), angle
