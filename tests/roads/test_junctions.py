"""Junctions that are mapped as many nodes: what the map says of them holds of the network."""

import math
from itertools import combinations

import numpy as np
import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.marking import arrow_at, guide_lines, lines_through, turn_arrow
from urbantwin.roads.marking.turn_arrow import arrow_on
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
SIGNAL = {"highway": "traffic_signals"}
ONE_WAY = {"highway": "primary", "oneway": "yes", "lanes": "2", "maxspeed": "50",
           "sidewalk": "no"}  # fmt: skip
STREET = {"highway": "residential", "sidewalk": "both"}


def carriageways(gap, signal=SIGNAL):
    """Two streets of two carriageways each; ways 1 to 4 lead east, west, north and south."""
    h = gap / 2
    nodes = {50: (-h, -h, signal), 51: (h, -h, signal), 52: (h, h, signal), 53: (-h, h, signal)}
    nodes |= {0: (-150, -h, {}), 2: (150, -h, {}), 10: (150, h, {}), 12: (-150, h, {})}
    nodes |= {100: (h, -150, {}), 102: (h, 150, {}), 110: (-h, 150, {}), 112: (-h, -150, {})}
    ways = {
        1: ([0, 50, 51, 2], ONE_WAY),
        2: ([10, 52, 53, 12], ONE_WAY),
        3: ([100, 51, 52, 102], ONE_WAY),
        4: ([110, 53, 50, 112], ONE_WAY),
    }
    return nodes, ways


@pytest.fixture
def build(write_osm, tmp_path):
    def run(nodes, ways, side="right", relations=None):
        path = write_osm(nodes, ways, relations=relations)
        out = tmp_path / "n.net.xml"
        region = shapely.box(-140, -140, 140, 140)
        extract = read_extract(path)
        built = build_roads(extract, HERE, region, Elevation.flat(), driving_side=side, out=out)
        return built, sumolib.net.readNet(str(out))

    return run


def compass(edge, outwards):
    """Where an edge lies as seen from the middle: E, N, W or S."""
    x, y = (edge.getShape()[-1] if outwards else edge.getShape()[0])[:2]
    return "ENWS"[round(math.atan2(y, x) / (math.pi / 2)) % 4]


def ways_through(net):
    (node,) = [n for n in net.getNodes() if len(n.getOutgoing()) > 2]
    return {
        (compass(item.getFrom(), outwards=False), compass(item.getTo(), outwards=True))
        for item in node.getConnections()
        if not item.getFrom().getID().startswith(":")
    }


@pytest.mark.parametrize(
    ("gap", "side"),
    [
        (9, "right"),
        (24, "left"),
        *further((14, "right"), (24, "right"), (9, "left"), (14, "left")),
    ],
)
def test_carriageways_that_cross_are_one_junction(side, gap, build):
    nodes, ways = carriageways(gap)
    if side == "left":
        nodes = {key: (-x, y, tags) for key, (x, y, tags) in nodes.items()}
    built, net = build(nodes, ways, side)
    junctions = [j for j in built.model.junctions if len(j.connections) > 2]
    assert len(junctions) == 1
    # From each of four sides straight on, left and right, and never back.
    assert ways_through(net) == {(a, b) for a in "ENWS" for b in "ENWS" if a != b}
    # Nothing of the edges between the four nodes is left.
    assert all(edge.getLength() > 50 for edge in net.getEdges())
    controlled = {item.getID() for item in net.getTrafficLights()}
    assert len(controlled) == 1


def test_who_rides_among_cars_goes_on_where_a_cycle_lane_begins(build):
    """Nobody may ride on the lanes of the street beside its cycle lane."""
    nodes, ways = carriageways(14)
    ways[1] = ([0, 50, 51], ONE_WAY)
    ways[9] = ([51, 2], {**ONE_WAY, "cycleway:right": "lane"})
    _, net = build(nodes, ways)
    (begins,) = [e for e in net.getEdges() if compass(e, True) == "E" and e.getLength() > 50
                 and e.getFromNode().getType() == "traffic_light"]  # fmt: skip
    ridden = [lane.allows("bicycle") for lane in begins.getLanes()]
    assert any(ridden)
    assert not all(ridden)
    for side in "WNS":
        (comes,) = [e for e in net.getEdges() if compass(e, False) == side and e.getLength() > 50
                    and e.getToNode().getType() == "traffic_light"]  # fmt: skip
        assert begins in comes.getAllowedOutgoing("bicycle"), side


