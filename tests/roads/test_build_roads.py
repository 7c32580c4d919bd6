"""The lane network against the map that it was made from."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, build_roads, driving_side
from urbantwin.site import read_extract

from ..thorough import further

HERE = SiteFrame(48.7, 9.18)
PLACES = ("taipei", "quad_intersection", "perth_stretched_lights", "manchester-kingsway")
MORE_PLACES = ("neukolln", "munich", "london-borough")


def build(path, frame, region, out, elevation=None):
    return build_roads(
        read_extract(path),
        frame,
        region,
        elevation or Elevation.flat(),
        driving_side=driving_side(frame.latitude, frame.longitude),
        out=out,
    )


def test_lanes_widths_and_speeds_are_as_mapped(write_osm, tmp_path):
    nodes = {1: (-100, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (100, 0, {})}
    nodes |= {4: (0, -100, {}), 5: (0, 100, {})}
    fast = {"highway": "secondary", "lanes": "4", "maxspeed": "60", "sidewalk": "no"}
    slow = {"highway": "residential", "lanes": "2", "maxspeed": "20 mph", "sidewalk": "both"}
    path = write_osm(nodes, {10: ([1, 2, 3], fast), 11: ([4, 2, 5], slow)})
    network = build(path, HERE, shapely.box(-90, -90, 90, 90), tmp_path / "n.net.xml").network
    assert network.driving_side == "right"
    for road in network.roads:
        lanes = [network.lane_by_id[lane] for lane in road.lanes]
        driving = [lane for lane in lanes if lane.kind == "driving"]
        assert len(driving) == (2 if 10 in road.ways else 1)
        speed = 60 / 3.6 if 10 in road.ways else 20 * 1.609344 / 3.6
        assert all(lane.speed_limit == pytest.approx(speed, abs=0.01) for lane in driving)
        assert sum(lane.kind == "sidewalk" for lane in lanes) == (0 if 10 in road.ways else 1)
    assert len(network.programs) == 1
    assert {signal.program for signal in network.signals} == {network.programs[0].id}


def test_everything_ends_at_the_region(write_osm, tmp_path):
    nodes = {1: (-280, 0, {}), 2: (280, 0, {}), 3: (0, -280, {}), 4: (0, 280, {}), 5: (0, 0, {})}
    street = {"highway": "tertiary"}
    path = write_osm(nodes, {1: ([1, 5, 2], street), 2: ([3, 5, 4], street)})
    region = shapely.Point(0, 0).buffer(80, quad_segs=64)
    network = build(path, HERE, region, tmp_path / "n.net.xml").network
    ends = [np.hypot(*lane.centre[k, :2]) for lane in network.lanes for k in (0, -1)]
    assert max(ends) == pytest.approx(80, abs=1.0)


@pytest.mark.parametrize("names", [PLACES, *further((MORE_PLACES,))], ids=["few", "more"])
def test_forbidden_turns_have_no_connection(names, real_roads):
    """Restrictions of the map, parsed here, between roads that are each made from one way."""
    checked = 0
    for name in names:
        place = real_roads(name)
        network = place.built.network
        roads_of: dict[str, set[str]] = {}
        for road in network.roads:
            for way in road.ways:
                roads_of.setdefault(str(way), set()).add(road.id)
        lanes = network.lane_by_id
        turns = {
            (lane.road, lanes[end].road)
            for lane in network.lanes
            for via in lane.successors
            for end in lanes[via].successors
        }
        for relation in ElementTree.parse(place.extract).getroot().iter("relation"):
            tags = {tag.get("k"): tag.get("v") for tag in relation.iter("tag")}
            if not tags.get("restriction", "").startswith("no_") or "except" in tags:
                continue
            member = {item.get("role"): item.get("ref") for item in relation.iter("member")}
            start, end = (roads_of.get(member.get(role), set()) for role in ("from", "to"))
            if len(start) == len(end) == 1 and start != end:
                checked += 1
                assert (next(iter(start)), next(iter(end))) not in turns, member
    assert checked >= 1


@pytest.mark.parametrize("name", [*PLACES, *further("neukolln")])
def test_real_extracts_keep_lane_counts_and_speeds(name, real_roads):
    """Of every road made from one way, as its own tags say (parsed here, independently)."""
    place = real_roads(name)
    network = place.built.network
    ways = {}
    for way in ElementTree.parse(place.extract).getroot().iter("way"):
        ways[int(way.get("id"))] = {tag.get("k"): tag.get("v") for tag in way.iter("tag")}
    counted = 0
    for road in network.roads:
        lanes = [network.lane_by_id[lane] for lane in road.lanes]
        motor = [lane for lane in lanes if {"car", "bus"} & set(lane.allowed)]
        if len(road.ways) != 1 or not motor:  # a contraflow cycle lane has no motor lane
            continue
        tags = ways[road.ways[0]]
        speed = re.fullmatch(r"(\d+)( mph)?", tags.get("maxspeed", ""))
        if speed:
            metric = float(speed[1]) * (1.609344 if speed[2] else 1.0) / 3.6
            assert motor[0].speed_limit == pytest.approx(metric, abs=0.02), road.id
            counted += 1
        if tags.get("oneway") == "yes" and tags.get("lanes", "").isdigit():
            # Turn pockets may add lanes near a junction, never take any away.
            assert len(motor) >= int(tags["lanes"]), road.id
            counted += 1
    assert counted >= 4


def test_perth_drives_on_the_left(real_roads):
    network = real_roads("perth_stretched_lights").built.network
    assert network.driving_side == "left"
    checked = 0
    for road in network.roads:
        walk = [
            network.lane_by_id[k] for k in road.lanes if network.lane_by_id[k].kind == "sidewalk"
        ]
        drive = [
            network.lane_by_id[k] for k in road.lanes if network.lane_by_id[k].kind == "driving"
        ]
        if walk and drive:
            a, b = drive[0].centre[0, :2], drive[0].centre[-1, :2]
            left = np.array([-(b - a)[1], (b - a)[0]])
            assert (walk[0].centre[0, :2] - a) @ left > 0
            checked += 1
    assert checked > 4


def test_lanes_lie_on_the_ground(write_osm, tmp_path):
    axis = np.arange(-200.0, 201.0)
    x, y = np.meshgrid(axis, axis)
    slope = Elevation(-200.0, -200.0, 1.0, 0.04 * x - 0.02 * y)
    nodes = {1: (-150, 0, {}), 2: (0, 0, {}), 3: (150, 10, {}), 4: (5, -150, {})}
    path = write_osm(
        nodes,
        {1: ([1, 2, 3], {"highway": "secondary"}), 2: ([4, 2], {"highway": "residential"})},
    )
    network = build(
        path, HERE, shapely.Point(0, 0).buffer(120), tmp_path / "n.net.xml", slope
    ).network
    for lane in network.lanes:
        np.testing.assert_allclose(lane.centre[:, 2], lane.centre[:, :2] @ [0.04, -0.02], atol=1e-3)


def test_a_bridge_clears_the_road_below_and_comes_down_gently(write_osm, tmp_path):
    nodes = {1: (-300, 0, {}), 2: (-40, 0, {}), 3: (40, 0, {}), 4: (300, 0, {})}
    nodes |= {5: (0, -200, {}), 6: (0, 200, {})}
    over = {"highway": "primary", "lanes": "2"}
    path = write_osm(
        nodes,
        {
            1: ([1, 2], over),
            2: ([2, 3], {**over, "bridge": "yes", "layer": "1"}),
            3: ([3, 4], over),
            4: ([5, 6], {"highway": "residential"}),
        },
    )
    built = build(path, HERE, shapely.Point(0, 0).buffer(180), tmp_path / "n.net.xml")
    above = [lane for lane in built.network.lanes if 2 in _ways(built.network, lane)]
    below = [lane for lane in built.network.lanes if 4 in _ways(built.network, lane)]
    assert {lane.level for lane in above} == {1}
    assert {lane.level for lane in below} == {0}
    assert max(lane.centre[:, 2].max() for lane in below) == pytest.approx(0.0, abs=1e-9)
    for lane in above:
        z = built.network.height(lane.id, [[0.0, 0.0]])
        assert z[0] > 4.7
    for lane in built.network.lanes:
        run = np.linalg.norm(np.diff(lane.centre[:, :2], axis=0), axis=1)
        rise = np.abs(np.diff(lane.centre[:, 2]))
        assert (rise[run > 1] / run[run > 1]).max(initial=0.0) < 0.09


def _ways(network, lane):
    return next((road.ways for road in network.roads if road.id == lane.road), ())


def test_saving_keeps_the_network(write_osm, tmp_path):
    nodes = {1: (-100, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (100, 30, {})}
    nodes |= {4: (0, 100, {})}
    path = write_osm(
        nodes, {1: ([1, 2, 3], {"highway": "primary"}), 2: ([4, 2], {"highway": "tertiary"})}
    )
    network = build(path, HERE, shapely.Point(0, 0).buffer(90), tmp_path / "n.net.xml").network
    network.save(tmp_path / "roads.json")
    again = RoadNetwork.load(tmp_path / "roads.json")
    assert again.roads == network.roads
    assert again.programs == network.programs
    assert again.signals == network.signals
    for a, b in zip(again.lanes, network.lanes, strict=True):
        np.testing.assert_allclose(a.centre, b.centre, atol=1e-4)
        assert (a.id, a.kind, a.successors, a.allowed) == (b.id, b.kind, b.successors, b.allowed)
    assert math.isclose(again.carriageway(0).area, network.carriageway(0).area, rel_tol=1e-4)


def test_a_region_without_streets_is_named(write_osm, tmp_path):
    path = write_osm({1: (0, 0, {}), 2: (50, 0, {})}, {1: ([1, 2], {"highway": "footway"})})
    with pytest.raises(InputError, match="no streets within the region") as caught:
        build(path, HERE, shapely.Point(0, 0).buffer(80), tmp_path / "n.net.xml")
    assert caught.value.file == str(path)


def test_the_sumo_network_has_no_date_and_no_path(write_osm, tmp_path):
    path = write_osm({1: (-50, 0, {}), 2: (50, 0, {})}, {1: ([1, 2], {"highway": "residential"})})
    texts = []
    for name in ("a.net.xml", "b.net.xml"):
        build(path, HERE, shapely.Point(0, 0).buffer(80), tmp_path / name)
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1]
    assert str(tmp_path) not in texts[0]
    assert "generated on" not in texts[0]


def test_ids_below_zero_give_the_same_roads(write_osm, tmp_path):
    """Editors give what is not uploaded yet negative ids (OSM wiki, "JOSM file format")."""
    nodes = {1: (-100, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (100, 0, {})}
    nodes |= {4: (0, -100, {}), 5: (0, 100, {}), 6: (40, 0, {"highway": "crossing"})}
    nodes |= {7: (2, 100, {})}
    ways = {
        10: ([1, 2, 6, 3], {"highway": "secondary", "lanes": "3", "turn:lanes": "left|through"}),
        11: ([4, 2], {"highway": "residential", "lanes": "1"}),
        12: ([2, 5], {"highway": "residential", "oneway": "yes", "oneway:bicycle": "no"}),
    }
    banned = {30: ([("way", 10, "from"), ("node", 2, "via"), ("way", 12, "to")],
                   {"type": "restriction", "restriction": "no_right_turn"})}  # fmt: skip
    region = shapely.box(-90, -90, 90, 90)
    found = []
    for sign in (1, -1):
        path = write_osm(
            {sign * node: row for node, row in nodes.items()},
            {sign * way: ([sign * n for n in row], tags) for way, (row, tags) in ways.items()},
            f"map{sign}.osm",
            {
                sign * k: ([(what, sign * ref, role) for what, ref, role in members], tags)
                for k, (members, tags) in banned.items()
            },
        )
        found.append(build(path, HERE, region, tmp_path / f"n{sign}.net.xml"))
    plain, signed = found
    assert {way for road in signed.network.roads for way in road.ways} == {-10, -11, -12}

    def lanes(built):
        names = {road.id: road.ways for road in built.network.roads}
        return sorted(
            (
                [abs(way) for way in names.get(lane.road, ())],
                lane.kind,
                np.round(lane.centre[[0, -1]], 2).tolist(),
                round(lane.width, 3),
                lane.allowed,
                len(lane.successors),
            )
            for lane in built.network.lanes
        )

    assert lanes(plain) == lanes(signed)
    (words,) = signed.notes["reinterpreted"]
    assert re.match(r"way -12 at 48\.70\d+, 9\.1[78]\d+: oneway:bicycle=no: ", words)


def test_streets_without_markings_have_no_lines(write_osm, tmp_path):
    nodes = {1: (-60, 0, {}), 2: (0, 0, {}), 3: (60, 0, {})}
    street = {"highway": "tertiary", "sidewalk": "left"}
    ways = {1: ([1, 2], {**street, "lane_markings": "no"})}
    ways[2] = [2, 3], {**street, "lanes": "3"}
    built = build(
        write_osm(nodes, ways), HERE, shapely.box(-50, -50, 50, 50), tmp_path / "n.net.xml"
    )
    marks = {
        road.ways[0]: {section.centre_mark for section in road.sections}
        | {lane.mark for section in road.sections for lane in section.lanes if lane.kind != "curb"}
        for road in built.model.roads
        if road.junction < 0
    }
    assert marks[1] <= {"none", "curb"}
    assert "broken" in marks[2]
