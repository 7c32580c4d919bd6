"""Tracks of trams: which way they run, what leads nowhere, where trams halt, what SUMO reads."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import shapely
import sumolib.net

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, sumo_binary
from urbantwin.roads.rails import add_rails, with_trams
from urbantwin.site import read_extract

FRAME, REGION = SiteFrame(48.7, 9.18), shapely.box(-100, -100, 100, 100)
TRAM = {"railway": "tram"}
#: A pair of tracks from west to east, both drawn eastwards, 3 m apart.
PAIR_NODES = {
    1: (-150.0, -1.5, {}),
    2: (150.0, -1.5, {}),
    3: (-150.0, 1.5, {}),
    4: (150.0, 1.5, {}),
}
CORNERS = [(-160.0, -160.0), (160.0, -160.0), (160.0, 160.0), (-160.0, 160.0)]


def tracks_of(path: Path, side: str = "right", *, closed: bool = True) -> RoadNetwork:
    empty = RoadNetwork(side, (), (), (), (), ())
    return with_trams(
        empty, read_extract(path), FRAME, REGION, Elevation.flat(), closed_loop=closed
    )


def heading_east(track) -> bool:
    return bool(track.line[-1, 0] > track.line[0, 0])


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_two_tracks_of_a_street_are_run_as_its_traffic_is(write_osm, side):
    path = write_osm(PAIR_NODES, {1: ([1, 2], TRAM), 2: ([3, 4], TRAM)})
    inner = [track for track in tracks_of(path, side).tracks if not track.outer]
    assert len(inner) == 2
    for track in inner:
        south = track.line[:, 1].mean() < 0
        assert heading_east(track) == (south == (side == "right"))


def test_what_the_map_says_of_the_direction_counts_first(write_osm):
    against = {**TRAM, "railway:preferred_direction": "backward"}
    path = write_osm(PAIR_NODES, {1: ([1, 2], against), 2: ([3, 4], TRAM)})
    inner = [track for track in tracks_of(path).tracks if not track.outer]
    southern = next(track for track in inner if track.line[:, 1].mean() < 0)
    assert not heading_east(southern)


def test_lines_tell_directions_by_the_order_of_their_ways(write_osm):
    nodes = {1: (-150.0, 0.0, {}), 2: (0.0, 0.0, {}), 3: (150.0, 0.0, {})}
    ways = {1: ([2, 1], TRAM), 2: ([2, 3], TRAM)}
    route = {1: ([("way", 1, ""), ("way", 2, "")], {"type": "route", "route": "tram"})}
    path = write_osm(nodes, ways, relations=route)
    network = tracks_of(path)
    assert all(heading_east(track) for track in network.tracks if not track.outer)


def test_a_track_by_itself_is_run_in_both_directions(write_osm):
    path = write_osm(PAIR_NODES, {1: ([1, 2], TRAM)})
    inner = [track for track in tracks_of(path).tracks if not track.outer]
    assert sorted(map(heading_east, inner)) == [False, True]


def test_a_branch_is_taken_over_its_switch_and_a_terminus_is_left_out(write_osm):
    nodes = {
        1: (-150.0, 0.0, {}),
        2: (0.0, 0.0, {}),
        3: (150.0, 0.0, {}),
        4: (60.0, 25.0, {}),
        5: (100.0, 150.0, {}),
        6: (60.0, -25.0, {}),
        # What is mapped reaches so far.
        **{20 + k: (x, y, {"natural": "tree"}) for k, (x, y) in enumerate(CORNERS)},
    }
    one_way = {**TRAM, "oneway": "yes"}
    ways = {
        1: ([1, 2], one_way),
        2: ([2, 3], one_way),
        3: ([2, 4, 5], one_way),
        4: ([2, 6], one_way),
    }
    network = tracks_of(write_osm(nodes, ways))
    inner = {track.id: track for track in network.tracks if not track.outer}
    assert len(inner) == 3
    trunk = next(track for track in inner.values() if track.line[0, 0] < -90)
    assert len([name for name in trunk.successors if name in inner]) == 2
    # Every way out leads back to the way in, around the region.
    outer = [track for track in network.tracks if track.outer]
    assert len(outer) == 2
    for track in outer:
        assert track.successors == (trunk.id,)
        assert not shapely.box(-99, -99, 99, 99).intersects(shapely.LineString(track.line))


def test_tracks_that_cross_do_not_join(write_osm):
    nodes = {
        1: (-150.0, 0.0, {}),
        2: (0.0, 0.0, {}),
        3: (150.0, 0.0, {}),
        4: (0.0, -150.0, {}),
        5: (0.0, 150.0, {}),
    }
    one_way = {**TRAM, "oneway": "yes"}
    network = tracks_of(write_osm(nodes, {1: ([1, 2, 3], one_way), 2: ([4, 2, 5], one_way)}))
    inner = {track.id: track for track in network.tracks if not track.outer}
    for track in inner.values():
        for name in track.successors:
            if name in inner:
                a, b = np.diff(track.line, axis=0)[-1], np.diff(inner[name].line, axis=0)[0]
                assert a @ b > 0.99 * np.linalg.norm(a) * np.linalg.norm(b)


def test_trams_halt_with_their_middle_where_the_stop_is(write_osm):
    nodes = {**PAIR_NODES, 9: (20.0, -1.5, {"railway": "tram_stop", "name": "Middle"})}
    path = write_osm(nodes, {1: ([1, 9, 2], TRAM), 2: ([3, 4], TRAM)})
    network = tracks_of(path)
    (stop,) = network.tram_stops
    assert stop.name == "Middle"
    track = next(x for x in network.tracks if f"{x.id}_0" == stop.lane)
    front = shapely.LineString(track.line).interpolate(stop.end_m)
    assert (front.x, front.y) == pytest.approx((35.0, -1.5), abs=0.3)
    assert heading_east(track)


def test_tunnels_sidings_and_other_railways_carry_no_trams(write_osm):
    ways = {
        1: ([1, 2], {**TRAM, "tunnel": "yes"}),
        2: ([3, 4], {**TRAM, "service": "yard"}),
        3: ([1, 4], {"railway": "rail"}),
    }
    assert not tracks_of(write_osm(PAIR_NODES, ways)).tracks


def test_sumo_drives_a_tram_over_the_tracks_again_and_again(write_osm, tmp_path):
    """SUMO's own reader and simulation take the network with the rails in it."""
    path = write_osm(PAIR_NODES, {1: ([1, 2], TRAM), 2: ([3, 4], TRAM)})
    network = tracks_of(path)
    plain = tmp_path / "street"
    (tmp_path / "s.nod.xml").write_text(
        '<nodes><node id="a" x="0" y="50"/><node id="b" x="90" y="50"/></nodes>'
    )
    (tmp_path / "s.edg.xml").write_text('<edges><edge id="ab" from="a" to="b"/></edges>')
    net = plain.with_suffix(".net.xml")
    subprocess.run(
        [sumo_binary("netconvert"), "-n", tmp_path / "s.nod.xml", "-e", tmp_path / "s.edg.xml",
         "-o", net], check=True, capture_output=True,
    )  # fmt: skip
    add_rails(net, network.tracks)
    read = sumolib.net.readNet(str(net))
    by_id = {track.id: track for track in network.tracks}
    for name, track in by_id.items():
        edge = read.getEdge(name)
        assert edge.allows("tram")
        assert not edge.allows("passenger")
        assert {x.getID() for x in edge.getOutgoing()} == set(track.successors)
    start = next(track for track in network.tracks if not track.outer)
    edges = [start.id]
    for _ in range(7):
        edges.append(by_id[edges[-1]].successors[0])
    (tmp_path / "t.rou.xml").write_text(
        '<routes><vType id="t" vClass="tram" length="30"/><vehicle id="0" type="t" depart="0">'
        f'<route edges="{" ".join(edges)}"/></vehicle></routes>'
    )
    out = tmp_path / "trips.xml"
    subprocess.run(
        [sumo_binary("sumo"), "-n", net, "-r", tmp_path / "t.rou.xml", "--tripinfo-output", out,
         "--xml-validation", "never"], check=True, capture_output=True,
    )  # fmt: skip
    length = sum(float(read.getEdge(name).getLength()) for name in edges)
    trip = out.read_text()
    driven = float(trip.split('routeLength="')[1].split('"')[0])
    assert driven == pytest.approx(length, abs=31.0)