def test_junctions_60_m_apart_stay_two(build):
    nodes = {1: (-150, 0, {}), 2: (-30, 0, SIGNAL), 3: (30, 0, SIGNAL), 4: (150, 0, {})}
    nodes |= {5: (-30, 130, {}), 6: (-30, -130, {}), 7: (30, 130, {}), 8: (30, -130, {})}
    main = {"highway": "primary", "lanes": "4", "sidewalk": "both"}
    ways = {1: ([1, 2, 3, 4], main), 2: ([5, 2, 6], STREET), 3: ([7, 3, 8], STREET)}
    built, _ = build(nodes, ways)
    middles = [j.outline.mean(axis=0) for j in built.model.junctions if len(j.connections) > 2]
    assert len(middles) == 2
    assert np.linalg.norm(middles[0] - middles[1]) == pytest.approx(60, abs=5)


@pytest.mark.parametrize(("tags", "number"), [({}, 1), ({"highway": "crossing"}, 2)])
def test_a_mapped_crossing_between_nodes_parts_them(tags, number, build):
    """Two nodes 36 m apart, both with signals: one junction, unless people cross between."""
    nodes = {1: (-130, 0, {}), 2: (-18, 0, SIGNAL), 9: (0, 0, tags), 3: (18, 0, SIGNAL)}
    nodes |= {4: (130, 0, {}), 5: (-18, 130, {}), 6: (18, -130, {})}
    main = {"highway": "primary", "lanes": "2", "sidewalk": "both"}
    ways = {1: ([1, 2, 9, 3, 4], main), 2: ([5, 2], STREET), 3: ([6, 3], STREET)}
    built, _ = build(nodes, ways)
    turning = [j for j in built.model.junctions if len(j.connections) > 4]
    assert len(turning) == number


def test_roads_end_at_mapped_stop_lines(build):
    nodes, ways = carriageways(14, signal={})
    nodes |= {20: (-31, -7, SIGNAL | {"traffic_signals:direction": "forward"})}
    nodes |= {21: (7, -27, SIGNAL), 22: (27, 7, SIGNAL), 23: (-7, 35, SIGNAL)}
    ways[1][0].insert(1, 20)
    ways[3][0].insert(1, 21)
    ways[2][0].insert(1, 22)
    ways[4][0].insert(1, 23)
    built, _ = build(nodes, ways)
    ends = {
        "ENWS"[round((head.yaw + math.pi) / (math.pi / 2)) % 4]: max(abs(head.x), abs(head.y))
        for head in built.network.signals
    }
    assert ends == pytest.approx({"W": 31, "S": 27, "E": 27, "N": 35}, abs=0.3)


def test_restrictions_over_a_way_between_hold(build):
    """From the south one may not go over the middle to the west: no left turn."""
    nodes, ways = carriageways(20)
    # Way 3 is cut at its nodes so that its middle part is a way of its own.
    ways[3] = ([100, 51], ONE_WAY)
    ways[30], ways[31] = ([51, 52], ONE_WAY), ([52, 102], ONE_WAY)
    ways[2] = ([10, 52], ONE_WAY)
    ways[20], ways[21] = ([52, 53], ONE_WAY), ([53, 12], ONE_WAY)
    members = [("way", 3, "from"), ("way", 30, "via"), ("way", 20, "to")]
    ban = {7: (members, {"type": "restriction", "restriction": "no_left_turn"})}
    _, free = build(nodes, ways)
    _, held = build(nodes, ways, relations=ban)
    assert ways_through(free) - ways_through(held) == {("S", "W")}


ARROWS = [
    ("|||right", [(), (), (), ("right",)]),
    ("left|through|through;right", [("left",), ("through",), ("through", "right")]),
    ("left;through|none|slight_right", [("left", "through"), (), ("right",)]),
    ("reverse;left|through|", [("around", "left"), ("through",), ()]),
]


#: Every tag on one street; which words they are does not depend on the carriageway.
ARROWS_AT = [
    *(("one street", *row) for row in ARROWS[:2]),
    ("first carriageway", *ARROWS[0]),
    ("second carriageway", *ARROWS[1]),
    *further(*(("one street", *row) for row in ARROWS[2:])),
    *further(*(("first carriageway", *row) for row in ARROWS[3::3])),
    *further(("second carriageway", *ARROWS[2])),
]


