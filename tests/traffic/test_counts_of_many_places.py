"""Counts that see the same actors several times: at junctions, by detectors, on crossings."""

import re
import subprocess
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.exports.sumo import write_sumo
from urbantwin.roads import sumo_binary
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.netconvert import sumo_home
from urbantwin.traffic.assets import asset
from urbantwin.traffic.calibration.bicycles import bicycle_counts
from urbantwin.traffic.calibration.elsewhere import CountedElsewhere, counted_elsewhere
from urbantwin.traffic.calibration.measured import measured
from urbantwin.traffic.calibration.parameters import traffic_of
from urbantwin.traffic.calibration.passages import JunctionLinks, SeenTrack, passages_of
from urbantwin.traffic.calibration.ways_seen import ways_seen
from urbantwin.traffic.demand.counted_report import counted_report
from urbantwin.traffic.demand.counts import counted_demand, fitted_volumes
from urbantwin.traffic.demand.counts_table import read_counts
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.demand.time_of_day import CARS, TRUCKS, counts_from, hour_factor
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.traffic.sumo.counted_signals import net_for_counts, timing_told
from urbantwin.traffic.sumo.simulation import simulate
from urbantwin.twin import Twin

#: Cars an hour between the six ends of two junctions in a row; what the counts below are made of.
TRUE = {("w", "e"): 300, ("e", "w"): 200, ("an", "bs"): 60, ("bn", "w"): 90, ("as", "an"): 120}


@pytest.fixture(scope="module")
def street_twin(make_net, twin_of, tmp_path_factory) -> Twin:
    """Two signalised junctions 120 m apart on one street."""
    places = {"w": (-150, 0), "e": (150, 0), "an": (-60, 120), "as": (-60, -120)}
    places |= {"bn": (60, 120), "bs": (60, -120)}
    nodes = '<node id="a" x="-60" y="0" type="traffic_light"/>'
    nodes += '<node id="b" x="60" y="0" type="traffic_light"/>'
    nodes += "".join(f'<node id="{one}" x="{x}" y="{y}"/>' for one, (x, y) in places.items())
    pairs = [("w", "a"), ("an", "a"), ("as", "a"), ("e", "b"), ("bn", "b"), ("bs", "b"), ("a", "b")]
    edges = "".join(
        f'<edge id="{start}-{end}" from="{start}" to="{end}" numLanes="1" speed="13.9"/>'
        for one, other in pairs
        for start, end in ((one, other), (other, one))
    )
    folder = tmp_path_factory.mktemp("street")
    return twin_of(folder / "twin", make_net(folder, nodes, edges), {"car": 0.0})


def way(start: str, end: str) -> tuple[str, ...]:
    """The edges from one end to another."""
    side = {name: "b" if name in ("e", "bn", "bs") else "a" for pair in TRUE for name in pair}
    between = [] if side[start] == side[end] else [f"{side[start]}-{side[end]}"]
    return (f"{start}-{side[start]}", *between, f"{side[end]}-{end}")


def planned(twin: Twin, rows: list[dict[str, object]], seconds: float = 3600.0) -> Demand:
    return counted_demand(
        rows,
        twin.roads,
        StreetNetwork(twin.net_path, twin.region),
        {"car": 1.0},
        warmup_s=0.0,
        duration_s=seconds,
        seed=1,
        body=lambda name, _: name,
    )


def turns(volumes: dict[tuple[str, ...], float]) -> dict[tuple[str, str], float]:
    found: Counter[tuple[str, str]] = Counter()
    for edges, cars in volumes.items():
        for pair in pairwise(edges):
            found[pair] += cars
    return found


