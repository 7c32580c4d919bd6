"""Assumed signal programs, judged by sumolib's table of conflicts and by SUMO's own traffic."""

import math
import subprocess
from itertools import combinations, product
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, sumo_binary, sumo_environment
from urbantwin.roads.signals import heads_of
from urbantwin.roads.signals.capacity import capped, cycle_s, green_seconds
from urbantwin.roads.signals.default_programs import set_default_programs
from urbantwin.scene.signal_pole import signal_mesh
from urbantwin.site import read_extract

from ..thorough import further
from .controllers import signalised_junctions

HERE = SiteFrame(48.7, 9.18)
SIGNAL = {"highway": "traffic_signals"}
SIDE = {"highway": "secondary", "lanes": "2", "maxspeed": "50", "sidewalk": "both"}
WIDE = {"highway": "primary", "lanes": "4", "maxspeed": "50", "sidewalk": "both"}
ONE_WAY = {"highway": "primary", "oneway": "yes", "lanes": "2", "maxspeed": "50"}


def cross(lanes=4):
    """Streets of two lanes and of more."""
    nodes = {1: (-150, 0, {}), 2: (0, 0, SIGNAL), 3: (150, 0, {})}
    nodes |= {4: (0, -150, {}), 5: (0, 150, {})}
    return nodes, {10: ([1, 2, 3], {**WIDE, "lanes": str(lanes)}), 11: ([4, 2, 5], SIDE)}


def tee():
    nodes = {1: (-150, 0, {}), 2: (0, 0, SIGNAL), 3: (150, 0, {}), 4: (0, -150, {})}
    return nodes, {10: ([1, 2, 3], SIDE), 11: ([4, 2], SIDE)}


def turn_lanes():
    """Four lanes each way and one more before the junction, to turn left from."""
    nodes, ways = {2: (0, 0, SIGNAL)}, {}
    for k, (x, y) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
        nodes |= {10 + k: (150 * x, 150 * y, {}), 20 + k: (60 * x, 60 * y, {})}
        turns = "left|through|through;right"
        tags = {**WIDE, "lanes": "5", "lanes:forward": "3", "lanes:backward": "2"}
        ways[30 + k] = ([10 + k, 20 + k], WIDE)
        ways[40 + k] = ([20 + k, 2], {**tags, "turn:lanes:forward": turns})
    return nodes, ways


def carriageways(gap=20):
    """Two streets of two carriageways each: four nodes, some metres between them."""
    h = gap / 2
    nodes = {50: (-h, -h, SIGNAL), 51: (h, -h, SIGNAL), 52: (h, h, SIGNAL), 53: (-h, h, SIGNAL)}
    nodes |= {0: (-150, -h, {}), 2: (150, -h, {}), 10: (150, h, {}), 12: (-150, h, {})}
    nodes |= {100: (h, -150, {}), 102: (h, 150, {}), 110: (-h, 150, {}), 112: (-h, -150, {})}
    return nodes, {
        1: ([0, 50, 51, 2], ONE_WAY),
        2: ([10, 52, 53, 12], ONE_WAY),
        3: ([100, 51, 52, 102], ONE_WAY),
        4: ([110, 53, 50, 112], ONE_WAY),
    }


def staggered():
    """Two junctions 70 m apart on one street."""
    nodes = {1: (-150, 0, {}), 2: (-35, 0, SIGNAL), 3: (35, 0, SIGNAL), 4: (150, 0, {})}
    nodes |= {5: (-35, 150, {}), 6: (35, -150, {}), 7: (-35, -150, {}), 8: (35, 150, {})}
    return nodes, {10: ([1, 2, 3, 4], WIDE), 11: ([5, 2, 7], SIDE), 12: ([6, 3, 8], SIDE)}


PLACES = {f.__name__: f for f in (cross, tee, turn_lanes, carriageways, staggered)}


BUILT: dict = {}  # networks are made once: tests only read them


@pytest.fixture
def built(write_osm, tmp_path):
    def run(nodes, ways, side="right"):
        key = repr((nodes, ways, side))
        if key not in BUILT:
            out = BUILT[key] = tmp_path / f"{len(BUILT)}.net.xml"
            region = shapely.box(-140, -140, 140, 140)
            extract = read_extract(write_osm(nodes, ways))
            build_roads(extract, HERE, region, Elevation.flat(), driving_side=side, out=out)
        return BUILT[key]

    return run


