"""Junctions that maps have now and then, and maps that are wrong: a sound network comes of all."""

import math

import numpy as np
import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.marking import painted
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
SIGNAL = {"highway": "traffic_signals"}
ZEBRA = {"highway": "crossing", "crossing": "marked"}
STREET = {"highway": "residential", "sidewalk": "both"}
MAIN = {"highway": "primary", "lanes": "4", "maxspeed": "50"}
ONE_WAY = {"highway": "primary", "oneway": "yes", "lanes": "2", "maxspeed": "50"}

#: A junction with lights in the middle of two streets: where they end, west to south.
FOUR_ARMS = {
    1: (0, 0, SIGNAL),
    2: (-150, 0, {}),
    3: (150, 0, {}),
    4: (0, 150, {}),
    5: (0, -150, {}),
}


def spokes(count, radius=140.0, first=0.0):
    """Places round the middle."""
    angles = [first + 2 * math.pi * k / count for k in range(count)]
    return [(radius * math.cos(a), radius * math.sin(a)) for a in angles]


def roundabout_with_signals():
    nodes = {k: (x, y, {}) for k, (x, y) in enumerate(spokes(16, 22.0), 1)}
    ring = {**ONE_WAY, "junction": "roundabout"}
    ways = {1: ([*range(1, 17), 1], ring)}
    for k, (x, y) in enumerate(spokes(4)):
        a, outer = 1 + 4 * k, 100 + k
        nodes[outer] = (x, y, {})
        nodes[200 + k] = (0.25 * x, 0.25 * y, SIGNAL)
        nodes[a - 1 or 16] = (*nodes[a - 1 or 16][:2], SIGNAL)
        ways[10 + k] = ([outer, 200 + k, a], MAIN)
    return nodes, ways


def five_arms():
    nodes = {1: (0, 0, SIGNAL)} | {10 + k: (x, y, {}) for k, (x, y) in enumerate(spokes(5))}
    return nodes, {k: ([10 + k, 1], STREET if k % 2 else MAIN) for k in range(5)}


def eight_arms_at_one_degree():
    nodes = {1: (0, 0, {})} | {10 + k: (x, y, {}) for k, (x, y) in enumerate(spokes(7))}
    nodes[30] = (139, 6, {})
    return nodes, {k: ([n, 1], STREET) for k, n in enumerate((*range(10, 17), 30), 1)}


def diverging_diamond():
    """Both directions change sides between two signals, ramps join from the sides."""
    nodes = {1: (-40, 0, SIGNAL), 2: (40, 0, SIGNAL)}
    nodes |= {
        10: (-150, -6, {}),
        11: (150, -6, {}),
        12: (0, 8, {}),
        13: (-20, 6, {}),
        14: (20, 6, {}),
    }
    nodes |= {
        20: (150, 6, {}),
        21: (-150, 6, {}),
        22: (0, -8, {}),
        23: (20, -6, {}),
        24: (-20, -6, {}),
    }
    nodes |= {30: (-60, -140, {}), 31: (-60, 140, {}), 32: (60, 140, {}), 33: (60, -140, {})}
    nodes |= {40: (-75, -6, {}), 41: (-75, 6, {}), 42: (75, 6, {}), 43: (75, -6, {})}
    link = {"highway": "primary_link", "oneway": "yes", "lanes": "1"}
    ways = {
        1: ([10, 40, 1, 13, 12, 14, 2, 43, 11], ONE_WAY),
        2: ([20, 42, 2, 23, 22, 24, 1, 41, 21], ONE_WAY),
        3: ([30, 40], link), 4: ([41, 31], link), 5: ([32, 42], link), 6: ([43, 33], link),
        7: ([13, 31], link), 8: ([23, 33], link),
    }  # fmt: skip
    return nodes, ways


def cut_by_the_border():
    nodes = {1: (135, 0, SIGNAL), 2: (-150, 0, {}), 3: (150, 0, {}), 4: (135, 150, {})}
    nodes |= {5: (135, -150, {}), 6: (125, 0, ZEBRA), 7: (139, 0, ZEBRA), 8: (128, 0, SIGNAL)}
    return nodes, {1: ([2, 6, 8, 1, 7, 3], MAIN), 2: ([4, 1, 5], STREET)}