def test_likeliest_volumes_are_those_of_proportional_fitting() -> None:
    # A table of three origins and destinations, whose sums were counted: with a uniform prior
    # the likeliest table is the product of the margins (closed form).
    out, into = np.array([100.0, 200, 300]), np.array([240.0, 120, 240])
    passes = np.zeros((9, 6), bool)
    for k in range(9):
        passes[k, k // 3] = passes[k, 3 + k % 3] = True
    found = fitted_volumes(np.ones(9), passes, np.concatenate([out, into]))
    np.testing.assert_allclose(found.reshape(3, 3), np.outer(out, into) / 600, rtol=1e-3)


def test_counts_that_contradict_each_other_end_in_the_middle() -> None:
    passes = np.array([[True, True]])
    (found,) = fitted_volumes(np.ones(1), passes, np.array([100.0, 144.0]))
    assert found == pytest.approx(120, rel=1e-3)  # their geometric mean
    assert fitted_volumes(np.ones(1), passes, np.array([100.0, 0.0])) == 0


def test_counts_at_two_junctions_bring_each_vehicle_once(street_twin: Twin) -> None:
    volumes = {way(*ends): float(cars) for ends, cars in TRUE.items()}
    counted = turns(volumes)
    rows = [
        {"approach": start, "turn": end, "actor_class": "car", "per_hour": cars}
        for (start, end), cars in counted.items()
    ]
    demand = planned(street_twin, rows)
    assert not demand.left_out
    assert len(demand.trips) == pytest.approx(sum(TRUE.values()), abs=5)
    found = turns(Counter(trip.edges for trip in demand.trips))
    for place, cars in counted.items():
        assert found[place] == pytest.approx(cars, rel=0.03, abs=3)
    assert [len(row.trips) for row in demand.counted] == [
        pytest.approx(cars, rel=0.03, abs=3) for cars in counted.values()
    ]


def test_detectors_of_sumo_are_counts_of_their_roads(street_twin: Twin, tmp_path: Path) -> None:
    flows = {("w", "e"): 30, ("e", "w"): 20, ("an", "bs"): 10}
    vehicles = sorted(
        (3.0 * k + number, way(*ends))
        for number, (ends, count) in enumerate(flows.items())
        for k in range(count)
    )
    (tmp_path / "cars.rou.xml").write_text(
        "<routes>"
        + "".join(
            f'<vehicle id="{n}" depart="{at}"><route edges="{" ".join(edges)}"/></vehicle>'
            for n, (at, edges) in enumerate(vehicles)
        )
        + "</routes>"
    )
    loops = {"in": "w-a_0", "middle": "a-b_0", "again": "a-b_0", "back": "b-a_0", "out": "b-bs_0"}
    (tmp_path / "loops.add.xml").write_text(
        "<additional>"
        + "".join(
            f'<inductionLoop id="{name}" lane="{lane}" pos="{40 + 5 * k}" period="900" '
            'file="loops.xml"/>'
            for k, (name, lane) in enumerate(loops.items())
        )
        + "</additional>"
    )
    files = ["-n", street_twin.net_path, "-r", "cars.rou.xml", "-a", "loops.add.xml"]
    command = [sumo_binary("sumo"), *map(str, files), "-e", "900", "--no-step-log"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    rows = read_counts(tmp_path / "loops.xml", tmp_path / "loops.add.xml")
    assert {row["road"]: row["per_quarter"] for row in rows} == {
        "w-a": [30.0],
        "a-b": [40.0],
        "b-a": [20.0],
        "b-bs": [10.0],
    }
    found = planned(street_twin, rows, seconds=900.0)
    passed = Counter(edge for trip in found.trips for edge in trip.edges)
    for row in rows:
        assert passed[row["road"]] == pytest.approx(row["per_quarter"][0], abs=2)
    with pytest.raises(InputError, match="no position of the detector 'in'"):
        read_counts(tmp_path / "loops.xml")


def test_tables_of_other_programs_are_read(tmp_path: Path) -> None:
    edges = tmp_path / "edges.xml"
    edges.write_text(
        '<data><interval begin="0" end="900"><edge id="12" entered="7"/>'
        '<edgeRelation from="12" to="13" count="3"/></interval></data>'
    )
    assert [
        (row.get("road"), row.get("turn"), row["per_quarter"]) for row in read_counts(edges)
    ] == [
        ("12", None, [7.0]),
        (None, "13", [3.0]),
    ]
    flows, places = tmp_path / "flows.csv", tmp_path / "places.xml"
    flows.write_text("Detector;Time;qPKW;qLKW;vPKW;vLKW\na;0;5;1;50;50\nb;0;7;0;50;50\n")
    places.write_text(
        '<detectors><detectorDefinition id="a" lane="12_0" pos="5"/>'
        '<detectorDefinition id="b" lane="12_1" pos="5"/></detectors>'
    )
    assert {
        (row["road"], row["actor_class"]): row["per_quarter"][0]
        for row in read_counts(flows, places)
    } == {("12", "car"): 3.0, ("12", "truck"): 0.25}  # one interval: an hour in four quarters
    wide = tmp_path / "wide.csv"
    wide.write_text(
        "approach,turn,begin,car,bicycle\nnorth,left,07:00,10,4\nnorth,left,07:15,8,2\n"
    )
    rows = read_counts(wide)
    assert {row["actor_class"]: row["per_quarter"] for row in rows} == {
        "car": [10.0, 8.0],
        "bicycle": [4.0, 2.0],
    }
    assert rows[0]["begin"] == "07:00"


def test_people_cross_where_they_were_counted(crossing_twin: Twin) -> None:
    rows = [{"crossing": "north", "per_hour": 600.0}, {"crossing": "east", "per_hour": 200.0}]
    asked = {"counts": rows, "per_hour": {"pedestrian": 200.0}, "warmup_s": 200.0}
    demand = demand_of(crossing_twin, asked=asked, duration_s=400.0, seed=1)
    net, steps = crossing_twin.net_path, 400
    seen = simulate(net, demand, asset, warmup_s=200.0, steps=steps, step_s=1.0, seed=1)
    roads, per_hour = crossing_twin.roads, asked["per_hour"]
    north, east = counted_report(rows, per_hour, demand, seen, roads, steps=steps, step_s=1.0)
    assert north["driven_per_hour"] == pytest.approx(600, rel=0.25)
    assert east["driven_per_hour"] == pytest.approx(200, rel=0.5)


def test_bicycles_counted_on_a_crossing_ride_past_its_arm(crossing_twin: Twin) -> None:
    # On the right one rides west along the north arm, east along the south arm.
    past = {
        "north": ("ec", "cw"),
        "south": ("wc", "ce"),
        "east": ("sc", "cn"),
        "west": ("nc", "cs"),
    }
    rows: list[dict[str, object]] = [
        {"crossing": arm, "actor_class": "bicycle", "per_hour": 100.0 * (k + 1)}
        for k, arm in enumerate(past)
    ]
    demand = planned(crossing_twin, rows)
    ridden = Counter(pair for trip in demand.trips for pair in pairwise(trip.edges))
    assert {trip.actor_class for trip in demand.trips} == {"bicycle"}
    assert [ridden[way] for way in past.values()] == [
        pytest.approx(row["per_hour"]) for row in rows
    ]


@pytest.mark.thorough
def test_signals_serve_those_who_were_counted(crossing_twin: Twin, tmp_path: Path) -> None:
    def greens(*axis: str) -> float:
        rows = [{"approach": f"{one}c", "turn": "through", "per_hour": 900.0} for one in axis]
        rows += [{"approach": f"{x}c", "turn": "through", "per_hour": 90.0} for x in "nsew"]
        asked = {
            **{**crossing_twin.site["traffic"], "per_hour": {"car": 1.0}, "counts": rows},
            **{"duration_s": 3600.0, "warmup_s": 0.0, "seed": 1},
        }
        demand = demand_of(crossing_twin, asked=asked, duration_s=3600.0, seed=1)
        net = net_for_counts(crossing_twin, demand, 1.0, tmp_path / "counted.net.xml")
        roads, told = timing_told(net, crossing_twin.roads)
        assert set(told) <= {program.id for program in roads.programs}
        # What is exported drives by the same.
        counted = Twin(crossing_twin.folder, crossing_twin.manifest)
        vars(counted)["site"] = {**crossing_twin.site, "traffic": asked}
        write_sumo(counted, tmp_path / axis[0])
        exported, _ = timing_told(tmp_path / axis[0] / "network.net.xml", crossing_twin.roads)
        assert exported.programs == roads.programs
        (head,) = {one.links[0] for one in roads.signals if one.lane == "wc_1"}
        (program,) = roads.programs
        return sum(seconds for seconds, state in program.phases if state[head] in "gG")

    assert greens("w", "e") > 1.5 * greens("n", "s")


def test_a_time_of_day_picks_the_quarter_of_an_hour() -> None:
    # SUMO's own tool for sampling routes has the same days, of the same source.
    tool = (sumo_home() / "tools/routeSampler.py").read_text()
    for name, day in (("TGw2_PKW", CARS), ("TGw_LKW", TRUCKS)):
        (told,) = re.findall(rf'"{name}":\s*"([\d.,]+)"', tool)
        assert [float(one) for one in told.split(",")] == list(day)
        assert sum(day) == pytest.approx(100.0, abs=0.6)
    assert hour_factor("12:00") == pytest.approx(1.0, abs=0.1)
    assert hour_factor("03:30") < 0.1
    assert hour_factor("17:00") > 1.2
    assert hour_factor("17:00", "truck") < 0.6
    row = {"road": "a", "begin": "07:00", "per_quarter": [1.0, 2.0, 3.0], "row": "x.csv line 2"}
    (found,) = counts_from([row], "07:20")
    assert found["per_quarter"] == [2.0, 3.0]
    with pytest.raises(InputError, match=r"csv line 2: was not counted at 07:45.*07:00 to 07:4"):
        counts_from([row], "07:45")


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ({"road": "zz"}, r"counts\[0\]: the road 'zz' is not there.*wc"),
        ({"crossing": "up"}, r"counts\[0\]: the crossing 'up' is not there.*\(north\)"),
        ({"crossing": "north", "actor_class": "car"}, r"counts a car.*bicycles at a crossing"),
        ({"road": "wc", "actor_class": "pedestrian"}, r"counts a pedestrian.*at a crossing"),
        ({"junction": "x", "approach": "wc", "turn": "left"}, r"the junction 'x' is not there"),
    ],
)
def test_a_place_that_is_not_there_is_told(
    crossing_twin: Twin, row: dict[str, object], told: str
) -> None:
    with pytest.raises(InputError, match=told):
        planned(crossing_twin, [{**row, "per_hour": 10.0}])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "<d><interval begin='0' end='9'><edge id='1'/></interval></d>",
            "line 1: has no cou",
        ),
        (
            "<d><interval begin='x' end='9'><edge id='1' count='1'/></interval></d>",
            "begin is",
        ),
        ("<data>", "is no XML"),
        ("<data/>", "counts nothing"),
    ],
)
def test_a_wrong_file_of_detectors_is_told(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "loops.xml").write_text(text)
    with pytest.raises(InputError, match=told):
        read_counts(tmp_path / "loops.xml")


