"""Programs from ``site.yaml``; SUMO itself says what its signals show."""

import subprocess
from xml.etree import ElementTree

import pytest
import shapely
import sumolib
import yaml
from lxml import etree

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, sumo_binary, sumo_environment
from urbantwin.roads.signals.controlled_links import signalised_junctions
from urbantwin.roads.signals.programs import described_signals, set_programs
from urbantwin.site import read_extract
from urbantwin.site.signals import SignalPlan, SignalSpec
from urbantwin.site.yaml_document import read_document

HERE = SiteFrame(48.7, 9.18)
CROSSED = {"highway": "crossing", "crossing": "traffic_signals"}
MAIN = {"highway": "primary", "name": "Long Avenue", "lanes": "4", "maxspeed": "50",
        "sidewalk": "both"}  # fmt: skip
SIDE = {"highway": "secondary", "name": "Cross Street", "lanes": "2", "maxspeed": "50",
        "sidewalk": "both"}  # fmt: skip
TWO_PHASES = [
    {"seconds": 30, "green": ["east", "west"]},
    {"seconds": 20, "green": ["north", "south"]},
]
TIMED = [{**phase, "yellow": 3, "all_red": 2} for phase in TWO_PHASES]


def plans_of(signals, written):
    written.write_text(yaml.safe_dump({"signals": list(signals)}))
    document = read_document(written, kind="a site")
    return tuple(
        SignalPlan(SignalSpec.model_validate(item), document, k)
        for k, item in enumerate(document.value["signals"])
    )


