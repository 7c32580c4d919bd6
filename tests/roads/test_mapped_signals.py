"""Which junctions get signals, drawn by hand from the words of the OSM wiki."""

import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)
SIGNAL = {"highway": "traffic_signals"}
CROSSING = {"highway": "crossing", "crossing": "traffic_signals"}
FORWARD, BACKWARD = ({**SIGNAL, "traffic_signals:direction": d} for d in ("forward", "backward"))
STREET = {"highway": "secondary"}


def built(path, tmp_path):
    return build_roads(
        read_extract(path),
        HERE,
        shapely.box(-190, -190, 190, 190),
        Elevation.flat(),
        driving_side="right",
        out=tmp_path / "n.net.xml",
    )


def cross(west=None, east=None, south=None, north=None, *, west_m=15, middle=None):
    """Two streets of two ways each, with something mapped on each arm."""
    nodes = {0: (0, 0, middle or {})}
    nodes |= {1: (-150, 0, {}), 2: (150, 0, {}), 3: (0, -150, {}), 4: (0, 150, {})}
    nodes |= {11: (-west_m, 0, west or {}), 12: (15, 0, east or {})}
    nodes |= {13: (0, -15, south or {}), 14: (0, 15, north or {})}
    ways = {1: ([1, 11, 0, 12, 2], STREET), 2: ([3, 13, 0, 14, 4], STREET)}
    return nodes, ways


@pytest.mark.parametrize(
    ("mapped", "expected"),
    [
        ({"middle": SIGNAL}, True),
        ({"west": SIGNAL, "east": SIGNAL, "south": SIGNAL, "north": SIGNAL}, True),
        ({"west": SIGNAL}, True),  # half mapped: no crossing that it could be there for
        ({"west": FORWARD}, True),
        ({"west": BACKWARD}, False),  # faces traffic that leaves the junction
        ({"west": SIGNAL, "west_m": 60}, False),
        ({"west": CROSSING, "east": CROSSING}, True),
        ({"west": {**SIGNAL, "crossing": "marked"}, "south": SIGNAL}, True),
        ({}, False),
    ],
)
def test_a_signal_belongs_to_the_junction_that_it_stands_before(
    mapped, expected, write_osm, tmp_path
):
    found = built(write_osm(*cross(**mapped)), tmp_path)
    signalised = [j for j in found.network.junctions if j.kind == "traffic_light"]
    assert bool(signalised) == expected
    assert len(found.network.programs) == expected
    assert found.notes["signalised_crossings_left_out"] == 0
    if signalised:
        assert shapely.Point(0, 0).within(signalised[0].polygon)


@pytest.mark.parametrize("mapped", [CROSSING, {**SIGNAL, "crossing": "marked"}])
def test_lights_of_a_crossing_near_a_junction_are_the_crossings_own(mapped, write_osm, tmp_path):
    found = built(write_osm(*cross(west=mapped)), tmp_path)
    (junction,) = (j for j in found.network.junctions if j.kind == "traffic_light")
    assert junction.polygon.distance(shapely.Point(-15, 0)) < 0.1
    assert not shapely.Point(0, 0).within(junction.polygon)
    (crossing,) = (lane for lane in found.network.lanes if lane.kind == "crossing")
    assert shapely.LineString(crossing.centre[:, :2]).distance(shapely.Point(-15, 0)) < 0.5


def test_lights_of_a_crossing_stop_all_who_come_to_a_junction_over_it(write_osm, tmp_path):
    """A lane leaves a one-way street 5 m behind the crossing."""
    nodes = {1: (-150, 0, {}), 2: (-5, 0, CROSSING), 3: (0, 0, {}), 4: (150, 0, {})}
    nodes[5] = (0, 150, {})
    one_way = {"highway": "secondary", "oneway": "yes", "lanes": "2", "sidewalk": "both"}
    ways = {1: [1, 2, 3, 4], 2: [3, 5]}
    found = built(write_osm(nodes, {k: (refs, one_way) for k, refs in ways.items()}), tmp_path)
    (crossing,) = (lane for lane in found.network.lanes if lane.kind == "crossing")
    (program,) = found.network.programs
    links = {head.lane: head.links for head in found.network.signals}
    vehicles = [k for lane, mine in links.items() if lane != crossing.id for k in mine]
    assert len(vehicles) >= 2
    walking = [state for _, state in program.phases if state[links[crossing.id][0]] in "Gg"]
    assert walking
    assert all(state[k] == "r" for state in walking for k in vehicles)