@pytest.mark.parametrize(("where", "tag", "expected"), ARROWS_AT)
def test_arrows_are_as_tagged(where, tag, expected, build):
    """The way with arrows ends at the middle of a street, or of one of its two carriageways."""
    lanes = {"lanes": str(len(expected)), "turn:lanes": tag}
    if where != "one street":
        nodes, ways = carriageways(14)
        path = [0, 50, 51, 2]
        end = 2 if where == "first carriageway" else 3
        ways[1] = (path[:end], ONE_WAY | lanes)
        ways[5] = (path[end - 1 :], ONE_WAY)
    else:
        nodes = {1: (-150, 0, {}), 2: (0, 0, SIGNAL), 3: (150, 0, {}), 4: (0, 150, {})}
        nodes[5] = (0, -150, {})
        ways = {1: ([1, 2], ONE_WAY | lanes), 2: ([2, 3], STREET), 3: ([4, 2, 5], STREET)}
    network = build(nodes, ways)[0].network
    (road,) = [road for road in network.roads if 1 in road.ways]
    found = [network.lane_by_id[name] for name in road.lanes[::-1]]  # from the left
    for lane, words in zip([x for x in found if x.kind == "driving"], expected, strict=True):
        painted = turn_arrow(network, lane)
        tips = [lane.length - back for back in (2.5, 32.5)]  # twice on long lanes
        wanted = [arrow_at(words, lane, at, 6.0) for at in tips] if words else None
        assert (painted is None) == (not words), lane.id
        differs = shapely.symmetric_difference(painted, shapely.union_all(wanted))
        assert shapely.area(differs) < 1e-6 or not words, (lane.id, words)


def test_opposed_turns_pass_in_front_of_each_other(build):
    built, _ = build(*carriageways(20))
    lefts = []
    for road in built.model.roads:
        heading = np.unwrap(road.curve.at(np.linspace(0, road.length, 50))[:, 2])
        if road.junction >= 0 and heading[-1] - heading[0] > 1.2:
            lefts.append((heading[0], road.curve.line))
    opposed = [
        a.distance(b)
        for (first, a), (second, b) in combinations(lefts, 2)
        if math.cos(first - second) < -0.9
    ]
    assert len(opposed) == 2
    assert min(opposed) > 2.5
    # And lines guide them from their stop line to their exit.
    assert len(list(guide_lines(built.model))) == len(lefts) == 4


@pytest.mark.real
@pytest.mark.parametrize(
    "name", ["manchester-kingsway", "taipei", *further("london-borough", "munich")]
)
def test_nothing_floats_in_real_junctions(name, real_roads):
    """Roads end at the border of a junction: none lies within one, and no stop line does."""
    built, out = real_roads(name).built, real_roads(name).net
    assert built.network.driving_side == (
        "left" if name in ("manchester-kingsway", "london-borough") else "right"
    )
    wide = [j for j in built.network.junctions if j.id.startswith("cluster_")]
    assert wide
    for junction in wide:
        inside = junction.polygon.buffer(-4.0)
        for road in built.model.roads:
            if road.junction < 0:
                assert not road.curve.line.intersects(inside), (junction.id, road.name)
        for head in built.network.signals:
            if built.network.lane_by_id[head.lane].kind != "crossing":
                assert not inside.contains(shapely.Point(head.x, head.y))
    # Who goes ahead from one lane does not cross who goes ahead from the lane beside it.
    net = sumolib.net.readNet(str(out), withInternal=True)
    for edge in net.getEdges(withInternal=False):
        ahead = [
            (lane, item.getTo(), shapely.LineString(net.getLane(item.getViaLaneID()).getShape()))
            for lane in edge.getLanes()
            if lane.allows("passenger")
            for item in lane.getOutgoing()
            if item.getDirection() in "sLR" and item.getViaLaneID()
        ]
        for (a, to, way), (b, there, other) in combinations(ahead, 2):
            assert a is b or to is there or not way.crosses(other), (a.getID(), b.getID())


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_nobody_turns_a_corner_tighter_than_a_car_can(side, build):
    """A street of one lane comes to one of three, at 65 degrees: who turns to the near kerb."""
    turn = -1 if side == "right" else 1
    nodes = {1: (-130, 0, {}), 2: (0, 0, {}), 3: (130, 0, {}), 4: (60, turn * 130, {})}
    three, one = ONE_WAY | {"lanes": "3"}, STREET | {"lanes": "1", "oneway": "yes"}
    built, _ = build(nodes, {1: ([1, 2, 3], three), 2: ([4, 2], one)}, side)
    turns = [road for road in built.model.roads if road.junction >= 0]
    tightest = {}
    for road in turns:
        stations = np.linspace(0.0, road.curve.length, 40)
        heading = np.unwrap(road.curve.at(stations)[:, 2])
        if 0.6 < abs(heading[-1] - heading[0]) < 2.4:
            bend = np.abs(np.gradient(heading, stations)).max()
            tightest[road.id] = 1 / bend
    assert tightest
    assert min(tightest.values()) > 3.0