def seen_on(twin: Twin, per_hour: dict[tuple[str, str], int], seconds: float) -> list[SeenTrack]:
    """Cars that drive at 10 m/s along the middle of their lanes; every third is lost between."""
    found = []
    for (start, end), rate in per_hour.items():
        lines = [twin.roads.lane_by_id[f"{edge}_0"].centre[:, :2] for edge in way(start, end)]
        line = np.concatenate(lines)
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        time_s = np.arange(0, length[-1] / 10, 0.2)
        xy = np.column_stack([np.interp(10 * time_s, length, side) for side in line.T])
        step = np.gradient(xy, axis=0)
        yaw, speed = np.arctan2(step[:, 1], step[:, 0]), np.full(len(time_s), 10.0)
        for number in range(round(rate * seconds / 3600)):
            at = 1.0 + number * 3600 / rate + time_s
            there = (np.abs(xy) < 110).all(axis=1) & ((number % 3 > 0) | (np.abs(xy[:, 0]) > 8))
            kept = np.flatnonzero(there)
            for part in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1):
                name, nothing = f"{start}{end}{number}.{part[0]}", np.full(len(part), np.nan)
                size = np.array([4.0, 2.0, 1.5])
                track = RecordedTrack(name, "car", at[part], xy[part], yaw[part], nothing, size)
                found.append(SeenTrack(track, at[part], xy[part], yaw[part], speed[part]))
    return found


