"""Axes of a grid, each with its levels, and the cells that a design makes of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from urbantwin.errors import InputError

__all__ = ["MAX_CELLS", "Axis", "Cell", "Level", "factorial", "level_text", "one_at_a_time"]

#: Value of an axis: a number or a name.
Level = int | float | str

#: Maximum number of cells of a grid.
MAX_CELLS = 100_000


@dataclass(frozen=True)
class Axis:
    """A factor that is varied.

    Attributes:
        name: name as in the file.
        levels: at least one, each once; the first is the base that the others are compared with.
    """

    name: str
    levels: tuple[Level, ...]

    @property
    def base(self) -> Level:
        """The level that the others are compared with."""
        return self.levels[0]

    def repeated(self) -> Level | None:
        """Return a level that is given twice, or ``None``; 1 and 1.0 are the same."""
        for number, level in enumerate(self.levels):
            if level in self.levels[:number]:
                return level
        return None


@dataclass(frozen=True)
class Cell:
    """One level of each axis.

    Attributes:
        levels: levels by the name of the axis, in the order of the axes.
    """

    levels: Mapping[str, Level]

    def name(self, axes: Sequence[Axis]) -> str:
        """Return the differences from the base: ``fog_visibility_m=200``; ``base`` without any."""
        names = [f"{name}={level_text(self.levels[name])}" for name in self.varied(axes)]
        return ", ".join(names) or "base"

    def varied(self, axes: Sequence[Axis]) -> tuple[str, ...]:
        """Return the axes that are not at their base."""
        return tuple(axis.name for axis in axes if self.levels[axis.name] != axis.base)

    def at(self, **levels: Level) -> Cell:
        """Return the cell with some axes at other levels."""
        return Cell({**self.levels, **levels})


def level_text(level: Level) -> str:
    """Return a level as text: ``0.05``, ``none``."""
    return level if isinstance(level, str) else f"{level:.10g}"


def one_at_a_time(axes: Sequence[Axis]) -> tuple[Cell, ...]:
    """Return the base, and a cell for every other level of each axis, the others at their base."""
    base = Cell({axis.name: axis.base for axis in axes})
    return (base, *(base.at(**{axis.name: level}) for axis in axes for level in axis.levels[1:]))


def factorial(axes: Sequence[Axis]) -> tuple[Cell, ...]:
    """Return a cell for each combination of levels, base first; the last axis varies fastest.

    Raises:
        InputError: there are more than `MAX_CELLS`.
    """
    count = math.prod(len(axis.levels) for axis in axes)
    if count > MAX_CELLS:
        raise InputError(
            f"{count} combinations of levels", expected=f"at most {MAX_CELLS}, or fewer levels"
        )
    names = [axis.name for axis in axes]
    combinations = itertools.product(*(axis.levels for axis in axes))
    return tuple(Cell(dict(zip(names, levels, strict=True))) for levels in combinations)
