"""People wait at stops, get on what halts there, and others get off and walk away."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.roads import BusStop
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.sumo_network import read_sumo_network
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.passengers import with_passengers
from urbantwin.traffic.demand.stop_places import stop_place
from urbantwin.traffic.paths.at_stops import with_passengers_at_stops
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.sumo.simulation import simulate

NODES = """<node id="a" x="0" y="0"/><node id="b" x="150" y="0"/><node id="c" x="150" y="150"/>
<node id="d" x="0" y="150"/>"""
EDGES = "".join(
    f'<edge id="{start}{end}" from="{start}" to="{end}" numLanes="1" speed="13.9"'
    ' sidewalkWidth="4"/>'
    for start, end in ("ab", "bc", "cd", "da")
)
STOP = BusStop("bc_1", "Corner", 60.0, 78.0)
STEPS, STEP_S = 2400, 0.1
NOTHING = PlanBoxes(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))


@pytest.fixture(scope="module")
def ring(make_net: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_net(tmp_path_factory.mktemp("stops"), NODES, EDGES, "--walkingareas", "true")


@pytest.fixture(scope="module")
def driven(ring: Path):
    roads = read_sumo_network(ring, driving_side="right", level_of_way={}, origin={})
    circulation = Circulation(
        StreetNetwork(ring, None),
        {"da"},
        {"bus": 50.0, "pedestrian": 51.0},
        3,
        stops=[STOP],
        bus_roads={"ab", "bc", "cd", "da"},
    )
    demand = circulation.demand(
        circulation.populations(at_once=1.0), warmup_s=60.0, duration_s=240.0, body=Fleet().body
    )
    assert circulation.walks is not None
    both = with_passengers(
        demand, roads, circulation.walks,
        per_halt=3.0, seconds=300.0, come_in_s=30.0, seed=3, body=Fleet().body,
    )  # fmt: skip
    assert both.trips[: len(demand.trips)] == demand.trips, "everybody else does as before"
    seen = simulate(ring, both, asset, warmup_s=60.0, steps=STEPS, step_s=STEP_S, seed=3)
    drawn = with_passengers_at_stops(seen, both, NOTHING, step_s=STEP_S, asset=asset)
    return roads, both, seen, drawn


def test_who_gets_on_waits_before_and_is_gone_after(driven) -> None:
    _, demand, seen, drawn = driven
    what = [row[1] for row in seen.boarded]
    assert what.count("boards") >= 5
    assert what.count("alights") >= 5
    assert what.count("waits") > what.count("boards") / 2
    checked = 0
    for at_s, kind, trip, stop, vehicle, _ in seen.boarded:
        assert demand.trips[vehicle].actor_class == "bus" or kind == "waits"
        assert stop == 0
        if kind == "waits" or not 20.0 < at_s < 210.0:
            continue
        rows = drawn.trip == trip
        steps = drawn.step[rows] * STEP_S
        if kind == "boards":
            assert ((steps > at_s - 5.0) & (steps < at_s)).sum() == pytest.approx(50, abs=1)
            assert not ((steps > at_s + 12.0) & (steps < at_s + 60.0)).any()
            end_s = steps[steps < at_s + 60.0].max()
        else:
            assert not ((steps > at_s - 60.0) & (steps < at_s - 0.1)).any()
            end_s = steps[steps > at_s - 60.0].min()
        # The bus stands, and its side is within a stride of whom it takes.
        end = drawn.front[rows][np.argmin(np.abs(steps - end_s))]
        bus = (drawn.trip == vehicle) & (drawn.step == round(end_s / STEP_S))
        assert drawn.speed[bus] == pytest.approx(0.0, abs=0.01)
        mesh = asset(demand.trips[vehicle].asset)
        nose, yaw = drawn.front[bus][0], np.radians(90.0 - drawn.angle_deg[bus][0])
        back = nose - mesh.length * np.array([np.cos(yaw), np.sin(yaw)])
        middle = shapely.LineString([back, nose])
        assert middle.distance(shapely.Point(end)) == pytest.approx(mesh.width / 2 + 0.2, abs=0.2)
        checked += 1
    assert checked >= 4


def test_nobody_leaps_or_stands_where_another_waits(driven) -> None:
    roads, demand, seen, drawn = driven
    footway = roads.footway(0)
    gets_off = {(row[2], round(row[0] / STEP_S)) for row in seen.boarded if row[1] == "alights"}
    waiting: dict[int, list[np.ndarray]] = {}
    for trip in demand.passengers.stop_of:
        rows = np.flatnonzero(drawn.trip == trip)
        rows = rows[np.argsort(drawn.step[rows])]
        step, xy = drawn.step[rows], drawn.front[rows]
        assert (np.diff(step) > 0).all()
        # Elsewhere SUMO's walkers leap, in corners and where they turn.
        beside = np.array([drawn.lanes[lane] == "bc_0" for lane in drawn.lane[rows]], np.bool_)
        joined = (np.diff(step) == 1) & beside[1:] & beside[:-1]
        assert np.hypot(*np.diff(xy, axis=0)[joined].T).max(initial=0.0) < 0.3
        for k in np.flatnonzero(drawn.speed[rows] == 0.0)[::50]:
            if (trip, step[k]) in gets_off:  # at the door, for one step
                continue
            waiting.setdefault(int(step[k]), []).append(xy[k])
            assert footway.buffer(0.01).contains(shapely.Point(xy[k]))
    assert waiting
    for places in waiting.values():
        apart = [np.hypot(*(a - b)) for n, a in enumerate(places) for b in places[:n]]
        assert min(apart, default=9.0) > 0.7


def test_one_more_stop_changes_nobody_at_the_others(ring: Path) -> None:
    roads = read_sumo_network(ring, driving_side="right", level_of_way={}, origin={})
    network = StreetNetwork(ring, None)

    def planned(*stops: BusStop):
        made = Circulation(network, {"da"}, {"bus": 100.0, "pedestrian": 60.0}, 3, stops=stops)
        demand = made.demand(made.populations(), warmup_s=60, duration_s=60, body=Fleet().body)
        assert made.walks is not None
        return with_passengers(
            demand, roads, made.walks,
            per_halt=2.0, seconds=120.0, come_in_s=30.0, seed=3, body=Fleet().body,
        )  # fmt: skip

    few, more = planned(STOP), planned(STOP, BusStop("cd_1", "Other", 60.0, 78.0))
    mine = [few.trips[trip] for trip in few.passengers.stop_of]
    assert mine == [more.trips[k] for k, stop in more.passengers.stop_of.items() if stop == 0]
    assert 1 in more.passengers.stop_of.values()


@pytest.mark.parametrize("side", ["right", "left"])
def test_people_wait_on_the_side_of_the_doors(ring: Path, side: str) -> None:
    roads = read_sumo_network(ring, driving_side=side, level_of_way={}, origin={})
    place = stop_place(roads, STOP, 0, {"ab", "bc", "cd", "da"}, 1)
    if side == "left":
        assert place is None, "the only footway is on the other side"
        return
    assert place is not None
    assert place.edge == "bc"
    lane = roads.lane_by_id["bc_1"].centre
    ahead = (lane[-1] - lane[0])[:2] / np.linalg.norm((lane[-1] - lane[0])[:2])
    to_slots = place.slots - lane[0, :2]
    assert (ahead[0] * to_slots[:, 1] - ahead[1] * to_slots[:, 0] < 0).all()
    along = to_slots @ ahead
    assert STOP.start_m - 1 < along.min()
    assert along.max() < STOP.end_m + 1
    assert len(place.slots) > 20
