"""Who walks together: parties of the sizes that were observed, side by side where there is room."""

import math
from collections import Counter

import numpy as np
import pytest

from urbantwin.roads.network import Lane, Road, RoadNetwork
from urbantwin.traffic.demand.demand import Demand, Trip, party_places
from urbantwin.traffic.paths.abreast import BEHIND_M, BESIDE_M, with_parties
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import Simulated

NONE = np.zeros((0, 0))
STEP_S = 0.1


@pytest.mark.parametrize(("in_groups", "rate"), [(0.56, 0.821), (0.67, 1.109)])
def test_parties_are_of_the_sizes_that_moussaid_observed(in_groups: float, rate: float) -> None:
    places = party_places(60_000, in_groups, 3)
    starts = np.append(np.flatnonzero(np.array(places) == 0), len(places))
    sizes = Counter(np.diff(starts)[:-1].tolist())
    total = sum(sizes.values())
    for size in (1, 2, 3):
        poisson = math.exp(-rate) * rate**size / math.factorial(size) / (1 - math.exp(-rate))
        assert sizes[size] / total == pytest.approx(poisson, abs=0.01)
    assert 1 - sizes[1] / len(places) == pytest.approx(in_groups, abs=0.02)


def test_who_comes_later_changes_no_party() -> None:
    assert party_places(80, 0.56, 1)[:50] == party_places(50, 0.56, 1)
    assert party_places(50, 0.56, 2) != party_places(50, 0.56, 1)
    assert party_places(5, 0.0, 1) == [0] * 5


def walk(width: float, people: int) -> Simulated:
    """People along a sidewalk of a width; after 20 s the first waits for 5 s, then goes on."""
    centre = np.array([[0.0, 0.0, 0.0], [80.0, 0.0, 0.0]])
    lane = Lane("r_0", "r", "sidewalk", width, 14.0, centre, np.zeros((0, 2)), 0, (), (), "")
    road = Road("r", "", (), "", ("r_0",), "", "")
    network = RoadNetwork("right", (road,), (lane,), (), (), ())
    speed = np.full(500, 1.2)
    speed[200:250] = 0.0
    x = 10.0 + np.cumsum(speed) * STEP_S
    whole = np.zeros(500, np.int32)
    observed = Observed(NONE, NONE, NONE, NONE, NONE, 0.0, ())
    simulated = Simulated(
        np.arange(500, dtype=np.int32), whole, np.column_stack([x, 0 * x]), np.full(500, 90.0),
        speed, whole, ("r_0",), (), 0, 0, frozenset({0}), "", observed,
    )  # fmt: skip
    trips = tuple(Trip("pedestrian", "x", 0.0, ("r",), beside=k) for k in range(people))
    return with_parties(simulated, Demand(trips, ()), network, STEP_S)


@pytest.mark.parametrize("people", [2, 3])
def test_a_party_walks_and_waits_side_by_side(people: int) -> None:
    found = walk(4.0, people)
    assert found.departed == frozenset(range(people))
    leader = found.front[found.trip == 0]
    sides = []
    for number in range(1, people):
        own = found.front[found.trip == number]
        np.testing.assert_allclose(own[:, 0], leader[:, 0], atol=0.02)
        np.testing.assert_allclose(np.abs(own[:, 1]), BESIDE_M, atol=0.02)
        np.testing.assert_allclose(np.diff(own[200:249], axis=0), 0.0, atol=1e-9)
        sides.append(np.sign(own[0, 1]))
    assert len(set(sides)) == people - 1


def test_four_are_two_pairs() -> None:
    found = walk(4.0, 4)
    here = np.array([found.front[found.trip == number][300] for number in range(4)])
    here = here - here[0]
    np.testing.assert_allclose(np.abs(here[1]), [0.0, BESIDE_M], atol=0.02)
    np.testing.assert_allclose(here[2], [-BEHIND_M, 0.0], atol=0.02)
    np.testing.assert_allclose(here[3], here[1] + here[2], atol=0.02)


def test_where_the_footway_is_narrow_they_walk_behind_each_other() -> None:
    found = walk(1.2, 3)
    for number in (1, 2):
        own, leader = found.front[found.trip == number], found.front[found.trip == 0]
        np.testing.assert_allclose(own[:, 1], 0.0, atol=1e-6)
        np.testing.assert_allclose(own[:, 0], leader[:, 0] - number * BEHIND_M, atol=0.05)


def test_alone_nothing_changes() -> None:
    found = walk(4.0, 1)
    assert len(found.trip) == 500