@pytest.fixture
def build(write_osm, tmp_path):
    nodes = {1: (-150, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (150, 0, {})}
    nodes |= {4: (0, -150, {}), 5: (0, 150, {})}
    nodes |= {6: (-13, 0, CROSSED), 7: (13, 0, CROSSED), 8: (0, -14, CROSSED), 9: (0, 14, CROSSED)}
    path = write_osm(nodes, {10: ([1, 6, 2, 7, 3], MAIN), 11: ([4, 8, 2, 9, 5], SIDE)})

    def run(*signals):
        plans = plans_of(signals, tmp_path / "site.yaml")
        out = tmp_path / "n.net.xml"
        region = shapely.box(-140, -140, 140, 140)
        built = build_roads(
            read_extract(path), HERE, region, Elevation.flat(), driving_side="right", out=out,
            plans=plans,
        )  # fmt: skip
        return built, out

    return run


@pytest.fixture(scope="module")
def crossing_net():
    """The same crossing's SUMO network, once it is built."""
    return []


@pytest.fixture
def plan(build, crossing_net, tmp_path):
    """Set plans in a copy of the crossing's network and return the network."""
    if not crossing_net:
        crossing_net.append(build()[1].read_bytes())

    def run(*signals):
        net = tmp_path / "copy.net.xml"
        net.write_bytes(crossing_net[0])
        set_programs(net, plans_of(signals, tmp_path / "site.yaml"), HERE)
        return net

    return run


def shown_by_sumo(net, tmp_path, seconds):
    """State of the one program at every whole second, as SUMO writes it while it runs."""
    out, more = tmp_path / "states.xml", tmp_path / "more.add.xml"
    program = ElementTree.parse(net).getroot().find("tlLogic").get("id")
    event = f'<timedEvent type="SaveTLSStates" source="{program}" dest="{out}"/>'
    more.write_text(f"<additional>{event}</additional>")
    command = [sumo_binary("sumo"), "-n", net, "-a", more, "--end", str(seconds)]
    options = ["--no-step-log", "true", "--xml-validation", "never"]
    subprocess.run([*command, *options], check=True, capture_output=True, env=sumo_environment())
    rows = ElementTree.parse(out).getroot().iter("tlsState")
    return {round(float(row.get("time"))): row.get("state") for row in rows}


def links_of(net):
    """Link index -> (street, direction letter) of vehicles, read from the file alone."""
    root = ElementTree.parse(net).getroot()
    names = {edge.get("id"): edge.get("name") for edge in root.iter("edge")}
    return {
        int(item.get("linkIndex")): (names[item.get("from")], item.get("dir"))
        for item in root.iter("connection")
        if item.get("tl") and not item.get("from").startswith(":")
    }


@pytest.mark.parametrize("offset", [0, 17, -5])
def test_sumo_shows_the_plan_and_its_offset(offset, plan, tmp_path):
    wanted = {"junction": "Long Avenue / Cross Street", "cycle": 60, "offset": offset}
    net = plan({**wanted, "phases": TIMED})
    states, links = shown_by_sumo(net, tmp_path, 140), links_of(net)
    assert {street for street, _ in links.values()} == {"Long Avenue", "Cross Street"}
    for time in range(1, 140):
        at = (time - offset) % 60
        for index, (street, _) in links.items():
            since = (at - (0 if street == "Long Avenue" else 35)) % 60
            length = 30 if street == "Long Avenue" else 20
            expected = "Gg" if since < length else "y" if since < length + 3 else "r"
            assert states[time][index] in expected, (time, street)


def test_the_model_and_the_network_carry_the_same_program(build):
    built, net = build({"junction": "Cross Street", "offset": 9, "phases": TWO_PHASES})
    assert built.notes["signal_programs_set"] == 1
    logic = ElementTree.parse(net).getroot().find("tlLogic")
    phases = tuple((float(p.get("duration")), p.get("state")) for p in logic.iter("phase"))
    (program,) = built.network.programs
    (controller,) = built.model.controllers
    assert (program.offset, program.phases) == (9.0, phases)
    assert (controller.offset, controller.phases) == (9.0, phases)
    (described,) = described_signals(net).values()
    assert described["cycle"] == sum(seconds for seconds, _ in phases)
    assert described["offset"] == 9.0


def test_greens_never_conflict_and_who_must_gives_way(plan):
    """By sumolib's own reading of the junction's table of conflicts."""
    phases = [
        {"seconds": 20, "green": ["east through", "west through", "east right", "west right"]},
        {"seconds": 8, "green": ["east left", "west left"], "walk": []},
        {"seconds": 20, "green": ["Cross Street"]},
    ]
    path = plan({"junction": {"latitude": 48.7, "longitude": 9.18}, "phases": phases})
    net = sumolib.net.readNet(str(path), withPrograms=True, withPedestrianConnections=True)
    (light,) = net.getTrafficLights()
    node = next(n for n in net.getNodes() if n.getType() == "traffic_light")
    links = {}
    for edge in net.getEdges(withInternal=True):
        for lane in edge.getLanes():
            for item in lane.getOutgoing():
                if item.getTLSID() == light.getID():
                    links[item.getTLLinkIndex()] = item
    walkers = {k for k, item in links.items() if item.getFrom().getID().startswith(":")}
    assert walkers
    row = {k: node.getLinkIndex(item) for k, item in links.items() if k not in walkers}
    (program,) = light.getPrograms().values()
    seen = set()
    for phase in program.getPhases():
        on = {k for k, letter in enumerate(phase.state) if letter in "Gg"}
        seen |= on
        for a in on & row.keys():
            for b in on & row.keys():
                if node.areFoes(row[a], row[b]) and phase.state[a] == phase.state[b] == "G":
                    pytest.fail(f"{a} and {b} in {phase.state}")
    assert seen == set(links)
    # Walkers on the way of a protected left turn stay where they are.
    names = links_of(path)
    for phase in program.getPhases():
        lefts = [k for k, (street, way) in names.items()
                 if street == "Long Avenue" and way == "l" and phase.state[k] == "G"]  # fmt: skip
        if lefts and all(phase.state[k] not in "Gg" for k, (_, way) in names.items() if way == "s"):
            assert not {k for k in walkers if phase.state[k] in "Gg"}


def test_people_who_set_out_last_are_across_before_traffic_starts(plan):
    """Walking 1.2 m/s (RiLSA 2015), measured on the crossings that SUMO has."""
    net = plan({"junction": "Long Avenue", "phases": TWO_PHASES})
    root = ElementTree.parse(net).getroot()
    lengths = {lane.get("id"): float(lane.get("length")) for lane in root.iter("lane")}
    phases = [(float(p.get("duration")), p.get("state")) for p in root.iter("phase")]
    cycle = sum(seconds for seconds, _ in phases)
    starts = [sum(seconds for seconds, _ in phases[:k]) for k in range(len(phases))]
    vehicles = links_of(net)
    checked = 0
    for item in root.iter("connection"):
        if not item.get("tl") or not item.get("from").startswith(":"):
            continue
        index = int(item.get("linkIndex"))
        crossed = root.find(f"edge[@id='{item.get('to')}']").get("crossingEdges").split()
        street = next(e.get("name") for e in root.iter("edge") if e.get("id") in crossed)
        shown = [state[index] in "Gg" for _, state in phases]
        ends = [starts[k] + phases[k][0] for k in range(len(phases))
                if shown[k] and not shown[k - len(phases) + 1]]  # fmt: skip
        straight = [k for k, (name, way) in vehicles.items() if name == street and way == "s"]
        letters = [{state[j] for j in straight} for _, state in phases]
        begins = [starts[k] for k in range(len(phases))
                  if letters[k] & set("Gg") and "r" in letters[k - 1]]  # fmt: skip
        for end in ends:
            gap = min((begin - end) % cycle for begin in begins)
            assert gap >= lengths[f"{item.get('to')}_0"] / 1.2 - 1e-6
            checked += 1
    assert checked >= 4


def test_phases_without_seconds_share_what_the_cycle_leaves(plan):
    phases = [{"green": ["east", "west"]}, {"seconds": 20, "green": ["northbound", "south-bound"]}]
    net = plan({"junction": "Long Avenue", "cycle": 90, "phases": phases})
    (described,) = described_signals(net).values()
    assert described["cycle"] == pytest.approx(90)


def test_states_are_taken_letter_by_letter(plan):
    net = plan({"junction": "Long Avenue", "offset": 1})
    (before,) = described_signals(net).values()
    states = [{"seconds": p["seconds"] + 1, "state": p["state"]} for p in before["phases"]]
    net = plan({"junction": "Long Avenue", "states": states})
    (after,) = described_signals(net).values()
    assert [(p["seconds"], p["state"]) for p in after["phases"]] == [
        (float(p["seconds"]), p["state"]) for p in states
    ]


def test_traffic_extends_states_that_last_between_two_times(plan):
    net = plan({"junction": "Long Avenue", "offset": 1})
    (before,) = described_signals(net).values()
    states = [{"seconds": p["seconds"], "state": p["state"]} for p in before["phases"]]
    longest = max(states, key=lambda one: one["seconds"])
    longest |= {"at_least": 6.0, "at_most": 60.0}
    net = plan({"junction": "Long Avenue", "states": states})
    (after,) = described_signals(net).values()
    assert [
        {name: p[name] for name in ("seconds", "state", "at_least", "at_most") if name in p}
        for p in after["phases"]
    ] == states
    (logic,) = ElementTree.parse(net).getroot().iter("tlLogic")
    assert logic.get("type") == "actuated"
    for one in states:  # the least green counts
        one |= {"at_least": min(one["seconds"], 1.0), "at_most": one["seconds"]}
    with pytest.raises(InputError, match=r"s of green"):
        plan({"junction": "Long Avenue", "states": states})


@pytest.mark.parametrize(
    ("signal", "place", "words"),
    [
        (
            {"junction": "nowhere", "offset": 1},
            "signals[0].junction",
            "(Cross Street / Long Avenue)",
        ),
        ({"junction": 7, "offset": 1}, "signals[0].junction", "is not a signalised junction"),
        (
            {"junction": {"latitude": 48.71, "longitude": 9.18}, "offset": 1},
            "signals[0].junction",
            "within 100 m",
        ),
        (
            {"junction": 2, "phases": [{"seconds": 30, "green": ["east", "north"]}]},
            "signals[0].phases[0].green",
            "north through (Cross Street) and east through (Long Avenue)",
        ),
        (
            {"junction": 2, "phases": [TWO_PHASES[0], {"seconds": 9, "green": ["uphill"]}]},
            "signals[0].phases[1].green[0]",
            "north (Cross Street), east (Long Avenue)",
        ),
        (
            {"junction": 2, "phases": [{"seconds": 9, "green": ["north u-turn"]}]},
            "signals[0].phases[0].green[0]",
            "left, right, through",
        ),
        (
            {"junction": 2, "phases": [{**TWO_PHASES[0], "walk": ["east"]}, TWO_PHASES[1]]},
            "signals[0].phases[0].walk[0]",
            "the crossing over the east arm",
        ),
        (
            {"junction": 2, "phases": TWO_PHASES[:1]},
            "signals[0].phases",
            "never gives green",
        ),
        (
            {"junction": 2, "cycle": 40, "phases": TIMED},
            "signals[0].cycle",
            "last 60 s",
        ),
        (
            {"junction": 2, "cycle": 40, "phases": [TWO_PHASES[0], {"green": ["north", "south"]}]},
            "signals[0].cycle",
            "at least",
        ),
        (
            {"junction": 2, "phases": [TWO_PHASES[0], {"green": ["north", "south"]}]},
            "signals[0].phases[1]",
            "has no seconds",
        ),
        (
            {"junction": 2, "phases": [{**TWO_PHASES[0], "seconds": 2}, TWO_PHASES[1]]},
            "signals[0].phases",
            "2 s of green; expected at least",
        ),
        (
            {"junction": 2, "states": [{"seconds": 9, "state": "GGG"}]},
            "signals[0].states[0].state",
            "has 3 letters",
        ),
    ],
)
def test_a_plan_that_cannot_be_is_told_in_one_line(signal, place, words, plan, tmp_path):
    with pytest.raises(InputError) as caught:
        plan(signal)
    text = str(caught.value)
    assert "\n" not in text
    assert f"{tmp_path / 'site.yaml'}: {place} (line" in text
    assert words in text


def test_conflicting_letters_are_told(plan):
    net = plan({"junction": 2, "offset": 1})
    (described,) = described_signals(net).values()
    everything = "G" * len(described["phases"][0]["state"])
    with pytest.raises(InputError, match="right of way to conflicting traffic"):
        plan({"junction": 2, "states": [{"seconds": 30, "state": everything}]})
    first, *_ = (p["state"] for p in described["phases"] if "G" in p["state"])
    red = "r" * len(first)
    with pytest.raises(InputError, match="without yellow"):
        plan({"junction": 2, "states": [{"seconds": 9, "state": s} for s in (first, red)]})


def test_people_have_no_green_with_two_lanes_that_turn_side_by_side(write_osm, tmp_path):
    """From the south two lanes turn right, from the north one: people walk with the latter."""
    nodes = {1: (-150, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (150, 0, {})}
    nodes |= {4: (0, -150, {}), 5: (0, 150, {})}
    nodes |= {6: (-13, 0, CROSSED), 7: (13, 0, CROSSED)}
    two = {**MAIN, "oneway": "yes", "lanes": "2", "turn:lanes": "right|right"}
    one = {**MAIN, "oneway": "yes", "lanes": "1", "turn:lanes": "right"}
    ways = {10: ([1, 6, 2, 7, 3], MAIN), 11: ([4, 2], two), 12: ([5, 2], one)}
    out = tmp_path / "n.net.xml"
    region = shapely.box(-140, -140, 140, 140)
    build_roads(
        read_extract(write_osm(nodes, ways)), HERE, region, Elevation.flat(), driving_side="right",
        out=out,
    )  # fmt: skip
    (junction,) = signalised_junctions(etree.parse(out).getroot())
    walks = [link for link in junction.links if link.movement == "walk"]
    lanes = {}
    for link in junction.links:
        crossed = [w for w in walks if junction.are_foes(link, w) and link.road not in w.crosses]
        if link.movement == "right" and crossed:
            lanes.setdefault(link.road, []).append(
                all(junction.together(link.index, walk.index) for walk in crossed)
            )
    apart = {
        len(each): each for road, each in lanes.items() if road.lstrip("-")[:2] in ("11", "12")
    }
    assert apart == {2: [False, False], 1: [True]}
