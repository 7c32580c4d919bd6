"""Effects of factors: paired over seeds, with intervals and sizes.

Every seed's motion is replayed under all cells, so that two cells of one seed differ in their
factors alone. What a level does is the mean over seeds of its difference to the base level; the
interval is Student's of paired differences (Student 1908, Biometrika 6(1)). The size of an effect
is told as Cohen's d, the difference over the standard deviation of both levels (Cohen 1988,
Statistical Power Analysis, section 2.2, with their mean variance), as d_z, over that of the
differences (section 2.3), and as Cliff's delta, how much oftener one is greater than the other
(Cliff 1993, Psychological Bulletin 114(3)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from urbantwin.grid import Axis, Cell, Level
from urbantwin.grid.axes import told_level

__all__ = ["Measured", "cliffs_delta", "interactions_of", "main_effects_of", "paired_effect"]

_SURE = 0.95


@dataclass(frozen=True)
class Measured:
    """The figures of one recording of a study.

    Attributes:
        seed: of the motion.
        cell: its levels.
        figures: by class, then by name of the figure.
    """

    seed: int
    cell: Cell
    figures: Mapping[str, Mapping[str, float]]


def cliffs_delta(base: NDArray[np.float64], level: NDArray[np.float64]) -> float:
    """Return how much oftener ``level`` is greater than ``base`` than less, -1..1."""
    apart = np.sign(level[:, None] - base[None, :])
    return float(apart.mean())


def paired_effect(base: NDArray[np.float64], level: NDArray[np.float64]) -> dict[str, Any]:
    """Return what a level does, of its figures (N,) and the base's of the same seeds.

    ``difference`` with ``low`` and ``high`` (95 %; ``None`` with one seed), ``cohens_d``, ``d_z``
    (``None`` where nothing varies), ``cliffs_delta`` and ``seeds``.
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
    """Return a row for every other level of each factor, class and figure: see `paired_effect`.

    Of a factorial design each seed's difference is the mean over the levels of all other factors.

    Args:
        measured: what was measured.
        axes: the factors.
    """
    rows = []
    for axis in axes:
        for level in axis.levels[1:]:
            for name, figure in _figures(measured):
                pairs = _pairs(measured, axis, level, name, figure)
                if pairs:
                    base, other = (np.array(side) for side in zip(*pairs, strict=True))
                    rows.append(
                        {
                            "factor": axis.name,
                            "level": told_level(level),
                            "base_level": told_level(axis.base),
                            "class": name,
                            "figure": figure,
                            **paired_effect(base, other),
                        }
                    )
    return rows


def _pairs(
    measured: Sequence[Measured], axis: Axis, level: Level, name: str, figure: str
) -> list[tuple[float, float]]:
    """Return of each seed the mean figure at the base and at a level, of the same other levels."""
    found = []
    for seed in dict.fromkeys(one.seed for one in measured):
        mine = {
            _key(one.cell): one.figures[name][figure]
            for one in measured
            if one.seed == seed and figure in one.figures.get(name, {})
        }
        pairs = [
            (value, mine[there])
            for one in measured
            if one.seed == seed and one.cell.levels[axis.name] == axis.base
            for value in [mine.get(_key(one.cell))]
            for there in [_key(one.cell.at(**{axis.name: level}))]
            if value is not None and there in mine
        ]
        if pairs:
            base, other = np.mean(np.array(pairs), axis=0)
            found.append((float(base), float(other)))
    return found


def interactions_of(measured: Sequence[Measured], axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """Return a row for every two levels of two factors that were measured together.

    ``difference`` is what both do together beyond the sum of what each does alone, of each seed the
    mean over all other factors; with its interval over seeds.

    Args:
        measured: of a factorial design; another has none.
        axes: the factors.
    """
    rows = []
    for one, other in combinations(axes, 2):
        for first in one.levels[1:]:
            for second in other.levels[1:]:
                for name, figure in _figures(measured):
                    found = _together(measured, (one, first), (other, second), name, figure)
                    if len(found):
                        told = paired_effect(np.zeros(len(found)), found)
                        rows.append(
                            {
                                "factor": one.name,
                                "level": told_level(first),
                                "other_factor": other.name,
                                "other_level": told_level(second),
                                "class": name,
                                "figure": figure,
                                **{
                                    key: told[key] for key in ("seeds", "difference", "low", "high")
                                },
                            }
                        )
    return rows


def _together(
    measured: Sequence[Measured],
    one: tuple[Axis, Level],
    other: tuple[Axis, Level],
    name: str,
    figure: str,
) -> NDArray[np.float64]:
    """Return of each seed what two levels do beyond the sum of both."""
    found = []
    for seed in dict.fromkeys(row.seed for row in measured):
        mine = {
            _key(row.cell): row.figures[name][figure]
            for row in measured
            if row.seed == seed and figure in row.figures.get(name, {})
        }
        apart = []
        for row in measured:
            levels = row.cell.levels
            here = levels[one[0].name] == one[0].base and levels[other[0].name] == other[0].base
            if row.seed != seed or not here:
                continue
            cells = [
                row.cell,
                row.cell.at(**{one[0].name: one[1]}),
                row.cell.at(**{other[0].name: other[1]}),
                row.cell.at(**{one[0].name: one[1], other[0].name: other[1]}),
            ]
            values = [mine.get(_key(cell)) for cell in cells]
            known = [value for value in values if value is not None]
            if len(known) == len(cells):
                apart.append(known[3] - known[1] - known[2] + known[0])
        if apart:
            found.append(float(np.mean(apart)))
    return np.array(found)


def _figures(measured: Sequence[Measured]) -> list[tuple[str, str]]:
    """Return every class and figure that there is, in the order of their first appearance."""
    found: dict[tuple[str, str], None] = {}
    for one in measured:
        for name, row in one.figures.items():
            found |= dict.fromkeys((name, figure) for figure in row)
    return list(found)


def _key(cell: Cell) -> tuple[tuple[str, Level], ...]:
    return tuple(cell.levels.items())
