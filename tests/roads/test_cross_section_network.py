"""The lanes of the finished network against the tags of the ways that they come from."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.netconvert import sumo_network
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
#: A crossroads: the way under test comes from the west.
NODES = {1: (-120, 0, {}), 2: (0, 0, {}), 3: (120, 0, {}), 4: (0, -120, {}), 5: (0, 120, {})}
STREET = {"highway": "secondary", "lanes": "4", "sidewalk": "no"}
BASE = {"highway": "secondary", "sidewalk": "no"}
MPH = 1609.344 / 3600


def built(osm, tmp_path, radius_m, side="right", **how):
    """The network of a map around the origin."""
    return build_roads(
        read_extract(osm),
        HERE,
        shapely.Point(0, 0).buffer(radius_m),
        Elevation.flat(),
        driving_side=side,
        out=tmp_path / "n.net.xml",
        **how,
    ).network


@pytest.fixture
def build(write_osm, tmp_path):
    def build(tags, side="right", others=STREET, nodes=NODES, *, closed_loop=False):
        ways = {10: ([1, 2], {**BASE, **tags}), 11: ([2, 3], others), 12: ([4, 2, 5], others)}
        if callable(others):
            ways = others(tags)
        return built(write_osm(nodes, ways), tmp_path, 110, side, closed_loop=closed_loop)

    return build


def edges(network, way=10):
    """The lanes of both directions of a way, from the curb inwards: eastwards, westwards."""
    found = {True: [], False: []}
    for road in network.roads:
        if way in road.ways:
            lanes = [network.lane_by_id[name] for name in road.lanes]
            found[bool(lanes[0].centre[-1, 0] > lanes[0].centre[0, 0])] += lanes
    return found[True], found[False]


def rows(write_osm, tmp_path, cases, side):
    """Straight roads off one street, 40 m apart: of each its lanes eastwards and westwards."""
    north = {k: 40.0 * (k - len(cases) / 2) for k in range(len(cases))}
    nodes = {}
    for k, y in north.items():
        nodes |= {2 * k + 1: (-60, y, {}), 2 * k + 2: (60, y, {})}
    ways = {k + 1: ([2 * k + 1, 2 * k + 2], {**BASE, **tags}) for k, tags in enumerate(cases)}
    ways[900] = ([2 * k + 2 for k in range(len(cases))], BASE)
    network = built(write_osm(nodes, ways), tmp_path, 400, side)
    return [(*edges(network, k + 1), y) for k, y in north.items()]


def middle(lane):
    """Where a lane's middle lies at x = 0, metres north."""
    line = lane.centre[np.argsort(lane.centre[:, 0])]
    return float(np.interp(0.0, line[:, 0], line[:, 1]))


def shape(lanes):
    return [(lane.kind, round(lane.width, 2)) for lane in lanes]


CAR = ("driving", 3.25)
#: What is mapped as a sidewalk is 0.15 m of curb and the rest, where it lies beside lanes.
CASES = [
    ({"lanes": "3", "lanes:forward": "2", "width:lanes:forward": "3.1|2.9",
      "width:lanes:backward": "3.7"},
     [("driving", 2.9), ("driving", 3.1)], [("driving", 3.7)]),
    ({"lanes": "2", "width": "6"}, [("driving", 3.0)], [("driving", 3.0)]),
    ({"cycleway:right": "lane", "cycleway:right:width": "1.6"},
     [("bicycle", 1.6), CAR], [CAR]),
    ({"cycleway:both": "track", "sidewalk": "both", "sidewalk:both:width": "3"},
     [("sidewalk", 2.85), ("bicycle", 2.0), CAR], [("sidewalk", 2.85), ("bicycle", 2.0), CAR]),
    ({"oneway": "yes", "lanes": "2", "sidewalk": "both"},
     [("sidewalk", 2.35), CAR, CAR], [("sidewalk", 2.5)]),
    ({"oneway": "yes", "lanes": "2", "cycleway": "opposite_lane"},
     [CAR, CAR], [("bicycle", 1.85)]),
    ({"oneway": "yes", "lanes": "3", "bus:lanes": "||designated"},
     [("bus", 3.25), CAR, CAR], []),
    ({"oneway": "-1", "lanes": "2", "sidewalk": "left"}, [], [("sidewalk", 2.35), CAR, CAR]),
    ({"oneway": "yes", "lanes": "3", "busway": "opposite_lane"}, [CAR, CAR], [("bus", 3.25)]),
    ({"oneway": "yes", "lanes": "3", "turn:lanes": "left|through||right",
      "bicycle:lanes": "||designated|", "vehicle:lanes": "||no|"},
     [CAR, ("bicycle", 1.85), CAR, CAR], []),
    ({"highway": "residential", "lanes": "1", "width": "5"},
     [("driving", 2.5)], [("driving", 2.5)]),
]  # fmt: skip


