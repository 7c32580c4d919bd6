"""Sizes of effects, against scipy and by hand."""

import itertools

import numpy as np
import pytest
from scipy import stats

from urbantwin.experiments.grid import Axis, Cell, factorial, one_at_a_time
from urbantwin.experiments.study.effects import (
    Measured,
    cliffs_delta,
    interactions_of,
    main_effects_of,
    paired_effect,
)

AXES = (Axis("a", (0, 1, 2)), Axis("b", ("none", "x")))


def test_a_difference_is_that_of_a_paired_t_test() -> None:
    draw = np.random.default_rng(3)
    for count in (2, 3, 8):
        base = draw.normal(0.6, 0.1, count)
        level = base + draw.normal(-0.05, 0.02, count)
        told = paired_effect(base, level)
        judge = stats.ttest_rel(level, base)
        ends = judge.confidence_interval(0.95)
        assert told["difference"] == pytest.approx(level.mean() - base.mean())
        assert (told["low"], told["high"]) == pytest.approx((ends.low, ends.high))
        # t of a paired test is d_z times the root of n.
        assert told["d_z"] * np.sqrt(count) == pytest.approx(judge.statistic)
        # With as many of both, the mean variance is the pooled one of an unpaired test.
        unpaired = stats.ttest_ind(level, base).statistic
        assert told["cohens_d"] == pytest.approx(unpaired * np.sqrt(2 / count))


def test_cliffs_delta_is_that_of_mann_and_whitney() -> None:
    draw = np.random.default_rng(5)
    base, level = draw.integers(0, 9, 12).astype(float), draw.integers(2, 11, 12).astype(float)
    u = stats.mannwhitneyu(level, base).statistic
    assert cliffs_delta(base, level) == pytest.approx(2 * u / 144 - 1)


def test_one_seed_has_no_interval_and_no_spread_no_size() -> None:
    told = paired_effect(np.array([0.5]), np.array([0.4]))
    assert told["low"] is told["high"] is told["cohens_d"] is told["d_z"] is None
    told = paired_effect(np.array([0.5, 0.5]), np.array([0.4, 0.4]))
    assert (told["low"], told["high"]) == pytest.approx((-0.1, -0.1))
    assert told["cohens_d"] is None


def figures(cell: Cell, seed: int) -> float:
    """A figure whose effects are known: of a level, of two together, and of the seed."""
    a, b = float(cell.levels["a"]), float(cell.levels["b"] == "x")
    return 10 * seed - 3 * a + 2 * b + 0.5 * a * b


def measured(cells: tuple[Cell, ...], seeds: tuple[int, ...] = (1, 2, 3)) -> list[Measured]:
    return [
        Measured(seed, cell, {"car": {"ap": figures(cell, seed)}})
        for seed, cell in itertools.product(seeds, cells)
    ]


def test_effects_of_one_factor_at_a_time_are_those_beside_the_base() -> None:
    rows = main_effects_of(measured(one_at_a_time(AXES)), AXES)
    told = {(row["factor"], row["level"]): row["difference"] for row in rows}
    assert told == pytest.approx({("a", "1"): -3, ("a", "2"): -6, ("b", "x"): 2})
    # Seeds differ by far more than levels do; paired, they take nothing from the certainty.
    assert all(row["low"] == pytest.approx(row["high"]) for row in rows)
    assert not interactions_of(measured(one_at_a_time(AXES)), AXES)


def test_effects_of_a_factorial_design_are_means_and_what_is_left_is_of_both() -> None:
    runs = measured(factorial(AXES))
    rows = main_effects_of(runs, AXES)
    told = {(row["factor"], row["level"]): row["difference"] for row in rows}
    # 0.5 a b on top: of b, over a = 0, 1, 2, its mean; of a, over b = 0, 1.
    assert told == pytest.approx({("a", "1"): -2.75, ("a", "2"): -5.5, ("b", "x"): 2.5})
    both = {row["level"]: row["difference"] for row in interactions_of(runs, AXES)}
    assert both == pytest.approx({"1": 0.5, "2": 1.0})


def test_what_failed_is_left_out_in_pairs() -> None:
    """A seed without a level says nothing of it, and a mean is over what both have."""
    runs = [one for one in measured(factorial(AXES)) if one.seed != 2 or one.cell.levels["a"] != 1]
    rows = {(row["factor"], row["level"]): row for row in main_effects_of(runs, AXES)}
    assert rows["a", "1"]["seeds"] == 2
    assert rows["a", "2"]["seeds"] == 3
    assert rows["a", "1"]["difference"] == pytest.approx(-2.75)
    seed_2 = rows["b", "x"]["difference"] * 3 - 2 * 2.5
    assert seed_2 == pytest.approx(2.5)  # over a = 0 and 2
