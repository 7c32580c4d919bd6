"""Platoons: made as they are told, and told as they were made; chance makes none."""

from typing import Any

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.traffic.calibration.arrivals import platoons_of
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import JunctionLinks
from urbantwin.traffic.calibration.uncounted import UncountedFlows, ways_missed
from urbantwin.traffic.demand.demand import CountedRow, Demand, Trip
from urbantwin.traffic.demand.platoons import in_platoons, moved_into
from urbantwin.twin import Twin

CYCLE_S, GREEN = 72.0, 0.3
NOBODY = np.zeros((0, 0), np.bool_)


def counted(seconds: float, counts: dict[str, int], turns: dict[tuple[str, str], int]) -> Measured:
    """Return what was counted of whom nothing else is known."""
    return Measured(seconds, counts, counts, turns)


def came(seed: int, count: int, seconds: float, share: float) -> np.ndarray[Any, Any]:
    """Times of which a share lies in the first part of a cycle, and the others anywhere."""
    random = np.random.default_rng(seed)
    times = random.uniform(0, seconds, count)
    held = random.random(count) < share
    times[held] = times[held] // CYCLE_S * CYCLE_S + random.uniform(0, GREEN * CYCLE_S, held.sum())
    return np.sort(times)


def test_platoons_are_found_with_their_cycle_and_chance_makes_none() -> None:
    seconds = 30 * CYCLE_S
    arrivals = {"a": came(1, 250, seconds, 0.7), "b": came(2, 250, seconds, 0.0)}
    (row,) = platoons_of(arrivals, seconds, 0.0)
    assert row["approach"] == "a"
    assert row["cycle_s"] == pytest.approx(CYCLE_S, rel=0.01)
    # The junction's own cycle is taken where it tells as much.
    (row,) = platoons_of(arrivals, seconds, CYCLE_S)
    assert row["cycle_s"] == CYCLE_S
    in_green = sum(row["shares"][: round(GREEN * 12)])
    assert in_green == pytest.approx(0.7 + 0.3 * GREEN, abs=0.12)
    # Two cycles are no pattern, however clear it looks.
    assert platoons_of({"a": came(3, 250, 2 * CYCLE_S, 1.0)}, 2 * CYCLE_S, CYCLE_S) == []
    by_chance = [platoons_of({"a": came(k, 200, seconds, 0.0)}, seconds, 0.0) for k in range(20)]
    assert sum(map(bool, by_chance)) <= 1


def test_even_times_come_as_shares_say_and_none_is_lost() -> None:
    times = np.arange(0.05, 3 * CYCLE_S, 0.1)
    shares = [3.0, 1.0, 0.5, 1.5]
    moved = moved_into(times, CYCLE_S, shares)
    counted, _ = np.histogram(moved % CYCLE_S, np.linspace(0, CYCLE_S, 5))
    assert counted / len(times) == pytest.approx(np.array(shares) / sum(shares), abs=0.01)
    assert (np.diff(moved) > 0).all()
    assert (moved // CYCLE_S == times // CYCLE_S).all()


def test_who_is_counted_reaches_the_stop_line_in_platoons(crossing_twin: Twin) -> None:
    ways = [("wc", "ce"), ("nc", "cs")]
    trips = tuple(
        Trip("car", "a", round(k * 9.0 + 1.5 * (k % 2), 2), ways[k % 2]) for k in range(800)
    )
    rows = tuple(CountedRow(*way, tuple(range(n, 800, 2))) for n, way in enumerate(ways))
    network = StreetNetwork(crossing_twin.net_path, None)
    platoon = {"approach": "wc", "cycle_s": CYCLE_S, "shares": [8.0, 1.0, 1.0, 1.0]}
    drivers = {"car": {"speed_factor": 0.8}}
    moved = in_platoons(Demand(trips, (), counted=rows), [platoon], network, drivers)
    edges = {str(one.getID()): one for one in network.streets}
    takes_s = edges["wc"].getLength() / edges["wc"].getSpeed() / 0.8

    def phases(row: int) -> np.ndarray[Any, Any]:
        mine = [moved.trips[k] for k in moved.counted[row].trips]
        assert {trip.edges for trip in mine} == {ways[row]}
        return (np.array([trip.depart_s for trip in mine]) + takes_s) % CYCLE_S

    with pytest.raises(InputError, match=r"arrivals\[0\].approach: there is no road 'wx'.*wc"):
        in_platoons(Demand(trips, ()), [{**platoon, "approach": "wx"}], network, drivers)
    departs = [trip.depart_s for trip in moved.trips]
    assert departs == sorted(departs)
    assert departs[0] >= 0
    assert [len(row.trips) for row in moved.counted] == [400, 400]
    assert (phases(0) < CYCLE_S / 4).mean() == pytest.approx(8 / 11, abs=0.1)
    assert (phases(1) < CYCLE_S / 4).mean() == pytest.approx(1 / 4, abs=0.1)


def test_as_many_are_seen_as_were_though_more_set_out() -> None:
    def seen(seconds: float, people: int) -> Measured:
        counts = {"car": 100, "pedestrian": people, "bicycle": 40}
        return counted(seconds, counts, {})

    flows = UncountedFlows(seen(1800.0, 60))
    assert flows.per_hour == {"pedestrian": 120.0, "bicycle": 80.0}
    # A third of those who walk come into view, and no bicycle does.
    trial = seen(3600.0, 40)
    trial.new["bicycle"] = 0
    flows.learn(flows.per_hour, trial)
    assert flows.per_hour == {"pedestrian": 360.0, "bicycle": 80.0}
    assert [one.split(":")[0] for one in flows.untold()] == ["bicycle"]


def test_vehicles_that_nobody_drives_are_named() -> None:
    links = JunctionLinks("c", {":c_0_0": ("w_0", "e"), ":c_1_0": ("n_1", "s")}, {}, None, NOBODY)

    def came(turns: dict[tuple[str, str], int]) -> list[str]:
        counts = {"car": 100, "pedestrian": 50}
        return ways_missed(counted(600.0, counts, turns), links)

    assert came({("w", "e"): 60, ("n", "s"): 35}) == []
    no_way, elsewhere = came({("w", "e"): 60, ("n", "e"): 5})
    assert no_way.startswith("5 vehicles from road n to e: the map has no way")
    assert elsewhere.startswith("35 of 100 motor vehicles")
