"""Figures of layouts in closed form, and the search against enumeration."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from urbantwin.studies.placement.judge import Judge
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.search import Found, pareto_front, possible_layouts, search
from urbantwin.studies.placement.sighting import NOBODY, Sighting
from urbantwin.studies.placement.view import Views


def sighting(question, points, **other):
    """Return what a view sees of hand-made points on the targets."""
    count, squares = len(question.recipe.moments.targets), len(question.recipe.squares.crossing)
    made = Sighting(
        np.asarray(points, np.float32),
        np.asarray(points, np.float32),
        np.full(count, NOBODY, np.int32),
        np.zeros(count, np.float32),
        np.full(count, 15.0, np.float32),
        np.ones(squares, bool),
        np.ones(squares, np.float32),
        np.ones(len(question.recipe.voxels.entropy), bool),
    )
    return made._replace(**other)


@pytest.fixture(scope="module")
def judge(question):
    return Judge(question.recipe.moments, question.recipe.squares, question.recipe.voxels)


def test_shares_points_and_the_failure_that_is_missed_most(question, judge):
    track = question.recipe.moments.targets.track
    # Actors 1 and 2 by the first sensor, 2 and 3 by the second; 4 by neither alone.
    first = sighting(question, np.select([track == 1, track == 2, track == 4], [60, 20, 3], 0))
    second = sighting(question, np.select([track == 2, track == 3, track == 4], [5, 5, 2], 0))
    verdict = judge.verdict([first, second], 1234.0)
    share = {n: (track == n).mean() for n in range(1, 5)}
    found = verdict.values
    assert found["cost"] == 1234.0
    assert found["seen_5"] == pytest.approx(1.0)
    assert found["seen_20"] == pytest.approx(share[1] + share[2], abs=1e-6)
    assert found["seen_50"] == pytest.approx(share[1], abs=1e-6)
    assert found["points"] == pytest.approx(
        60 * share[1] + 25 * share[2] + 5 * share[3] + 5 * share[4], abs=1e-5
    )
    without_first, without_second = share[2] + share[3], share[1] + share[2]
    assert found["seen_5_one_failed"] == pytest.approx(min(without_first, without_second), abs=1e-6)
    assert found["seen_5_by_two"] == pytest.approx(share[2], abs=1e-6)
    assert found["unseen_longest_s"] == 0
    low, high = verdict.intervals["seen_20"]
    assert low <= found["seen_20"] <= high
    assert set(verdict.values) == set(MEASURES)


def test_the_longest_time_unseen_is_a_run_of_moments(question, judge):
    targets = question.recipe.moments.targets
    points = np.full(len(targets), 9.0)
    # Of six moments of actor 1: seen, not, not, seen, not, seen.
    rows = np.flatnonzero(targets.track == 1)
    assert len(rows) == 6
    points[rows] = [9, 4, 0, 5, 4.4, 6]
    (longest,) = {*judge.longest_unseen_s(points)} - {0.0}
    assert longest == pytest.approx(2 * question.recipe.moments.step_s)
    verdict = judge.verdict([sighting(question, points)], 0.0)
    assert verdict.values["unseen_longest_s"] == pytest.approx(0.8)
    assert verdict.values["unseen_mean_s"] == pytest.approx(0.8 / 4)


def test_uniformity_density_blind_area_and_entropy(question, judge):
    squares, count = question.recipe.squares, len(question.recipe.squares.crossing)
    points = np.zeros(len(question.recipe.moments.targets))
    even = judge.verdict([sighting(question, points)], 0.0).values
    assert even["nuc"] == 0
    assert even["density_per_m2"] == pytest.approx(1 / 4)
    assert even["blind_m2"] == 0
    assert even["entropy_nats"] == pytest.approx(question.recipe.voxels.entropy.sum())
    ground = np.zeros(count, np.float32)
    ground[: count // 2] = 2.0
    sees = np.ones(count, bool)
    sees[squares.crossing] = False
    half = sighting(
        question,
        points,
        ground=ground,
        sees=sees,
        passed=np.zeros(len(question.recipe.voxels.entropy), bool),
    )
    found = judge.verdict([half], 0.0).values
    # Half of the areas have twice the mean, the others none: a standard deviation of 1.
    assert found["nuc"] == pytest.approx(1.0, abs=0.01)
    assert found["blind_m2"] == found["blind_crossings_m2"] == 4.0 * squares.crossing.sum()
    assert found["entropy_nats"] == 0
    both = judge.verdict([half, sighting(question, points)], 0.0).values
    assert both["blind_m2"] == 0


def test_intervals_hold_the_mean_of_other_actors(question):
    """Of 1,000 sets of actors with a known share, about 95 % of intervals hold it."""
    targets = question.recipe.moments.targets
    tracks = np.arange(40)
    many = replace(
        question.recipe.moments,
        targets=replace(
            targets,
            moment=np.zeros(40, np.int64),
            actor=tracks,
            track=tracks,
            kind=np.full(40, "car"),
            middle=np.zeros((40, 3)),
            size=np.ones((40, 3)),
            yaw=np.zeros(40),
        ),
    )
    judge = Judge(many, question.recipe.squares, question.recipe.voxels)
    random = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        points = 20.0 * (random.random(40) < 0.6)
        one = sighting(question, np.zeros(len(targets)))._replace(
            points=points.astype(np.float32), range_m=np.zeros(40, np.float32)
        )
        low, high = judge.verdict([one], 0.0).intervals["seen_20"]
        held += low <= 0.6 <= high
    assert 0.88 <= held / 200 <= 0.99


def every_layout(views):
    for count in (1, 2):
        for layout in itertools.combinations(range(len(views.every)), count):
            if views.fits(layout):
                yield layout


def test_there_are_as_many_layouts_as_said(question):
    layouts = list(every_layout(question.views))
    assert len(layouts) == possible_layouts(question.views)


def test_costs_count_a_new_pole_once(question):
    views = question.views
    low, high = views.chosen(0, 0, 0, 0, 0), views.chosen(0, 1, 0, 0, 0)
    mapped = views.chosen(1, 0, 0, 0, 0)
    assert views.cost((low,)) == 4000 + 800 + 6000
    assert views.cost((low, high)) == 2 * 4800 + 6000
    assert views.cost((low, mapped)) == 2 * 4800 + 6000
    assert views.cost((mapped,)) == 4800 == views.cost(views.cheapest())
    assert views.fits((low, high))
    assert not views.fits((low, views.chosen(0, 0, 0, 1, 0)))


@pytest.mark.parametrize("least", [1, 2, 3, 4, 5])
def test_the_cheapest_layout_is_the_cheapest_of_all(question, least):
    spec = question.spec.model_copy(
        update={"sensors": question.spec.sensors.model_copy(update={"least": least, "most": least})}
    )
    views = Views(spec, question.mounts.every)
    cheapest = min(
        views.cost(layout)
        for layout in itertools.combinations(range(len(views.every)), least)
        if views.fits(layout)
    )
    assert views.fits(views.cheapest())
    assert views.cost(views.cheapest()) == cheapest


def verdicts(judge, casts, views):
    return lambda layouts: [judge.verdict(casts.of(one), views.cost(one)) for one in layouts]


@pytest.mark.thorough
def test_a_search_that_judges_all_finds_the_front_of_all(question, judge, casts):
    judged = verdicts(judge, casts, question.views)
    every = list(every_layout(question.views))
    found = search(question.views, judged, layouts=1000, seed=1)
    assert {one.layout for one in found} == set(every)
    assert len(found) == len(every)
    names = question.spec.objectives
    signs = [1 if MEASURES[name].more else -1 for name in names]
    values = {one.layout: [s * one.verdict.values[n] for s, n in zip(signs, names, strict=True)]
              for one in found}  # fmt: skip
    best = {
        layout
        for layout, own in values.items()
        if not any(
            all(a >= b for a, b in zip(other, own, strict=True)) and other != own
            for other in values.values()
        )
    }
    assert {found[k].layout for k in pareto_front(found, names)} == best


def test_a_search_with_a_budget_begins_with_a_cheapest_layout(question, judge, casts):
    cheapest = question.views.cheapest()
    budget = question.views.cost(cheapest)
    spec = question.spec.model_copy(update={"budget": budget})
    views = Views(spec, question.mounts.every)
    found = search(views, verdicts(judge, casts, views), layouts=1, seed=5)
    assert [one.layout for one in found] == [cheapest]


@pytest.mark.thorough
def test_a_search_keeps_to_its_budget_and_comes_out_the_same(question, judge, casts):
    spec = question.spec.model_copy(update={"budget": 11_000.0})
    views = Views(spec, question.mounts.every)
    judged = verdicts(judge, casts, views)
    found = search(views, judged, layouts=12, seed=5)
    assert 1 < len(found) <= 12
    assert len({one.layout for one in found}) == len(found)
    assert max(one.verdict.values["cost"] for one in found) <= 11_000
    again = search(views, judged, layouts=12, seed=5)
    assert [one.layout for one in again] == [one.layout for one in found]
    other = search(views, judged, layouts=12, seed=6)
    assert [one.layout for one in other] != [one.layout for one in found]


def test_equal_layouts_are_both_on_the_front(question, judge):
    verdict = judge.verdict(
        [sighting(question, np.zeros(len(question.recipe.moments.targets)))], 5.0
    )
    twice = [Found((0,), verdict), Found((1,), verdict)]
    assert pareto_front(twice, ["cost", "seen_20"]) == [0, 1]