def against_the_line():
    nodes = {
        1: (0, 0, SIGNAL),
        2: (-150, 0, {}),
        3: (150, 0, {}),
        4: (0, 150, {}),
        5: (0, -150, {}),
    }
    back = {**ONE_WAY, "oneway": "-1", "turn:lanes": "left|right;through"}
    return nodes, {1: ([2, 1], back), 2: ([1, 3], back), 3: ([4, 1, 5], STREET)}


def a_lane_for_both():
    both = {**MAIN, "lanes": "3", "lanes:forward": "1", "lanes:backward": "1",
            "lanes:both_ways": "1", "turn:lanes:both_ways": "left"}  # fmt: skip
    nodes = {
        1: (0, 0, SIGNAL),
        2: (-150, 0, {}),
        3: (150, 0, {}),
        4: (0, 150, {}),
        5: (0, -150, {}),
    }
    return nodes, {1: ([2, 1, 3], both), 2: ([4, 1, 5], both)}


def nonsense_tags():
    nodes = {
        1: (0, 0, SIGNAL),
        2: (-150, 0, {}),
        3: (150, 0, {}),
        4: (0, 150, {}),
        5: (0, -150, {}),
    }
    bad = {"highway": "primary", "lanes": "-7;x", "lanes:forward": "99", "oneway": "perhaps",
           "turn:lanes": "left;left|sideways||||", "width": "1e9", "maxspeed": "fast",
           "placement": "left_of:17", "layer": "nan"}  # fmt: skip
    worse = {"highway": "secondary", "lanes": "0", "turn:lanes:forward": "|", "change:lanes": "?",
             "lanes:backward": "2.5", "turn:lanes:backward": "none|none|none|none"}  # fmt: skip
    return nodes, {1: ([2, 1], bad), 2: ([1, 3], worse), 3: ([4, 1, 5], STREET)}


def nodes_twice():
    """Every node is there twice at one place, one way runs over itself, one has one place only."""
    nodes = FOUR_ARMS | {k + 10: FOUR_ARMS[k] for k in range(1, 6)}
    ways = {1: ([2, 1, 11, 1, 3], MAIN), 2: ([4, 14, 1, 1, 5], STREET), 3: ([3, 13], STREET),
            4: ([2, 1, 3], MAIN)}  # fmt: skip
    return nodes, ways


def bridge_over_the_middle():
    nodes = FOUR_ARMS | {6: (-150, -140, {}), 7: (150, 140, {}), 8: (-20, -19, {}), 9: (20, 19, {})}
    over = {**ONE_WAY, "bridge": "yes", "layer": "1"}
    ways = {1: ([2, 1, 3], MAIN), 2: ([4, 1, 5], STREET), 3: ([6, 8], ONE_WAY), 4: ([8, 9], over),
            5: ([9, 7], ONE_WAY)}  # fmt: skip
    return nodes, ways


def a_dead_end_of_two_metres():
    nodes = {1: (0, 0, SIGNAL), 2: (-150, 0, {}), 3: (150, 0, {}), 4: (0, 2, {}), 5: (0, -150, {})}
    nodes |= {6: (1, -1.5, {}), 7: (-150, -3, {})}
    ways = {1: ([2, 1, 3], MAIN), 2: ([1, 4], STREET), 3: ([1, 6, 5], STREET), 4: ([7, 6], ONE_WAY)}
    return nodes, ways


def a_block_every_five_metres():
    """Streets that lie nearer to each other than they are wide."""
    side = 5
    nodes = {i * side + j + 1: (5.0 * i, 5.0 * j, {}) for i in range(side) for j in range(side)}
    across = {i + 1: ([i * side + j + 1 for j in range(side)], STREET) for i in range(side)}
    along = {50 + j: ([i * side + j + 1 for i in range(side)], STREET) for j in range(side)}
    return nodes, across | along


ODD = [
    roundabout_with_signals, five_arms, eight_arms_at_one_degree, diverging_diamond,
    cut_by_the_border, against_the_line, a_lane_for_both, nonsense_tags, nodes_twice,
    bridge_over_the_middle, a_dead_end_of_two_metres,
]  # fmt: skip


MIRRORED = (roundabout_with_signals, diverging_diamond, a_lane_for_both)


