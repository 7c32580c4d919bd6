"""Effects of factors: paired over seeds, with intervals and effect sizes.

Every seed's motion is replayed under all cells, so two cells of a seed differ in their factors
only. The effect of a level is the mean over seeds of its difference to the base level; the interval
is Student's for paired differences (Student 1908, Biometrika 6(1)). Effect sizes are Cohen's d, the
difference over the standard deviation of both levels (Cohen 1988, Statistical Power Analysis,
section 2.2, with their mean variance); d_z, over that of the differences (section 2.3); and Cliff's
delta, the probability that one is greater minus that it is smaller (Cliff 1993, Psychological
Bulletin 114(3)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from urbantwin.experiments.grid import Axis, Cell, Level, level_text

__all__ = ["Measured", "cliffs_delta", "interactions_of", "main_effects_of", "paired_effect"]

_SURE = 0.95


@dataclass(frozen=True)
class Measured:
    """The figures of one recording of a study.

    Attributes:
        seed: seed of the motion.
        cell: levels of the factors.
        figures: figures by class, then by name.
        objects: number of objects that count, by class.
    """

    seed: int
    cell: Cell
    figures: Mapping[str, Mapping[str, float]]
    objects: Mapping[str, int] = field(default_factory=dict)


def cliffs_delta(base: NDArray[np.float64], level: NDArray[np.float64]) -> float:
    """Return Cliff's delta, -1..1, of ``level`` against ``base``."""
    apart = np.sign(level[:, None] - base[None, :])
    return float(apart.mean())


def paired_effect(base: NDArray[np.float64], level: NDArray[np.float64]) -> dict[str, Any]:
    """Return the effect of a level, from its figures (N,) and the base's for the same seeds.

    ``difference`` with ``low`` and ``high`` (95 %; ``None`` with one seed), ``cohens_d``, ``d_z``
    (``None`` without variance), ``cliffs_delta`` and ``seeds``.
    """
    apart = level - base
    count = len(apart)
    middle = float(apart.mean())
    low = high = cohen = within = None
    if count > 1:
        spread = float(apart.std(ddof=1))
        reach = float(student.ppf((1 + _SURE) / 2, count - 1)) * spread / np.sqrt(count)
        low, high = middle - float(reach), middle + float(reach)
        both = float(np.sqrt((base.var(ddof=1) + level.var(ddof=1)) / 2))
        cohen = middle / both if both > 1e-12 else None
        within = middle / spread if spread > 1e-12 else None
    return {
        "seeds": count,
        "base_mean": float(base.mean()),
        "level_mean": float(level.mean()),
        "difference": middle,
        "low": low,
        "high": high,
        "cohens_d": cohen,
        "d_z": within,
        "cliffs_delta": cliffs_delta(base, level),
    }


def main_effects_of(measured: Sequence[Measured], axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """Return a row per non-base level, class and figure of each factor; see `paired_effect`.

    For a factorial design, each seed's difference is the mean over the levels of all other factors.

    Args:
        measured: figures of all recordings.
        axes: the factors.
    """
    rows = []
    for axis in axes:
        for level in axis.levels[1:]:
            for name, figure in _figures(measured):
                found = _matched(measured, [axis], [{}, {axis.name: level}], name, figure)
                if found:
                    base, other = np.array([np.mean(values, axis=0) for values in found]).T
                    rows.append(
                        {
                            "factor": axis.name,
                            "level": level_text(level),
                            "base_level": level_text(axis.base),
                            "class": name,
                            "figure": figure,
                            **paired_effect(base, other),
                        }
                    )
    return rows


def interactions_of(measured: Sequence[Measured], axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """Return a row per pair of levels of two factors that were measured together.

    ``difference`` is the joint effect minus the sum of the single effects, averaged per seed over
    all other factors, with its interval over seeds.

    Args:
        measured: figures of a factorial design; other designs have no interactions.
        axes: the factors.
    """
    rows = []
    for one, other in combinations(axes, 2):
        for first, second in product(one.levels[1:], other.levels[1:]):
            alone, beside = {one.name: first}, {other.name: second}
            for name, figure in _figures(measured):
                found = _matched(
                    measured, [one, other], [{}, alone, beside, alone | beside], name, figure
                )
                beyond = [np.mean(v[:, 3] - v[:, 1] - v[:, 2] + v[:, 0]) for v in found]
                if beyond:
                    effect = paired_effect(np.zeros(len(beyond)), np.array(beyond))
                    rows.append(
                        {
                            "factor": one.name,
                            "level": level_text(first),
                            "other_factor": other.name,
                            "other_level": level_text(second),
                            "class": name,
                            "figure": figure,
                            **{key: effect[key] for key in ("seeds", "difference", "low", "high")},
                        }
                    )
    return rows


def _matched(
    measured: Sequence[Measured],
    axes: Sequence[Axis],
    changes: Sequence[Mapping[str, Level]],
    name: str,
    figure: str,
) -> list[NDArray[np.float64]]:
    """Return a figure of a class for cells that differ in some axes only.

    Args:
        measured: figures of all recordings.
        axes: these axes; a row's cell has them at their base.
        changes: levels of these axes, one column each.
        name: name of the class.
        figure: name of the figure.

    Returns:
        For each seed with any, rows (N, columns) with all cells measured.
    """
    found = []
    for seed in dict.fromkeys(one.seed for one in measured):
        its = {
            _key(one.cell): one.figures[name][figure]
            for one in measured
            if one.seed == seed and figure in one.figures.get(name, {})
        }
        rows = [
            [its.get(_key(one.cell.at(**change))) for change in changes]
            for one in measured
            if one.seed == seed and all(one.cell.levels[axis.name] == axis.base for axis in axes)
        ]
        whole = [row for row in rows if None not in row]
        if whole:
            found.append(np.array(whole, np.float64))
    return found


def _figures(measured: Sequence[Measured]) -> list[tuple[str, str]]:
    """Return all classes and figures, in order of first appearance."""
    rows = ((name, row) for one in measured for name, row in one.figures.items())
    return list(dict.fromkeys((name, figure) for name, row in rows for figure in row))


def _key(cell: Cell) -> tuple[tuple[str, Level], ...]:
    return tuple(cell.levels.items())
