"""Outer roads: every way out of a region leads back, by SUMO's network and by plain geometry."""

import math
from itertools import compress
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.csgraph
import shapely
import sumolib.net

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.loop import close_loop
from urbantwin.roads.loop.ring_road import match_exits
from urbantwin.site import read_extract

from ..thorough import further
from .controllers import signalised_junctions

HERE = SiteFrame(48.7, 9.18)
REGION = shapely.box(-90, -90, 90, 90)
EXTRACTS = (
    "quad_intersection",
    "perth_stretched_lights",
    *further("West-Oakland", "taipei", "neukolln", "munich"),
)


def built(path, frame, region, out, side="right"):
    extract = read_extract(path)
    return build_roads(
        extract, frame, region, Elevation.flat(), driving_side=side, out=out, closed_loop=True
    )


def drivable(net, vclass):
    """Edges of a class, and the matrix of what follows what, as SUMO itself reads the file."""
    network = sumolib.net.readNet(str(net))
    edges = [edge for edge in network.getEdges() if edge.allows(vclass)]
    index = {edge.getID(): k for k, edge in enumerate(edges)}
    graph = scipy.sparse.lil_array((len(edges), len(edges)))
    for edge in edges:
        for other in edge.getAllowedOutgoing(vclass):
            graph[index[edge.getID()], index[other.getID()]] = 1
    return edges, graph.tocsr()


@pytest.mark.parametrize("name", EXTRACTS)
def test_every_street_of_an_extract_can_be_driven_for_ever(real_roads, name):
    place = real_roads(name, closed_loop=True)
    roads, net = place.built, place.net
    assert roads.notes["closed_loop"]["open_ends"] == 0
    assert signalised_junctions(net) >= 1
    edges, graph = drivable(net, "passenger")
    # Roads that lead only into tunnels stand, and nobody comes to them.
    still = np.asarray(graph.sum(axis=1)).ravel() == 0
    assert still.sum() == roads.notes["roads_before_portals"], "whoever drives can drive on"
    assert graph[:, still].sum() == 0
    edges, graph = list(compress(edges, ~still)), graph[~still][:, ~still]
    _, part = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    metres = np.bincount(part, [edge.getLength() for edge in edges])
    assert metres.max() > 0.9 * metres.sum(), "and come back to nearly everywhere"
    outer = [road for road in roads.network.roads if not road.ways]
    assert outer
    streets = [
        shapely.LineString(roads.network.lane_by_id[lane].centre[:, :2])
        for road in roads.network.roads
        if road.ways
        for lane in road.lanes
    ]
    for road in outer:
        for lane in road.lanes:
            line = shapely.LineString(roads.network.lane_by_id[lane].centre[:, :2])
            # Beyond the region, or where the map itself ends before it.
            inside = place.region.buffer(-0.5).intersection(line)
            assert inside.length < 0.2 * line.length or not any(map(inside.crosses, streets))


