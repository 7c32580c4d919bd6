"""Counts by approach and turn: who comes is who was counted."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.interface.outcome import outcome_of_motion
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.traffic import run_traffic
from urbantwin.traffic.demand.counted_places import turn_of
from urbantwin.traffic.demand.counts import counted_demand
from urbantwin.traffic.demand.counts_table import read_counts
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.demand.vehicle_types import IN_BENDS, manners_of
from urbantwin.twin import Twin

ROWS = [
    {"approach": "wc", "turn": "ce", "actor_class": "car", "per_hour": 300.0},
    {"approach": "north", "turn": "right", "actor_class": "car", "per_quarter": [30.0, 60.0]},
    {"approach": "east", "turn": "south", "actor_class": "truck", "per_hour": 60.0},
]


def planned(twin: Twin, rows: list[dict[str, object]], seconds: float = 1800.0) -> Counter[object]:
    demand = counted_demand(
        rows,
        twin.roads,
        StreetNetwork(twin.net_path, twin.region),
        {"car": 900.0, "truck": 100.0, "bicycle": 500.0},
        warmup_s=0.0,
        duration_s=seconds,
        seed=1,
        body=lambda name, _: f"{name}-mesh",
    )
    assert not demand.left_out
    assert all(0 <= trip.depart_s < seconds for trip in demand.trips)
    return Counter((trip.actor_class, trip.edges) for trip in demand.trips)


def test_as_many_come_by_each_way_as_were_counted(crossing_twin: Twin) -> None:
    vans = {"approach": "South", "turn": "through", "actor_class": "van", "per_hour": 40.0}
    found = planned(crossing_twin, [*ROWS, vans])
    assert found == {
        ("car", ("wc", "ce")): 150,
        ("car", ("nc", "cw")): 90,  # who comes from the north and turns right goes west
        ("truck", ("ec", "cs")): 30,
        ("van", ("sc", "cn")): 20,  # vans go where cars go
    }


def test_motor_traffic_is_shared_out_by_class(crossing_twin: Twin) -> None:
    found = planned(crossing_twin, [{"approach": "wc", "turn": "left", "per_hour": 200.0}])
    assert found == {("car", ("wc", "cn")): 90, ("truck", ("wc", "cn")): 10}


def test_one_more_row_does_not_change_the_others(crossing_twin: Twin) -> None:
    asked = {**crossing_twin.site["traffic"], "per_hour": {}, "warmup_s": 0.0}
    one, two = (
        demand_of(crossing_twin, asked={**asked, "counts": rows}, duration_s=900.0, seed=3)
        for rows in (ROWS[:2], ROWS)
    )
    trucks = [trip for trip in two.trips if trip.actor_class == "truck"]
    assert trucks
    assert [trip for trip in two.trips if trip.actor_class != "truck"] == list(one.trips)


def test_turns_are_those_of_the_plan(crossing_twin: Twin) -> None:
    roads = {road.id: road for road in crossing_twin.roads.roads}
    turns = {
        name: turn_of(crossing_twin.roads, roads["wc"], roads[name])
        for name in ("cn", "ce", "cs", "cw")
    }
    assert turns == {"cn": "left", "ce": "through", "cs": "right", "cw": "u-turn"}


def test_what_was_asked_and_driven_stand_side_by_side(
    crossing_twin: Twin, tmp_path: Path, records: Callable[..., np.recarray]
) -> None:
    changes = {"counts": ROWS, "per_hour": {}, "warmup_s": 40.0}
    motion = run_traffic(crossing_twin, tmp_path / "motion", seconds=90.0, changes=changes)
    told = motion.manifest["counts"]
    assert [row["asked_per_hour"] for row in told] == [300.0, 120.0, 60.0]
    rows = records(motion.actors)
    came = {
        track: rows.time_s[(rows.track == track) & np.isin(rows.lane, ["ce_0", "ce_1", "ce_2"])]
        for track in np.unique(rows.track[rows["class"] == "car"])
    }
    east = sum(len(times) > 0 and times[0] > 0 for times in came.values())
    assert told[0]["driven_per_hour"] == pytest.approx(east * 40)
    outcome = outcome_of_motion(motion)
    assert outcome["counted_asked_per_hour"] == 480.0
    assert outcome["counted_driven_per_hour"] == sum(row["driven_per_hour"] for row in told)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ({"approach": "up", "turn": "left"}, r"counts\[0\]: the approach 'up' is not there.*wc"),
        ({"approach": "north", "turn": "zc"}, r"the turn 'zc' is not there.*left"),
    ],
)
def test_an_approach_that_is_not_there_is_told(
    crossing_twin: Twin, row: dict[str, object], told: str
) -> None:
    with pytest.raises(InputError, match=told):
        planned(crossing_twin, [{**row, "per_hour": 10.0}])


def test_a_table_is_read_by_quarters_of_an_hour(tmp_path: Path) -> None:
    file = tmp_path / "counts.csv"
    file.write_text(
        "approach,turn,class,begin,count\nnorth,left,car,07:00,10\nnorth,left,car,07:05,11\n"
        "north,left,car,07:10,12\nnorth,left,car,07:15,20\nwc,through,,07:15,5\n"
    )
    first, second = read_counts(file)
    assert first["per_quarter"] == [33.0, 20.0]
    assert (second["approach"], second["actor_class"]) == ("wc", None)
    assert second["per_quarter"] == [0.0, 5.0]
    file.write_text("origin,destination,count\nwc,ce,400\n")
    assert read_counts(file)[0]["per_quarter"] == [100.0] * 4


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("approach,count\nn,3\n", "line 1: has no column turn"),
        ("approach,turn,count\nn,left,x\n", "line 2: count is 'x'"),
        ("approach,turn,count\nn,left,-1\n", "line 2: counts less"),
        ("approach,turn,class,count\nn,left,cart,1\n", "line 2: unknown class 'cart'"),
        ("approach,turn,begin,count\nn,left,7h,1\n", "line 2: begins at '7h'"),
        ("approach,turn,begin,count\nn,left,0,1\nn,left,700,1\n", "intervals of 700 s"),
    ],
)
def test_a_wrong_table_is_told(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "counts.csv").write_text(text)
    with pytest.raises(InputError, match=told):
        read_counts(tmp_path / "counts.csv")


def test_drivers_become_attributes_of_sumo() -> None:
    found = manners_of({"car": {"speed_factor": 0.9, "headway_s": 1.3, "critical_gap_s": None}})
    assert found == {"car": {"tau": "1.3", "speedFactor": "normc(0.900,0.100,0.650,1.150)"}}
    assert manners_of({"bicycle": {"lane_offset_m": -0.8}}) == {"bicycle": {"latAlignment": "-0.8"}}


def test_acceleration_fades_in_a_line_and_bends_are_taken_as_told() -> None:
    found = manners_of({"car": {"acceleration": 2.0, "acceleration_at_10": 1.2}})["car"]
    assert found["speedTable"].split() == ["0", "10", "20", "30"]
    assert [float(x) for x in found["maxAccelProfile"].split()] == [2.0, 1.2, 0.4, 0.3]
    # Speed in a bend goes as the root of the acceleration to the side.
    slow, fast = (
        float(manners_of({"car": {"sideways_acceleration": a}})["car"][IN_BENDS])
        for a in (1.0, 4.0)
    )
    assert fast / slow == pytest.approx(2.0, abs=0.01)