def test_lanes_on_the_right(write_osm, tmp_path):
    found = rows(write_osm, tmp_path, [tags for tags, _, _ in CASES], "right")
    for (tags, east, west), (along, against, _) in zip(CASES, found, strict=True):
        assert (shape(along), shape(against)) == (east, west), tags


def swapped(tags):
    """The mirror image of tags: left for right, lanes counted from the other side."""

    def swap(text):
        text = text.replace("left", "*").replace("right", "left").replace("*", "right")
        return "|".join(text.split("|")[::-1])

    return {swap(key): swap(value) for key, value in tags.items()}


def test_lanes_on_the_left(write_osm, tmp_path):
    found = rows(write_osm, tmp_path, [swapped(tags) for tags, _, _ in CASES], "left")
    for (tags, east, west), (along, against, _) in zip(CASES, found, strict=True):
        assert (shape(along), shape(against)) == (east, west), tags
        # The curb is to the left of those who drive.
        for lanes, sign in ((along, 1), (against, -1)):
            place = [sign * middle(lane) for lane in lanes]
            assert place == sorted(place, reverse=True)


#: Tags, and how far north of the line lanes lie, from the curb inwards: lanes of 3.25 m.
PLACES = [
    # Without a tag the line is the middle of the carriageway.
    ({"oneway": "yes", "lanes": "2"}, [-1.625, 1.625]),
    ({"oneway": "yes", "lanes": "2", "sidewalk": "both"}, [-4.575, -1.625, 1.625]),
    ({"oneway": "yes", "lanes": "2", "placement": "right_of:1"}, [-1.625, 1.625]),
    ({"oneway": "yes", "lanes": "2", "placement": "left_of:1"}, [-4.875, -1.625]),
    ({"oneway": "yes", "lanes": "3", "placement": "middle_of:1"}, [-6.5, -3.25, 0.0]),
    ({"lanes": "3", "lanes:forward": "2"}, [-3.25, 0.0]),
    ({"lanes": "3", "lanes:forward": "2", "placement:forward": "left_of:1"}, [-4.875, -1.625]),
    ({"lanes": "4", "placement:backward": "right_of:1"}, [-8.125, -4.875]),
]


def test_placement(write_osm, tmp_path):
    found = rows(write_osm, tmp_path, [tags for tags, _ in PLACES], "right")
    for (tags, expected), (along, _, y) in zip(PLACES, found, strict=True):
        assert [middle(lane) - y for lane in along] == pytest.approx(expected, abs=0.03), tags


def test_placement_on_the_left(write_osm, tmp_path):
    cases = []
    for tags, _ in PLACES:
        mirror = swapped(tags)
        for key in [key for key in mirror if "placement" in key]:
            lanes = 3 if tags.get("lanes") == "3" and "oneway" in tags else 2
            word, number = mirror[key].split(":")
            mirror[key] = f"{word}:{lanes + 1 - int(number)}"
        cases.append(mirror)
    found = rows(write_osm, tmp_path, cases, "left")
    for (tags, expected), (along, _, y) in zip(PLACES, found, strict=True):
        assert [y - middle(lane) for lane in along] == pytest.approx(expected, abs=0.03), tags