def test_a_crossing_between_junctions_has_signals_of_its_own(write_osm, tmp_path):
    """60 m before the junction; the street has sidewalks, so that people come to it."""
    nodes, ways = cross(west=CROSSING, west_m=60)
    ways = {k: (refs, {**tags, "sidewalk": "both"}) for k, (refs, tags) in ways.items()}
    found = built(write_osm(nodes, ways), tmp_path)
    assert found.notes["signalised_crossings_between_junctions"] == 1
    (program,) = found.network.programs
    (junction,) = (j for j in found.network.junctions if j.kind == "traffic_light")
    assert junction.polygon.distance(shapely.Point(-60, 0)) < 0.1
    lanes = [found.network.lane_by_id[head.lane] for head in found.network.signals]
    (crossing,) = (lane for lane in lanes if lane.kind == "crossing")
    assert shapely.LineString(crossing.centre[:, :2]).distance(shapely.Point(-60, 0)) < 3
    links = {head.lane: head.links for head in found.network.signals}
    vehicles = {k for lane, found_ in links.items() if lane != crossing.id for k in found_}
    walking = [s for s in program.phases if s[1][links[crossing.id][0]] in "Gg"]
    assert walking
    for _, state in walking:
        assert all(state[k] == "r" for k in vehicles)


def test_stop_lines_of_a_wide_junction_make_one_program(write_osm, tmp_path):
    """Two carriageways cross two: signals stand at stop lines only, 25 m before."""
    nodes, ways = {}, {}
    for k, (y, way) in enumerate(((-6, 1), (6, -1))):  # eastward below, westward above
        a = 10 * k
        nodes |= {a: (-150 * way, y, {}), a + 1: (-31 * way, y, SIGNAL), a + 2: (150 * way, y, {})}
    for k, (x, way) in enumerate(((6, 1), (-6, -1))):  # northward right, southward left
        a = 100 + 10 * k
        nodes |= {a: (x, -150 * way, {}), a + 1: (x, -31 * way, SIGNAL), a + 2: (x, 150 * way, {})}
    nodes |= {50: (-6, -6, {}), 51: (6, -6, {}), 52: (6, 6, {}), 53: (-6, 6, {})}
    one_way = {"highway": "primary", "oneway": "yes", "lanes": "2"}
    ways = {
        1: ([0, 1, 50, 51, 2], one_way),
        2: ([10, 11, 52, 53, 12], one_way),
        3: ([100, 101, 51, 52, 102], one_way),
        4: ([110, 111, 53, 50, 112], one_way),
    }
    network = built(write_osm(nodes, ways), tmp_path).network
    assert len(network.programs) == 1
    heads = {signal.lane.rsplit("_", 1)[0] for signal in network.signals}
    entering = {
        road.id
        for road in network.roads
        if min(abs(network.lane_by_id[road.lanes[-1]].centre[0, :2]).max(), 200) > 140
        and abs(network.lane_by_id[road.lanes[-1]].centre[-1, :2]).max() < 60
    }
    assert len(entering) == 4
    assert entering <= heads


def test_traffic_stops_long_enough_to_cross_where_no_sidewalk_is_mapped(write_osm, tmp_path):
    nodes, ways = cross(west=CROSSING, west_m=60)
    ways = {k: (refs, {**tags, "sidewalk": "no"}) for k, (refs, tags) in ways.items()}
    network = built(write_osm(nodes, ways), tmp_path).network
    (program,) = network.programs
    driven = [
        link
        for head in network.signals
        if network.lane_by_id[head.lane].kind == "driving"
        for link in head.links
    ]
    assert driven
    red = sum(s for s, state in program.phases if all(state[k] == "r" for k in driven))
    assert red >= 10
    assert 60 <= sum(seconds for seconds, _ in program.phases) <= 120