@pytest.fixture
def avenue(write_osm):
    """A dual carriageway from west to east, and a street across it that both ways run on."""
    nodes = {1: (-200, -8, {}), 2: (0, -8, {}), 3: (200, -8, {})}
    nodes |= {4: (200, 8, {}), 5: (0, 8, {}), 6: (-200, 8, {})}
    nodes |= {7: (0, -200, {}), 8: (0, 200, {})}
    one_way = {"highway": "primary", "oneway": "yes", "lanes": "2", "sidewalk": "right"}
    street = {"highway": "residential", "lanes": "2", "sidewalk": "both", "cycleway": "lane"}
    return write_osm(
        nodes, {10: ([1, 2, 3], one_way), 11: ([4, 5, 6], one_way), 12: ([7, 2, 5, 8], street)}
    )


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_a_street_turns_round_and_carriageways_turn_into_each_other(avenue, tmp_path, side):
    if side == "left":  # mirrored: traffic keeps left where the carriageways change places
        text = avenue.read_text()
        avenue.write_text(text.replace('ref="2"', 'ref="x"').replace('ref="5"', 'ref="2"')
                          .replace('ref="x"', 'ref="5"').replace('ref="1"', 'ref="y"')
                          .replace('ref="6"', 'ref="1"').replace('ref="y"', 'ref="6"')
                          .replace('ref="3"', 'ref="z"').replace('ref="4"', 'ref="3"')
                          .replace('ref="z"', 'ref="4"')
                          .replace('ref="7"', 'ref="w"').replace('ref="8"', 'ref="7"')
                          .replace('ref="w"', 'ref="8"'))  # fmt: skip
    net = tmp_path / "n.net.xml"
    roads = built(avenue, HERE, REGION, net, side)
    notes = roads.notes["closed_loop"]
    assert (notes["turning_drops"], notes["carriageways_joined"]) == (2, 2)
    assert notes["outer_roads_without_room"] == notes["roads_round_the_region"] == 0
    for road in roads.network.roads:
        if road.ways:
            continue
        lanes = [roads.network.lane_by_id[lane] for lane in road.lanes]
        kinds = sorted(lane.kind for lane in lanes)
        assert kinds.count("driving") == (2 if road.kind == "primary" else 1)
        assert kinds.count("sidewalk") == 1
        assert kinds.count("bicycle") == (road.kind == "residential")
        for lane in lanes:
            xy = lane.centre[:, :2]
            step = np.diff(xy, axis=0)
            heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
            length = np.linalg.norm(step, axis=1)
            # Over 4 m nobody turns faster than on a radius of 6 m.
            at = np.cumsum(length)
            turned = np.interp(at + 4, at, heading) - np.interp(at, at, heading)
            assert np.abs(turned).max() < 4 / 6
            # Right-hand traffic turns round to the left.
            if road.kind == "residential" and lane.kind == "driving":
                assert (heading[-1] - heading[0]) * (1 if side == "right" else -1) > 0


def test_every_class_comes_back_to_where_it_was(avenue, tmp_path):
    net = tmp_path / "n.net.xml"
    built(avenue, HERE, REGION, net)
    for vclass in ("passenger", "bus", "bicycle"):
        _, graph = drivable(net, vclass)
        count, _ = scipy.sparse.csgraph.connected_components(graph, connection="strong")
        assert count == 1, vclass


def test_one_way_exits_lead_round_the_region_to_entries_without_crossing(write_osm, tmp_path):
    """A square of one-way streets: four exits, four entries, all of them apart."""
    nodes = {k: (x, y, {}) for k, (x, y) in enumerate(
        [(-200, -40), (-40, -40), (40, -40), (200, -40), (-200, 40), (-40, 40), (40, 40), (200, 40),
         (-40, -200), (-40, 200), (40, -200), (40, 200)], 1)}  # fmt: skip
    tags = {"highway": "tertiary", "oneway": "yes"}
    ways = {20: ([1, 2, 3, 4], tags), 21: ([8, 7, 6, 5], tags)}
    ways |= {22: ([9, 2, 6, 10], tags), 23: ([12, 7, 3, 11], tags)}
    extract = read_extract(write_osm(nodes, ways))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    loop = close_loop(pieces, extract.nodes, driving_side="right")
    assert loop.notes["roads_round_the_region"] + loop.notes["carriageways_joined"] == 4
    lines = [shapely.LineString(piece.points) for piece in loop.outer]
    for k, line in enumerate(lines):
        assert line.is_simple
        assert REGION.buffer(-0.1).disjoint(line)
        for other in lines[:k]:
            meet = line.intersection(other)
            assert meet.is_empty or meet.geom_type == "Point", "they meet at their ends at most"
            assert meet.is_empty or min(meet.distance(end) for end in line.boundary.geoms) < 0.01


def test_a_road_round_the_region_leaves_it_free_where_the_map_has_nothing(write_osm):
    """A one-way street alone: the way back lay 20 m beside it, within the region."""
    nodes = {1: (-200, 0, {}), 2: (200, 10, {})}
    one_way = {20: ([1, 2], {"highway": "tertiary", "oneway": "yes"})}
    extract = read_extract(write_osm(nodes, one_way))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    loop = close_loop(pieces, extract.nodes, driving_side="right", region=REGION)
    assert loop.notes["roads_round_the_region"] == 1
    assert all(REGION.buffer(-0.1).disjoint(shapely.LineString(x.points)) for x in loop.outer)


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_both_carriageways_of_a_street_without_a_junction_stand(side, write_osm, tmp_path):
    """People cross it in two stages, and nothing else meets it within the region."""
    y = 9 if side == "right" else -9
    nodes = {1: (-200, -y, {}), 2: (0, -y, {}), 3: (200, -y, {})}
    nodes |= {4: (200, y, {}), 5: (0, y, {}), 6: (-200, y, {})}
    tags = {"highway": "primary", "oneway": "yes", "lanes": "2"}
    made = write_osm(nodes, {20: ([1, 2, 3], tags), 21: ([4, 5, 6], tags)})
    net = tmp_path / "n.net.xml"
    roads = built(made, HERE, REGION, net, side)
    assert roads.notes["left_out"] == []
    assert {way for road in roads.network.roads for way in road.ways} == {20, 21}
    assert roads.notes["closed_loop"]["carriageways_joined"] == 2
    _, graph = drivable(net, "passenger")
    count, _ = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    assert count == 1


