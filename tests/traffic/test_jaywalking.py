"""Who crosses between crossings, on a street laid out by hand: gaps are those of the manual."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from urbantwin.roads.network import Lane, Road, RoadNetwork
from urbantwin.traffic.assets import asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.jaywalking import with_jaywalkers
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import Simulated

STEP_S, WALKS_MS = 0.1, 1.4
NOBODY = Observed(*np.zeros((5, 0, 9)), longest_halt_s=0.0, stuck=())
NOTHING = PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))
#: A carriageway of 7 m between two footways, until a crossing at x = 2.
FOOTWAY_Y, KERB_Y = 5.0, 3.5
#: It waits so long for the crossing's green.
RED_S = 20.0


def lane(name: str, kind: str, *ends: tuple[float, float], width: float = 3.0) -> Lane:
    centre = np.column_stack([np.array(ends), np.zeros(len(ends))])
    return Lane(name, name[:-2], kind, width, 13.9, centre, np.zeros((0, 2)), 0, (), (), "")


def street() -> RoadNetwork:
    lanes = (
        lane("to_0", "sidewalk", (-100, -FOOTWAY_Y), (0, -FOOTWAY_Y)),
        lane("to_1", "driving", (-100, -KERB_Y / 2), (0, -KERB_Y / 2), width=3.5),
        lane("from_0", "sidewalk", (0, FOOTWAY_Y), (-100, FOOTWAY_Y)),
        lane("from_1", "driving", (0, KERB_Y / 2), (-100, KERB_Y / 2), width=3.5),
        lane(":corner_0", "walkingarea", (0, -FOOTWAY_Y), (4, -FOOTWAY_Y)),
        lane(":c_0", "crossing", (2, -FOOTWAY_Y), (2, FOOTWAY_Y)),
    )
    roads = tuple(
        Road(one, "", (1,), "residential", (f"{one}_0", f"{one}_1"), "a", "b")
        for one in ("to", "from")
    )
    return RoadNetwork("right", roads, lanes, (), (), ())


def seen(cars: np.ndarray) -> Simulated:
    """Somebody to the crossing, over it after the red, and on; cars by when they pass x = 0, s."""
    legs = [(-80.0, -FOOTWAY_Y), (2.0, -FOOTWAY_Y), (2.0, FOOTWAY_Y), (42.0, FOOTWAY_Y)]
    ways = [np.linspace(a, b, round(np.hypot(*np.subtract(b, a)) / WALKS_MS / STEP_S))
            for a, b in pairwise(legs)]  # fmt: skip
    stands = np.tile([legs[1]], (round(RED_S / STEP_S), 1))
    xy = np.concatenate([ways[0], stands, *ways[1:]])
    walks = np.full(len(xy), 2)
    walks[: len(ways[0])] = 0
    walks[len(ways[0]) + len(stands) :][: len(ways[1])] = 4
    walks[len(ways[0]) + len(stands) + len(ways[1]) :] = 2
    step = np.arange(len(xy))
    driven = [np.column_stack([(step * STEP_S - at) * 10.0, np.full(len(step), -KERB_Y / 2)])
              for at in cars]  # fmt: skip
    front = np.concatenate([xy, *driven])
    trip = np.repeat(np.arange(len(cars) + 1), len(step))
    order = np.argsort(np.tile(step, len(cars) + 1), kind="stable")
    speed = np.where(trip == 0, np.tile(np.append(
        0.0, np.hypot(*np.diff(xy, axis=0).T)), len(cars) + 1) / STEP_S, 10.0)  # fmt: skip
    lanes = np.where(trip == 0, np.tile(walks, len(cars) + 1), 1)
    rows = np.tile(step, len(cars) + 1), trip, front, np.full(len(trip), 90.0), speed, lanes
    names = ("to_0", "to_1", ":corner_0", "from_0", ":c_0")
    return Simulated(*(one[order] for one in rows), names, (), 0, 0, frozenset(), "", NOBODY)


def crossed(
    cars: np.ndarray, share: float = 1.0, blocks: PlanBoxes = NOTHING, seed: int = 1
) -> tuple[Simulated, np.ndarray]:
    """What was seen then, and where the walker is."""
    trips = [Trip("pedestrian", "pedestrian-man", 0.0, ("to",))]
    trips += [Trip("car", "car-city", 0.0, ("to",))] * len(cars)
    found = with_jaywalkers(
        seen(cars), Demand(tuple(trips), ()), street(), blocks,
        share=share, seed=seed, step_s=STEP_S, asset=asset,
    )  # fmt: skip
    return found, found.front[found.trip == 0]


def test_it_crosses_before_the_crossing_and_is_on_time() -> None:
    found, xy = crossed(np.zeros(0))
    was = seen(np.zeros(0)).front
    (told,) = found.jaywalks
    across = np.abs(xy[:, 1]) < KERB_Y
    assert (xy[across, 0] < -5.0).all()
    assert np.ptp(xy[across, 0]) < 0.5  # straight over
    names = np.array(found.lanes, object)[found.lane[found.trip == 0]]
    assert set(names[across]) == {"jaywalk:to_0"}
    assert told.waited_s == 0.0
    assert np.abs(np.array([told.x, told.y]) - [xy[across, 0].mean(), 0.0]).max() < 0.2
    # It is where it was before and after, and nowhere faster than people walk.
    assert (xy[0] == was[0]).all()
    assert (xy[-280:] == was[-280:]).all()
    assert np.hypot(*np.diff(xy, axis=0).T).max() / STEP_S < 1.85
    assert (crossed(np.zeros(0), share=0.0)[1] == was).all()


def test_it_waits_for_a_gap_as_long_as_the_manual_has_it() -> None:
    """HCM 2010, equation 19-69: the width at 3.5 ft/s, and 3 s."""
    least = 2 * KERB_Y / (3.5 * 0.3048) + 3.0
    length, width = asset("car-city").length, asset("car-city").width
    assert width < 2.0
    for every, waits in ((least - 1.0, False), (least + 2.5, True)):
        cars = np.arange(-8, 30) * every
        found, xy = crossed(cars)
        if not waits:  # gaps are too short: it goes to the crossing
            assert not found.jaywalks
            assert (xy == seen(np.zeros(0)).front).all()
            continue
        (told,) = found.jaywalks
        # From when the last car has passed to when the next one comes.
        passes = cars + told.x / 10.0
        after = passes + length / 10.0
        ready = told.time_s
        assert passes[passes > ready].min() - ready >= least
        assert after[passes < ready].max() < ready
        at = xy[round(ready / STEP_S) : round((ready + 8.0) / STEP_S)]
        time_s = ready + np.arange(len(at)) * STEP_S
        on_lane = (at[:, 1] > -KERB_Y) & (at[:, 1] < 0.0)
        front = (time_s[on_lane, None] - cars) * 10.0
        clear = (front < at[on_lane, :1] - 1.0) | (front - length > at[on_lane, :1] + 1.0)
        assert clear.all()


def test_nobody_crosses_where_something_stands() -> None:
    fence = PlanBoxes(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1), np.array([[100.0, 0.05]]))
    found, xy = crossed(np.zeros(0), blocks=fence)
    assert not found.jaywalks
    assert not shapely.LineString(xy[xy[:, 0] < 1.0]).intersects(fence.polygons[0])


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_the_share_is_that_of_the_site(share: float) -> None:
    count = sum(len(crossed(np.zeros(0), share, seed=seed)[0].jaywalks) for seed in range(80))
    assert abs(count / 80 - share) < 3 * np.sqrt(share * (1 - share) / 80)


def test_what_else_was_seen_stays() -> None:
    cars = np.array([3.0, 60.0])
    found, _ = crossed(cars)
    was = seen(cars)
    driven = was.trip > 0
    assert (found.front[driven] == was.front[driven]).all()
    assert replace(found, front=was.front).step is found.step