def areas(network, *ways):
    """The lanes of each way as one area in plan."""
    roads = [[road for road in network.roads if way in road.ways] for way in ways]
    return [
        shapely.union_all(
            [network.lane_by_id[name].polygon for road in mine for name in road.lanes]
        )
        for mine in roads
    ]


@pytest.mark.parametrize("side", ["right", *further("left")])
def test_ways_that_part_lie_side_by_side(side, build):
    """Four lanes that part into three and one at 4 degrees: each has its own asphalt."""
    turn = -1 if side == "right" else 1
    nodes = {1: (-130, 0, {}), 2: (-40, 0, {}), 3: (130, 0, {}), 4: (130, turn * 12, {})}
    four, three = ONE_WAY | {"lanes": "4"}, ONE_WAY | {"lanes": "3"}
    one = ONE_WAY | {"lanes": "1"}
    built, _ = build(nodes, {1: ([1, 2], four), 2: ([2, 3], three), 3: ([2, 4], one)}, side)
    before, on, off = areas(built.network, 1, 2, 3)
    assert on.intersection(off).area < 1.0
    assert before.intersection(shapely.union_all([on, off])).area < 1.0
    # Far from where they part, each lies where it is mapped.
    assert shapely.Point(125, 0).within(on)
    assert shapely.Point(125, turn * 11.6).within(off)


def test_a_crossing_between_two_junctions_belongs_to_one(build):
    """A carriageway parts 29 m before a wide junction, a crossing between: a road is left there."""
    crossing = {"highway": "crossing", "crossing": "traffic_signals"}
    nodes, ways = carriageways(14)
    nodes |= {60: (-36, -7, {}), 61: (-25, -7, SIGNAL), 62: (-20, -7, crossing)}
    nodes |= {63: (-26, -25, {}), 64: (-40, -150, {})}
    ways[1] = ([0, 60], ONE_WAY)
    ways[5] = ([60, 61, 62, 50], ONE_WAY | {"turn:lanes": "left|through;right"})
    ways[7] = ([50, 51, 2], ONE_WAY)
    ways[6] = ([60, 63, 64], ONE_WAY | {"lanes": "1"})
    network = build(nodes, ways)[0].network
    (road,) = [road for road in network.roads if 5 in road.ways]
    for name in road.lanes:
        lane = network.lane_by_id[name]
        assert lane.length > 5.0
        assert lane.centre[-1, 0] == pytest.approx(-25, abs=1.0)  # at its stop line
        assert turn_arrow(network, lane) is not None


def test_the_arrow_of_a_short_lane_stands_upstream(build):
    """The way with arrows is 5 m long: they begin on the street that leads into it."""
    nodes = {1: (-140, 0, {}), 2: (-17, 0, {}), 4: (0, 0, SIGNAL), 3: (140, 0, {})}
    nodes |= {5: (0, 140, {}), 6: (0, -140, {}), 8: (-12, 0, SIGNAL), 9: (-40, 60, {})}
    nodes[4] = (0, 0, {})
    ways = {
        1: ([1, 2], ONE_WAY),
        2: ([2, 8, 4], ONE_WAY | {"turn:lanes": "left|through;right"}),
        3: ([4, 3], STREET),
        4: ([5, 4, 6], STREET),
        5: ([2, 9], ONE_WAY | {"lanes": "1"}),
    }
    network = build(nodes, ways)[0].network
    (road,) = [r for r in network.roads if 2 in r.ways and 1 not in r.ways]
    for name in road.lanes:
        lane = network.lane_by_id[name]
        arrow = turn_arrow(network, lane)
        assert lane.length < 6.0
        x0, _, x1, _ = arrow.bounds
        assert x0 < lane.centre[0, 0] - 2.0
        assert x1 - x0 == pytest.approx(6.0, abs=0.2)
        assert x1 <= lane.centre[-1, 0] - 2.0