def test_a_transition_joins_what_lies_before_and_after(build):
    nodes = {**NODES, 6: (-100, 0, {}), 7: (-60, 0, {}), 8: (-30, 0, {})}
    one = {**BASE, "oneway": "yes"}

    def ways(_):
        return {
            9: ([6, 7], {**one, "lanes": "2", "placement": "right_of:1"}),
            10: ([7, 8], {**one, "lanes": "2", "placement": "transition"}),
            13: ([8, 2], {**one, "lanes": "2", "placement": "left_of:1"}),
            11: ([2, 3], STREET),
            12: ([4, 2, 5], STREET),
        }

    network = build({}, others=ways, nodes=nodes)
    found = []
    for way in (9, 10, 13):
        for lane in edges(network, way)[0]:
            found += lane.centre[:, :2].tolist()
    inner = np.array([p for p in found if p[0] < -8])
    for x, expected in ((-90, 1.625), (-65, 1.625), (-45, 0.0), (-25, -1.625), (-12, -1.625)):
        near = inner[np.abs(inner[:, 0] - x) < 12]
        lanes = [lane for way in (9, 10, 13) for lane in edges(network, way)[0]]
        line = max(
            (
                float(np.interp(x, lane.centre[:, 0], lane.centre[:, 1]))
                for lane in lanes
                if lane.centre[0, 0] - 0.5 < x < lane.centre[-1, 0] + 0.5
            ),
            default=math.nan,
        )
        assert line == pytest.approx(expected, abs=0.15), (x, near)


def test_speeds(build):
    along, against = edges(build({"maxspeed:forward": "70", "maxspeed:backward": "30 mph"}))
    assert along[0].speed_limit == pytest.approx(70 / 3.6, abs=0.01)
    assert against[0].speed_limit == pytest.approx(30 * MPH, abs=0.01)
    along, _ = edges(build({"oneway": "yes", "lanes": "2", "maxspeed:lanes": "100|80"}))
    assert [x.speed_limit for x in along] == pytest.approx([80 / 3.6, 100 / 3.6], abs=0.01)


def test_who_may_use_a_lane(build):
    tags = {"oneway": "yes", "lanes": "3", "bus:lanes": "||designated", "hgv": "no"}
    tags["sidewalk"] = "right"
    along, _ = edges(build({**tags, "motorcycle:lanes": "no||", "cycleway:right": "lane"}))
    assert [x.kind for x in along] == ["sidewalk", "bicycle", "bus", "driving", "driving"]
    assert along[2].allowed == ("bus",)
    assert not {"truck", "bicycle"} & set(along[3].allowed)
    assert {"car", "motorcycle", "bus"} <= set(along[3].allowed)
    assert "motorcycle" not in along[4].allowed


@pytest.mark.parametrize(
    ("tags", "kinds"),
    [
        ({"motor_vehicle": "no"}, ["bicycle", "bicycle"]),
        ({"access": "no"}, ["driving", "driving"]),
        ({"vehicle": "no", "bus": "yes"}, ["bus", "bus"]),
    ],
)
def test_a_street_that_is_closed_stands_and_no_car_drives_there(build, tags, kinds, tmp_path):
    """The western arm of a crossroads; sumolib reads who may use it and where the loop leads."""
    network = build({"oneway": "yes", "lanes": "2", **tags}, closed_loop=True)
    along, back = edges(network)
    assert ([x.kind for x in along], back) == (kinds, [])
    assert all(x.length > 80 for x in along)
    net = sumolib.net.readNet(str(tmp_path / "n.net.xml"))
    assert not any(net.getLane(x.id).allows("passenger") for x in along)
    assert any(edge.allows("passenger") for edge in net.getEdges())
    buses = "bus" in tags
    assert {net.getLane(x.id).allows("bus") for x in along} == {buses}
    # Where only the closed street begins, no outer road leads to it.
    leads = net.getEdge(along[0].road).getIncoming()
    assert bool(leads) == buses