def programs(path):
    """Program -> its phases and, by sumolib, its links and the table of conflicts of each node."""
    net = sumolib.net.readNet(str(path), withPrograms=True, withPedestrianConnections=True)
    links = {light.getID(): {} for light in net.getTrafficLights()}
    for edge in net.getEdges(withInternal=True):
        for lane in edge.getLanes():
            for item in lane.getOutgoing():
                if item.getTLSID():
                    links[item.getTLSID()].setdefault(item.getTLLinkIndex(), []).append(item)
    for light in net.getTrafficLights():
        (program,) = light.getPrograms().values()
        phases = [(float(phase.duration), phase.state) for phase in program.getPhases()]
        yield phases, links[light.getID()]


def node_and_row(item):
    start = item.getFrom()
    on_foot = start.getID().startswith(":")
    node = start.getFromNode() if on_foot else start.getToNode()
    return node, node.getLinkIndex(item)


def check(path):
    """Check what holds of every program; return how many pairs of conflicting links there were."""
    conflicts = 0
    for phases, links in programs(path):
        assert 60 <= sum(seconds for seconds, _ in phases) <= 120
        assert all(any(state[k] in "Gg" for _, state in phases) for k in links)
        for k, items in links.items():
            vehicles = not items[0].getFrom().getID().startswith(":")
            for (_, before), (_, after) in zip(phases, phases[1:] + phases[:1], strict=True):
                assert not (vehicles and before[k] in "Gg" and after[k] == "r"), "no yellow"
        for i, j in combinations(sorted(links), 2):
            for a, b in product(links[i], links[j]):
                (node, row), (other, at) = node_and_row(a), node_and_row(b)
                if node is not other or row < 0 or at < 0 or a.getFrom() is b.getFrom():
                    continue
                if not node.areFoes(row, at):
                    continue
                conflicts += 1
                assert not any(state[i] == state[j] == "G" for _, state in phases), (i, j)
    return conflicts


def simulated(path, tmp_path, *, seconds=600, seed=1, per_hour=200, routes=None):
    """What SUMO's statistics say of traffic from every way in to every way out."""
    net = sumolib.net.readNet(str(path))
    cars = [edge for edge in net.getEdges() if edge.allows("passenger")]
    ends = {node for edge in cars for node in (edge.getFromNode(), edge.getToNode())}
    ends = {node for node in ends if max(map(abs, node.getCoord())) > 130}
    starts = [edge for edge in cars if edge.getFromNode() in ends]
    goals = [edge for edge in cars if edge.getToNode() in ends]
    rows = []
    for a, b in product(starts, goals):
        way, _ = net.getShortestPath(a, b, vClass="passenger")
        back = math.dist(a.getFromNode().getCoord(), b.getToNode().getCoord()) < 60
        if way and not back and (not routes or routes(a, b)):
            rows.append([edge.getID() for edge in way])
    flows = ElementTree.Element("routes")
    for k, row in enumerate(rows):
        lanes = sum(lane.allows("passenger") for lane in net.getEdge(row[0]).getLanes())
        share = per_hour * lanes / sum(other[0] == row[0] for other in rows)
        flow = ElementTree.SubElement(
            flows, "flow", id=f"{k}", begin="0", end=f"{seconds}", departLane="best",
            vehsPerHour=f"{share:.1f}",
        )  # fmt: skip
        ElementTree.SubElement(flow, "route", edges=" ".join(row))
    ElementTree.ElementTree(flows).write(tmp_path / "r.rou.xml")
    command = [
        sumo_binary("sumo"), "-n", path, "-r", tmp_path / "r.rou.xml", "--end", f"{seconds + 200}",
        "--seed", str(seed), "--statistic-output", tmp_path / "s.xml", "--no-step-log", "true",
        "--collision.check-junctions", "true", "--collision.action", "warn",
        "--tripinfo-output", tmp_path / "t.xml", "--duration-log.statistics", "true",
        "--xml-validation", "never", "--no-warnings", "true",
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, env=sumo_environment())
    told = ElementTree.parse(tmp_path / "s.xml").getroot()
    trips = ElementTree.parse(tmp_path / "t.xml").getroot().findall("tripinfo")
    asked = sum(float(flow.get("vehsPerHour")) for flow in flows) * seconds / 3600
    return told, trips, asked


