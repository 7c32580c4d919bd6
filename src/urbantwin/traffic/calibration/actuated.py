"""Signals whose greens traffic extends: how long each phase lasted, at the least and at the most.

A fixed program shows the same phases for the same times again and again, or those of another
program from some time of day on. An actuated one shows the same phases, each as long as traffic
wants it, so that one time differs from the next again and again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["ActuatedCycle", "actuated_cycle"]

#: Groups that change within so long change together: tables have them some tenths late, seconds.
_TOGETHER_S = 0.35
#: A phase that lasts this much longer or shorter than the time before lasts otherwise, seconds: a
#: controller counts in seconds, and tables in tenths.
_OTHERWISE_S = 0.5
#: Of what follows on each other so many, and such a share, are otherwise where traffic extends a
#: phase.
_MANY, _SHARE = 5, 0.2
#: Such a share of the cycles has the phases in one order; else no such program could show them.
_ORDERED = 0.8

#: What each group shows, and for how long: seconds.
_Run = tuple[tuple[str, ...], float]


@dataclass(frozen=True)
class ActuatedCycle:
    """The phases of signals whose greens traffic extends, in their order.

    Attributes:
        groups: G of them.
        letters: (K,) what each group shows in each phase.
        seconds: (K,) how long phases last, median.
        at_least: (K,) the shortest that was seen, where traffic extends a phase; else the median.
        at_most: (K,) the longest, likewise.
        cycles: how many were seen whole and in this order.
        ordered: the share of all cycles that were.
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
        """Whether a program of phases in one order can show it."""
        return self.ordered >= _ORDERED

    def sampled(self, step_s: float) -> tuple[dict[str, NDArray[np.str_]], NDArray[np.int64]]:
        """Return what groups show in a usual cycle, every so many seconds, and in which phase."""
        counts = [round(one / step_s) for one in self.seconds]
        phase = np.repeat(np.arange(len(counts)), counts)
        return {
            group: np.array([one[k] for one in self.letters])[phase]
            for k, group in enumerate(self.groups)
        }, phase


def actuated_cycle(letters: Mapping[str, NDArray[np.str_]], step_s: float) -> ActuatedCycle | None:
    """Return the phases that were shown; ``None`` where they last as long again and again.

    Args:
        letters: group -> (N,) what it showed.
        step_s: time between two of these.
    """
    groups = tuple(sorted(letters))
    runs = _runs(np.array([letters[group] for group in groups]), step_s)
    cycles = _cycles(runs)
    if not cycles:
        return None
    orders = Counter(tuple(shown for shown, _ in one) for one in cycles)
    order = max(orders, key=lambda one: (orders[one], one))
    lasted = np.array(
        [[seconds for _, seconds in one] for one in cycles if tuple(x for x, _ in one) == order]
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
    seconds, at_least, at_most = (tuple(np.round(one, 1).tolist()) for one in (usual, least, most))
    return ActuatedCycle(
        groups, order, seconds, at_least, at_most, len(lasted), len(lasted) / len(cycles)
    )


def _varies(lasted: NDArray[np.float64]) -> bool:
    """Return whether how long a phase lasted (C,) differs from one time to the next, and often.

    Where another program begins, all last otherwise, but once.
    """
    otherwise = np.abs(np.diff(lasted)) > _OTHERWISE_S
    return bool(otherwise.sum() >= _MANY and otherwise.mean() >= _SHARE)


def _runs(letters: NDArray[np.str_], step_s: float) -> list[_Run]:
    """Return what all groups (G, N) show together, one after the other, without both ends."""
    cuts = np.flatnonzero((letters[:, 1:] != letters[:, :-1]).any(axis=0)) + 1
    runs: list[_Run] = []
    owed = 0.0
    for begin, end in pairwise(cuts.tolist()):
        seconds = (end - begin) * step_s
        if seconds < _TOGETHER_S:  # some have changed, and the others are about to
            owed += seconds
            continue
        runs.append((tuple(letters[:, begin].tolist()), seconds + owed))
        owed = 0.0
    return runs


def _cycles(runs: Sequence[_Run]) -> list[list[_Run]]:
    """Return the runs of each whole cycle: from one beginning of a group's green to the next.

    The group is the first of those whose green begins as often as most groups' does: some have
    green twice in a cycle, some not in each.
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
    often = Counter(len(found) for found in begins.values())
    usual = max(often, key=lambda count: (often[count], count))
    starts = next(begins[group] for group in sorted(begins) if len(begins[group]) == usual)
    return [list(runs[first:last]) for first, last in pairwise(starts)]
