"""Cells of designs."""

import itertools

import pytest

from urbantwin.errors import InputError
from urbantwin.experiments.grid import Axis, factorial, one_at_a_time

AXES = (Axis("rain", ("none", 200)), Axis("sway", (0, 0.01, 0.03)))


def test_one_at_a_time_moves_one_axis_from_the_base() -> None:
    cells = one_at_a_time(AXES)
    assert [one.name(AXES) for one in cells] == ["base", "rain=200", "sway=0.01", "sway=0.03"]
    assert all(len(one.varied(AXES)) <= 1 for one in cells)


def test_factorial_has_every_combination_once_the_base_first() -> None:
    cells = factorial(AXES)
    assert [tuple(one.levels.values()) for one in cells] == list(
        itertools.product(*(one.levels for one in AXES))
    )
    assert cells[0].name(AXES) == "base"
    with pytest.raises(InputError, match="1048576 combinations"):
        factorial([Axis(f"a{k}", (0, 1)) for k in range(20)])


def test_a_level_that_is_there_twice_is_found_however_it_is_written() -> None:
    assert Axis("a", (0, 1, 1.0)).repeated() == 1
    assert Axis("a", ("none", "b", "none")).repeated() == "none"
    assert Axis("a", (0, 1, "1")).repeated() is None