def test_arrows_follow_a_lane_that_bends():
    """On a bend of 12 m radius every part of an arrow is as far from the lane's middle as drawn."""
    angle = np.linspace(0.0, np.pi / 2, 60)
    line = shapely.LineString(12.0 * np.column_stack([np.sin(angle), 1 - np.cos(angle)]))
    straight = shapely.LineString([(0, 0), (line.length, 0)])
    for ways in (("through",), ("left", "through"), ("right",)):
        flat, bent = (arrow_on(one, ways, 3.0, 14.0, 6.0) for one in (straight, line))
        low, high = flat.bounds[1], flat.bounds[3]
        corners = shapely.get_coordinates(bent)
        aside = 12.0 - np.linalg.norm(corners - [0.0, 12.0], axis=1)
        assert (aside.min(), aside.max()) == pytest.approx((low, high), abs=0.03)
        assert bent.area == pytest.approx(flat.area, rel=0.05)


def test_lines_between_lanes_go_on_past_a_minor_street(build):
    """Three lanes straight on: two lines between them, which the turns do not have."""
    three = ONE_WAY | {"lanes": "3"}
    nodes = {1: (-150, 0, {}), 2: (0, 0, {}), 3: (150, 0, {}), 4: (0, 150, {})}
    built, _ = build(nodes, {1: ([1, 2, 3], three), 2: ([2, 4], STREET)})
    lines = list(lines_through(built.network, built.model))
    widths = {lane.width for lane in built.network.lanes if lane.road and lane.kind == "driving"}
    middle = sorted(float(line.points[:, 1].mean()) for line in lines)
    assert len(lines) == 2
    assert middle[1] - middle[0] == pytest.approx(max(widths), abs=0.05)
    assert all(np.ptp(line.points[:, 1]) < 0.05 for line in lines)
    # At signals the lines end.
    nodes[2] = (0, 0, SIGNAL)
    built, _ = build(nodes, {1: ([1, 2, 3], three), 2: ([2, 4], STREET)})
    assert not list(lines_through(built.network, built.model))


def test_a_crossing_and_its_stop_lines_are_one_signal(build):
    """A street is crossed at lights, with a stop line mapped on either side."""
    stop = SIGNAL | {"crossing": "no", "traffic_signals": "pedestrian_crossing"}
    nodes = {1: (-150, 0, {}), 2: (150, 0, {}), 3: (0, 0, {"highway": "crossing"})}
    nodes[3][2]["crossing"] = "traffic_signals"
    for number, x, told in ((4, -4, "forward"), (5, 4, "backward")):
        nodes[number] = (x, 0, stop | {"traffic_signals:direction": told})
    network = build(nodes, {1: ([1, 4, 3, 5, 2], STREET)})[0].network
    assert len(network.programs) == 1
    stopped = [network.lane_by_id[name] for name in sorted(network.stopped_lanes)]
    assert sorted(lane.kind for lane in stopped) == ["crossing", "driving", "driving"]
    assert all(lane.length > 100 for lane in stopped if lane.kind == "driving")


def test_ways_side_by_side_move_apart_in_the_closed_loop_too(write_osm, tmp_path):
    """Both part from one street and run on 5 m apart to the border, where outer roads begin."""
    nodes = {1: (-150, 0, {}), 2: (-90, 0, {}), 3: (-60, 0, {}), 4: (150, 0, {})}
    nodes |= {5: (-60, -5, {}), 6: (150, -5, {})}
    ways = {1: ([1, 2], ONE_WAY | {"lanes": "4"}), 2: ([2, 3, 4], ONE_WAY), 3: ([2, 5, 6], ONE_WAY)}
    extract = read_extract(write_osm(nodes, ways))
    for loop in (False, True):
        built = build_roads(
            extract, HERE, shapely.box(-140, -140, 140, 140), Elevation.flat(),
            driving_side="right", out=tmp_path / "n.net.xml", closed_loop=loop,
        )  # fmt: skip
        one, other = areas(built.network, 2, 3)
        inside = shapely.box(-140, -140, 110, 140)
        assert one.intersection(other).intersection(inside).area < 1.0
