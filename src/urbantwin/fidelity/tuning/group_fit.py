"""One group of knobs: searched, examined, proved on frames that it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from urbantwin.fidelity.tuning.journal import Journal
from urbantwin.fidelity.tuning.knobs import Knob
from urbantwin.fidelity.tuning.sharpness import VAGUE, sharpness
from urbantwin.fidelity.tuning.study import Term, search

__all__ = [
    "AT_BOUND",
    "FITTED",
    "NOT_BETTER",
    "NOT_DETERMINED",
    "GroupFit",
    "Searching",
    "fit_group",
]

#: Nearer to a bound than this share of the way between them is at it.
_AT_BOUND = 0.005
FITTED = "fitted"
NOT_DETERMINED = "not identifiable: kept"
AT_BOUND = "ended at its bound: kept"
NOT_BETTER = "no better on frames it was not fitted to: kept"


@dataclass(frozen=True, eq=False)
class GroupFit:
    """What became of a group.

    Attributes:
        name: of the group.
        values: of its knobs, as they are to be written.
        state: of each knob: one of `FITTED`, `NOT_DETERMINED`, `AT_BOUND`, `NOT_BETTER`.
        sharp: standard error of each, as a share of the distance between its bounds.
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
    """How groups are searched: see `study.search`."""

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
        """Search, with progress told by the name of the study."""
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


def fit_group(  # noqa: PLR0913 - every one is a choice of its own
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
    """Fit the knobs of a group.

    What the training frames do not determine goes back to its start, and the others are searched
    again without it. What then is no better on the validation frames goes back as a whole.

    Args:
        name: of the group.
        knobs: of the group.
        training: loss on the frames that are fitted to.
        validation: the same on those that decide; ``None``: there are too few frames.
        values: of all knobs, before the fit.
        begin: where the search begins.
        searching: how.
        spread: of the first trials, as a share of the bounds' distance.
        error: times the standard errors that the scatter of the losses shows.
    """
    start = {one.name: one.start for one in knobs}
    found, history = searching.search(name, knobs, training, values, begin, spread=spread)
    sharp = sharpness(knobs, {**values, **found}, training)
    sharp = {name: error * one for name, one in sharp.items()}
    state = {one.name: FITTED if sharp[one.name] <= VAGUE else NOT_DETERMINED for one in knobs}
    for one in knobs:
        share = one.share(found[one.name])
        # A share of nothing is a value like any other.
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