def test_more_exits_than_entries_share_them(write_osm, tmp_path):
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, 200, {}), 5: (0, -200, {})}
    tags = {"highway": "tertiary", "oneway": "yes"}
    ways = {20: ([1, 2], tags), 21: ([2, 3], tags), 22: ([2, 4], tags), 23: ([2, 5], tags)}
    net = tmp_path / "n.net.xml"
    roads = built(write_osm(nodes, ways), HERE, REGION, net)
    assert roads.notes["closed_loop"]["roads_round_the_region"] == 3
    _, graph = drivable(net, "passenger")
    count, _ = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    assert count == 1


def test_a_cul_de_sac_stays_and_turns_within_its_end(write_osm, tmp_path):
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, 60, {})}
    street = {"highway": "residential", "lanes": "2"}
    net = tmp_path / "n.net.xml"
    roads = built(
        write_osm(nodes, {10: ([1, 2, 3], street), 11: ([2, 4], street)}), HERE, REGION, net
    )
    assert roads.notes["closed_loop"]["turning_drops"] == 2
    turns = [
        item
        for item in ElementTree.parse(net).getroot().iter("connection")
        if item.get("dir") == "t" and not item.get("from", "").startswith(":")
    ]
    assert {(item.get("from"), item.get("to")) for item in turns} == {("11", "-11")}


def test_a_one_way_street_that_ends_within_the_region_is_cut_back(write_osm):
    """It ends among other streets, where no outer road could reach it."""
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, 30, {})}
    nodes |= {5: (-200, 60, {}), 6: (200, 60, {}), 7: (-60, 60, {}), 8: (-60, 0, {})}
    nodes |= {9: (60, 60, {}), 10: (60, 0, {})}
    street, one_way = {"highway": "residential"}, {"highway": "residential", "oneway": "yes"}
    ways = {20: ([1, 8, 2, 10, 3], street), 21: ([5, 7, 9, 6], street), 22: ([2, 4], one_way)}
    ways |= {23: ([7, 8], street), 24: ([9, 10], street)}
    extract = read_extract(write_osm(nodes, ways))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    loop = close_loop(pieces, extract.nodes, driving_side="right")
    assert loop.notes["dead_ends_cut_back"] == 1
    assert 22 not in {piece.id for piece in loop.pieces}
    assert loop.notes["turning_drops"] == 4


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_a_street_that_parts_where_the_map_begins_is_come_to(side, write_osm, tmp_path):
    """A carriageway and its slip lane begin at one node, which no other way leads to."""
    mirror = 1 if side == "right" else -1
    nodes = {1: (-90, -8, {}), 2: (0, -8, {}), 3: (200, -8, {})}
    nodes |= {4: (200, 8, {}), 5: (0, 8, {}), 6: (-90, 8, {}), 7: (-5, -200, {})}
    nodes = {key: (x, mirror * y, tags) for key, (x, y, tags) in nodes.items()}
    one_way = {"highway": "primary", "oneway": "yes", "lanes": "2", "sidewalk": "no"}
    slip = {"highway": "primary_link", "oneway": "yes", "sidewalk": "no"}
    ways = {10: ([1, 2, 3], one_way), 11: ([4, 5, 6], one_way), 12: ([1, 7], slip)}
    ways |= {13: ([7, 2, 5], {**one_way, "oneway": "no"})}
    net = tmp_path / "n.net.xml"
    region = shapely.box(-150, -150, 150, 150)
    roads = built(write_osm(nodes, ways), SiteFrame(48.7, 9.18), region, net, side)
    edges, graph = drivable(net, "passenger")
    carriageway = {road.id for road in roads.network.roads if 10 in road.ways}
    (begins,) = [
        k
        for k, edge in enumerate(edges)
        if edge.getID() in carriageway and edge.getFromNode().getCoord()[0] < -80
    ]
    assert graph[:, begins].sum() > 0, "an outer road leads to it"
    _, part = scipy.sparse.csgraph.connected_components(graph, connection="strong")
    assert len(set(part)) == 1


