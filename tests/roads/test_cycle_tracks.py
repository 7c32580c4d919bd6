"""Cycle tracks that a sketch draws: lanes, signals, ends and traffic of their own."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib.net

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.assignment.circuit import Circuit
from urbantwin.roads.assignment.routing_graph import driven_graph
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.roads.signals.controlled_links import signalised_junctions
from urbantwin.site.sketch import read_sketch

from ..thorough import further
from .test_drawn_turns import feature, mirrored, written

FRAME = SiteFrame(52.5, 13.4)
TRACK = {"class": "cycle_track"}


def crossed_street():
    """Return a street from west to east with signals in the middle, and a track from the south."""
    both = {"lanes_back": 1}
    return [
        feature("street", [(-90, 0), (-12, 0)], name="west", **both),
        feature("street", [(12, 0), (90, 0)], name="east", **both),
        feature("turn", [(-12, -1.6), (12, -1.6)]),
        feature("turn", [(12, 1.6), (-12, 1.6)]),
        feature("street", [(0, -90), (0, -12)], name="south track", **both, **TRACK),
        feature("street", [(0, 12), (0, 90)], name="north track", **both, **TRACK),
        feature("turn", [(0.8, -12), (0.8, 0), (0.8, 12)], **TRACK),
        feature("turn", [(-0.8, 12), (-0.8, 0), (-0.8, -12)], **TRACK),
        {
            "type": "Feature",
            "properties": {"kind": "junction", "signals": True},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[(-20, -20), (20, -20), (20, 20), (-20, 20), (-20, -20)]],
            },
        },
    ]


def built(folder, drawn, side="right", *, closed=True):
    return build_roads(
        read_sketch(written(folder, drawn), FRAME),
        FRAME,
        shapely.Point(0, 0).buffer(60),
        Elevation.flat(),
        driving_side=side,
        out=folder / "n.net.xml",
        closed_loop=closed,
    )


def outer_edges(net):
    """Return the ids of edges that lie beyond the region."""
    found = set()
    for edge in net.getEdges(withInternal=False):
        middle = np.mean(np.array(edge.getShape())[:, :2], axis=0)
        if np.hypot(*middle) > 62.0:
            found.add(edge.getID())
    return found


@pytest.mark.parametrize("side", ["right", "left"])
def test_bicycles_have_a_way_across_and_nobody_else(tmp_path, side):
    """SUMO's own reading: from the south track to the north one and back, never onto the street."""
    drawn = crossed_street()
    drawn[:-1] = drawn[:-1] if side == "right" else mirrored(drawn[:-1])
    built(tmp_path, drawn, side)
    net = sumolib.net.readNet(str(tmp_path / "n.net.xml"), withInternal=True)
    tracks = [e for e in net.getEdges(withInternal=False) if "track" in e.getName()]
    assert len(tracks) == 4
    for edge in tracks:
        assert edge.allows("bicycle")
        assert not any(edge.allows(name) for name in ("passenger", "bus", "pedestrian"))
        (lane,) = edge.getLanes()
        assert 1.0 <= lane.getWidth() <= 2.5
    into = [e for e in tracks if e.getToNode().getType() == "traffic_light"]
    ends = {e.getName(): {o.getName() for o in e.getOutgoing()} for e in into}
    assert ends == {"south track": {"north track"}, "north track": {"south track"}}


def test_those_who_leave_by_a_track_come_back_by_it(tmp_path):
    """Without a way from street to track: both have circuits, and no passage leads over."""
    built(tmp_path, crossed_street())
    net = sumolib.net.readNet(str(tmp_path / "n.net.xml"))
    network = StreetNetwork(tmp_path / "n.net.xml", None)
    graph = driven_graph(network, "bicycle", outer_edges(net))
    circuit = Circuit.of(graph)
    is_track = np.array([net.getEdge(e).getType() == "highway.cycleway" for e in graph.edges])
    assert set(is_track[circuit.starts]) == {True, False}
    random = np.random.default_rng(1)
    for start in circuit.starts:
        state = int(start)
        for _ in range(20):
            way = circuit.passage(state, random)
            assert {bool(is_track[k]) for k in way} == {bool(is_track[start])}
            state = way[-1]
    cars = driven_graph(network, "passenger", outer_edges(net))
    assert not {net.getEdge(e).getType() for e in cars.edges} & {"highway.cycleway"}


def test_a_track_has_green_and_never_with_those_whom_it_crosses(tmp_path):
    """Every link of the tracks gets green; the street's ways straight on are red meanwhile."""
    built(tmp_path, crossed_street())
    root = ElementTree.parse(tmp_path / "n.net.xml").getroot()
    (junction,) = signalised_junctions(root)
    track = {link.index for link in junction.links if "track" in link.street}
    street = {link.index for link in junction.links} - track
    assert len(track) == 2
    states = [state for _, state in junction.phases]
    green = [{k for k, letter in enumerate(state) if letter in "gG"} for state in states]
    for k in track:
        assert any(k in on for on in green)
    assert not any(on & track and on & street for on in green)


