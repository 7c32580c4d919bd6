"""The search for layouts that no other is better than in every way, by optuna."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from urbantwin.studies.placement.judge import Verdict
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.view import Layout, Views

if TYPE_CHECKING:
    import optuna

__all__ = ["Found", "pareto_front", "possible_layouts", "search"]

#: Number of layouts per generation; fixed, so that results do not depend on the workers.
TOGETHER = 40
#: The search ends after this number of trials in a row without a new layout that may be judged.
_PATIENCE = 40 * TOGETHER


@dataclass(frozen=True)
class Found:
    """An evaluated layout.

    Attributes:
        layout: its views.
        verdict: its evaluation.
    """

    layout: Layout
    verdict: Verdict


def search(
    views: Views,
    judge: Callable[[Sequence[Layout]], Sequence[Verdict]],
    *,
    layouts: int,
    seed: int,
    first: Sequence[Layout] = (),
    tell: Callable[[int], None] | None = None,
) -> list[Found]:
    """Return distinct layouts in order of evaluation.

    NSGA-II (Deb et al. 2002, IEEE Transactions on Evolutionary Computation 6:182) in optuna. The
    budget, and distinct places of sensors, are constraints: layouts that break them are never
    evaluated. With a budget the first layout is a cheapest one, so that at least one is feasible.
    If there are at most ``layouts`` layouts, all are evaluated. The same arguments give the same
    layouts.

    Args:
        views: views that layouts consist of.
        judge: evaluates several layouts together.
        layouts: number of layouts to evaluate, or fewer if there are fewer.
        seed: random seed of the sampler.
        first: initial layouts.
        tell: called with the number of evaluated layouts.
    """
    import optuna

    spec = views.spec
    names = spec.objectives
    known: dict[Layout, Verdict] = {}
    found: list[Found] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about experimental features
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        sampler = optuna.samplers.NSGAIISampler(
            population_size=TOGETHER,
            seed=seed,
            constraints_func=lambda trial: trial.user_attrs["too_much"],
        )
        study = optuna.create_study(
            directions=[MEASURES[name].direction for name in names], sampler=sampler
        )
        worst = [-1e12 if MEASURES[name].more else 1e12 for name in names]

        def judge_new(asked: Sequence[Layout]) -> None:
            new = list(dict.fromkeys(one for one in asked if one not in known))
            new = new[: layouts - len(found)]
            for layout, verdict in zip(new, judge(new), strict=True):
                known[layout] = verdict
                found.append(Found(layout, verdict))
            if new and tell is not None:
                tell(len(found))

        cheapest = [] if spec.budget is None else [views.cheapest()]
        judge_new([one for one in (*first, *cheapest) if not _too_much(views, one)])
        if possible_layouts(views) <= layouts:
            every = [one for one in _every_layout(views) if not _too_much(views, one)]
            for begin in range(0, len(every), TOGETHER):
                judge_new(every[begin : begin + TOGETHER])
            return found
        vain = 0
        while len(found) < layouts and vain < _PATIENCE:
            trials = [study.ask() for _ in range(TOGETHER)]
            asked = [_suggested(trial, views) for trial in trials]
            before = len(found)
            judge_new([one for one in asked if not _too_much(views, one)])
            vain = vain + TOGETHER if len(found) == before else 0
            for trial, layout in zip(trials, asked, strict=True):
                excess = _too_much(views, layout)
                trial.set_user_attr("too_much", (float(excess),))
                verdict = known.get(layout)
                values = worst if verdict is None else [verdict.values[name] for name in names]
                study.tell(trial, values)
    return found


def _every_layout(views: Views) -> Iterator[Layout]:
    counts = range(views.spec.sensors.least, views.spec.sensors.most + 1)
    for count in counts:
        yield from combinations(range(len(views.every)), count)


def _suggested(trial: optuna.Trial, views: Views) -> Layout:
    """Return the layout of a trial; all slots are sampled, so that crossover is meaningful."""
    spec = views.spec
    count = trial.suggest_int("sensors", spec.sensors.least, spec.sensors.most)
    chosen = []
    for slot in range(spec.sensors.most):
        choices = [
            trial.suggest_int(f"{name}-{slot}", 0, size - 1)
            for name, size in (
                ("mount", len(views.mounts)),
                ("height", max(len(one.heights_m) for one in views.mounts)),
                ("model", len(spec.models)),
                ("tilt", len(spec.tilt_deg)),
                ("yaw", len(spec.yaw_deg)),
            )
        ]
        chosen.append(views.chosen(*choices))
    return tuple(sorted(chosen[:count]))


def _too_much(views: Views, layout: Layout) -> float:
    """Return by how much a layout violates the constraints; 0 if it does not."""
    budget = views.spec.budget
    over = 0.0 if budget is None else max(0.0, views.cost(layout) / max(budget, 1e-9) - 1.0)
    return over + (0.0 if views.fits(layout) else 1.0)


def possible_layouts(views: Views) -> int:
    """Return an upper bound of the number of layouts, regardless of cost."""
    places = sum(len(one.heights_m) for one in views.mounts)
    per_place = len(views.every) / max(places, 1)
    counts = range(views.spec.sensors.least, views.spec.sensors.most + 1)
    return int(sum(math.comb(places, k) * per_place**k for k in counts) + 0.5)


def pareto_front(found: Sequence[Found], objectives: Sequence[str]) -> list[int]:
    """Return the numbers of the Pareto-optimal layouts.

    Args:
        found: the layouts.
        objectives: names of the objectives.
    """
    signs = np.array([1.0 if MEASURES[name].more else -1.0 for name in objectives])
    values = np.array([[one.verdict.values[name] for name in objectives] for one in found])
    values = values.reshape(len(found), len(objectives)) * signs
    front = []
    for number, own in enumerate(values):
        as_good = (values >= own).all(axis=1)
        better = (values > own).any(axis=1)
        if not (as_good & better).any():
            front.append(number)
    return front
