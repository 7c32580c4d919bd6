"""Fit of one group of parameters: search, identifiability, validation on other frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from urbantwin.fidelity.tuning.knobs import Knob
from urbantwin.fidelity.tuning.loss import Loss
from urbantwin.fidelity.tuning.study import Journal, Term, search

__all__ = [
    "AT_BOUND",
    "FITTED",
    "NOT_BETTER",
    "NOT_DETERMINED",
    "GroupFit",
    "Searching",
    "fit_group",
]

#: Distance from a bound, as a share of the range, below which a value is at the bound.
_AT_BOUND = 0.005
FITTED = "fitted"
NOT_DETERMINED = "not identifiable: kept"
AT_BOUND = "ended at its bound: kept"
NOT_BETTER = "no better on frames it was not fitted to: kept"
#: Step of finite differences, as a share of the range between the bounds.
_STEP = 0.015
#: Standard error, as that share, above which a parameter is not determined.
VAGUE = 0.08
#: Curvature below which a direction is flat, in losses for the bounds' distance squared.
_FLAT = 1e-3


@dataclass(frozen=True, eq=False)
class GroupFit:
    """Result of a group.

    Attributes:
        name: name of the group.
        values: values of its parameters, as written.
        state: state of each parameter: `FITTED`, `NOT_DETERMINED`, `AT_BOUND` or `NOT_BETTER`.
        sharp: standard error of each, as a share of the range between its bounds.
        history: the best loss after every trial.
        losses: by part, the loss at the start and at ``values``.
    """

    name: str
    values: dict[str, float]
    state: dict[str, str]
    sharp: dict[str, float]
    history: list[float]
    losses: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Searching:
    """Options of the search of groups: see `study.search`."""

    trials: int
    seed: int
    journal: Journal
    workers: int
    tell: Callable[[str, float], None]

    def search(
        self,
        name: str,
        knobs: Sequence[Knob],
        term: Term,
        fixed: dict[str, float],
        begin: dict[str, float],
        trials: int | None = None,
        spread: float = 0.12,
    ) -> tuple[dict[str, float], list[float]]:
        """Search a study; progress is reported under its name."""
        count = trials or self.trials
        return search(
            name,
            knobs,
            term,
            fixed=fixed,
            begin=begin,
            trials=count,
            seed=self.seed,
            journal=self.journal,
            spread=spread,
            workers=self.workers,
            tell=lambda done: self.tell(name, done / count),
        )


def fit_group(  # noqa: PLR0913 - independent options
    name: str,
    knobs: Sequence[Knob],
    training: Term,
    validation: Term | None,
    *,
    values: dict[str, float],
    begin: dict[str, float],
    searching: Searching,
    spread: float = 0.12,
    error: float = 1.0,
) -> GroupFit:
    """Fit the parameters of a group.

    Parameters that the training frames do not determine return to their start, and the others are
    searched again. If the result is not better on the validation frames, all return to their start.

    Args:
        name: name of the group.
        knobs: parameters of the group.
        training: loss on the training frames.
        validation: loss on the validation frames; ``None``: there are too few frames.
        values: values of all parameters before the fit.
        begin: start of the search.
        searching: options of the search.
        spread: initial standard deviation, as a share of the range between the bounds.
        error: factor of the standard errors from the scatter of the losses.
    """
    start = {one.name: one.start for one in knobs}
    found, history = searching.search(name, knobs, training, values, begin, spread=spread)
    sharp = sharpness(knobs, {**values, **found}, training)
    sharp = {name: error * one for name, one in sharp.items()}
    state = {one.name: FITTED if sharp[one.name] <= VAGUE else NOT_DETERMINED for one in knobs}
    for one in knobs:
        share = one.share(found[one.name])
        # zero is a valid value of a share
        if share > 1 - _AT_BOUND or (share < _AT_BOUND and one.low != 0.0):
            state[one.name] = AT_BOUND
    free = [one for one in knobs if state[one.name] == FITTED]
    if len(free) < len(knobs):
        kept = {one.name: one.start for one in knobs if one not in free}
        found |= kept
        if free:
            fixed = {**values, **kept}
            again, more = searching.search(
                f"{name}, again", free, training, fixed, found, searching.trials // 2, spread / 2
            )
            found |= again
            history += [min(x, history[-1]) for x in more]
    if validation is not None and found != start:
        worse, _ = validation({**values, **found}).worse_than(validation({**values, **start}))
        if worse >= 0:
            found = dict(start)
            state = {k: NOT_BETTER if v == FITTED else v for k, v in state.items()}
    losses = {
        part: (term({**values, **start}).mean, term({**values, **found}).mean)
        for part, term in (("training", training), ("validation", validation))
        if term is not None
    }
    return GroupFit(name, found, state, sharp, history, losses)


def sharpness(knobs: Sequence[Knob], values: dict[str, float], term: Term) -> dict[str, float]:
    """Return the standard error of each parameter, as a share of the range between its bounds.

    For the minimum of a mean of losses the covariance is ``H^-1 G H^-1`` (the sandwich of Huber
    1967), with the curvature H of the mean and the scatter G of the gradients of the sectors, which
    count as independent. ``inf`` if a parameter is part of a flat direction, in which others
    compensate for it.
    """
    count = len(knobs)
    middle = np.array([one.share(values[one.name]) for one in knobs])
    middle = np.clip(middle, _STEP, 1 - _STEP)

    def at(*moves: tuple[int, float]) -> Loss:
        shares = middle.copy()
        for knob, sign in moves:
            shares[knob] += sign * _STEP
        tried = {one.name: one.at(float(x)) for one, x in zip(knobs, shares, strict=True)}
        return term({**values, **tried})

    here = at().mean
    sides = [(at((k, 1.0)), at((k, -1.0))) for k in range(count)]
    curved = np.empty((count, count))
    for i in range(count):
        curved[i, i] = sides[i][0].mean + sides[i][1].mean - 2 * here
        for j in range(i):
            both = at((i, 1.0), (j, 1.0)).mean + at((i, -1.0), (j, -1.0)).mean
            alone = sum(one.mean for one in (*sides[i], *sides[j]))
            curved[i, j] = curved[j, i] = (both - alone + 2 * here) / 2
    curved /= _STEP**2
    weight = sides[0][0].weight
    slopes = np.array([(up.total - down.total) / (2 * _STEP) for up, down in sides])
    slopes -= slopes.sum(axis=1, keepdims=True) * weight / max(weight.sum(), 1e-12)
    there = max(int((weight > 0).sum()), 2)
    scatter = slopes @ slopes.T / max(weight.sum(), 1e-12) ** 2 * there / (there - 1)
    size, axes = np.linalg.eigh(curved)
    flat = size < _FLAT
    inverse = (axes / np.where(flat, np.inf, size)) @ axes.T
    error = np.sqrt(np.maximum(np.diag(inverse @ scatter @ inverse), 0.0))
    lost = (np.abs(axes[:, flat]) > 0.2).any(axis=1)
    error = np.where(lost, np.inf, error)
    return {one.name: float(x) for one, x in zip(knobs, error, strict=True)}