def test_where_most_streets_are_private_those_drive_who_may(build):
    """A port: all its streets are private, and one of them is closed all the same."""
    port = {**STREET, "access": "private"}
    along, _ = edges(build({"access": "private", "motor_vehicle": "no"}, others=port))
    network = build({"access": "private"}, others=port)
    assert not any("car" in lane.allowed for lane in along)
    assert all("car" in lane.allowed for way in (10, 11) for lane in edges(network, way)[0])


def turns(network, lanes):
    """The compass directions that each lane leads to."""
    found = []
    for lane in lanes:
        ends, ahead = set(), list(lane.successors)
        while ahead:
            out = network.lane_by_id[ahead.pop()]
            if out.road:
                step = out.centre[-1, :2] - out.centre[0, :2]
                ends.add("ENWS"[round(math.atan2(step[1], step[0]) / (math.pi / 2)) % 4])
            elif out.kind == "connection":
                ahead += out.successors
        found.append("".join(sorted(ends)))
    return found


@pytest.mark.parametrize(
    ("arrows", "expected"),
    [
        ("left|through|right", ["S", "E", "N"]),
        ("left|through|through;right", ["ES", "E", "N"]),
        ("left||", ["ES", "E", "N"]),
        *further(
            ("left;through|right", ["S", "EN"]),
            ("left|left|through;right", ["ES", "N", "N"]),
        ),
    ],
)
@pytest.mark.parametrize("cycle", [{}, *further({"cycleway:right": "lane"})])
def test_turns_are_as_mapped(build, arrows, expected, cycle):
    number = arrows.count("|") + 1
    tags = {"oneway": "yes", "lanes": str(number), "turn:lanes": arrows, **cycle}
    network = build(tags)
    cars = [lane for lane in edges(network)[0] if lane.kind == "driving"]
    assert turns(network, cars) == expected
    network = build(swapped(tags), "left")
    cars = [lane for lane in edges(network)[0] if lane.kind == "driving"]
    flip = str.maketrans("NS", "SN")
    assert turns(network, cars) == ["".join(sorted(e.translate(flip))) for e in expected]


def test_arrows_to_nowhere_leave_no_lane_without_a_way_on(build):
    tags = {"oneway": "yes", "lanes": "3", "turn:lanes": "left|through|right"}
    tags["cycleway:right"] = "lane"

    def no_left(_):
        return {
            10: ([1, 2], {**BASE, **tags}),
            11: ([2, 3], STREET),
            12: ([5, 2, 4], {**STREET, "lanes": "2", "oneway": "yes"}),
        }

    network = build({}, others=no_left)
    cars = [lane for lane in edges(network)[0] if lane.kind == "driving"]
    assert all(turns(network, cars))
    assert turns(network, cars)[0] == "S"


def test_edges_that_netconvert_does_not_make_are_no_failure(write_osm, tmp_path):
    path = write_osm({1: (0, 0, {}), 2: (90, 0, {})}, {7: ([1, 2], {"highway": "tertiary"})})
    told = tmp_path / "told.edg.xml"
    rows = "".join(f'<edge id="{k}" shape="9.18,48.7 9.19,48.7"/>' for k in ("7#1", "8", "-9"))
    known = '<edge id="7"><lane index="0" speed="7.5"/></edge>'
    told.write_text(f"<edges>{rows}{known}</edges>")
    out = tmp_path / "n.net.xml"
    sumo_network(path, HERE, driving_side="right", keep_apart=(), edges=told, out=out)
    lane = next(
        item for item in ElementTree.parse(out).getroot().iter("lane") if item.get("id") == "7_0"
    )
    assert float(lane.get("speed")) == 7.5


