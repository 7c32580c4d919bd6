"""Actuated signals: the observed, shortest and longest duration of each phase.

A fixed program repeats the same phases with the same durations, or switches to another program at
some time of day. An actuated one repeats the same phases, but their durations depend on traffic and
differ from cycle to cycle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["ActuatedCycle", "actuated_cycle"]

#: Changes of groups within this time count as simultaneous: tables record them some tenths late,
#: seconds.
_SAME_CHANGE_S = 0.35
#: A larger difference to the previous duration counts as a change, seconds: controllers count in
#: seconds, tables in tenths.
_DURATION_CHANGE_S = 0.5
#: Number and share of changes among consecutive durations from which a phase counts as actuated.
_MIN_CHANGES, _MIN_CHANGE_SHARE = 5, 0.2
#: Least share of the cycles with the same order of phases, without which no such program can show
#: them.
_MIN_ORDERED_SHARE = 0.8

#: State of each group, and its duration in seconds.
_Run = tuple[tuple[str, ...], float]


@dataclass(frozen=True)
class ActuatedCycle:
    """The phases of actuated signals, in their order.

    Attributes:
        groups: G groups.
        letters: (K,) state of each group in each phase.
        seconds: (K,) median duration of each phase.
        at_least: (K,) shortest observed duration of actuated phases; else the median.
        at_most: (K,) longest observed duration of actuated phases; else the median.
        cycles: number of complete cycles observed in this order.
        ordered: share of all cycles with this order.
    """

    groups: tuple[str, ...]
    letters: tuple[tuple[str, ...], ...]
    seconds: tuple[float, ...]
    at_least: tuple[float, ...]
    at_most: tuple[float, ...]
    cycles: int
    ordered: float

    @property
    def driven(self) -> bool:
        """Whether a program with phases in one order can show it."""
        return self.ordered >= _MIN_ORDERED_SHARE

    def sampled(self, step_s: float) -> tuple[dict[str, NDArray[np.str_]], NDArray[np.int64]]:
        """Return the states of groups, and the phase, of a usual cycle at regular times."""
        counts = [round(phase_s / step_s) for phase_s in self.seconds]
        phase = np.repeat(np.arange(len(counts)), counts)
        return {
            group: np.array([letters[k] for letters in self.letters])[phase]
            for k, group in enumerate(self.groups)
        }, phase


def actuated_cycle(letters: Mapping[str, NDArray[np.str_]], step_s: float) -> ActuatedCycle | None:
    """Return the phases of actuated signals; ``None`` if their durations are fixed.

    Args:
        letters: group -> (N,) states.
        step_s: time between two states, seconds.
    """
    groups = tuple(sorted(letters))
    runs = _runs(np.array([letters[group] for group in groups]), step_s)
    cycles = _cycles(runs)
    if not cycles:
        return None
    orders = Counter(tuple(shown for shown, _ in cycle) for cycle in cycles)
    order = max(orders, key=lambda phases: (orders[phases], phases))
    lasted = np.array(
        [
            [seconds for _, seconds in cycle]
            for cycle in cycles
            if tuple(x for x, _ in cycle) == order
        ]
    )
    extended = np.array(
        [
            bool(_varies(column) and set(shown) & set("Gg") and not set(shown) & set("yu"))
            for shown, column in zip(order, lasted.T, strict=True)
        ]
    )
    if not extended.any():
        return None
    usual = np.median(lasted, axis=0)
    least, most = (np.where(extended, f(lasted, axis=0), usual) for f in (np.min, np.max))
    seconds, at_least, at_most = (
        tuple(np.round(durations_s, 1).tolist()) for durations_s in (usual, least, most)
    )
    return ActuatedCycle(
        groups, order, seconds, at_least, at_most, len(lasted), len(lasted) / len(cycles)
    )


def _varies(lasted: NDArray[np.float64]) -> bool:
    """Return whether the durations of a phase (C,) often differ from one cycle to the next.

    A change of the program changes all of them, but only once.
    """
    otherwise = np.abs(np.diff(lasted)) > _DURATION_CHANGE_S
    return bool(otherwise.sum() >= _MIN_CHANGES and otherwise.mean() >= _MIN_CHANGE_SHARE)


def _runs(letters: NDArray[np.str_], step_s: float) -> list[_Run]:
    """Return the joint states of all groups (G, N) with durations, without the first and last."""
    cuts = np.flatnonzero((letters[:, 1:] != letters[:, :-1]).any(axis=0)) + 1
    runs: list[_Run] = []
    owed = 0.0
    for begin, end in pairwise(cuts.tolist()):
        seconds = (end - begin) * step_s
        if seconds < _SAME_CHANGE_S:  # some groups have changed, the others are about to
            owed += seconds
            continue
        runs.append((tuple(letters[:, begin].tolist()), seconds + owed))
        owed = 0.0
    return runs


def _cycles(runs: Sequence[_Run]) -> list[list[_Run]]:
    """Return the runs of each complete cycle: between two consecutive begins of green of a group.

    The group is the first whose number of green begins is the most common: some groups have green
    twice in a cycle, some not in each.
    """
    if not runs:
        return []
    begins: dict[int, list[int]] = {}
    for k, ((before, _), (now, _)) in enumerate(pairwise(runs)):
        for group, (was, is_now) in enumerate(zip(before, now, strict=True)):
            if is_now in "Gg" and was not in "Gg":
                begins.setdefault(group, []).append(k + 1)
    if not begins:
        return []
    often = Counter(len(starts_of_group) for starts_of_group in begins.values())
    usual = max(often, key=lambda count: (often[count], count))
    starts = next(begins[group] for group in sorted(begins) if len(begins[group]) == usual)
    return [list(runs[first:last]) for first, last in pairwise(starts)]