@pytest.mark.thorough
def test_who_passes_only_another_junction_is_driven_too(street_twin: Twin) -> None:
    # 80 more turn at the second junction alone, and only who goes through passes both.
    seconds, true = 720.0, {**TRUE, ("bs", "e"): 80}
    links = JunctionLinks.of(street_twin.net_path, street_twin.roads)
    tracks = seen_on(street_twin, true, seconds)
    passages = passages_of(tracks, street_twin.roads, links)
    part = measured(tracks, passages, street_twin.roads, 0.0, seconds)
    elsewhere = counted_elsewhere(tracks, street_twin.roads, links.junction)
    traffic, _ = traffic_of(part, passages, {}, 0.0, elsewhere)
    found = turns(
        dict(Counter(trip.edges for trip in planned(street_twin, traffic["counts"]).trips))
    )
    wanted = turns({way(*ends): rate for ends, rate in true.items()})
    assert {one: found[one] for one in wanted} == pytest.approx(wanted, abs=8)
    assert sum(found.values()) == pytest.approx(sum(wanted.values()), abs=20)


@pytest.mark.thorough
def test_who_passes_the_main_junction_comes_by_the_roads_that_were_seen(street_twin: Twin) -> None:
    """As many at every turn of the other junction, though a third of the tracks is broken."""
    seconds = 720.0
    links = JunctionLinks.of(street_twin.net_path, street_twin.roads)
    ends = {
        name: rate
        for name, rate in {**TRUE, ("e", "an"): 50}.items()
        if any(edge.split("-")[0] == links.junction for edge in way(*name))
    }
    tracks = seen_on(street_twin, ends, seconds)
    passages = passages_of(tracks, street_twin.roads, links)
    ways = ways_seen(passages, street_twin.roads)
    wanted = turns({way(*name): rate for name, rate in ends.items()})
    other = {one: rate for one, rate in wanted.items() if not one[0].endswith(links.junction)}
    counted = {
        (road, turn): sum(map(len, times.values())) * 3600 / seconds
        for ((_, road), (_, turn)), times in ways.items()
    }
    assert {one: counted.pop(one) for one in other} == pytest.approx(other, abs=11)  # of two
    assert not any(counted.values())
    assert sum(sum(map(len, times.values())) for times in ways.values()) == pytest.approx(
        sum(other.values()) * seconds / 3600, abs=3
    )
    assert not ways_seen(passages, street_twin.roads, ways)
    part = measured(tracks, passages, street_twin.roads, 0.0, seconds)
    elsewhere = CountedElsewhere(ways, (), {})
    traffic, _ = traffic_of(part, passages, {}, 0.0, elsewhere)
    found = turns(
        dict(Counter(trip.edges for trip in planned(street_twin, traffic["counts"]).trips))
    )
    assert {one: found[one] for one in wanted} == pytest.approx(wanted, abs=12)