def test_an_edge_that_comes_back_to_its_junction_stays(write_osm, tmp_path):
    """Both ends of a slip lane in one joined junction: netconvert alone drops such an edge."""
    nodes = {1: (0, 0, {}), 2: (60, 0, {}), 3: (60, 60, {}), 4: (0, 60, {}), 5: (4, 4, {})}
    path = write_osm(
        nodes, {7: ([5, 1], STREET), 8: ([1, 2, 3, 4, 5], {**STREET, "oneway": "yes"})}
    )

    def joined(plain):
        edges = {**plain.edges, "8": replace(plain.edges["8"], end="1")}
        return replace(plain, edges=edges, links=())

    out = tmp_path / "n.net.xml"
    sumo_network(path, HERE, driving_side="right", keep_apart=(), reshape=joined, out=out)
    ends = [
        (item.get("from"), item.get("to"))
        for item in ElementTree.parse(out).getroot().iter("edge")
        if item.get("id", "").startswith("8")
    ]
    assert sorted(ends) == [("1", "8.middle"), ("8.middle", "1")]


@pytest.mark.parametrize(
    ("placement", "south", "north"),
    [({}, -0.875, 0.875), ({"placement": "middle_of:2"}, 0.0, 1.75)],
)
def test_parallel_carriageways_do_not_lie_on_each_other(
    write_osm, tmp_path, placement, south, north
):
    """Three lanes of 3.25 m each way, drawn 8 m apart: 1.75 m are missing between them."""
    nodes = {1: (-80, 0, {}), 2: (80, 0, {}), 3: (80, 8, {}), 4: (-80, 8, {})}
    tags = {**BASE, "oneway": "yes", "lanes": "3"}
    nodes |= {5: (110, 4, {}), 6: (150, 4, {})}
    ways = {1: ([1, 2], {**tags, **placement}), 2: ([3, 4], tags)}
    ways |= {3: ([2, 5], tags), 4: ([5, 3], tags), 5: ([5, 6], BASE)}
    network = built(write_osm(nodes, ways), tmp_path, 140)
    found = []
    for way, y in ((1, 0.0), (2, 8.0)):
        lanes = [lane for side in edges(network, way) for lane in side if lane.kind == "driving"]
        found.append(float(np.mean([middle(lane) for lane in lanes])) - y)
    assert found == pytest.approx([south, north], abs=0.05)


@pytest.mark.parametrize(
    ("tags", "between", "width"),
    [
        # Assumed is 2.75 m a lane in Germany, on main streets 3.25 m.
        ({"highway": "residential"}, 4.6, 2.2),
        ({"highway": "residential"}, 3.4, 2.0),
        ({"highway": "residential"}, 9.0, 2.75),
        ({"highway": "secondary"}, 4.6, 2.75),
        ({"highway": "residential", "width": "6"}, 4.6, 3.0),
    ],
)
def test_lanes_of_unmapped_width_yield_to_houses(write_osm, tmp_path, tags, between, width):
    """Rows of houses on both sides, the street nearer to the southern one than they are apart."""
    near, far = -0.4 * between, 0.6 * between
    nodes = dict(NODES)
    houses = {}
    for k, (low, high) in enumerate([(near - 8, near), (far, far + 8)]):
        corners = [(-90, low), (-50, low), (-50, high), (-90, high)]
        nodes |= {20 + 4 * k + j: (*xy, {}) for j, xy in enumerate(corners)}
        ring = [20 + 4 * k + j for j in (0, 1, 2, 3, 0)]
        houses[30 + k] = (ring, {"building": "house"})
    ways = {10: ([1, 2], {"sidewalk": "no", **tags}), 11: ([2, 3], STREET), **houses}
    network = built(write_osm(nodes, {**ways, 12: ([4, 2, 5], STREET)}), tmp_path, 110)
    lanes = [lane for side in edges(network) for lane in side if lane.kind == "driving"]
    assert [lane.width for lane in lanes] == pytest.approx([width] * 2, abs=0.01)
    walls = shapely.MultiPolygon([shapely.box(-90, near - 8, -50, near),
                                  shapely.box(-90, far, -50, far + 8)])  # fmt: skip
    taken = shapely.union_all([lane.polygon for lane in lanes]).intersection(walls).area
    # Between walls that are too near a street lies in the middle.
    assert taken == pytest.approx(40 * max(0.0, 2 * width - between), abs=6.0)
