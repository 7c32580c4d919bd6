"""Search for parameter values by optuna, and the journal from which it resumes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from urbantwin.fidelity.tuning.knobs import Knob
from urbantwin.fidelity.tuning.loss import Loss

if TYPE_CHECKING:
    import optuna
import json
from pathlib import Path
from types import TracebackType

from urbantwin.artefact.document import json_value
from urbantwin.errors import InputError

__all__ = ["Journal", "Term", "search"]


class Journal:
    """Losses by study and trial, one line of JSON each.

    A study is deterministic: when restarted, it requests the same values in the same order, so
    recorded losses need not be computed again. Lines of another recipe are dropped.

    Args:
        path: the journal file; created if missing.
        recipe: hash of everything that the fit depends on.
    """

    def __init__(self, path: Path, recipe: str) -> None:
        self._path = path
        self._kept: dict[tuple[str, int], tuple[list[float], float]] = {}
        lines = (
            path.read_text(errors="replace", encoding="utf-8").splitlines()
            if path.is_file()
            else []
        )
        ours = bool(lines) and lines[0] == json.dumps({"recipe": recipe})
        for line in lines[1:] if ours else ():
            try:
                one = json_value(line, file=path, expected="a trial")
                key = (str(one["study"]), int(one["trial"]))
                self._kept[key] = ([float(x) for x in one["shares"]], float(one["loss"]))
            except (InputError, ValueError, KeyError, TypeError):
                break  # an incomplete last line of an interrupted run
        self._stream = path.open("w", encoding="utf-8")
        self._write({"recipe": recipe})
        for (study, trial), (shares, loss) in self._kept.items():
            self._write({"study": study, "trial": trial, "shares": shares, "loss": loss})

    def recall(self, study: str, trial: int, shares: list[float]) -> float | None:
        """Return the loss of a recorded trial; ``None`` if it is not recorded."""
        kept = self._kept.get((study, trial))
        return kept[1] if kept is not None and kept[0] == shares else None

    def keep(self, study: str, trial: int, shares: list[float], loss: float) -> None:
        """Record the loss of a trial."""
        if (study, trial) not in self._kept:
            self._write({"study": study, "trial": trial, "shares": shares, "loss": loss})

    def _write(self, line: dict[str, object]) -> None:
        self._stream.write(json.dumps(line) + "\n")
        self._stream.flush()

    def __enter__(self) -> Journal:
        """Return the journal."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the journal; without an error, delete it."""
        self._stream.close()
        if kind is None:
            self._path.unlink(missing_ok=True)


#: Loss of parameter values.
Term = Callable[[dict[str, float]], Loss]

#: Trials requested together, independent of the workers so that results are, too.
_TOGETHER = 8
#: Weight of the penalty for values off their start, which holds undetermined parameters.
_PULL = 2e-3
#: Share of the trials that refine the best one along conjugate directions (Powell 1964).
_POLISH = 0.5


def search(  # noqa: PLR0913 - independent options
    name: str,
    knobs: Sequence[Knob],
    term: Term,
    *,
    fixed: dict[str, float],
    begin: dict[str, float],
    trials: int,
    seed: int,
    journal: Journal,
    spread: float = 0.12,
    workers: int = 1,
    tell: Callable[[int], None] | None = None,
) -> tuple[dict[str, float], list[float]]:
    """Return the parameter values with the smallest loss, and the best loss after every trial.

    Uses CMA-ES (Hansen 2016, arXiv 1604.00772) in optuna, or for one parameter its tree-structured
    Parzen estimator, from ``begin``. The last trials refine the best one along conjugate
    directions. The result depends on neither the workers nor the journal.

    Args:
        name: name of the study in the journal.
        knobs: the parameters to search.
        term: the loss.
        fixed: values of all other parameters.
        begin: start values.
        trials: number of trials.
        seed: seed of the sampler.
        journal: recorded trials of earlier runs.
        spread: initial standard deviation, as a share of the range between the bounds.
        workers: threads that compute trials.
        tell: called with the number of finished trials.
    """
    origin = np.array([one.share(one.start) for one in knobs])
    first = [one.share(begin[one.name]) for one in knobs]
    history: list[float] = []

    def loss_at(shares: Sequence[float]) -> float:
        values = {one.name: one.at(x) for one, x in zip(knobs, shares, strict=True)}
        pull = _PULL * float(((np.asarray(shares) - origin) ** 2).sum()) * 4
        return term({**fixed, **values}).mean + pull

    def remembered(trial: int, shares: Sequence[float]) -> float:
        asked = [float(x) for x in shares]
        loss = journal.recall(name, trial, asked)
        return loss_at(asked) if loss is None else loss

    def note(trial: int, shares: Sequence[float], loss: float) -> None:
        journal.keep(name, trial, [float(x) for x in shares], loss)
        history.append(min(loss, history[-1] if history else np.inf))
        if tell is not None:
            tell(len(history))

    import optuna

    polish = int(_POLISH * trials)
    with warnings.catch_warnings(), ThreadPoolExecutor(workers) as pool:
        warnings.simplefilter("ignore")  # optuna marks samplers as experimental
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        study = optuna.create_study(sampler=_sampler(knobs, first, seed, spread))
        names = [one.name for one in knobs]
        study.enqueue_trial(dict(zip(names, first, strict=True)))
        while len(history) < max(1, trials - polish):
            count = min(_TOGETHER, max(1, trials - polish) - len(history))
            if not history:
                count = 1  # the start values alone
            asked = [study.ask() for _ in range(count)]
            shares = [[one.suggest_float(key, 0.0, 1.0) for key in names] for one in asked]
            losses = list(pool.map(remembered, [one.number for one in asked], shares))
            for trial, point, loss in zip(asked, shares, losses, strict=True):
                note(trial.number, point, loss)
                study.tell(trial, loss)
    found = [study.best_params[key] for key in names]
    if polish > len(names) + 1:
        number = len(history)

        def step(shares: np.ndarray) -> float:
            nonlocal number
            point = [float(x) for x in np.clip(shares, 0.0, 1.0)]
            loss = remembered(number, point)
            note(number, point, loss)
            number += 1
            return loss

        best = study.best_value
        while number < trials:
            polished = minimize(
                step,
                found,
                method="Powell",
                bounds=[(0.0, 1.0)] * len(found),
                options={"maxfev": trials - number, "xtol": 1e-3, "ftol": 1e-6},
            )
            if not polished.fun < best - 1e-7:
                break
            found, best = list(polished.x), float(polished.fun)
    return {one.name: one.at(float(x)) for one, x in zip(knobs, found, strict=True)}, history


def _sampler(
    knobs: Sequence[Knob], first: Sequence[float], seed: int, spread: float
) -> optuna.samplers.BaseSampler:
    import optuna

    if len(knobs) == 1:
        return optuna.samplers.TPESampler(seed=seed, n_startup_trials=8)
    return optuna.samplers.CmaEsSampler(
        x0={one.name: float(np.clip(x, 0.02, 0.98)) for one, x in zip(knobs, first, strict=True)},
        sigma0=spread,
        seed=seed,
        popsize=max(_TOGETHER, 4 + int(3 * np.log(len(knobs)))),
    )