def test_a_street_turns_round_beside_the_buildings_that_stand_there(write_osm):
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {})}
    street = {"highway": "residential", "lanes": "2", "sidewalk": "both"}
    extract = read_extract(write_osm(nodes, {10: ([1, 2, 3], street)}))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    free = close_loop(pieces, extract.nodes, driving_side="right")
    east = REGION.bounds[2]
    usual = shapely.union_all([shapely.LineString(piece.points) for piece in free.outer])
    usual = usual.intersection(shapely.box(east, -100, east + 200, 100))
    # A house on each side of the street, where it would turn round.
    houses = [
        shapely.box(*part.bounds)
        for part in (
            usual.intersection(shapely.box(east, 7, east + 200, 100)),
            usual.intersection(shapely.box(east, -100, east + 200, -7)),
        )
        if not part.is_empty
    ]
    assert any(usual.intersects(house) for house in houses)
    loop = close_loop(pieces, extract.nodes, driving_side="right", buildings=houses)
    roads = shapely.union_all([shapely.LineString(piece.points) for piece in loop.outer])
    assert all(roads.disjoint(house) for house in houses)
    assert loop.notes["turning_drops"] == 2


def test_no_road_leads_through_a_building_that_stands_in_the_twin(write_osm):
    """Where houses leave no room anywhere, those that nobody sees give way to those that stand."""
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {})}
    street = {"highway": "residential", "lanes": "2", "sidewalk": "both"}
    extract = read_extract(write_osm(nodes, {10: ([1, 2, 3], street)}))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    houses = shapely.box(-400, -400, 400, 400)
    # Some reach from the region over the straight way on from both ends of the street.
    standing = [shapely.box(112, -60, 190, 14), shapely.box(-190, -60, -112, 14)]
    loop = close_loop(
        pieces, extract.nodes, driving_side="right", buildings=[houses], standing=standing
    )
    blind = close_loop(pieces, extract.nodes, driving_side="right", buildings=[houses])
    through = [
        sum(
            shapely.LineString(piece.points).intersection(house).length
            for piece in found.outer
            for house in standing
        )
        for found in (loop, blind)
    ]
    assert through[0] == 0.0 < through[1]


def test_a_road_round_the_region_leads_round_what_reaches_out_of_it(write_osm):
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (0, 200, {})}
    one_way = {"highway": "tertiary", "oneway": "yes"}
    extract = read_extract(write_osm(nodes, {10: ([1, 2], one_way), 11: ([2, 3], one_way)}))
    pieces = extract.clipped(HERE, REGION, list(extract.ways.values()))
    hall = shapely.box(-140, 60, -60, 140)
    through = [
        sum(shapely.LineString(piece.points).intersection(hall).length for piece in found.outer)
        for found in (
            close_loop(pieces, extract.nodes, driving_side="right", standing=one)
            for one in ([hall], [])
        )
    ]
    assert through[0] == 0.0 < through[1]


def test_pairs_never_cross_and_leave_nobody_out():
    """Against every other set of pairs of a small case, and for crossings in larger ones."""
    random = np.random.default_rng(1)
    for exits, entries in ((3, 3), (5, 5), (6, 2), (1, 4), (7, 7)):
        a, b = random.uniform(0, 1000, exits), random.uniform(0, 1000, entries)
        pairs = match_exits(a, b, 1000.0)
        assert {i for i, _ in pairs} == set(range(exits))
        assert {j for _, j in pairs} == set(range(entries))
        assert len(pairs) == max(exits, entries)
        chords = [
            shapely.LineString(
                [
                    (math.cos(p * math.tau / 1000), math.sin(p * math.tau / 1000))
                    for p in (a[i], b[j])
                ]
            )
            for i, j in pairs
        ]
        for k, chord in enumerate(chords):
            assert not any(chord.crosses(other) for other in chords[:k])
    assert match_exits(np.array([1.0]), np.zeros(0), 10.0) == []