@pytest.mark.parametrize(
    ("name", "side"),
    [
        *((name, "right") for name in PLACES),
        ("turn_lanes", "left"),
        *further(*((name, "left") for name in PLACES if name != "turn_lanes")),
    ],
)
def test_no_conflicting_greens_and_green_for_everybody(name, side, built):
    nodes, ways = PLACES[name]()
    if side == "left":  # seen in a mirror, streets are driven on the other side
        nodes = {key: (-x, y, tags) for key, (x, y, tags) in nodes.items()}
        turns = {"turn:lanes:forward": "left;through|through|right"}
        ways = {k: (refs, tags | (turns if turns.keys() & tags else {}))
                for k, (refs, tags) in ways.items()}  # fmt: skip
    assert check(built(nodes, ways, side)) > 5


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
@pytest.mark.parametrize("name", PLACES)
def test_traffic_gets_through(name, seed, built, tmp_path):
    told, _, asked = simulated(built(*PLACES[name]()), tmp_path, seed=seed)
    assert told.find("teleports").get("total") == "0"
    assert told.find("safety").get("collisions") == "0"
    done = int(told.find("vehicleTripStatistics").get("count"))
    assert asked >= 100
    assert done >= 0.95 * asked


def test_left_turns_over_two_lanes_have_a_stage_of_their_own(built):
    ((phases, links),) = programs(built(*turn_lanes()))
    lefts = [k for k, items in links.items() if items[0].getDirection() == "l"]
    assert len(lefts) == 4
    for left in lefts:
        street = links[left][0].getFrom()
        assert any(
            state[left] == "G"
            and all(
                state[k] in "ry"
                for k, items in links.items()
                if items[0].getDirection() == "s" and items[0].getFrom() is not street
            )
            for _, state in phases
        )


def test_traffic_extends_greens_within_the_longest_cycle(built):
    for phases, least, most in lasting(built(*turn_lanes())):
        assert all(
            low <= usual <= high for (usual, _), low, high in zip(phases, least, most, strict=True)
        )
        assert any(low < high for low, high in zip(least, most, strict=True))
        assert sum(most) <= 120
        for (_, state), low, high in zip(phases, least, most, strict=True):
            assert low == high or not set(state) & set("y"), "yellow has its own time"


def lasting(path):
    """Phases of each program, and how long each lasts at the least and at the most."""
    for logic in ElementTree.parse(path).iter("tlLogic"):
        assert logic.get("type") == "actuated"
        rows = logic.findall("phase")
        usual = [float(row.get("duration")) for row in rows]
        ends = [
            [float(row.get(key, second)) for row, second in zip(rows, usual, strict=True)]
            for key in ("minDur", "maxDur")
        ]
        yield list(zip(usual, (row.get("state") for row in rows), strict=True)), *ends