def test_opendrive_has_lanes_for_biking(tmp_path):
    """The roads of a track have lanes of the type biking and no others for traffic."""
    roads = built(tmp_path, crossed_street(), closed=False)
    path = tmp_path / "m.xodr"
    write_opendrive(roads.model, FRAME, path, name="m")
    root = ElementTree.parse(path).getroot()
    found = [r for r in root.iter("road") if "track" in r.get("name", "")]
    assert len(found) == 2
    for road in found:
        kinds = [lane.get("type") for lane in road.iter("lane") if lane.get("id") != "0"]
        assert kinds.count("biking") == 2
        assert not {"driving", "bus", "sidewalk"} & set(kinds)


@pytest.mark.thorough
@pytest.mark.parametrize("version", ["1.4", *further("1.8")])
def test_asams_checker_reports_no_issue(tmp_path, judge, version):
    """Roads of biking lanes alone, and ways through a junction for them."""
    roads = built(tmp_path, crossed_street())
    write_opendrive(roads.model, FRAME, tmp_path / "n.xodr", version=version, name="n")
    (found,) = judge("asam_and_carla", f"check={tmp_path / 'n.xodr'}").values()
    assert found["issues"] == []


def test_a_track_that_crosses_a_street_meets_it(tmp_path):
    """Drawn as a street across another: bicycles may turn from one onto the other."""
    drawn = [
        feature("street", [(-90, 0), (90, 0)], name="street", lanes_back=1),
        feature("street", [(0, -90), (0, 90)], name="track", lanes_back=1, **TRACK),
    ]
    built(tmp_path, drawn)
    net = sumolib.net.readNet(str(tmp_path / "n.net.xml"))
    graph = driven_graph(StreetNetwork(tmp_path / "n.net.xml", None), "bicycle", outer_edges(net))
    circuit = Circuit.of(graph)
    names = {net.getEdge(graph.edges[k]).getName() for k in circuit.starts}
    into = [e for e in net.getEdges() if e.getName() == "street" and len(e.getOutgoing()) > 2]
    assert into
    for edge in into:
        assert "track" in {o.getName() for o in edge.getAllowedOutgoing("bicycle")}
        assert "track" not in {o.getName() for o in edge.getAllowedOutgoing("passenger")}
    assert names == {""}
    assert len(circuit.gates) == 4


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [({"lane_width_m": 0.5}, "1 to 8 m"), ({"sidewalk": "right"}, "cycle track")],
)
def test_what_no_track_has_is_told(tmp_path, wrong, expected):
    """Lanes of half a metre, a sidewalk."""
    drawn = [feature("street", [(0, -90), (0, 90)], **TRACK, **wrong)]
    with pytest.raises(InputError, match=expected):
        read_sketch(written(tmp_path, drawn), FRAME)


def test_who_turns_off_a_street_has_green_with_the_track_beside(tmp_path):
    """As with people who cross: right turns and the track go together, the side street does not."""
    both = {"lanes_back": 1}
    drawn = [
        feature("street", [(-90, 0), (-14, 0)], name="west", **both),
        feature("street", [(14, 0), (90, 0)], name="east", **both),
        feature("street", [(0, -90), (0, -16)], name="south", **both),
        feature("turn", [(-14, -1.6), (14, -1.6)]),
        feature("turn", [(14, 1.6), (-14, 1.6)]),
        feature("turn", [(-14, -1.6), (-1.6, -16)]),
        feature("turn", [(1.6, -16), (-14, 1.6)]),
        feature("street", [(-90, -10), (-14, -10)], name="west track", **both, **TRACK),
        feature("street", [(14, -10), (90, -10)], name="east track", **both, **TRACK),
        feature("turn", [(-14, -10.8), (0, -10.8), (14, -10.8)], **TRACK),
        feature("turn", [(14, -9.2), (0, -9.2), (-14, -9.2)], **TRACK),
        crossed_street()[-1],
    ]
    built(tmp_path, drawn)
    (junction,) = signalised_junctions(ElementTree.parse(tmp_path / "n.net.xml").getroot())
    green = [{k for k, letter in enumerate(s) if letter in "gG"} for _, s in junction.phases]
    track = {link.index for link in junction.links if "track" in link.street}
    side = {link.index for link in junction.links if link.street == "south"}
    right = {
        link.index for link in junction.links if link.street == "west" and link.movement == "right"
    }
    assert len(track) == 2
    assert right
    assert side
    assert any(track <= on and right <= on for on in green)
    assert not any(on & track and on & side for on in green)
