"""Which population is taken, of streets whose flow is known in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from urbantwin.traffic.demand.demand import Population
from urbantwin.traffic.flow.flow_calibration import (
    LONG_PILOTS,
    LONGEST_HALT_S,
    SURE,
    Calibrated,
    _in_the_long_run,
    _Pilot,
)


def streets(capacity: float, locks_up: float = np.inf) -> tuple[Callable[[float], _Pilot], list]:
    """Pilots of streets that carry as many as come up to a capacity (a triangular diagram's
    plateau), and where somebody stands for long once there are too many; and what was tried."""
    tried: list[float] = []

    def pilot(size: float) -> _Pilot:
        tried.append(size)
        halt_s = 2 * LONGEST_HALT_S if size > locks_up else 60.0
        return _Pilot(size, min(size, capacity), {}, {}, 1500, halt_s)

    return pilot, tried


def taken(first: float, most: float, pilot: Callable[[float], _Pilot]) -> _Pilot:
    """The pilot that is taken, of which so much was told that more was to come each time."""
    told: list[float] = []
    found = _in_the_long_run(first, most, pilot, told.append)
    assert told == sorted(set(told))
    assert 0.0 < told[0] <= told[-1] < 1.0
    return found


@pytest.mark.parametrize("first", [0.4, 0.7, 0.95, 1.0])
def test_what_can_be_carried_is_found_with_the_smallest_population(first: float) -> None:
    pilot, tried = streets(2.0)
    found = taken(first, 3.0, pilot)
    assert found.flow >= 0.94
    assert found.size <= 1.0 + 1e-9
    assert len(tried) <= LONG_PILOTS


@pytest.mark.parametrize("first", [0.4, 0.6, 0.9])
def test_beyond_capacity_more_vehicles_are_not_taken(first: float) -> None:
    pilot, tried = streets(0.7)
    found = taken(first, 3.0, pilot)
    assert found.flow == pytest.approx(min(0.7, max(tried)), abs=0.05)
    assert found.flow > 0.64
    assert found.size <= max(first, 0.7 * 1.25)


@pytest.mark.parametrize("first", [0.5, 0.8, 1.0])
def test_nobody_stands_for_long_in_the_population_that_is_taken(first: float) -> None:
    pilot, _ = streets(2.0, locks_up=0.6)
    found = taken(first, 3.0, pilot)
    assert 0.4 < found.size <= 0.6
    assert found.flow == pytest.approx(found.size, rel=0.3)


def test_streets_that_lock_up_with_a_fifth_of_the_traffic_carry_less_than_that() -> None:
    pilot, tried = streets(2.0, locks_up=0.2)
    found = taken(1.0, 3.0, pilot)
    assert 0.1 < found.size <= 0.2
    assert found.flow == pytest.approx(found.size)
    assert len(tried) <= LONG_PILOTS


def test_streets_that_always_lock_up_get_few_vehicles_and_are_asked_for_as_few() -> None:
    pilot, _ = streets(2.0, locks_up=0.0)
    found = taken(1.0, 3.0, pilot)
    assert 0 < found.flow == found.size < 0.1


def test_there_is_never_more_than_the_most_and_less_where_more_come_than_asked() -> None:
    pilot, tried = streets(2.0)
    assert taken(0.5, 0.6, pilot).size == 0.6
    assert max(tried) == 0.6
    assert taken(1.25, 3.0, pilot).size == pytest.approx(1.0)


def test_a_guess_is_what_was_carried_and_nothing_else_changes() -> None:
    """0.8 of 500 cars in the pilots are 380 asked for; people and cyclists stay as they are."""
    groups = [
        Population(name, 500.0, 9, 60.0, 400.0, 0) for name in ("car", "bicycle", "pedestrian")
    ]
    found = Calibrated(groups, 0.8).as_asked()
    assert [group.per_hour for group in found.populations] == [500 * 0.8 * SURE, 500.0, 500.0]
    assert [group.count for group in found.populations] == [9, 9, 9]
    assert found.carried == 1.0