def test_the_time_to_clear_grows_with_the_junction(built):
    """Who crosses ten lanes of 3 m at 50 km/h needs over 2 s, two lanes less than 1 s."""

    def cleared(path):
        """Shortest time from the end of yellow on the side street to green on the other."""
        ((phases, links),) = programs(path)
        straight = {True: set(), False: set()}
        for k, items in links.items():
            if items[0].getDirection() == "s" and not items[0].getFrom().getID().startswith(":"):
                shape = items[0].getFrom().getShape()
                straight[abs(shape[0][1]) > 50].add(k)
        seconds = [state for length, state in phases for _ in range(round(length))] * 2
        gaps = []
        for side, main in product(straight[True], straight[False]):
            for start in range(1, len(seconds) // 2):
                if seconds[start - 1][side] == "y" and seconds[start][side] == "r":
                    rest = (t for t in range(start, len(seconds)) if seconds[t][main] in "Gg")
                    gaps.append(next(rest) - start)
        return min(gaps)

    assert 1 <= cleared(built(*cross(2))) < cleared(built(*cross(10)))


def test_who_can_only_turn_over_crossings_has_time_when_people_are_over(built):
    """Where many walk nobody would leave the side street else. People walk 1.2 m/s."""
    nodes, ways = tee()
    crossing = {"highway": "crossing", "crossing": "traffic_signals"}
    nodes |= {6: (-12, 0, crossing), 7: (12, 0, crossing)}
    ways[10] = ([1, 6, 2, 7, 3], SIDE)
    ((phases, links),) = programs(built(nodes, ways))
    seconds = [state for length, state in phases for _ in range(round(length))] * 2
    walks = {k: max(item.getTo().getLength() for item in items) for k, items in links.items()
             if items[0].getFrom().getID().startswith(":")}  # fmt: skip
    side = [k for k, items in links.items() if k not in walks
            and abs(items[0].getFrom().getShape()[0][1]) > 50]  # fmt: skip
    assert side
    assert walks
    for link in side:
        free, busy_until = 0, 0
        for t, state in enumerate(seconds):
            for k, metres in walks.items():
                if state[k] == "G" and state[link] in "Gg":
                    busy_until = max(busy_until, t + 1 + metres / 1.2)
            free += state[link] in "Gg" and t >= busy_until
        print("FREE", link, free, phases, walks)
        assert free >= 2 * 5, (link, free, phases, walks, side)


@given(st.lists(st.floats(0.0, 0.5), min_size=2, max_size=6), st.data())
def test_green_is_shared_out_to_the_second_and_nobody_gets_too_little(ratios, data):
    least = data.draw(st.lists(st.integers(5, 30), min_size=len(ratios), max_size=len(ratios)))
    whole = sum(least) + data.draw(st.integers(0, 60))
    found = green_seconds(ratios, least, whole)
    assert sum(found) == whole
    assert all(seconds >= low for seconds, low in zip(found, least, strict=True))
    assert all(seconds == int(seconds) for seconds in found)


def test_the_cycle_is_webster_s():
    """(1.5 L + 5) / (1 - Y) = (18 + 5) / 0.3 = 76.7 s, in steps of 5 s."""
    assert cycle_s([0.4, 0.3], 12.0, 40.0) == 80.0
    assert cycle_s([0.1, 0.1], 10.0, 30.0) == 60.0
    assert cycle_s([0.5, 0.6], 20.0, 70.0) == 120.0


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=6))
def test_who_asks_for_more_than_there_is_has_what_others_leave(ratios):
    found = capped(ratios)
    far = [has for asked, has in zip(ratios, found, strict=True) if asked > 0.9]
    rest = sum(asked for asked in ratios if asked <= 0.9)
    assert [has for asked, has in zip(ratios, found, strict=True) if asked <= 0.9] == [
        asked for asked in ratios if asked <= 0.9
    ]
    assert len(set(far)) <= 1
    assert all(has >= 0.9 / len(ratios) for has in far)
    if far and min(far) > 0.9 / len(ratios) + 1e-9:
        assert sum(far) + rest == pytest.approx(0.9)


def test_a_street_far_above_capacity_leaves_the_other_what_it_needs(built):
    """2,200 an hour on a lane, 300 on the other street: of 120 s that needs 20 s and a bit."""
    path = built(*cross(lanes=2))
    net = sumolib.net.readNet(str(path))
    ways = [(a, b) for a in net.getEdges() for b in a.getOutgoing() if len(a.getOutgoing()) > 1]
    across = {a.getID() for a, _ in ways if abs(a.getShape()[0][0]) > abs(a.getShape()[0][1])}
    ways = [(a, b) for a, b in ways if a.getOutgoing()[b][0].getDirection() == "s"]
    volumes = {(a.getID(), b.getID(), ""): 300.0 for a, b in ways}
    fullest = min(volumes.keys() - {way for way in volumes if way[0] in across})
    set_default_programs(path, flows={**volumes, fullest: 2200.0}, fixed=True)
    ((phases, links),) = programs(path)
    for way in volumes:
        (link,) = [
            k for k, items in links.items()
            if (items[0].getFrom().getID(), items[0].getTo().getID()) == way[:2]
        ]  # fmt: skip
        green = sum(seconds for seconds, state in phases if state[link] in "Gg")
        if way[0] in across:
            assert 300 / 0.9 / 1800 < green / 120 < 300 / 0.7 / 1800
        else:
            assert green > 60


@pytest.mark.parametrize(
    "name",
    ["manchester-kingsway", "taipei", *further("london-borough", "higashimurayama", "chennai")],
)
def test_real_junctions_have_sound_programs_and_a_place_for_every_head(name, real_roads):
    place = real_roads(name)
    built = place.built
    assert check(place.net) > 10
    assert signalised_junctions(place.net) >= 1
    heads = [head for head in heads_of(built.model) if head.signal.dynamic]
    seen = {(h.signal.program, link) for h in heads for link in h.signal.links}
    assert seen == {(s.program, link) for s in built.network.signals for link in s.links}
    carriageway = built.network.carriageway(0)
    _, notes = signal_mesh(
        heads, ground_height=lambda xy: np.zeros(len(xy)), carriageway=carriageway
    )
    assert notes["traffic signal heads"] == len(heads)