@pytest.mark.parametrize(
    ("place", "side"),
    [
        *((one, "right") for one in ODD),
        (bridge_over_the_middle, "left"),
        *further(*((one, "left") for one in MIRRORED)),
    ],
)
def test_an_odd_place_becomes_a_sound_network(place, side, write_osm, tmp_path):
    nodes, ways = place()
    if side == "left":
        nodes = {key: (x, -y, tags) for key, (x, y, tags) in nodes.items()}
    extract = read_extract(write_osm(nodes, ways))
    out = tmp_path / "n.net.xml"
    region = shapely.box(-140, -140, 140, 140)
    built = build_roads(extract, HERE, region, Elevation.flat(), driving_side=side, out=out)
    network, model = built.network, built.model
    assert sumolib.net.readNet(str(out)).getEdges()
    # Every lane of a street leads on, or beside it one does; or the street ends there.
    ends = {j.id for j in network.junctions if j.kind == "dead_end"}
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes]
        driven = [lane for lane in lanes if lane.kind in ("driving", "bus")]
        assert not driven or road.to_junction in ends or any(lane.successors for lane in driven)
        assert all(np.isfinite(lane.centre).all() and lane.width < 8 for lane in lanes)
    # No street lies on another of its level, and none within a junction.
    streets = [
        (road.level, shapely.union_all([_lane(network, road, s) for s in road.sections]))
        for road in model.roads
        if road.junction < 0
    ]
    outlines = [(j.level, shapely.Polygon(j.outline).buffer(0)) for j in model.junctions]
    middle = region.buffer(-25)
    for k, (level, area) in enumerate(streets):
        for other, there in [*streets[:k], *outlines]:
            assert other != level or area.intersection(there).intersection(middle).area < 6.0
    # Arrows and stop lines stand before junctions.
    paint = painted(network, model).of("stop")
    stops = shapely.centroid(shapely.polygons(paint)) if len(paint) else np.array([])
    inside = shapely.union_all([outline for _, outline in outlines]).buffer(-1.5)
    assert not shapely.contains(inside, stops).any()


def test_a_loop_from_a_junction_of_several_nodes_back_into_it_is_a_street(write_osm, tmp_path):
    """Buses turn round before a station: out at one node, back in at the next, 8 m on."""
    nodes = FOUR_ARMS | {1: (0, 0, {}), 6: (8, 0, {}), 7: (10, -40, {}), 8: (30, -50, {})}
    nodes |= {9: (50, -40, {}), 10: (50, -15, {})}
    loop = {**STREET, "oneway": "yes"}
    ways = {1: ([2, 1, 6, 3], STREET), 2: ([1, 4], STREET), 3: ([6, 10, 9, 8, 7, 1], loop)}
    out = tmp_path / "n.net.xml"
    region = shapely.box(-140, -140, 140, 140)
    extract = read_extract(write_osm(nodes, ways))
    built = build_roads(extract, HERE, region, Elevation.flat(), driving_side="right", out=out)
    mapped = shapely.LineString([nodes[node][:2] for node in (10, 9, 8, 7)])
    lanes = [shapely.LineString(lane.centre[:, :2]) for lane in built.network.lanes
             if lane.kind == "driving"]  # fmt: skip
    driven = shapely.union_all([line.buffer(3.0) for line in lanes])
    assert driven.intersection(mapped).length > 0.95 * mapped.length
    streets = [road for road in built.model.roads if 3 in road.ways and road.junction < 0]
    assert sum(road.curve.length for road in streets) > 0.9 * mapped.length


def test_streets_nearer_to_each_other_than_they_are_wide_build(write_osm, tmp_path):
    extract = read_extract(write_osm(*a_block_every_five_metres()))
    out = tmp_path / "n.net.xml"
    region = shapely.box(-140, -140, 140, 140)
    built = build_roads(extract, HERE, region, Elevation.flat(), driving_side="right", out=out)
    assert sumolib.net.readNet(str(out)).getEdges()
    assert all(np.isfinite(lane.centre).all() for lane in built.network.lanes)


def _lane(network, road, section):
    names = [name for lane in section.lanes for name in lane.strip.split()]
    lanes = [network.lane_by_id[name] for name in names if name in network.lane_by_id]
    kinds = ("driving", "bus", "bicycle")
    return shapely.union_all([lane.polygon for lane in lanes if lane.kind in kinds])