@pytest.mark.thorough
def test_bicycles_are_driven_way_by_way(street_twin: Twin) -> None:
    """As many on each way as rode it; and as before where a tenth was counted nowhere."""
    seconds = 720.0
    links = JunctionLinks.of(street_twin.net_path, street_twin.roads)
    tracks = [
        replace(one, track=replace(one.track, actor_class="bicycle"))
        for one in seen_on(street_twin, {**TRUE, ("bs", "e"): 80}, seconds)
    ]
    part = measured(tracks, [], street_twin.roads, 0.0, seconds)
    rows = bicycle_counts(part, tracks, street_twin.roads, links)
    assert {row["actor_class"] for row in rows} == {"bicycle"}
    found = turns(dict(Counter(trip.edges for trip in planned(street_twin, rows).trips)))
    wanted = turns({way(*ends): rate for ends, rate in {**TRUE, ("bs", "e"): 80}.items()})
    assert {one: found[one] for one in wanted} == pytest.approx(wanted, abs=8)
    beside = [
        replace(one, track=replace(one.track, name=f"on a path {k}"), xy=one.xy + [0.0, 40.0])
        for k, one in enumerate(tracks[: len(tracks) // 5])
    ]
    part = measured(tracks + beside, [], street_twin.roads, 0.0, seconds)
    assert not bicycle_counts(part, tracks + beside, street_twin.roads, links)


def test_a_junction_that_is_seen_in_part_is_not_counted(street_twin: Twin) -> None:
    tracks = []
    for one in seen_on(street_twin, TRUE, 720.0):
        part = one.xy[:, 0] < 58  # up to the middle of the second junction
        if part.sum() > 3:
            values = one.time_s[part], one.xy[part], one.yaw[part], one.speed[part]
            tracks.append(SeenTrack(one.track, *values))
    first = JunctionLinks.of(street_twin.net_path, street_twin.roads).junction
    assert not counted_elsewhere(tracks, street_twin.roads, first).times
